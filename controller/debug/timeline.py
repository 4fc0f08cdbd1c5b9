"""Recorded run that can be returned to: complete states at intervals, and what entered between them.

Every scan is recomputed from the last stored state before it. The machine is shared by the recorded run and its
branches; each of them restores its own state before it reads or runs.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, NamedTuple, TypeVar

from controller.common.errors import InputError
from controller.debug.condition import Condition
from controller.debug.keyframes import Packer, unpack
from controller.debug.machine import DebugSignal, OutsideEntry, RecordedMachine

LENGTH: Final = 20_000
"""Default length, scans; the complete trial of the paper has 11,350."""
INTERVAL: Final = 50
"""Scans between two stored states: half a second of machine time is recomputed in 1 to 2 ms."""


Start = TypeVar("Start")
"""Result of a function at the beginning of a scan."""


class _Keyframe(NamedTuple):
    """Stored state.

    Attributes:
        scan: Number of scans that had been executed.
        entered: Number of entries of the next scan that it contains.
        state: The state, packed.
    """

    scan: int
    entered: int
    state: Any


class RunTimeline:
    """Run of a machine.

    Attributes:
        machine: The machine.
        last: Number of the last scan.
        length: Number of scans that are kept; the oldest are dropped in whole intervals.
        interval: Scans between two stored states.
    """

    def __init__(self, machine: RecordedMachine, *, length: int = LENGTH, interval: int = INTERVAL) -> None:
        """Begin a run at the present state of the machine.

        Args:
            machine: The machine.
            length: Number of scans to keep.
            interval: Scans between two stored states.
        """
        self.machine = machine
        self.last = machine.scan
        self.length, self.interval = length, interval
        self._entries: dict[int, list[OutsideEntry]] = {}
        self._keyframes: list[_Keyframe] = []
        self._packer = Packer()
        self.keep()

    @property
    def first(self) -> int:
        """Number of the first scan that can be returned to."""
        return self._keyframes[0].scan

    @property
    def scan(self) -> int:
        """Number of the present scan."""
        return self.machine.scan if self.machine.owner is self else self.last

    def keep(self) -> None:
        """Store the present state of the machine, which has just executed the last scan."""
        machine = self.machine
        self.last, machine.owner = machine.scan, self
        entered = len(self._entries.get(machine.scan + 1, ()))
        self._keyframes.append(_Keyframe(machine.scan, entered, self._packer.pack(machine.save())))
        drop = 0
        while self._keyframes[drop + 1 :] and self._keyframes[drop + 1].scan <= self.last - self.length:
            drop += 1
        if drop:
            del self._keyframes[:drop]
            for scan in [scan for scan in self._entries if scan <= self.first]:
                del self._entries[scan]

    def note(self, entry: OutsideEntry, after: int | None = None) -> None:
        """Record what enters the machine after a scan; None = the present one."""
        self._entries.setdefault((self.machine.scan if after is None else after) + 1, []).append(entry)

    def entries(self) -> Iterator[tuple[int, OutsideEntry]]:
        """Yield the scan and the entry of all that entered, in order."""
        for scan, entries in sorted(self._entries.items()):
            for entry in entries:
                yield scan, entry

    def told_entries(self) -> Iterator[tuple[int, str]]:
        """Yield the scan and the text of each entry of the recorded scans that is worth telling."""
        for scan, entry in self.entries():
            text = str(entry)
            if text and scan <= self.last:
                yield scan, text

    def entry_scans(self) -> list[int]:
        """Return the scans in which something entered, in order."""
        return sorted(self._entries)

    def due(self, scan: int) -> int:
        """Return the number of the next scan after which a state is to be stored."""
        return scan - scan % self.interval + self.interval

    def seek(self, scan: int) -> None:
        """Put the machine in the state after a scan.

        Raises:
            InputError: The scan is not recorded.
        """
        if not self.first <= scan <= self.last:
            raise InputError(f"scan {scan}: not recorded; choose one from {self.first} to {self.last}")
        machine = self.machine
        at = bisect_left(self._keyframes, (scan, 1), key=lambda each: each[:2]) - 1
        keyframe = self._keyframes[at]
        entered = 0
        if machine.owner is not self or not keyframe.scan <= machine.scan <= scan:
            machine.owner = None  # in case it is interrupted
            machine.restore(unpack(keyframe.state))
            entered = keyframe.entered
        self._play(scan, entered, machine.run)
        machine.owner = self

    def execute(self, scan: int, begin: Callable[[], Start]) -> Start:
        """Call a function in the state in which a scan begins, with all its entries, and execute the scan.

        Args:
            scan: Number of the scan.
            begin: The function; it leaves the state unchanged.

        Returns:
            The result of the function.

        Raises:
            InputError: The scan is not recorded.
        """
        if not self.first < scan <= self.last:
            raise InputError(f"scan {scan}: not recorded; choose one from {self.first + 1} to {self.last}")
        self.seek(scan - 1)
        machine = self.machine
        machine.owner = None
        for entry in self._entries.get(machine.scan + 1, ()):
            entry.apply(machine)
        start = begin()
        machine.run(machine.scan + 1)
        machine.owner = self
        return start

    def run(self, to: int, until: Condition | None = None) -> bool:
        """Run on from the present scan, within the recorded run; return True at the first scan that meets a condition.

        Args:
            to: Number of the last scan.
            until: The condition; None = none.
        """
        self.seek(self.scan)
        self.machine.owner = None
        met = self._play(min(to, self.last), 0, lambda to: self.machine.run(to, until))
        self.machine.owner = self
        return met

    def changes(self, since: int, to: int, signals: Sequence[DebugSignal]) -> list[int]:
        """Return the scans after `since` up to `to` in which one of the devices has changed, in order."""
        self.seek(since)
        before = [signal.read() for signal in signals]
        found: list[int] = []

        def collect(to: int) -> bool:
            found.extend(self.machine.changes(to, signals, before))
            return False

        self.machine.owner = None
        self._play(to, 0, collect)
        self.machine.owner = self
        return found

    def walk(self, since: int, to: int) -> Iterator[int]:
        """Yield each scan after `since` up to `to`, with the machine in the state after it."""
        for scan in range(since + 1, to + 1):
            self.seek(scan)
            yield scan

    def extend(self, to: int) -> None:
        """Run on beyond the last scan, storing states, and with the entries of these scans.

        The run ends before a scan with an entry that cannot be repeated.
        """
        self.seek(self.last)
        machine = self.machine
        for scan, entry in self.entries():
            if scan > self.last and not entry.is_repeatable:
                to = min(to, scan - 1)
        while self.last < to:
            self._play(min(self.due(self.last), to), 0, machine.run)
            if machine.scan % self.interval == 0:
                self.keep()
            self.last, machine.owner = machine.scan, self

    def branch(self, scan: int, changes: Sequence[tuple[int, OutsideEntry]]) -> RunTimeline:
        """Return a new run that begins after a scan, with the same later entries and others in addition.

        Args:
            scan: Number of the scan.
            changes: Further entries and the scans in which they enter; they follow the recorded ones.
        """
        self.seek(scan)
        line = RunTimeline(self.machine, length=self.length, interval=self.interval)
        line._entries = {at: [*entries] for at, entries in self._entries.items() if at > scan}
        for at, entry in changes:
            line._entries.setdefault(at, []).append(entry)
        return line

    def _play(self, to: int, entered: int, run: Callable[[int], bool]) -> bool:
        """Execute scans with their entries; return True as soon as `run` does."""
        machine, entries = self.machine, self._entries
        while machine.scan < to:
            following = machine.scan + 1
            for entry in entries.get(following, ())[entered:]:
                entry.apply(machine)
            entered = 0
            stop = min((scan - 1 for scan in entries if following < scan <= to), default=to)
            if run(stop):
                return True
        return False
