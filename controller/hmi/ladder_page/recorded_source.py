"""Scans of a recorded run, at the position to which the commands of the debugger move."""

from __future__ import annotations

import asyncio
from typing import Any

from controller.common.supervision.threads import in_thread
from controller.debug.commands import Debugger
from controller.debug.comparison import first_difference
from controller.debug.machine import copied
from controller.debug.timeline import RunTimeline
from controller.debug.why.answer import WhySentence
from controller.debug.why.proof import answer
from controller.fx.language.operand_rules import Key
from controller.fx.observation.end_values import EndValues
from controller.fx.observation.observation import ObservedAt
from controller.hmi.ladder_page.live_scan import LiveScan
from controller.hmi.ladder_page.program import PageProgram
from controller.hmi.ladder_page.source import NotReadyError, RunAccess, RunPicture, ScanNotKeptError
from controller.hmi.modbus.held_scan import HeldScan


class RecordedSource:
    """Scans of a recorded run; for use in one event loop.

    Attributes:
        program: The program.
        is_live: False.
        debugger: Debugger of the run.
        picture: Picture of its machine; None = it has none.
    """

    is_live = False

    def __init__(self, program: PageProgram, debugger: Debugger, picture: RunPicture | None = None) -> None:
        """Initialise a source that is not ready.

        Args:
            program: The program that was recorded.
            debugger: Debugger of the run.
            picture: Picture of its machine; None = it has none.
        """
        self.program = program
        self.picture = picture
        self.debugger = debugger
        self._end: EndValues | None = None
        self._lock = asyncio.Lock()
        self._latest: tuple[RunTimeline, LiveScan] | None = None
        self._difference: tuple[RunTimeline, int | None] | None = None

    async def run(self) -> None:
        """Translate the program."""
        end = await in_thread("ladder page", EndValues, self.program.ladder)
        async with self._lock:
            await in_thread("ladder page", lambda: self.debugger.recorded.machine.observer)
        self._end = end

    def recorded(self) -> RunAccess:
        """Return this run."""
        return self

    async def look(self, view: ObservedAt, scan: int | None = None) -> LiveScan:  # noqa: ARG002 - both views are known
        """Return a scan of the run that is shown; None = the present position."""
        async with self._lock:
            return await in_thread("ladder page", self._look, scan)

    async def keep(self) -> LiveScan:
        """Return the scan at the present position."""
        return await self.look(ObservedAt.END_VALUES)

    async def execute(self, command: str) -> list[str]:
        """Execute a command and return the lines of its answer."""
        async with self._lock:
            return await in_thread("ladder page", lambda: list(self.debugger.execute(command)))

    async def explain(self, device: Key, scan: int | None = None) -> list[WhySentence]:
        """Return why a device is on or off after a scan; None = at the position."""
        if self._end is None:
            raise NotReadyError
        async with self._lock:
            return await in_thread("ladder page", self._explain, device, scan)

    async def state(self) -> dict[str, Any]:
        """Return the position, the length of the run and of its branch, and the marks of the slider.

        Within a scan, the position is after the scan before it, and before a rung of the next one.
        """
        async with self._lock:
            return await in_thread("ladder page", self._state)

    async def machine(self, scan: int) -> dict[str, Any] | None:
        """Return the machine after a scan of the run that is shown; None = it has no picture."""
        async with self._lock:
            return await in_thread("ladder page", self._machine, scan)

    def _machine(self, scan: int) -> dict[str, Any] | None:
        if self.picture is None:
            return None
        line = self.debugger.line
        _check_kept(line, scan)
        line.seek(scan)
        return self.picture.view()

    def _look(self, scan: int | None) -> LiveScan:
        if self._end is None:
            raise NotReadyError
        line, number = self.debugger.line, self.debugger.scan if scan is None else scan
        if self._latest is not None and self._latest[0] is line and self._latest[1].held.number == number:
            return self._latest[1]
        _check_kept(line, number)
        line.seek(number - 1)
        at_ms, executed = line.machine.now_ms, line.machine.observer.observe(line, number)
        line.seek(number)
        held = HeldScan(number, at_ms, copied(line.machine.memory))
        seen = LiveScan(held, self._end.observe(held.memory), executed.seen, differing=executed.differing)
        self._latest = line, seen
        return seen

    def _explain(self, device: Key, scan: int | None) -> list[WhySentence]:
        debugger = self.debugger
        line, number = debugger.line, debugger.scan if scan is None else scan
        return list(answer(line, line.machine.explained, device, number).lines())

    def _state(self) -> dict[str, Any]:
        debugger, branched = self.debugger, self.debugger.branched
        scan, at = debugger.position
        return {
            "scan": scan,
            "rung": None if at is None else debugger.stepper.reference.rung_at(at),
            "track": "recorded" if debugger.line is debugger.recorded else "branch",
            "first": debugger.recorded.first + 1,
            "last": debugger.recorded.last,
            "branch": None if branched is None else [branched.first + 1, branched.last],
            "differs": None if branched is None else self._first_difference(branched),
            "marks": _marks(debugger.line),
        }

    def _first_difference(self, branched: RunTimeline) -> int | None:
        """Return the first scan in which the branch differs; None = it never does."""
        if self._difference is None or self._difference[0] is not branched:
            found = first_difference(self.debugger.recorded, branched)
            self._difference = branched, None if found is None else found.scan
        return self._difference[1]


def _check_kept(line: RunTimeline, scan: int) -> None:
    if not line.first < scan <= line.last:
        raise ScanNotKeptError(f"scan {scan} is not recorded; choose one from {line.first + 1} to {line.last}")


def _marks(line: RunTimeline) -> list[dict[str, Any]]:
    """Return what entered the run, and the events of the program, by scan."""
    marks = [{"scan": scan, "kind": "entry", "text": {"en": text, "zh": text}} for scan, text in line.told_entries()]
    line.seek(line.first)
    begun_ms = line.machine.now_ms
    line.seek(line.last)
    length_ms = max(1, line.machine.now_ms - begun_ms)
    for event in line.machine.events():
        scan = line.first + 1 + (event.at_ms - begun_ms) * (line.last - line.first) // length_ms
        if line.first < scan <= line.last:
            marks.append({"scan": scan, "kind": event.kind, "text": event.text._asdict()})
    return sorted(marks, key=lambda mark: mark["scan"])
