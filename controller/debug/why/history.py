"""Values, changes and observed scans to which the questions of one inquiry refer."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import ClassVar, Final

from controller.core.devices import Memory, device_name
from controller.debug.machine import DebugSignal
from controller.debug.search import device_changes, following, last
from controller.debug.timeline import RunTimeline
from controller.debug.why.answer import WhyCause
from controller.debug.why.program import ExplainedProgram
from controller.fx.language.operand_rules import Key
from controller.fx.observation.observation import ScanObservation
from controller.fx.observation.why import ChangeSet, RequiredChange
from controller.program.texts.operator import Text

_KEPT_SCANS: Final = 40
"""Number of observed scans that are kept."""
_INPUT_SCANS: Final = 3
"""Scans in which a change at a terminal reaches its input, with the input filter of 10 ms and a bounce."""


class ScanHistory(ABC):
    """Values, changes and observed scans.

    Attributes:
        first: Number of the first scan, of which only the values at its end are known.
        unchanged: Ending of the names of sentences about a device that has not changed since the first scan.
        is_recorded: Whether the first scan is the beginning of a record; without, earlier scans have decided much.
    """

    first: int
    unchanged: ClassVar[str]
    is_recorded: ClassVar[bool]

    @abstractmethod
    def memory(self, scan: int) -> Memory:
        """Return the devices after a scan; they may change at the next call."""

    @abstractmethod
    def value(self, key: Key, scan: int) -> int:
        """Return the value of a device after a scan."""

    @abstractmethod
    def changed(self, keys: Iterable[Key], scan: int) -> int | None:
        """Return the last scan up to this one in which one of some devices has changed; None = none is known."""

    @abstractmethod
    def observed(self, scan: int) -> ScanObservation:
        """Return a scan as executed."""

    @abstractmethod
    def time_ms(self, scan: int) -> int:
        """Return the time of a scan, ms."""

    def input_causes(self, _program: ExplainedProgram, _key: Key, _scan: int, _changed: int | None) -> list[WhyCause]:
        """Return the physical causes of the level of an input; empty without a plant."""
        return []

    def suspects(self, _program: ExplainedProgram, _scan: int) -> list[WhyCause]:
        """Return the faults that are active after a scan; empty without a plant."""
        return []

    def flip(self, _key: Key, _changed: int) -> str:
        """Return the change with which an input keeps its level from before a change; empty = none can be tried."""
        return ""

    def where(self, scan: int) -> dict[str, Text | str | int]:
        """Return number and time of a scan for a sentence."""
        return {"scan": scan, "time": f"{self.time_ms(scan) / 1000:.2f} s"}

    def choose(
        self, sets: Sequence[ChangeSet], scan: int, read_by: Callable[[RequiredChange], list[Key]], *, recent: bool
    ) -> ChangeSet:
        """Return the smallest set, and of several of this size the one that changed last.

        Args:
            sets: Minimal sets in this scan.
            scan: The scan.
            read_by: Function that returns the devices of a contact or a comparison.
            recent: Whether a set that has changed completely in this scan is preferred to a small one.
        """
        if recent and len(sets) > 1 and scan > self.first + 1:
            now, before = self.observed(scan).contacts, self.observed(scan - 1).contacts
            for each in sets:
                if all(now[c.contacts[0]] != before[c.contacts[0]] for c in (*each.changes, *each.causes)):
                    return each
        smallest = min(map(size_of, sets))
        candidates = [each for each in sets if size_of(each) == smallest]
        if len(candidates) == 1:
            return candidates[0]
        keys = dict.fromkeys(key for each in candidates for c in (*each.changes, *each.causes) for key in read_by(c))
        newest = self.changed(keys, scan)
        if newest is None:
            return candidates[0]
        moved = {key for key in keys if self.value(key, newest) != self.value(key, newest - 1)}
        fresh = (each for each in candidates if any(moved & {*read_by(c)} for c in (*each.changes, *each.causes)))
        return next(fresh, candidates[0])


class RunHistory(ScanHistory):
    """Values, changes and observed scans of a recorded run.

    Attributes:
        line: The recorded run.
    """

    unchanged = "always"
    is_recorded = True

    def __init__(self, line: RunTimeline) -> None:
        """Take a recorded run."""
        self.line = line
        self.first = line.first
        self._seen: dict[int, ScanObservation] = {}
        self._changes: dict[tuple[tuple[Key, ...], int], int | None] = {}

    def memory(self, scan: int) -> Memory:
        """Return the devices after a scan."""
        self.line.seek(scan)
        return self.line.machine.memory

    def value(self, key: Key, scan: int) -> int:
        """Return the value of a device after a scan."""
        self.line.seek(scan)
        return int(self._signal(key).read())

    def changed(self, keys: Iterable[Key], scan: int) -> int | None:
        """Return the last scan up to this one in which one of some devices has changed; None = none is recorded."""
        asked = (*keys,), scan
        if asked not in self._changes:
            signals = [self._signal(key) for key in asked[0]]
            self._changes[asked] = last(self.line, device_changes(self.line, signals), scan + 1) if signals else None
        return self._changes[asked]

    def observed(self, scan: int) -> ScanObservation:
        """Return a scan as executed."""
        if scan not in self._seen:
            if len(self._seen) >= _KEPT_SCANS:
                self._seen.pop(next(iter(self._seen)))
            self._seen[scan] = self.line.machine.observer.observe(self.line, scan).seen
        return self._seen[scan]

    def time_ms(self, scan: int) -> int:
        """Return the time at which the scan after this one begins, ms."""
        self.line.seek(scan)
        return self.line.machine.now_ms

    def input_causes(self, program: ExplainedProgram, key: Key, scan: int, changed: int | None) -> list[WhyCause]:
        """Return the physical causes of the level of an input; empty without a plant."""
        self.line.seek(scan)
        return list(program.input_causes(key, self.line, scan, changed))

    def suspects(self, program: ExplainedProgram, scan: int) -> list[WhyCause]:
        """Return the faults that are active after a scan; empty without a plant."""
        self.line.seek(scan)
        return list(program.suspects(self.line))

    def flip(self, key: Key, changed: int) -> str:
        """Return the change with which an input keeps its level from before a change until it has it again."""
        before = "on" if self.value(key, changed - 1) else "off"
        again = following(self.line, device_changes(self.line, [self._signal(key)]), changed)
        start = max(self.first + 1, changed - _INPUT_SCANS)
        return f"{device_name(*key)}={before}@{start}..{'' if again is None else again}"

    def _signal(self, key: Key) -> DebugSignal:
        return self.line.machine.signal(device_name(*key))


def size_of(each: ChangeSet) -> int:
    """Return the number of contacts of a set."""
    return len(each.changes) + len(each.causes)
