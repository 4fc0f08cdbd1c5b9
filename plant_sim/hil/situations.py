"""Situations of the machine by the outputs of the controller: the steps of an unknown program.

A situation of an arm is the set of its actuators that are on, with or without seedlings in the claws; a situation of
the tray is the set of the tray outputs that are on. Situations without an actuator are waits.
"""

from __future__ import annotations

from statistics import median
from typing import Final, NamedTuple

from plant_sim.hil.machine_view import SIDES, MachineView

TRAY = "tray"
RECURRENCES: Final = 3
"""Number of appearances from which a situation counts as recurrent."""


class OutputSituation(NamedTuple):
    """One situation.

    Attributes:
        owner: ``left``, ``right`` or ``tray``.
        on: Actuators of the owner that are on, without the name of the arm.
        loaded: True if the claws of the arm hold seedlings.
    """

    owner: str
    on: frozenset[str]
    loaded: bool

    @property
    def title(self) -> str:
        """Name of the situation."""
        outputs = " + ".join(sorted(self.on)) or "waiting"
        return f"{self.owner}: {outputs}" + (", loaded" if self.loaded else "")


class SituationLog:
    """Duration of every situation so far.

    Attributes:
        now: Present situation of each owner.
        since_ms: Plant time at which it began, ms.
    """

    def __init__(self, view: MachineView) -> None:
        """Begin with the present situation."""
        self._view = view
        self._durations_ms: dict[OutputSituation, list[int]] = {}
        self.now = {owner: self._read(owner) for owner in (*SIDES, TRAY)}
        self.since_ms = dict.fromkeys(self.now, view.now_ms)

    def update(self) -> None:
        """Note changes of situation."""
        for owner, before in self.now.items():
            situation = self._read(owner)
            if situation != before:
                self._durations_ms.setdefault(before, []).append(self._view.now_ms - self.since_ms[owner])
                self.now[owner], self.since_ms[owner] = situation, self._view.now_ms

    def clear(self) -> None:
        """Forget the durations."""
        self._durations_ms.clear()

    def usual_ms(self) -> dict[OutputSituation, int]:
        """Return the median duration of every situation that recurs, ms, in order of first appearance.

        A situation that has appeared only once or twice belongs to the first cycle after power-up.
        """
        durations_ms = self._durations_ms.items()
        return {situation: round(median(all_ms)) for situation, all_ms in durations_ms if len(all_ms) >= RECURRENCES}

    def lasts(self, situation: OutputSituation, for_ms: int) -> bool:
        """Return True if a situation exists and has lasted for at least this time, ms."""
        owner = situation.owner
        return self.now[owner] == situation and self._view.now_ms - self.since_ms[owner] >= for_ms

    def _read(self, owner: str) -> OutputSituation:
        if owner == TRAY:
            on = frozenset(tag for tag in self._view.on if tag.startswith("tray_"))
            return OutputSituation(TRAY, on, loaded=False)
        on, loaded = self._view.situation(owner)
        return OutputSituation(owner, on, loaded)
