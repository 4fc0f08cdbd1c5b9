"""Modbus RTU master on a serial line.

An RTU answer has no number (`RtuFrames`). After a failed exchange the received data is discarded, the line must be
silent, and the next request to the device is an echo with a random number (function 8): a device answers in order, so
that no earlier answer can follow the echo. A read before it shows whether the adapter returns what is sent.
Source: Modbus over Serial Line V1.02, 2.4 and 2.5.1.
"""

from __future__ import annotations

import importlib
import time
from typing import Any, Final

from controller.common.modbus.client import RtuFrames
from controller.common.modbus.client_requests import ModbusRequest
from controller.common.modbus.rtu import LONGEST_FRAME, SerialLine
from controller.common.serial_server import close_port
from controller.io.field.line import BusLine

# also without parity, where the specification requires a second stop bit
_BITS_A_CHARACTER: Final = 11
_SILENCE_CHARACTERS: Final = 3.5
_LEAST_SILENCE_S: Final = 0.001_75
"""Silence between frames above 19,200 baud, s. Source: 2.5.1.1."""


class RtuBus(BusLine):
    """Serial line with one or more devices. It is opened again like a connection, also as a new device file."""

    sequenced = False

    def __init__(self, settings: SerialLine) -> None:
        """Create a closed line.

        Args:
            settings: Settings; the unit address is ignored.

        Raises:
            ModuleNotFoundError: pyserial is not installed.
        """
        super().__init__(settings.path)
        self._settings = settings
        self._silence_s = max(_LEAST_SILENCE_S, _SILENCE_CHARACTERS * _BITS_A_CHARACTER / settings.baud)
        importlib.import_module("serial")  # reports a missing module before the first exchange
        self._port: Any = None
        self._frames = RtuFrames(settings.path)

    @property
    def is_open(self) -> bool:
        """True if the device file is open."""
        return self._port is not None

    def begin(self) -> None:
        """Open the device file."""
        try:
            self._port = self._settings.open()
        except (ValueError, OverflowError) as error:
            raise OSError(str(error)) from error
        self._frames.forget_adapter()
        self._discard()

    def finish(self, deadline_s: float) -> None:
        """Return: the device file is open."""

    def fileno(self) -> int:
        """Return the file descriptor of the device file."""
        return -1 if self._port is None else int(self._port.fileno())

    def send(self, unit: int, request: ModbusRequest) -> None:
        """Send a request; data that has arrived before it is discarded."""
        self._discard()
        self._port.write(self._frames.request(unit, request.pdu))

    def receive(self) -> bytes | None:
        """Return the answer of the unit to the last request; after it the line rests."""
        self._frames.feed(self._port.read(LONGEST_FRAME))
        answer = self._frames.answer()
        if answer is not None:
            self._rest()
        return answer

    def fail(self) -> None:
        """Discard what has arrived, and let the line rest."""
        self._frames.discard()
        self._rest()

    def close(self) -> None:
        """Close the device file."""
        port, self._port = self._port, None
        if port is not None:
            close_port(port)
        self._frames.discard()

    def _rest(self) -> None:
        self.ready_s = time.perf_counter() + self._silence_s

    def _discard(self) -> None:
        self._frames.discard()
        while self._port.read(LONGEST_FRAME):
            pass
