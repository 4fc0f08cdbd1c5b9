"""The PLC's memory as it stood at END of the last scan, for readers in other threads."""

from __future__ import annotations

from dataclasses import dataclass

from controller.core.scan import Plc


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One moment; nothing in it changes any more.

    Attributes:
        at_ms: Time of the scan, ms.
        scans: Scans done.
        bits: X Y M S T C by number; X and Y by octal value.
        words: D TN CN by number, signed.
    """

    at_ms: int
    scans: int
    bits: dict[str, list[bool]]
    words: dict[str, list[int]]


class Snapshots:
    """Takes a snapshot after each scan; an observer of the runtime.

    Attributes:
        latest: The snapshot of the last scan; None before the first.
    """

    def __init__(self) -> None:
        self.latest: Snapshot | None = None

    def __call__(self, now_ms: int, plc: Plc) -> None:
        """Copy the memory; the copy appears to readers all at once."""
        memory = plc.memory
        self.latest = Snapshot(
            now_ms,
            plc.scans,
            {
                "X": memory.X.copy(),
                "Y": memory.Y.copy(),
                "M": memory.M.copy(),
                "S": memory.S.copy(),
                "T": memory.T.copy(),
                "C": memory.C.copy(),
            },
            {"D": memory.D.copy(), "TN": memory.TV.copy(), "CN": memory.CV.copy()},
        )
