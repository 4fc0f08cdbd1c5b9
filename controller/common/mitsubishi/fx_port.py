"""Frames of the programming port of FX0 to FX3 PLCs (9600 bit/s, 7 data bits, even parity, 1 stop bit).

The protocol is not published. Sources: bomingfeng/Fx2N, doc/21.txt (frames, commands 0, 1, 7, 8, worked example);
KrystianD/fxplc (commands 0, 1, 7, 8); brooksg44/ISU-FX2N, captures/ (recordings of GX Works2: E00, E01, E10, E7, E8,
E41, B). The recorded telegrams are test vectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from controller.common.mitsubishi.framing import DigitError, parsed
from controller.common.mitsubishi.requests import FrameError

STX, ETX, ENQ, ACK, NAK = b"\x02", b"\x03", b"\x05", b"\x06", b"\x15"
Space = Literal["basic", "extended", "program"]
"""Address space: of the commands 0, 1, 7 and 8; of E00, E10, E7 and E8; of E01, E11 and E41."""
LONGEST_TRANSFER: Final[dict[Space, int]] = {"basic": 64, "extended": 254, "program": 254}
"""Largest number of bytes that a request reads or writes: the largest in the recordings are 64 and 254 bytes."""
LONGEST_FRAME: Final = 530
"""Longest accepted frame, bytes; the longest valid one, an extended write of 254 bytes, has 521."""
_SUM_CHARACTERS: Final = 2

_READS: Final[dict[bytes, Space]] = {b"0": "basic", b"E00": "extended", b"E01": "program"}
_WRITES: Final[dict[bytes, Space]] = {b"1": "basic", b"E10": "extended", b"E11": "program"}
_FORCES: Final[dict[bytes, tuple[Space, bool]]] = {
    b"7": ("basic", True),
    b"8": ("basic", False),
    b"E7": ("extended", True),
    b"E8": ("extended", False),
}


@dataclass(frozen=True, slots=True)
class ReadMemory:
    """Read of consecutive bytes; the reply contains the bytes."""

    space: Space
    address: int
    count: int


@dataclass(frozen=True, slots=True)
class WriteMemory:
    """Write of consecutive bytes."""

    space: Space
    address: int
    data: bytes


@dataclass(frozen=True, slots=True)
class ForceBit:
    """Force of one bit, by its number in the address space; it lasts until the program or a partner writes the bit."""

    space: Space
    number: int
    level: bool


@dataclass(frozen=True, slots=True)
class OtherCommand:
    """Command that is not known or not supported, with its text."""

    text: bytes


PortRequest = ReadMemory | WriteMemory | ForceBit | OtherCommand


class SumError(FrameError):
    """Raised for a frame with a wrong sum."""


def encode(text: bytes) -> bytes:
    """Return the frame with the given text: a command with its data, or the data of a reply.

    Examples:
        The worked example of doc/21.txt reads 4 bytes at 10F6h, which are D123 and D124.

        >>> encode(b"010F604").hex(" ")
        '02 30 31 30 46 36 30 34 03 37 34'
    """
    return STX + text + ETX + b"%02X" % (sum(text + ETX) & 0xFF)


def decode(frame: bytes) -> bytes:
    """Return the text of a complete frame.

    Raises:
        FrameError: STX, ETX or the sum is wrong.
    """
    if len(frame) < 1 + 1 + _SUM_CHARACTERS or frame[:1] != STX or frame[-3:-2] != ETX:
        raise FrameError(f"{frame!r}: not a frame of the programming port")
    text = frame[1:-3]
    if frame != encode(text):
        raise SumError(f"{frame!r}: wrong sum")
    return text


def frame_length(data: bytes) -> int | None:
    """Return the length of the frame that data starts with, or None if it is not complete."""
    end = data.find(ETX)
    return None if end < 0 or len(data) < end + 1 + _SUM_CHARACTERS else end + 1 + _SUM_CHARACTERS


def encode_request(request: PortRequest) -> bytes:
    """Return the frame of a request."""
    match request:
        case ReadMemory(space, address, count):
            return encode(_key(_READS, space) + b"%04X%02X" % (address, count))
        case WriteMemory(space, address, data):
            return encode(_key(_WRITES, space) + b"%04X%02X" % (address, len(data)) + data.hex().upper().encode())
        case ForceBit(space, number, level):
            command = next(text for text, kind in _FORCES.items() if kind == (space, level))
            return encode(command + number.to_bytes(2, "little").hex().upper().encode())
        case OtherCommand(text):
            return encode(text)


def decode_request(frame: bytes) -> PortRequest:
    """Return the request in a complete frame.

    Raises:
        FrameError: The frame is damaged, or its fields do not fit its command.
    """
    text = decode(frame)
    size = next((size for size in (3, 2, 1) if text[:size] in {*_READS, *_WRITES, *_FORCES}), 0)
    command, data = text[:size], text[size:]
    if command in _FORCES:
        if len(data) != 4:
            raise FrameError(f"{text!r}: a force has 4 digits")
        space, level = _FORCES[command]
        return ForceBit(space, int.from_bytes(_bytes(data), "little"), level)
    if not command:
        return OtherCommand(text)
    if len(data) < 6:
        raise FrameError(f"{text!r}: address or count is missing")
    address, count, content = parsed(data[:4], 16), parsed(data[4:6], 16), data[6:]
    space = {**_READS, **_WRITES}[command]
    if not 1 <= count <= LONGEST_TRANSFER[space] or address + count > 0x1_0000:
        raise FrameError(f"{text!r}: {count} bytes")
    if command in _READS:
        if content:
            raise FrameError(f"{text!r}: characters after the count")
        return ReadMemory(space, address, count)
    if len(content) != 2 * count:
        raise FrameError(f"{text!r}: {len(content)} digits instead of {2 * count}")
    return WriteMemory(space, address, _bytes(content))


def encode_bytes(data: bytes) -> bytes:
    """Return the frame of a reply with data."""
    return encode(data.hex().upper().encode())


def decode_bytes(frame: bytes) -> bytes:
    """Return the data of a reply.

    Raises:
        FrameError: The frame is damaged, or contains another character than a digit.
    """
    return _bytes(decode(frame))


def _bytes(digits: bytes) -> bytes:
    if len(digits) % 2:
        raise DigitError(f"{digits!r}: odd number of digits")
    return parsed(digits, 16).to_bytes(len(digits) // 2) if digits else b""


def _key(table: dict[bytes, Space], space: Space) -> bytes:
    return next(text for text, each in table.items() if each == space)
