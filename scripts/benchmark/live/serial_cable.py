"""Serial cable between two pseudo-terminals, which can be disconnected."""

from __future__ import annotations

import os
import select
import threading
import tty
from types import TracebackType
from typing import Self


class SerialCable:
    """Two serial lines, joined by a cable; what is written to one can be read from the other.

    Attributes:
        ends: Device files of the lines.
        is_cut: True while bytes are lost.
        carried: Bytes that have arrived, by the number of the line that sent them.
    """

    def __init__(self) -> None:
        pairs = [os.openpty() for _ in range(2)]
        self._masters = [master for master, _ in pairs]
        self._slaves = [slave for _, slave in pairs]
        for slave in self._slaves:
            tty.setraw(slave)
        self.ends = [os.ttyname(slave) for slave in self._slaves]
        self.is_cut = False
        self.carried = [0, 0]
        self._wake, self._woken = os.pipe()
        self._thread = threading.Thread(target=self._carry, name="serial cable")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        os.write(self._woken, b"x")
        self._thread.join()
        for number in (*self._masters, *self._slaves, self._wake, self._woken):
            os.close(number)

    def _carry(self) -> None:
        while True:
            ready, _, _ = select.select([*self._masters, self._wake], [], [])
            if self._wake in ready:
                return
            for number, master in enumerate(self._masters):
                if master in ready:
                    data = os.read(master, 4_096)
                    if not self.is_cut:
                        os.write(self._masters[1 - number], data)
                        self.carried[number] += len(data)
