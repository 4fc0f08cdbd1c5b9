"""Copies of the PLC memory at END of each scan, for readers in other threads."""

from __future__ import annotations

from dataclasses import dataclass

from controller.core.devices import Memory
from controller.core.scan import Plc


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Immutable copy of the PLC memory at the end of one scan.

    Attributes:
        at_ms: Time of the scan, ms.
        scans: Number of completed scans.
        bits: X, Y, M, S, T and C levels by number; X and Y by the value of the octal label.
        words: D, TN and CN values by number, signed.
    """

    at_ms: int
    scans: int
    bits: dict[str, list[bool]]
    words: dict[str, list[int]]


def snapshot_of(memory: Memory, at_ms: int, scans: int) -> Snapshot:
    """Return a copy of the memory of a PLC.

    Args:
        memory: All devices.
        at_ms: Time of the last scan, ms.
        scans: Number of completed scans.
    """
    bits = {
        "X": memory.X.copy(),
        "Y": memory.Y.copy(),
        "M": memory.M.copy(),
        "S": memory.S.copy(),
        "T": memory.T.copy(),
        "C": memory.C.copy(),
    }
    return Snapshot(at_ms, scans, bits, {"D": memory.D.copy(), "TN": memory.TV.copy(), "CN": memory.CV.copy()})


class Snapshots:
    """Observer of the runtime that takes a snapshot after each scan.

    Attributes:
        latest: Snapshot of the last scan; None before the first scan.
    """

    def __init__(self) -> None:
        self.latest: Snapshot | None = None

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Copy the memory; readers see the new copy atomically."""
        self.latest = snapshot_of(plc.memory, now_ms, plc.scans)
