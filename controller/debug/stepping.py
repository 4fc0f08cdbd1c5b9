"""Steps from one position of a run to another: by instruction, rung and scan, forwards and backwards.

The instructions that a scan executes are visited in the order of the list, each once. Within a scan the devices are
those with which it began; contacts, power and outputs are those of the observation.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from enum import StrEnum
from typing import Final

from controller.common.errors import InputError
from controller.debug.machine import RunPosition
from controller.debug.scan_observer import ScanObserver
from controller.debug.timeline import RunTimeline
from controller.fx.observation.observation import FlowState, is_output

RUNG: Final = re.compile(r"rung\s+(\d{1,9})")
"""Name of a rung in commands and breakpoints."""


class StepUnit(StrEnum):
    """Unit of a step."""

    INSTRUCTION = "instruction"
    RUNG = "rung"
    SCAN = "scan"


class Stepper:
    """Steps within the scans of a run and its branches."""

    def __init__(self, observer: ScanObserver) -> None:
        """Take the observer of the scans."""
        self.observer = observer
        self.reference = observer.reference

    def forward(self, line: RunTimeline, position: RunPosition, unit: StepUnit) -> RunPosition:
        """Return the next position; at the end of the run, the same one."""
        scan, at = position
        if scan >= line.last:
            return position
        if unit is not StepUnit.SCAN:
            following = [stop for stop in self._stops(line, scan + 1, unit) if at is None or stop > at]
            if following:
                return RunPosition(scan, following[0])
        return RunPosition(scan + 1)

    def back(self, line: RunTimeline, position: RunPosition, unit: StepUnit) -> RunPosition:
        """Return the position before; at the beginning of the run, the same one."""
        scan, at = position
        if unit is StepUnit.SCAN:
            return RunPosition(scan if at is not None else max(scan - 1, line.first))
        if at is None:
            if scan <= line.first:
                return position
            scan -= 1
        before = [stop for stop in self._stops(line, scan + 1, unit) if at is None or stop < at]
        return RunPosition(scan, before[-1]) if before else RunPosition(scan)

    def to_rung(self, line: RunTimeline, position: RunPosition, number: int) -> Iterator[RunPosition | None]:
        """Yield None for each scan without a rung, then the next position at which it is executed, if there is one.

        Raises:
            InputError: The program has no such rung.
        """
        first, end = self.instructions(number)
        for scan in range(position.scan, line.last):
            after = position.instruction if scan == position.scan else None
            rung = [at for at in range(first, end) if after is None or at > after]
            found = self.observer.executes(line, scan + 1, rung) if rung else None
            if found is not None:
                yield RunPosition(scan, found)
                return
            yield None

    def instructions(self, number: int) -> tuple[int, int]:
        """Return the first instruction of a rung, and the first one after it.

        Raises:
            InputError: The program has no such rung.
        """
        firsts = [rung.first for rung in self.reference.rungs]
        if not 0 <= number < len(firsts):
            raise InputError(f"rung {number}: no such rung; choose one from 0 to {len(firsts) - 1}")
        ends = [*firsts[1:], len(self.reference.ladder.instructions)]
        return firsts[number], ends[number]

    def place(self, at: int) -> str:
        """Return rung, step number and title of an instruction."""
        title = " ".join(self.reference.title_at(at).split())
        where = f"rung {self.reference.rung_at(at)}, step {self.reference.step_numbers[at]}"
        return f"{where}: {title}" if title else where

    def states(self, line: RunTimeline, position: RunPosition) -> Iterator[tuple[str, str]]:
        """Yield the instructions of the rung at a position, and the state of each in its scan."""
        if position.instruction is None:
            return
        scan = self.observer.observe(line, position.scan + 1)
        instructions = self.reference.ladder.instructions
        for at in range(*self.instructions(self.reference.rung_at(position.instruction))):
            state = scan.seen.state(at, instructions[at])
            words = {FlowState.ON: "driven", FlowState.OFF: "not driven"} if is_output(instructions[at]) else {}
            yield (
                f"{self.reference.step_numbers[at]} {instructions[at]}",
                words.get(state, state.value.replace("-", " ")),
            )

    def _stops(self, line: RunTimeline, scan: int, unit: StepUnit) -> Sequence[int]:
        stops = self.observer.observe(line, scan).stops
        if unit is StepUnit.INSTRUCTION:
            return stops
        firsts: dict[int, int] = {}
        for at in stops:
            firsts.setdefault(self.reference.rung_at(at), at)
        return list(firsts.values())


def last_of(positions: Iterable[RunPosition | None]) -> RunPosition | None:
    """Return the last position of a search; None = nothing was found."""
    found = None
    for found in positions:  # noqa: B007 - the search ends with what it has found
        pass
    return found
