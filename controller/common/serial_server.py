"""Server of one serial line: it listens, answers, and opens a disconnected line again."""

from __future__ import annotations

import asyncio
import importlib
import logging
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final

from controller.common.connections import LateAnswer

WRITE_LIMIT_S: Final = 0.1
"""Write timeout, s; a serial line that does not accept an answer within this time is treated as disconnected."""
REOPEN_S: Final = 0.5
"""Interval between attempts to open a disconnected serial line again, s."""
_RECEIVE_BYTES: Final = 256
"""Number of bytes read at once; limits the work done for one line before others are served."""

_log = logging.getLogger(__name__)


def open_port(path: str, baud: int, *, data_bits: int = 8, parity: str, stop_bits: int) -> Any:
    """Open a serial line and return its `serial.Serial`, which reads without waiting.

    The line is locked, so that two servers or masters cannot share it by mistake.

    Raises:
        OSError, ValueError, OverflowError: The line cannot be opened, or does not support the settings.
        ModuleNotFoundError: pyserial is not installed.
    """
    import termios  # noqa: PLC0415 - not available on Windows

    serial = importlib.import_module("serial")
    try:
        return serial.Serial(
            path,
            baud,
            bytesize=data_bits,
            parity=parity,
            stopbits=stop_bits,
            timeout=0,
            write_timeout=WRITE_LIMIT_S,
            exclusive=True,
        )
    except termios.error as error:  # pyserial 3.5 does not translate it if an adapter is unplugged while it is opened
        raise OSError(*error.args) from error


def close_port(port: Any) -> None:
    """Close a serial line; an error, as of an adapter that has been unplugged, is none of its user.

    The system has released the descriptor although it reports an error. pyserial would close it again later, when it is
    perhaps that of another file; the null device takes its place.
    """
    try:
        port.close()
    except OSError:
        port.fd = os.open(os.devnull, os.O_RDONLY)
        port.close()


class SerialServer(ABC):
    """Server of one serial line; the derived class has the protocol."""

    def __init__(self, path: str, gap_s: float) -> None:
        """Create a server; `start` opens the line.

        Args:
            path: Device file.
            gap_s: Idle time after which incomplete data is discarded, s.
        """
        self._path = path
        self._gap_s = gap_s
        self._port: Any = None
        self._loop: asyncio.AbstractEventLoop
        self._timers: set[asyncio.TimerHandle] = set()
        self._gap: asyncio.TimerHandle | None = None
        self._late: LateAnswer | None = None

    @property
    def path(self) -> str:
        """Device file of the serial line."""
        return self._path

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Open the serial line and start listening.

        Raises:
            OSError, ValueError, OverflowError: The serial line cannot be opened, or does not support the settings.
            ModuleNotFoundError: pyserial is not installed.
        """
        self._port = self._open()
        self._loop = loop
        loop.add_reader(self._port.fileno(), self._read)

    def stop(self) -> None:
        """Close the serial line if it is open, and do not open it again."""
        for timer in self._timers:
            timer.cancel()
        self._timers.clear()
        self._close()

    @abstractmethod
    def _open(self) -> Any:
        """Return the open `serial.Serial`; raise what `start` raises."""

    @abstractmethod
    def _feed(self, data: bytes) -> None:
        """Process received data, and that received before; requests wait while there is a late answer."""

    @property
    @abstractmethod
    def _is_waiting(self) -> bool:
        """True while received data is incomplete."""

    @abstractmethod
    def _discard_incomplete(self) -> None:
        """Discard incomplete data after the idle time; data after it may be complete."""

    @abstractmethod
    def _on_disconnect(self) -> None:
        """Discard received data and release what the partner holds: the line is closed."""

    def _send(self, data: bytes) -> None:
        """Send an answer, unless the line has been disconnected."""
        if self._port is None:
            return
        try:
            self._port.write(data)
        except OSError as error:
            self._disconnect(error)

    def _after(self, delay_s: float, function: Callable[[], None]) -> None:
        """Call a function later, unless the server is stopped before."""

        def due() -> None:
            self._timers.discard(timer)
            function()

        timer = self._loop.call_later(delay_s, due)
        self._timers.add(timer)

    def _read(self) -> None:
        try:
            data = self._port.read(_RECEIVE_BYTES)
        except OSError as error:
            self._disconnect(error)
            return
        # the idle time begins again with every byte
        if self._gap is not None:
            self._gap.cancel()
        self._process(data)

    def _process(self, data: bytes) -> None:
        self._feed(data)
        if self._is_waiting and self._late is None:
            self._gap = self._loop.call_later(self._gap_s, self._discard_incomplete)

    def _send_later(self, late: LateAnswer) -> None:
        """Send an answer as soon as it is ready, before the requests after it are processed."""

        def send(answer: bytes | None) -> None:
            self._late = None
            if answer:
                self._send(answer)
            self._process(b"")

        self._late = late
        late.when_ready(self._loop, send)

    def _close(self) -> None:
        if self._port is None:
            return
        if self._late is not None:
            self._late.abandon()
            self._late = None
        self._loop.remove_reader(self._port.fileno())
        close_port(self._port)
        self._port = None
        if self._gap is not None:
            self._gap.cancel()
        self._on_disconnect()

    def _disconnect(self, error: OSError) -> None:
        """Close a disconnected serial line; otherwise its invalid file descriptor would keep the event loop busy."""
        _log.warning("serial line %s is disconnected (%s); reconnect it, it is then opened again", self._path, error)
        self._close()
        self._after(REOPEN_S, self._reopen)

    def _reopen(self) -> None:
        try:
            self.start(self._loop)
        except (OSError, ValueError):
            self._after(REOPEN_S, self._reopen)
        else:
            _log.warning("serial line %s is connected again", self._path)
