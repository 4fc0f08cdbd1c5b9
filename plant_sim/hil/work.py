"""Cups and seedlings of a machine that works undisturbed, compared with those of the machine's own program."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from plant_sim.crop.seedling import CELLS_ALONG, TRAY_CELLS
from plant_sim.hil.machine_view import SIDES, MachineView
from plant_sim.hil.reference import TRIAL_SEEDLINGS, TrialQuantities, most

HALF_A_ROW: Final = CELLS_ALONG // 2
"""Cups that may always pass without a row (assumed): one late row is no missed row."""


class _Begin(NamedTuple):
    """Quantities at the beginning of a span."""

    in_tray: int
    lost: int
    thrown: dict[str, int]


class WorkMeter:
    """Quantities of spans of undisturbed work.

    A span begins once a started machine works, and ends before anything is pressed, broken or delayed. The cups of an
    arm count from its first row in the span, because the cups before it passed while the machine was started.
    """

    def __init__(self, view: MachineView, *, pitch_m: float) -> None:
        """Create a meter outside a span; the cups are `pitch_m` apart."""
        self._pitch_m = pitch_m
        self._view = view
        self._begin: _Begin | None = None
        self._from_cups: dict[str, float] = {}
        """Cups that had passed each arm at its first row in the span."""

    def begin(self) -> None:
        """Begin a span."""
        counts = self._view.module.plant.counts()
        lost = counts.P + counts.D + counts.T
        self._begin = _Begin(counts.in_tray, lost, dict(self._view.thrown))
        self._from_cups.clear()

    def update(self) -> None:
        """Note the first row of each arm."""
        if self._begin is not None and len(self._from_cups) < len(SIDES):
            for side in SIDES:
                if side not in self._from_cups and self._view.thrown[side] > self._begin.thrown.get(side, 0):
                    self._from_cups[side] = self._cups(side)

    def end(self, reference: TrialQuantities | None) -> Iterator[tuple[str, str]]:
        """End the span, and return the violated rules by name, with the quantity and its limit."""
        begin, self._begin = self._begin, None
        if begin is None or reference is None:
            return
        counts = self._view.module.plant.counts()
        picked = begin.in_tray - counts.in_tray
        lost = counts.P + counts.D + counts.T - begin.lost
        limit = most(round(reference.lost * max(picked, TRAY_CELLS) / TRIAL_SEEDLINGS))
        if lost > limit:
            yield "losses", f"{lost} seedlings lost while the machine worked undisturbed; limit {limit}"
        passed = {side: self._cups(side) - cups for side, cups in self._from_cups.items()}
        rows = {side: self._view.thrown[side] - begin.thrown.get(side, 0) for side in passed}  # one more is due
        missed = sum(max(0, int(cups) - CELLS_ALONG * rows[side]) for side, cups in passed.items())
        gaps = max(0, reference.missed_cups - reference.lost) * max(sum(passed.values()), TRAY_CELLS)
        limit = max(HALF_A_ROW, most(round(gaps / TRIAL_SEEDLINGS)))
        if missed > limit:
            yield "missed cups", f"{missed} cups without a row while the machine worked undisturbed; limit {limit}"

    def _cups(self, side: str) -> float:
        return self._view.module.plant.arms[side].cups.chain_m / self._pitch_m
