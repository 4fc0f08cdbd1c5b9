"""Writes of communication partners on their way into a scan: taken whole by one scan, settled at its end.

A partner is answered when its write is settled, so that an answer means *done*, and an error *not done*: a write that
no scan takes within the limit is withdrawn before its partner is told.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from typing import Final

NO_SCAN_LIMIT_S: Final = 0.2
"""Time without a scan after which a waiting write is withdrawn, s: the longest time between two scans."""


class NoScanError(Exception):
    """Raised to the partner of a write that has been withdrawn, because no scan took it; nothing has changed."""


class ScanWrite:
    """Write of one partner; awaiting it ends at the end of the scan that took it.

    Attributes:
        limit_s: Time after which the partner withdraws the write, s.
    """

    limit_s = NO_SCAN_LIMIT_S

    def __init__(self, writes: ScanWrites, action: Callable[[], None]) -> None:
        """Initialise a write that waits.

        Args:
            writes: Writes of the same program.
            action: Function that changes the devices, or raises the reason for its refusal and changes nothing.
        """
        self._writes = writes
        self._action = action
        self._error: Exception | None = None
        self._is_settled = threading.Event()
        self._call: Callable[[], None] | None = None

    def __await__(self) -> Generator[ScanWrite, None, None]:
        """Wait until the write is settled.

        Raises:
            NoScanError: The write has been withdrawn.
        """
        if not self._is_settled.is_set():
            yield self
        if self._error is not None:
            raise self._error

    def when_settled(self, call: Callable[[], None]) -> None:
        """Call a function as soon as the write is settled, in the thread that settles it."""
        with self._writes.lock:
            if not self._is_settled.is_set():
                self._call = call
                return
        call()

    def withdraw(self) -> None:
        """Settle the write with `NoScanError`, unless a scan has taken it."""
        if self._writes.remove(self):
            self.settle(NoScanError())

    def execute(self) -> None:
        """Change the devices; a refusal is kept for the partner."""
        try:
            self._action()
        except Exception as error:  # noqa: BLE001 - raised to the partner, in its thread
            self._error = error

    def settle(self, error: Exception | None = None) -> None:
        """End the wait of the partner."""
        with self._writes.lock:
            self._error = self._error or error
            self._is_settled.set()
            call = self._call
        if call is not None:
            call()


class ScanWrites:
    """Writes of all partners of one program; thread-safe.

    Attributes:
        lock: Lock of all writes; held for a few instructions only.
    """

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._waiting: list[ScanWrite] = []
        self._taken: list[ScanWrite] = []

    @property
    def are_waiting(self) -> bool:
        """True if the next scan takes a write."""
        return bool(self._waiting)

    def submit(self, action: Callable[[], None]) -> ScanWrite:
        """Return a write that the next scan takes.

        Args:
            action: Function called at the start of the scan; all its changes belong to this scan.
        """
        write = ScanWrite(self, action)
        with self.lock:
            self._waiting.append(write)
        return write

    def remove(self, write: ScanWrite) -> bool:
        """Remove a write that no scan has taken; return whether this was so."""
        with self.lock:
            is_waiting = write in self._waiting
            if is_waiting:
                self._waiting.remove(write)
        return is_waiting

    def take(self) -> None:
        """Execute the waiting writes in the order of their arrival, at the start of a scan."""
        if not self._waiting:
            return
        with self.lock:
            self._taken, self._waiting = self._waiting, []
        for write in self._taken:
            write.execute()

    def settle(self) -> None:
        """End the wait of the partners whose writes this scan took; called after the memory at END can be read."""
        taken, self._taken = self._taken, []
        for write in taken:
            write.settle()

    def withdraw_all(self) -> None:
        """Withdraw the waiting writes at once: the server ends."""
        for write in tuple(self._waiting):
            write.withdraw()
