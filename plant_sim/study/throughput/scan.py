"""Scan of a condition over planting frequencies, without the assumption that it is monotone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from controller.program.set_points import FASTEST_PER_MIN, SLOWEST_PER_MIN

SERVED_PER_MIN: Final = range(SLOWEST_PER_MIN, FASTEST_PER_MIN + 1)
"""Planting frequencies that the program serves, 1/min."""


@dataclass(frozen=True)
class ConditionScan:
    """Condition at every scanned planting frequency.

    Whether a cup is missed depends on the start position of the cups and on which arm is first in the centre, so a
    condition may fail at a frequency and be met again at a higher one.

    Attributes:
        name: The condition.
        met: Whether the condition is met, by ascending frequency, 1/min.
    """

    name: str
    met: Mapping[int, bool]

    @property
    def first_failure(self) -> int | None:
        """Lowest frequency at which the condition fails, 1/min; None if it never fails."""
        return next((frequency for frequency, is_met in self.met.items() if not is_met), None)

    @property
    def limit(self) -> int | None:
        """Highest frequency up to which the condition is met without exception, 1/min; None if the lowest fails."""
        first = self.first_failure
        return max((each for each in self.met if first is None or each < first), default=None)

    @property
    def met_again(self) -> tuple[int, ...]:
        """Frequencies above the first failure at which the condition is met, 1/min; empty if it is monotone."""
        first = self.first_failure
        return () if first is None else tuple(each for each, is_met in self.met.items() if is_met and each > first)
