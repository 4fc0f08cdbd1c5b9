"""Reference of a trial: the quantities of the machine's own program on the same machine, and the tolerances on them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from plant_sim.crop.seedling import TRAY_CELLS

TRIAL_TRAYS: Final = 2
"""Trays of a trial. Source: docs/sources/machine.md 5."""
TRIAL_SEEDLINGS: Final = TRIAL_TRAYS * TRAY_CELLS
SLOWER: Final = 1.25
"""Factor by which a trial may take longer than with the machine's own program."""
SWITCHED_FACTOR: Final = 2
SWITCHED_MORE: Final = 3
"""An actuator may be switched on twice as often as by the machine's own program, and three times more (assumed)."""


class TrialQuantities(NamedTuple):
    """Quantities of one trial.

    Attributes:
        lost: Lost seedlings.
        missed_cups: Cups that passed empty.
        duration_ms: Duration, ms.
        switched: Number of times each actuator was switched on, by tag.
    """

    lost: int
    missed_cups: int
    duration_ms: int
    switched: Mapping[str, int]


def most(reference: int) -> int:
    """Return the largest number that passes: three standard deviations of a Poisson count more than the reference."""
    return round(reference + 3 * math.sqrt(max(1, reference)))


def excesses(found: TrialQuantities, reference: TrialQuantities) -> Iterator[tuple[str, str]]:
    """Return the violated rules by name, with the quantity and its limit."""
    for name, what, count, usual in (
        ("losses", "seedlings lost", found.lost, reference.lost),
        ("missed cups", "cups missed", found.missed_cups, reference.missed_cups),
    ):
        if count > most(usual):
            yield name, f"{count} {what}; {usual} with the reference program, limit {most(usual)}"
    if found.duration_ms > (limit_ms := round(SLOWER * reference.duration_ms)):
        yield (
            "duration",
            f"{found.duration_ms / 1000:g} s; {reference.duration_ms / 1000:g} s with the reference program, "
            f"limit {limit_ms / 1000:g} s",
        )
    for tag, count in sorted(found.switched.items()):
        usual = reference.switched.get(tag, 0)
        if count > (limit := SWITCHED_FACTOR * usual + SWITCHED_MORE):
            yield "switching", f"{tag} switched on {count} times; {usual} with the reference program, limit {limit}"
            return
