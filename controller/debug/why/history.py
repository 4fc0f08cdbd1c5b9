"""Values, changes and observed scans of a recorded run, kept for one inquiry."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from controller.core.devices import device_name
from controller.debug.machine import DebugSignal
from controller.debug.search import device_changes, last
from controller.debug.timeline import RunTimeline
from controller.fx.language.operand_rules import Key
from controller.fx.observation.observation import ScanObservation
from controller.fx.observation.why import ChangeSet, RequiredChange
from controller.program.texts.operator import Text

_KEPT_SCANS: Final = 40
"""Number of observed scans that are kept."""


class RunHistory:
    """Values, changes and observed scans of a recorded run.

    Attributes:
        line: The recorded run.
    """

    def __init__(self, line: RunTimeline) -> None:
        """Take a recorded run."""
        self.line = line
        self._seen: dict[int, ScanObservation] = {}
        self._changes: dict[tuple[tuple[Key, ...], int], int | None] = {}

    def signal(self, key: Key) -> DebugSignal:
        """Return a device."""
        return self.line.machine.signal(device_name(*key))

    def value(self, key: Key, scan: int) -> int:
        """Return the value of a device after a scan."""
        self.line.seek(scan)
        return int(self.signal(key).read())

    def changed(self, keys: Iterable[Key], scan: int) -> int | None:
        """Return the last scan up to this one in which one of some devices has changed; None = none is recorded."""
        asked = (*keys,), scan
        if asked not in self._changes:
            signals = [self.signal(key) for key in asked[0]]
            self._changes[asked] = last(self.line, device_changes(self.line, signals), scan + 1) if signals else None
        return self._changes[asked]

    def observed(self, scan: int) -> ScanObservation:
        """Return a scan as executed."""
        if scan not in self._seen:
            if len(self._seen) >= _KEPT_SCANS:
                self._seen.pop(next(iter(self._seen)))
            self._seen[scan] = self.line.machine.observer.observe(self.line, scan).seen
        return self._seen[scan]

    def where(self, scan: int) -> dict[str, Text | str | int]:
        """Return number and time of a scan for a sentence."""
        self.line.seek(scan)
        return {"scan": scan, "time": f"{self.line.machine.now_ms / 1000:.2f} s"}

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
        if recent and len(sets) > 1 and scan > self.line.first + 1:
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


def size_of(each: ChangeSet) -> int:
    """Return the number of contacts of a set."""
    return len(each.changes) + len(each.causes)
