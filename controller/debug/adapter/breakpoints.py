"""Breakpoints of a client, and the search for the next or last one in a recorded run.

A search yields None now and then, so that a request of the client, such as *pause*, can be answered meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from controller.debug.commands import Debugger
from controller.debug.condition import Condition
from controller.debug.machine import RunPosition
from controller.debug.search import Find

_SPAN: Final = 1_000
"""Scans that are searched without a pause: about 12 ms."""


@dataclass(frozen=True, slots=True)
class InstructionBreakpoint:
    """Breakpoint before an instruction, in each scan that executes it.

    Attributes:
        number: Identifier.
        instruction: Index of the instruction.
        condition: Condition with which the scan must begin; None = none.
    """

    number: int
    instruction: int
    condition: Condition | None


@dataclass(frozen=True, slots=True)
class ChangeBreakpoint:
    """Breakpoint after a scan in which something happens.

    Attributes:
        number: Identifier.
        find: Search for the scans.
        condition: Condition that must be met after the scan, too; None = none.
        reason: Reason of the stop in the words of the protocol.
    """

    number: int
    find: Find
    condition: Condition | None
    reason: str


Breakpoint = InstructionBreakpoint | ChangeBreakpoint


class SearchEnd(NamedTuple):
    """Position at which a search has ended.

    Attributes:
        position: The position.
        hit: Breakpoints that were hit; empty = the end of the run.
    """

    position: RunPosition
    hit: tuple[Breakpoint, ...]


class BreakpointSearch:
    """Search for the breakpoints of one client."""

    def __init__(self, debugger: Debugger, breakpoints: Iterable[Breakpoint]) -> None:
        """Take the breakpoints for the run that a debugger shows."""
        self._debugger, self._line = debugger, debugger.line
        breakpoints = tuple(breakpoints)
        self._lines = [each for each in breakpoints if isinstance(each, InstructionBreakpoint)]
        self._changes = [each for each in breakpoints if isinstance(each, ChangeBreakpoint)]

    def forward(self, position: RunPosition) -> Iterator[SearchEnd | None]:
        """Yield None at intervals, and at last the next stop or the end of the run."""
        scan, after = position
        while scan < self._line.last:
            to = min(scan + _SPAN, self._line.last)
            changed = self._first_changes(scan, to)
            to = min((found for found, _ in changed), default=to)
            for each in range(scan + 1, to + 1 if self._lines else 0):
                yield None
                stop = self._in_scan(each, after if each == position.scan + 1 else None, last=False)
                if stop is not None:
                    yield stop
                    return
            if changed:
                yield SearchEnd(RunPosition(to), tuple(hit for found, hit in changed if found == to))
                return
            scan = to
            yield None
        yield SearchEnd(RunPosition(self._line.last), ())

    def back(self, position: RunPosition) -> Iterator[SearchEnd | None]:
        """Yield None at intervals, and at last the latest stop before or the beginning of the run."""
        scan, before = position
        if before is not None:
            stop = self._in_scan(scan + 1, before, last=True)
            if stop is not None:
                yield stop
                return
        to = scan if before is not None else scan - 1
        highest = scan  # last scan that can contain a line before the position
        while highest > self._line.first:
            since = max(self._line.first, to - _SPAN)
            changed = self._last_changes(since, to) if to > since else []
            found = max((found for found, _ in changed), default=since)
            for each in range(highest if self._lines else 0, found, -1):
                yield None
                stop = self._in_scan(each, None, last=True)
                if stop is not None:
                    yield stop
                    return
            if changed:
                yield SearchEnd(RunPosition(found), tuple(hit for scan, hit in changed if scan == found))
                return
            highest = to = since
            yield None
        yield SearchEnd(RunPosition(self._line.first), ())

    def _first_changes(self, since: int, to: int) -> list[tuple[int, Breakpoint]]:
        hits = ((self._met(each, each.find(since, to)), each) for each in self._changes)
        return [(found[0], each) for found, each in hits if found]

    def _last_changes(self, since: int, to: int) -> list[tuple[int, Breakpoint]]:
        hits = ((self._met(each, each.find(since, to)), each) for each in self._changes)
        return [(found[-1], each) for found, each in hits if found]

    def _met(self, breakpoint_: ChangeBreakpoint, scans: Iterable[int]) -> list[int]:
        condition = breakpoint_.condition
        return [scan for scan in scans if condition is None or self._holds(condition, scan)]

    def _in_scan(self, scan: int, beyond: int | None, *, last: bool) -> SearchEnd | None:
        """Return the first or last line of a scan that is hit.

        Args:
            scan: The scan.
            beyond: Only instructions after this one, or before it if the last one is wanted; None = all.
            last: Whether the last line is wanted.
        """
        due = [each for each in self._lines if each.condition is None or self._holds(each.condition, scan - 1)]
        wanted = {each.instruction for each in due}
        if beyond is not None:
            wanted = {at for at in wanted if (at < beyond if last else at > beyond)}
        if not wanted:
            return None
        at = self._debugger.stepper.observer.executes(self._line, scan, sorted(wanted, reverse=last))
        if at is None:
            return None
        return SearchEnd(RunPosition(scan - 1, at), tuple(each for each in due if at == each.instruction))

    def _holds(self, condition: Condition, scan: int) -> bool:
        self._line.seek(scan)
        return condition.holds()
