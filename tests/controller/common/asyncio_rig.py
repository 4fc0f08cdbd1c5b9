"""Event loop whose errors fail a test, event loop in simulated time, and the port of a serial line in it."""

from __future__ import annotations

import asyncio
import selectors
import socket
from collections.abc import Callable, Coroutine, Iterable
from typing import Any

Reception = tuple[float, bytes | OSError]
"""Time after the transmission of the request, s, and the bytes that arrive, or the error that the port reports."""


def run(main: Coroutine[Any, Any, None], loop: Callable[[], asyncio.AbstractEventLoop] | None = None) -> None:
    """Run a coroutine; what the event loop reports is an error, also an exception that nobody awaited."""
    reported: list[dict[str, Any]] = []
    with asyncio.Runner(loop_factory=loop) as runner:
        runner.get_loop().set_exception_handler(lambda _, context: reported.append(context))
        runner.run(main)
    assert reported == []


class _Selector(selectors.SelectSelector):
    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Return what is ready; if nothing is, set the clock forward by the timeout."""
        if timeout is None:
            return super().select()
        ready = super().select(0)
        if not ready:
            self.now_s += max(0.0, timeout)
        return ready


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Event loop that does not wait: its clock begins at 0 and is set forward to the next timer."""

    def __init__(self) -> None:
        self._clock = _Selector()
        super().__init__(self._clock)

    def time(self) -> float:
        """Return the simulated time, s."""
        return self._clock.now_s


class SimulatedPort:
    """Port of a serial line, with the interface of `serial.Serial` that a client uses.

    Attributes:
        sent: Transmitted frames with their times, s.
        reads: Number of reads.
        is_closed: True after `close`.
    """

    def __init__(self, *script: Iterable[Reception] | OSError) -> None:
        """Create an open port.

        Args:
            script: For each transmission the receptions that follow, or the error that it reports.
        """
        self.sent: list[tuple[float, bytes]] = []
        self.reads = 0
        self.is_closed = False
        self._script = iter(script)
        self._received: list[bytes | OSError] = []
        self._near, self._far = socket.socketpair()

    def fileno(self) -> int:
        """Return a file descriptor that is readable while there is something to read."""
        return self._near.fileno()

    def write(self, frame: bytes) -> None:
        """Transmit a frame."""
        loop = asyncio.get_running_loop()
        self.sent.append((loop.time(), frame))
        receptions = next(self._script, ())
        if isinstance(receptions, OSError):
            raise receptions
        for after_s, reception in receptions:
            loop.call_later(after_s, self.receive, reception)

    def receive(self, reception: bytes | OSError) -> None:
        """Let bytes arrive, or an error that stays."""
        self._received.append(reception)
        self._far.send(b"\0")

    def read(self, _count: int) -> bytes:
        """Return the bytes of one arrival."""
        self.reads += 1
        if not self._received:
            return b""
        reception = self._received[0]
        if isinstance(reception, OSError):
            raise reception
        self._near.recv(1)
        del self._received[0]
        return reception

    def reset_input_buffer(self) -> None:
        """Discard what has arrived."""
        for _ in self._received:
            self._near.recv(1)
        self._received.clear()

    def close(self) -> None:
        """Close the port."""
        self.is_closed = True
        self._near.close()
        self._far.close()
