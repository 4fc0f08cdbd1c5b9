"""Distribution of measured durations, in constant memory."""

from __future__ import annotations

import math
from typing import Final

_SHORTEST_S: Final = 1e-6
_RATIO: Final = 1.02
"""Ratio of the limits of a class: a percentile is at most 2 % too long."""
_LOG_RATIO: Final = math.log(_RATIO)


class Durations:
    """Durations, counted in logarithmic classes.

    >>> delays = Durations()
    >>> for delay_ms in (1, 1, 1, 5):
    ...     delays.add(delay_ms / 1e3)
    >>> delays.count, delays.longest_s, delays.mean_s
    (4, 0.005, 0.002)
    >>> round(1e3 * delays.percentile_s(50), 1)
    1.0

    Attributes:
        count: Number of durations.
        longest_s: Longest duration, s; 0 before the first.
        mean_s: Mean, s; 0 before the first.
    """

    def __init__(self) -> None:
        self.count = 0
        self.longest_s = 0.0
        self.mean_s = 0.0
        self._squares = 0.0  # sum of the squared deviations from the mean
        self._classes: dict[int, int] = {}

    def add(self, duration_s: float) -> None:
        """Add a duration, s; a negative one counts as 0."""
        duration_s = max(0.0, duration_s)
        self.count += 1
        self.longest_s = max(self.longest_s, duration_s)
        deviation_s = duration_s - self.mean_s
        self.mean_s += deviation_s / self.count
        self._squares += deviation_s * (duration_s - self.mean_s)
        number = 0 if duration_s <= _SHORTEST_S else math.ceil(math.log(duration_s / _SHORTEST_S) / _LOG_RATIO)
        self._classes[number] = self._classes.get(number, 0) + 1

    @property
    def deviation_s(self) -> float:
        """Standard deviation, s."""
        return math.sqrt(self._squares / self.count) if self.count else 0.0

    def percentile_s(self, percent: float) -> float | None:
        """Return the upper limit of the class that contains a percentile, s; None without a duration."""
        if not self.count:
            return None
        passed = 0
        for number in sorted(self._classes):
            passed += self._classes[number]
            if 100 * passed >= percent * self.count:
                break
        return min(_SHORTEST_S * _RATIO**number, self.longest_s)
