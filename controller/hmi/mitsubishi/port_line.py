"""Serial line of the programming port."""

from __future__ import annotations

import asyncio
import importlib
import logging
from typing import Any, Final

from controller.hmi.access.devices import AccessSource
from controller.hmi.mitsubishi.port_session import PortSession
from controller.hmi.serving.endpoints import SerialEndpoint

BAUD: Final = 9_600
GAP_S: Final = 0.5
"""Idle time after which an incomplete frame is discarded, s (assumed)."""
_RECEIVE_BYTES: Final = 256
_WRITE_LIMIT_S: Final = 0.1
"""Write timeout, s; a line that does not accept an answer within this time is treated as disconnected."""

_log = logging.getLogger(__name__)


class PortLine:
    """Server of one serial line with 9600 bit/s, 7 data bits, even parity and 1 stop bit."""

    def __init__(self, path: str, session: PortSession) -> None:
        """Create a server; `start` opens the line.

        Args:
            path: Device file.
            session: Programming port to serve.
        """
        self._path = path
        self._session = session
        self._port: Any = None
        self._loop: asyncio.AbstractEventLoop
        self._gap: asyncio.TimerHandle | None = None

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Open the serial line and start listening.

        Raises:
            OSError, ValueError: The serial line cannot be opened, or does not support the settings.
            ModuleNotFoundError: pyserial is not installed.
        """
        serial = importlib.import_module("serial")
        self._port = serial.Serial(
            self._path,
            BAUD,
            bytesize=serial.SEVENBITS,
            parity=serial.PARITY_EVEN,
            stopbits=serial.STOPBITS_ONE,
            timeout=0,
            write_timeout=_WRITE_LIMIT_S,
        )
        self._loop = loop
        loop.add_reader(self._port.fileno(), self._read)

    def stop(self) -> None:
        """Close the serial line if it is open."""
        if self._port is None:
            return
        self._loop.remove_reader(self._port.fileno())
        self._port.close()
        self._port = None
        if self._gap is not None:
            self._gap.cancel()
        self._session.discard()
        self._session.on_disconnect()

    def _read(self) -> None:
        if self._gap is not None:
            self._gap.cancel()
        try:
            answers = self._session.feed(self._port.read(_RECEIVE_BYTES))
            if answers:
                self._port.write(answers)
        except OSError as error:
            _log.warning("serial line %s is disconnected (%s); reconnect it and start again", self._path, error)
            self.stop()
            return
        if self._session.is_waiting:
            self._gap = self._loop.call_later(GAP_S, self._session.discard)


def programming_port(source: AccessSource, path: str, option: str) -> SerialEndpoint:
    """Return the programming port on a serial line.

    Args:
        source: PLC.
        path: Device file.
        option: Command-line option of the line, for error messages.
    """
    return SerialEndpoint(PortLine(path, PortSession(source.session(path))), path, option)
