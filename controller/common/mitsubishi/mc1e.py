"""MC protocol frame 1E, as the Ethernet modules of an FX3U have it.

Sources: FX3U-ENET-ADP user's manual 7.3-7.7 (formats and examples), 7.4 (commands and numbers of points), 9.3.2 (end
codes), public scans. Not found in a public source, from memory (general knowledge): the meaning of the abnormal codes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.common.mitsubishi.devices import BY_CODE_1E, KINDS, Device, splits_counter
from controller.common.mitsubishi.framing import DigitError, FrameReader, FrameWriter, ShortFrameError
from controller.common.mitsubishi.requests import (
    BITS_PER_WORD,
    FrameError,
    ReadBits,
    ReadTypeName,
    ReadWords,
    RefusedError,
    RemoteRun,
    RemoteStop,
    Reply,
    Request,
    RequestError,
    SelfTest,
    TypeName,
    WriteBits,
    WriteRandomBits,
    WriteRandomWords,
    WriteWords,
    has_two_words,
)

SUBHEADERS: Final = {
    ReadBits: 0x00,
    ReadWords: 0x01,
    WriteBits: 0x02,
    WriteWords: 0x03,
    WriteRandomBits: 0x04,
    WriteRandomWords: 0x05,
    RemoteRun: 0x13,
    RemoteStop: 0x14,
    ReadTypeName: 0x15,
    SelfTest: 0x16,
}
"""Subheader of each request."""
_RESPONSE: Final = 0x80

UNKNOWN_SUBHEADER: Final = 0x50
NOT_HEXADECIMAL: Final = 0x54
WRONG_DEVICE: Final = 0x56
TOO_MANY_POINTS: Final = 0x57
WRONG_HEAD: Final = 0x58
NOT_PROCESSED: Final = 0x5B
"""End code that is followed by an abnormal code."""
WRONG_PC: Final = 0x10
MODE_ERROR: Final = 0x11
REMOTE_ERROR: Final = 0x18

OWN_PC: Final = 0xFF
_HEADER_BYTES: Final = 4
_BATCH_BYTES: Final = 12
_BITS_READ, _BITS_WRITTEN, _BITS_AT_RANDOM = 256, 160, 80
_BIT_DEVICE_WORDS_READ, _BIT_DEVICE_WORDS_WRITTEN, _WORDS, _WORDS_AT_RANDOM = 32, 10, 64, 10
_LOOPBACK_BYTES: Final = 254


class Abnormal1EError(RequestError):
    """Raised for a request that is answered with end code 5Bh.

    Attributes:
        abnormal_code: Code that follows the end code.
    """

    def __init__(self, abnormal_code: int) -> None:
        super().__init__(NOT_PROCESSED)
        self.abnormal_code = abnormal_code


@dataclass(frozen=True, slots=True)
class Frame1E:
    """Frame 1E in binary or ASCII code.

    Attributes:
        is_ascii: True for ASCII code.
        timer: Monitoring timer of a request, 250 ms.
    """

    is_ascii: bool = False
    timer: int = 10

    @classmethod
    def of(cls, data: bytes) -> Frame1E:
        """Return the code that data starts with: a binary subheader is less than 20h, a digit is not.

        Raises:
            FrameError: No frame starts in this way.
        """
        if data[:1] in (b"0", b"1"):
            return cls(is_ascii=True)
        if data[0] >= ord(" "):
            raise FrameError(f"first byte {data[0]:02X}h: not a 1E frame")
        return cls()

    def request_length(self, data: bytes) -> int | None:
        """Return the length of the request that data starts with, or None if more data is needed to determine it.

        The end of a request with an unknown subheader or another character than a digit is not known: all data received
        so far counts as this request.
        """
        scale = 1 + self.is_ascii
        try:
            reader = FrameReader(data, is_ascii=self.is_ascii)
            subheader = reader.number(1)
            if subheader not in SUBHEADERS.values():
                return len(data)
            reader.number(3)
            size = _HEADER_BYTES
            if subheader <= 0x03:
                reader.number(6)
                count = reader.number(1) or 256
                size = _BATCH_BYTES
                if subheader == SUBHEADERS[WriteBits]:
                    return size * scale + (count + count % 2 if self.is_ascii else (count + 1) // 2)
                if subheader == SUBHEADERS[WriteWords]:
                    size += 2 * count
            elif subheader in (0x04, 0x05):
                size += 2 + reader.number(1) * (7 if subheader == SUBHEADERS[WriteRandomBits] else 8)
            elif subheader == SUBHEADERS[SelfTest]:
                size += 1 + reader.number(1)
        except ShortFrameError:
            return None
        except DigitError:
            return len(data)
        return size * scale

    def reply_length(self, data: bytes, request: Request) -> int | None:
        """Return the length of the reply to a request, or None if more data is needed to determine it."""
        scale = 1 + self.is_ascii
        if len(data) < 2 * scale:
            return None
        code = FrameReader(data[scale:], is_ascii=self.is_ascii).number(1)
        if code:
            return (4 if code == NOT_PROCESSED else 2) * scale
        match request:
            case ReadBits(_, count):
                return 2 * scale + (count + count % 2 if self.is_ascii else (count + 1) // 2)
            case ReadWords(_, count):
                return (2 + 2 * count) * scale
            case ReadTypeName():
                return 4 * scale
            case SelfTest(sent):
                return (3 + len(sent)) * scale
        return 2 * scale

    def encode_request(self, request: Request) -> bytes:
        """Return the frame of a request.

        Raises:
            RequestError: The frame 1E has no such request.
        """
        if type(request) not in SUBHEADERS:
            raise RequestError(UNKNOWN_SUBHEADER)
        writer = self._writer(SUBHEADERS[type(request)])
        writer.number(OWN_PC, 1)
        writer.number(self.timer, 2)
        match request:
            case ReadBits(first, count) | ReadWords(first, count):
                _put_batch(writer, first, count)
            case WriteBits(first, levels):
                _put_batch(writer, first, len(levels))
                writer.bits(levels, pad=True)
            case WriteWords(first, values):
                _put_batch(writer, first, len(values))
                writer.numbers(values, 2)
            case WriteRandomBits(levels=pairs):
                _put_random(writer, pairs, 1)
            case WriteRandomWords(pairs, ()):
                _put_random(writer, pairs, 2)
            case SelfTest(data):
                writer.number(len(data), 1)
                writer.numbers(data, 1)
        return bytes(writer)

    def decode_request(self, frame: bytes) -> Request:
        """Return the request in a complete frame.

        Raises:
            RequestError: The request is answered with an end code.
        """
        reader = FrameReader(frame, is_ascii=self.is_ascii)
        try:
            subheader, pc, _ = reader.number(1), reader.number(1), reader.number(2)
            if subheader not in SUBHEADERS.values():
                raise RequestError(UNKNOWN_SUBHEADER)
            if pc != OWN_PC:
                raise Abnormal1EError(WRONG_PC)
            request = _batch(reader, subheader) if subheader <= 0x03 else _other(reader, subheader)
        except DigitError as error:
            raise RequestError(NOT_HEXADECIMAL) from error
        except ShortFrameError as error:
            raise RequestError(TOO_MANY_POINTS) from error
        return request

    def encode_reply(self, request: Request, reply: Reply) -> bytes:
        """Return the frame of the reply to a request."""
        writer = self._writer(SUBHEADERS[type(request)] | _RESPONSE)
        writer.number(0, 1)
        if isinstance(request, ReadBits) and isinstance(reply, tuple):
            writer.bits([bool(level) for level in reply], pad=True)
        elif isinstance(reply, tuple):
            writer.numbers(reply, 2)
        elif isinstance(reply, TypeName):
            writer.number(reply.code, 1)
            writer.number(0, 1)
        elif isinstance(reply, bytes):
            writer.number(len(reply), 1)
            writer.numbers(reply, 1)
        return bytes(writer)

    def encode_error(self, frame: bytes, error: RequestError) -> bytes:
        """Return the frame that refuses a request; its subheader is that of the request."""
        try:
            subheader = FrameReader(frame, is_ascii=self.is_ascii).number(1)
        except FrameError:
            subheader = 0
        writer = self._writer((subheader | _RESPONSE) & 0xFF)
        writer.number(error.code, 1)
        if isinstance(error, Abnormal1EError):
            writer.number(error.abnormal_code, 1)
            writer.number(0, 1)
        return bytes(writer)

    def decode_reply(self, frame: bytes, request: Request) -> Reply:
        """Return the reply in a complete frame.

        Raises:
            RefusedError: The reply contains an end code other than 0.
            FrameError: The frame is not a reply to this request.
        """
        reader = FrameReader(frame, is_ascii=self.is_ascii)
        if reader.number(1) != SUBHEADERS[type(request)] | _RESPONSE:
            raise FrameError(f"{frame.hex(' ')}: not a reply to {type(request).__name__}")
        code = reader.number(1)
        if code:
            raise RefusedError(request, code, reader.number(1) if code == NOT_PROCESSED else 0)
        reply: Reply = None
        match request:
            case ReadBits(_, count):
                reply = reader.bits(count, pad=True)
            case ReadWords(_, count):
                reply = reader.numbers(count, 2)
            case ReadTypeName():
                reply = TypeName(reader.number(1))
                reader.number(1)
            case SelfTest():
                reply = bytes(reader.numbers(reader.number(1), 1))
        if reader.left:
            raise FrameError(f"{frame.hex(' ')}: {reader.left} bytes too many")
        return reply

    def _writer(self, subheader: int) -> FrameWriter:
        writer = FrameWriter(is_ascii=self.is_ascii)
        writer.number(subheader, 1)
        return writer


def _put_device(writer: FrameWriter, device: Device) -> None:
    code = KINDS[device.kind].code_1e
    if code is None:
        raise RequestError(WRONG_DEVICE)
    fields = ((code, 2), (device.number, 4)) if writer.is_ascii else ((device.number, 4), (code, 2))
    for value, size in fields:
        writer.number(value, size)


def _device(reader: FrameReader) -> Device:
    if reader.is_ascii:
        code, number = reader.number(2), reader.number(4)
    else:
        number, code = reader.number(4), reader.number(2)
    if code not in BY_CODE_1E:
        raise RequestError(WRONG_DEVICE)
    return Device(BY_CODE_1E[code].name, number)


def _put_batch(writer: FrameWriter, first: Device, count: int) -> None:
    _put_device(writer, first)
    if not 1 <= count <= _BITS_READ:
        raise RequestError(TOO_MANY_POINTS)
    writer.number(count % 256, 1)
    writer.number(0, 1)


def _put_random(writer: FrameWriter, pairs: tuple[tuple[Device, int], ...], size: int) -> None:
    writer.number(len(pairs), 1)
    writer.number(0, 1)
    for device, value in pairs:
        _put_device(writer, device)
        writer.number(int(value), size)


def _batch(reader: FrameReader, subheader: int) -> Request:
    first, count = _device(reader), reader.number(1) or 256
    reader.number(1)
    is_write = subheader >= SUBHEADERS[WriteBits]
    if subheader in (SUBHEADERS[ReadBits], SUBHEADERS[WriteBits]):
        _check_bits(first, count, _BITS_WRITTEN if is_write else _BITS_READ)
        return WriteBits(first, reader.bits(count, pad=True)) if is_write else ReadBits(first, count)
    if KINDS[first.kind].is_bit:
        limit = _BIT_DEVICE_WORDS_WRITTEN if is_write else _BIT_DEVICE_WORDS_READ
        _check_alignment(first)
    else:
        limit = _WORDS
    if count > limit or splits_counter(first, count):
        raise RequestError(TOO_MANY_POINTS)
    return WriteWords(first, reader.numbers(count, 2)) if is_write else ReadWords(first, count)


def _other(reader: FrameReader, subheader: int) -> Request:
    if subheader == SUBHEADERS[WriteRandomBits]:
        bits = _random(reader, 1, _BITS_AT_RANDOM)
        for device, level in bits:
            _check_bits(device, 1, 1)
            if level > 1:
                raise RequestError(NOT_HEXADECIMAL)
        return WriteRandomBits(tuple((device, bool(level)) for device, level in bits))
    if subheader == SUBHEADERS[WriteRandomWords]:
        words = _random(reader, 2, _WORDS_AT_RANDOM)
        for device, _ in words:
            if has_two_words(device):
                raise RequestError(WRONG_DEVICE)
            if KINDS[device.kind].is_bit:
                _check_alignment(device)
        return WriteRandomWords(words)
    if subheader == SUBHEADERS[SelfTest]:
        size = reader.number(1)
        if not 1 <= size <= _LOOPBACK_BYTES:
            raise RequestError(TOO_MANY_POINTS)
        return SelfTest(bytes(reader.numbers(size, 1)))
    if subheader == SUBHEADERS[RemoteRun]:
        return RemoteRun()
    return RemoteStop() if subheader == SUBHEADERS[RemoteStop] else ReadTypeName()


def _random(reader: FrameReader, size: int, limit: int) -> tuple[tuple[Device, int], ...]:
    count = reader.number(1)
    reader.number(1)
    if not 1 <= count <= limit:
        raise RequestError(TOO_MANY_POINTS)
    return tuple((_device(reader), reader.number(size)) for _ in range(count))


def _check_bits(device: Device, count: int, limit: int) -> None:
    if not KINDS[device.kind].is_bit:
        raise RequestError(WRONG_HEAD)
    if count > limit:
        raise RequestError(TOO_MANY_POINTS)


def _check_alignment(device: Device) -> None:
    """Refuse a bit device in a word command unless its number is a multiple of 16; M8000 is one."""
    if device.number % BITS_PER_WORD:
        raise RequestError(WRONG_HEAD)
