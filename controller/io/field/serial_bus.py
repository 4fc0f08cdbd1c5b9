"""Modbus RTU master on a serial line.

An RTU answer has no number. It is accepted if its unit, function, length and checksum match the request. After a
failed exchange the received data is discarded, the line must be silent, and the next request to the device is an echo
with a random number (function 8): a device answers in order, so that no earlier answer can follow the echo.
Source: Modbus over Serial Line V1.02, 2.4 and 2.5.1.
"""

from __future__ import annotations

import importlib
import time
from typing import Any, Final

from pymodbus.framer import FramerRTU

from controller.common.modbus.rtu import SerialLine
from controller.io.field.line import BusLine
from controller.io.field.requests import EXCEPTION, ModbusRequest

# also without parity, where the specification requires a second stop bit
_BITS_A_CHARACTER: Final = 11
_SILENCE_CHARACTERS: Final = 3.5
_LEAST_SILENCE_S: Final = 0.001_75
"""Silence between frames above 19,200 baud, s. Source: 2.5.1.1."""
_COUNTED: Final = (1, 2, 3, 4, 23)
_COUNT_INDEX: Final = 2
_CONFIRMATION: Final = 8
_REFUSAL: Final = 5
_SHORTEST: Final = 5
_LONGEST: Final = 256


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
        self._unit = 0
        self._request: ModbusRequest | None = None
        self._buffer = bytearray()

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
        self._discard()

    def finish(self, deadline_s: float) -> None:
        """Return: the device file is open."""

    def fileno(self) -> int:
        """Return the file descriptor of the device file."""
        return -1 if self._port is None else int(self._port.fileno())

    def send(self, unit: int, request: ModbusRequest) -> None:
        """Send a request; data that has arrived before it is discarded."""
        self._discard()
        self._unit, self._request = unit, request
        frame = bytes([unit]) + request.pdu
        self._port.write(frame + FramerRTU.compute_CRC(frame).to_bytes(2))

    def receive(self) -> bytes | None:
        """Return the answer of the unit to the last request; other bytes are skipped."""
        self._buffer += self._port.read(_LONGEST)
        buffer, request = self._buffer, self._request
        while request is not None and len(buffer) >= _SHORTEST:
            length = _length(buffer)
            if buffer[0] != self._unit or not request.accepts(bytes(buffer[1:2])) or length > _LONGEST:
                del buffer[0]
            elif len(buffer) < length:
                return None
            elif FramerRTU.check_CRC(bytes(buffer[: length - 2]), int.from_bytes(buffer[length - 2 : length])):
                answer = bytes(buffer[1 : length - 2])
                # a unit sends nothing unasked, so bytes after the answer are noise
                buffer.clear()
                self._rest()
                return answer
            else:
                del buffer[0]
        return None

    def fail(self) -> None:
        """Discard what has arrived, and let the line rest."""
        self._buffer.clear()
        self._rest()

    def close(self) -> None:
        """Close the device file."""
        if self._port is not None:
            self._port.close()
        self._port = None
        self._buffer.clear()

    def _rest(self) -> None:
        self.ready_s = time.perf_counter() + self._silence_s

    def _discard(self) -> None:
        self._buffer.clear()
        while self._port.read(_LONGEST):
            pass


def _length(received: bytearray) -> int:
    """Return the length of the answer at the start of the data, with address and checksum."""
    function = received[1]
    if function & EXCEPTION:
        return _REFUSAL
    return _COUNT_INDEX + 1 + received[_COUNT_INDEX] + 2 if function in _COUNTED else _CONFIRMATION
