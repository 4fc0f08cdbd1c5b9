"""Modbus RTU served on a serial line: frames cut by their length and checksum, one device behind one address.

Silence ends a frame in the specification (3.5 characters); adapters and operating systems make gaps of their own, so a
request is taken when its length is reached and its checksum right. What is no request to us (noise, others' requests
and their answers) is slid over byte by byte. Source: Modbus over Serial Line V1.02, 2.5.1.
"""

from __future__ import annotations

import asyncio
import importlib
import logging
from dataclasses import dataclass
from typing import Any, Final

from pymodbus.framer import FramerRTU

from controller.modbus.requests import Device, answer

GAP_S: Final = 0.05
"""Silence after which the beginning of a request will not be completed any more."""
BROADCAST: Final = 0
LONGEST_FRAME: Final = 256
_FIXED: Final = {
    1: 8, 2: 8, 3: 8, 4: 8, 5: 8, 6: 8, 7: 4, 8: 8, 11: 4, 12: 4, 17: 4, 22: 10, 24: 6, 43: 7
}  # fmt: skip
"""Length of the requests that have only one, with address and checksum; those that are refused, too."""
_COUNTED: Final = {15: 6, 16: 6, 20: 2, 21: 2, 23: 10}
"""Place of the byte count in those that have one."""
_SHORTEST: Final = 4
_WRITE_LIMIT_S: Final = 0.1
"""A line that takes no answer within this time is as good as gone."""

_log = logging.getLogger(__name__)


class SerialError(ValueError):
    """A serial line that cannot be; one line with the remedy."""


@dataclass(frozen=True, slots=True)
class SerialLine:
    """A serial line and our address on it.

    Attributes:
        path: Device file.
        baud: Speed, bit/s.
        parity: N, E or O.
        stop_bits: 1 or 2.
        unit: Our address, 1 to 247.
    """

    path: str
    baud: int = 19_200
    parity: str = "E"
    stop_bits: int = 1
    unit: int = 1

    @classmethod
    def parsed(cls, text: str) -> SerialLine:
        """Read a line such as `/dev/ttyUSB0:19200:8E1:1`; what is left out is 19200, 8E1 and 1.

        Raises:
            SerialError: It is no such line.
        """
        path, *rest = text.split(":")
        baud, frame, unit = (*rest, *("19200", "8E1", "1")[len(rest) :])[:3] if len(rest) <= 3 else ("", "", "")
        good_frame = len(frame) == 3 and frame[0] == "8" and frame[1] in "NEO" and frame[2] in "12"
        good_baud = baud.isdecimal() and int(baud) > 0
        if not (path and good_baud and good_frame and unit.isdecimal() and 1 <= int(unit) <= 247):
            raise SerialError(
                f"serial line {text!r}: give DEVICE:BAUD:8N1, 8E1 or 8O1:UNIT, as /dev/ttyUSB0:19200:8E1:1"
            )
        return cls(path, int(baud), frame[1], int(frame[2]), int(unit))


class RtuServer:
    """Answers the requests that come on one serial line."""

    def __init__(self, line: SerialLine, device: Device) -> None:
        """Serve a device on a line; it is opened by `start`."""
        self._line = line
        self._device = device
        self._buffer = bytearray()
        self._port: Any = None
        self._loop: asyncio.AbstractEventLoop
        self._gap: asyncio.TimerHandle | None = None

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Open the line and listen.

        Raises:
            OSError, ValueError, OverflowError: The line cannot be opened, or not at this speed.
            ModuleNotFoundError: There is no pyserial here.
        """
        serial = importlib.import_module("serial")
        line = self._line
        self._port = serial.Serial(
            line.path,
            line.baud,
            parity=line.parity,
            stopbits=line.stop_bits,
            timeout=0,
            write_timeout=_WRITE_LIMIT_S,
        )
        self._loop = loop
        loop.add_reader(self._port.fileno(), self._read)

    def stop(self) -> None:
        """Close the line, if it is open."""
        if self._port is None:
            return
        self._loop.remove_reader(self._port.fileno())
        self._port.close()
        self._port = None
        if self._gap is not None:
            self._gap.cancel()
        self._device.end()

    def _read(self) -> None:
        try:
            self._buffer += self._port.read(LONGEST_FRAME)
        except OSError as error:
            self._lose(error)
            return
        if self._gap is not None:
            self._gap.cancel()
        self._take()
        if self._buffer:
            self._gap = self._loop.call_later(GAP_S, self._give_up)

    def _lose(self, error: OSError) -> None:
        """Give up a line that is gone: a descriptor that only fails would keep the server busy for ever."""
        _log.warning(
            "serial line %s is gone (%s); panels on it are served again after a restart", self._line.path, error
        )
        self._buffer.clear()
        self.stop()

    def _take(self) -> None:
        """Serve the requests in the buffer and slide over what is none; leave the beginning of one."""
        buffer = self._buffer
        while buffer:
            length = request_length(buffer)
            if buffer[0] not in (self._line.unit, BROADCAST) or (length or 0) > LONGEST_FRAME:
                del buffer[0]
            elif length is None or len(buffer) < length:
                return
            elif _checksum_right(buffer[:length]):
                frame = bytes(buffer[:length])
                del buffer[:length]
                self._serve(frame)
            else:
                del buffer[0]

    def _give_up(self) -> None:
        """Take the beginning of a request that has stayed one for noise, and look behind it."""
        while self._buffer:
            del self._buffer[0]
            self._take()

    def _serve(self, frame: bytes) -> None:
        unit = frame[0]
        reply = bytes([unit]) + answer(self._device, frame[1:-2])
        if unit != BROADCAST:
            try:
                self._port.write(reply + FramerRTU.compute_CRC(reply).to_bytes(2))
            except OSError as error:
                self._lose(error)


def request_length(received: bytes | bytearray) -> int | None:
    """Return the length of the request that begins here, checksum included; None while it cannot be known.

    A function that is in no table is taken to have the shortest frame.
    """
    if len(received) < 2:
        return None
    function_code = received[1]
    if function_code in _COUNTED:
        place = _COUNTED[function_code]
        return None if len(received) <= place else place + 1 + received[place] + 2
    return _FIXED.get(function_code, _SHORTEST)


def _checksum_right(frame: bytes | bytearray) -> bool:
    return FramerRTU.check_CRC(bytes(frame[:-2]), int.from_bytes(frame[-2:]))
