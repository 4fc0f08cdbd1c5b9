"""Modbus RTU: settings and framing of a serial line, and a server with one device at one address.

According to the specification, an idle time of 3.5 characters ends a frame. Adapters and operating systems insert
gaps, so a request is accepted as soon as it is complete and its checksum is valid. Other data (noise, requests to
other units and their answers) is skipped byte by byte. Source: Modbus over Serial Line V1.02, 2.5.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from pymodbus.framer import FramerRTU

from controller.common.connections import LateAnswer, begun
from controller.common.errors import InputError
from controller.common.modbus.requests import ModbusDevice, answer
from controller.common.modbus.returned_answer import ReturnedAnswers
from controller.common.serial_server import SerialServer, open_port

GAP_S: Final = 0.05
"""Idle time after which an incomplete request is discarded, s."""
BROADCAST: Final = 0
LONGEST_FRAME: Final = 256
_FIXED: Final = {1: 8, 2: 8, 3: 8, 4: 8, 5: 8, 6: 8, 7: 4, 8: 8, 11: 4, 12: 4, 17: 4, 22: 10, 24: 6, 43: 7}
"""Length of fixed-length requests with address and checksum, bytes, by function code, including unsupported codes."""
_COUNTED: Final = {15: 6, 16: 6, 20: 2, 21: 2, 23: 10}
"""Index of the byte count in variable-length requests, by function code."""
_SHORTEST: Final = 4
_FASTEST_COUNTED_BAUD: Final = 19_200
_SHORTEST_SILENCE_S: Final = 1.75e-3
"""Silence between frames above 19,200 baud, s. Source: Modbus over Serial Line V1.02, 2.5.1.1."""


class SerialError(InputError):
    """Raised for invalid settings of a serial line; the message is one line with the remedy."""


@dataclass(frozen=True, slots=True)
class SerialLine:
    """Settings of a serial line and the unit address of the server.

    Attributes:
        path: Device file.
        baud: Baud rate, bit/s.
        parity: Parity: N, E or O.
        stop_bits: Number of stop bits, 1 or 2.
        unit: Unit address of the server, 1 to 247.
    """

    path: str
    baud: int = 19_200
    parity: str = "E"
    stop_bits: int = 1
    unit: int = 1

    @classmethod
    def parsed(cls, text: str) -> SerialLine:
        """Parse settings such as `/dev/ttyUSB0:19200:8E1:1`; the defaults of omitted parts are 19200, 8E1 and 1.

        Raises:
            SerialError: The text is invalid.
        """
        path, *rest = text.split(":")
        baud, frame, unit = (*rest, *("19200", "8E1", "1")[len(rest) :])[:3] if len(rest) <= 3 else ("", "", "")
        valid_frame = len(frame) == 3 and frame[0] == "8" and frame[1] in "NEO" and frame[2] in "12"
        valid_baud = baud.isdecimal() and int(baud) > 0
        if not (path and valid_baud and valid_frame and unit.isdecimal() and 1 <= int(unit) <= 247):
            raise SerialError(
                f"serial line {text!r}: must be DEVICE:BAUD:FRAME:UNIT with frame 8N1, 8E1 or 8O1, "
                "for example /dev/ttyUSB0:19200:8E1:1"
            )
        return cls(path, int(baud), frame[1], int(frame[2]), int(unit))

    def wire_s(self, count: int) -> float:
        """Return the transmission time of a number of bytes, s: start bit, 8 data bits, parity and stop bits each.

        >>> round(1e3 * SerialLine("/dev/ttyS0", 115_200).wire_s(8), 3)
        0.764
        """
        return count * (9 + (self.parity != "N") + self.stop_bits) / self.baud

    @property
    def silence_s(self) -> float:
        """Silence that separates two frames, s: 3.5 characters, or 1.75 ms above 19,200 baud."""
        return _SHORTEST_SILENCE_S if self.baud > _FASTEST_COUNTED_BAUD else self.wire_s(7) / 2

    def open(self) -> Any:
        """Open the serial line and return its `serial.Serial`, which reads without waiting.

        Raises:
            OSError, ValueError, OverflowError: The line cannot be opened, or does not support the baud rate.
            ModuleNotFoundError: pyserial is not installed.
        """
        return open_port(self.path, self.baud, parity=self.parity, stop_bits=self.stop_bits)


class RtuServer(SerialServer):
    """Modbus RTU server of one serial line; a disconnected line is opened again as soon as that is possible."""

    def __init__(self, line: SerialLine, device: ModbusDevice, *, models_wire: bool = False) -> None:
        """Create a server; `start` opens the serial line.

        Args:
            line: Settings of the serial line.
            device: Device to serve.
            models_wire: True to delay requests and answers by their transmission times and the silence between them,
                for a pseudo-terminal, which transmits at once.
        """
        super().__init__(line.path, GAP_S)
        self._line = line
        self._device = device
        self._models_wire = models_wire
        self._buffer = bytearray()
        self._returned = ReturnedAnswers(line.path, self._is_request)

    def _open(self) -> Any:
        return self._line.open()

    def _feed(self, data: bytes) -> None:
        self._buffer += data
        if self._returned.remove(self._buffer, self._loop.time()):
            self._process_buffer()

    @property
    def _is_waiting(self) -> bool:
        return bool(self._buffer)

    def _discard_incomplete(self) -> None:
        """Treat an incomplete request as noise and process the bytes after it."""
        while self._buffer and self._late is None:
            self._skip()
            self._process_buffer()

    def _on_disconnect(self) -> None:
        self._buffer.clear()
        self._returned.forget()
        self._device.on_disconnect()

    def _process_buffer(self) -> None:
        """Serve the requests in the buffer, skip other bytes and leave an incomplete request in the buffer."""
        buffer = self._buffer
        while buffer and self._late is None:
            length = request_length(buffer)
            if buffer[0] not in (self._line.unit, BROADCAST) or (length or 0) > LONGEST_FRAME:
                self._skip()
            elif length is None or len(buffer) < length:
                return
            elif is_checksum_valid(buffer[:length]):
                frame = bytes(buffer[:length])
                del buffer[:length]
                self._returned.request_served()
                self._serve(frame)
            else:
                self._skip()

    def _skip(self) -> None:
        """Skip a byte that does not begin a request."""
        del self._buffer[0]
        self._returned.noise_received()

    def _is_request(self, frame: bytes) -> bool:
        return request_length(frame) == len(frame) and frame[0] == self._line.unit

    def _send(self, data: bytes) -> None:
        super()._send(data)
        self._returned.sent(data, self._loop.time() + self._line.wire_s(len(data)))

    def _serve(self, frame: bytes) -> None:
        if self._models_wire:
            self._after(self._line.wire_s(len(frame)) + self._line.silence_s, lambda: self._execute(frame))
        else:
            self._execute(frame)

    def _execute(self, frame: bytes) -> None:
        reply = begun(self._answered(frame))
        if isinstance(reply, LateAnswer):
            self._send_later(reply)
        elif reply:
            self._after(self._line.wire_s(len(reply)) if self._models_wire else 0, lambda: self._send(reply))

    async def _answered(self, frame: bytes) -> bytes:
        """Return the reply to a request; nothing to a broadcast: all units execute it, and their answers collide."""
        unit = frame[0]
        pdu = await answer(self._device, frame[1:-2])
        return b"" if unit == BROADCAST else framed(unit, pdu)


def framed(unit: int, pdu: bytes) -> bytes:
    """Return a frame: unit address, PDU and checksum."""
    frame = bytes([unit]) + pdu
    # pymodbus returns the checksum with its bytes exchanged; the low byte is sent first
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2)


def request_length(received: bytes | bytearray) -> int | None:
    """Return the length of the request at the start of the data, including the checksum; None if it is not known yet.

    An unknown function code is assumed to have the shortest frame.
    """
    if len(received) < 2:
        return None
    function_code = received[1]
    if function_code in _COUNTED:
        index = _COUNTED[function_code]
        return None if len(received) <= index else index + 1 + received[index] + 2
    return _FIXED.get(function_code, _SHORTEST)


def is_checksum_valid(frame: bytes | bytearray) -> bool:
    """Return True if the last two bytes are the checksum of the others."""
    return FramerRTU.check_CRC(bytes(frame[:-2]), int.from_bytes(frame[-2:]))
