"""Annunciators of an FX program: which are on, their names, and the rest of a machine with one."""

from __future__ import annotations

from functools import cached_property

from controller.core.devices import ANNUNCIATOR_ON, ANNUNCIATORS
from controller.export.instruction_list import acting
from controller.fx.engine.plc import FxPlc
from controller.fx.language.instruction import Ladder
from plant_sim.twin.commissioning import default_io_map, program_of
from plant_sim.twin.ending.reported import alarm_name
from plant_sim.twin.ending.rule import Rest


def annunciators_on(plc: FxPlc) -> list[int]:
    """Return the numbers of the annunciators that are on, if the program enables them."""
    memory = plc.memory
    return [number for number in ANNUNCIATORS if memory.S[number]] if memory.M[ANNUNCIATOR_ON] else []


class AnnunciatorNames:
    """Names of the annunciators of a program: number and comment, or the alarm table's in the machine's own program."""

    def __init__(self, ladder: Ladder) -> None:
        self._ladder = ladder

    def __call__(self, number: int) -> str:
        """Return the name of an annunciator in a report."""
        if self._is_own:
            return alarm_name(number, "")
        return f"S{number} {self._ladder.comments.get(f'S{number}', '')}".strip()

    @cached_property
    def _is_own(self) -> bool:
        """True for an export of the machine's program, which contains the title of each of its blocks."""
        program = acting(program_of(default_io_map()).program)
        return {block.title for block in program.blocks} <= set(self._ladder.titles.values())


class AnnunciatorRest:
    """Rest of a machine after its program has set an annunciator while it moved."""

    def __init__(self, names: AnnunciatorNames) -> None:
        self._names = names
        self._known: set[int] = set()
        self._since_ms: int | None = None
        self._has_moved = False

    def of(self, plc: FxPlc, now_ms: int, *, moves: bool) -> Rest | None:
        """Return the rest after a scan; None if something moves, or no annunciator has come on since the last press."""
        self._has_moved |= moves
        active = [] if moves or not self._has_moved else [n for n in annunciators_on(plc) if n not in self._known]
        if not active:
            self._since_ms = None
            return None
        if self._since_ms is None:
            self._since_ms = now_ms
        return Rest(self._since_ms, f"at rest: {'; '.join(map(self._names, active))}")

    def forget(self, plc: FxPlc) -> None:
        """Take the annunciators that are on as known, before the operator presses the start button."""
        self._known = set(annunciators_on(plc))
