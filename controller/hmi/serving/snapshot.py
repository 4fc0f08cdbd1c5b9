"""Copies of the PLC memory at END of each scan, for readers in other threads.

A partner that reads a whole memory needs several requests, between which scans take place. It can hold one copy, so
that all its requests refer to the same scan.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Final

from controller.core.devices import Memory
from controller.core.scan import Plc
from controller.hmi.serving.devices import AccessRefusal, AccessRefusedError

RELEASE, HOLD = 0, 1
"""Requests of a partner: read the last scan; hold it. `HOLD` + n reads the n-th scan before the held one."""
HELD_SCANS: Final = 3
"""Number of scans that are held together: two before a scan tell what its pulse contacts have seen."""
HELD_WORDS: Final = 5
"""Number of words that tell which scan is read."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Immutable copy of the PLC memory at the end of one scan.

    Attributes:
        at_ms: Time of the scan, ms.
        scans: Number of completed scans.
        bits: X, Y, M, S, T and C levels by number; X and Y by the value of the octal label.
        words: D, TN and CN values by number, signed; the D of an FX3U are followed by R.
    """

    at_ms: int
    scans: int
    bits: dict[str, list[bool]]
    words: dict[str, list[int]]


def snapshot_of(memory: Memory, at_ms: int, scans: int) -> Snapshot:
    """Return a copy of the memory of a PLC; the rows of a machine program remain as they are, and slices are lists.

    Args:
        memory: All devices.
        at_ms: Time of the last scan, ms.
        scans: Number of completed scans.
    """
    bits = {
        "X": copy(memory.X),
        "Y": copy(memory.Y),
        "M": copy(memory.M),
        "S": copy(memory.S),
        "T": copy(memory.T),
        "C": copy(memory.C),
    }
    return Snapshot(at_ms, scans, bits, {"D": copy(memory.D), "TN": copy(memory.TV), "CN": copy(memory.CV)})


class Snapshots:
    """Snapshots of the last scans.

    Attributes:
        last: Up to `HELD_SCANS` snapshots, the last scan first.
    """

    def __init__(self) -> None:
        self.last: tuple[Snapshot, ...] = ()

    @property
    def latest(self) -> Snapshot | None:
        """Snapshot of the last scan; None before the first one."""
        return self.last[0] if self.last else None

    def add(self, snapshot: Snapshot) -> None:
        """Add the snapshot of the last scan; readers see it atomically."""
        self.last = (snapshot, *self.last)[:HELD_SCANS]

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Copy the memory, as an observer of the runtime."""
        self.add(snapshot_of(plc.memory, now_ms, plc.scans))


class HeldSnapshot:
    """Snapshot that one partner reads: that of the last scan, or the one that it holds."""

    def __init__(self, snapshots: Snapshots) -> None:
        """Initialise a partner that reads the last scan.

        Args:
            snapshots: Snapshots of the PLC.
        """
        self._snapshots = snapshots
        self._request = RELEASE
        self._held: tuple[Snapshot, ...] = ()

    def latest(self) -> Snapshot:
        """Return the snapshot of the last scan, whichever is held.

        Raises:
            AccessRefusedError: No scan has been completed yet.
        """
        latest = self._snapshots.latest
        if latest is None:
            raise AccessRefusedError(AccessRefusal.NOT_READY)
        return latest

    def read(self) -> Snapshot:
        """Return the snapshot that the partner reads.

        Raises:
            AccessRefusedError: No scan has been completed yet.
        """
        return self.latest() if self._request == RELEASE else self._held[self._request - HOLD]

    def request(self, value: int) -> None:
        """Select what the partner reads from now on.

        Args:
            value: `RELEASE`; `HOLD`, which takes the last scan each time; or `HOLD` + n, less than `HELD_SCANS` more,
                while a scan is held.

        Raises:
            AccessRefusedError: There is no such request, no scan is held, or too few scans have been completed.
        """
        if not RELEASE <= value < HOLD + HELD_SCANS or (value > HOLD and self._request == RELEASE):
            raise AccessRefusedError(AccessRefusal.BAD_VALUE)
        held = {RELEASE: (), HOLD: self._snapshots.last}.get(value, self._held)
        if value != RELEASE and value - HOLD >= len(held):
            raise AccessRefusedError(AccessRefusal.NOT_READY)
        self._request, self._held = value, held

    def words(self) -> list[int]:
        """Return the request, then number and time of the scan that is read, 32 bits each, low word first."""
        snapshot = self.read()
        longs = (snapshot.scans, snapshot.at_ms)
        return [self._request, *(word for long in longs for word in (long & 0xFFFF, long >> 16 & 0xFFFF))]
