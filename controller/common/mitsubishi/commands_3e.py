"""Commands of the MC protocol frames 3E and 4E: the data after the header, in both directions.

Sources: FX5 user's manual (MELSEC communication protocol), "Device access" (formats; numbers of points, half of them in
ASCII code); the limits of an FX5U and their end codes as measured by plc-comm-slmp 5.2 (profile iq-f, marked "live").
The subcommands for iQ-R (0002 and 0003) and monitoring (0801, 0802) are refused with C059h, as an FX5U refuses the
latter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.common.mitsubishi.devices import BY_CODE_3E, BY_TEXT_3E, KINDS, Device
from controller.common.mitsubishi.framing import FrameReader, FrameWriter, parsed
from controller.common.mitsubishi.requests import (
    FrameError,
    ReadBits,
    ReadBlocks,
    ReadRandom,
    ReadTypeName,
    ReadWords,
    RemoteRun,
    RemoteStop,
    Reply,
    Request,
    RequestError,
    SelfTest,
    TypeName,
    WriteBits,
    WriteBlocks,
    WriteRandomBits,
    WriteRandomWords,
    WriteWords,
)

TOO_MANY_WORDS: Final = 0xC051
TOO_MANY_BITS: Final = 0xC052
TOO_MANY_RANDOM_BITS: Final = 0xC053
TOO_MANY_RANDOM_WORDS: Final = 0xC054
UNKNOWN_COMMAND: Final = 0xC059
NO_SUCH_DEVICE: Final = 0xC05B
WRONG_CONTENTS: Final = 0xC05C
WRONG_LENGTH: Final = 0xC061
TOO_MANY_BLOCKS: Final = 0xC0D8

COMMANDS: Final[dict[type[Request], tuple[int, int]]] = {
    ReadBits: (0x0401, 0x0001),
    ReadWords: (0x0401, 0x0000),
    WriteBits: (0x1401, 0x0001),
    WriteWords: (0x1401, 0x0000),
    ReadRandom: (0x0403, 0x0000),
    WriteRandomBits: (0x1402, 0x0001),
    WriteRandomWords: (0x1402, 0x0000),
    ReadBlocks: (0x0406, 0x0000),
    WriteBlocks: (0x1406, 0x0000),
    RemoteRun: (0x1001, 0x0000),
    RemoteStop: (0x1002, 0x0000),
    ReadTypeName: (0x0101, 0x0000),
    SelfTest: (0x0619, 0x0000),
}
"""Command and subcommand of each request."""
_TYPES: Final = {command: request for request, command in COMMANDS.items()}

_WORDS, _BITS, _RANDOM_WORDS_READ, _RANDOM_BITS, _RANDOM_COST, _BLOCKS = 960, 3_584, 192, 188, 1_920, 120
"""Limits in binary code; in ASCII code half of each."""
_WORD_COST, _DOUBLE_WORD_COST = 12, 14
"""Weights in the limit of a random write of words."""
_NAME_BYTES: Final = 16
_LOOPBACK_BYTES: Final = 960


def write_request(writer: FrameWriter, request: Request) -> None:
    """Append command, subcommand and data of a request."""
    writer.numbers(COMMANDS[type(request)], 2)
    match request:
        case ReadBits(first, count) | ReadWords(first, count):
            _put_head(writer, first, count)
        case WriteBits(first, levels):
            _put_head(writer, first, len(levels))
            writer.bits(levels)
        case WriteWords(first, values):
            _put_head(writer, first, len(values))
            writer.numbers(values, 2)
        case ReadRandom() | WriteRandomBits() | WriteRandomWords():
            _put_random(writer, request)
        case ReadBlocks() | WriteBlocks():
            _put_blocks(writer, request)
        case RemoteRun():
            writer.numbers((1, 0), 2)  # mode: not forced; the second number is the clear mode and a reserved byte
        case RemoteStop():
            writer.number(1, 2)
        case SelfTest(data):
            writer.number(len(data), 2)
            writer.raw(data)


def read_request(reader: FrameReader) -> Request:
    """Return the request that consists of the remaining fields, from the command on.

    Raises:
        RequestError: The request is answered with an end code.
        FrameError: A field is missing, or is not a number.
    """
    kind = _TYPES.get((reader.number(2), reader.number(2)))
    if kind is None:
        raise RequestError(UNKNOWN_COMMAND)
    request = _READERS[kind](reader)
    if reader.left:
        raise RequestError(WRONG_LENGTH)
    return request


def write_reply(writer: FrameWriter, request: Request, reply: Reply) -> None:
    """Append the data of a reply."""
    if isinstance(reply, TypeName):
        writer.raw(reply.name.encode().ljust(_NAME_BYTES))
        writer.number(reply.code, 2)
    elif isinstance(reply, bytes):
        writer.number(len(reply), 2)
        writer.raw(reply)
    elif reply is not None and isinstance(request, ReadBits):
        writer.bits([bool(level) for level in reply])
    elif reply is not None:
        words = len(request.words) if isinstance(request, ReadRandom) else len(reply)
        writer.numbers(reply[:words], 2)
        writer.numbers(reply[words:], 4)


def read_reply(reader: FrameReader, request: Request) -> Reply:
    """Return the reply that consists of the remaining fields.

    Raises:
        FrameError: The data does not fit the request.
    """
    reply: Reply = None
    match request:
        case ReadBits(_, count):
            reply = reader.bits(count)
        case ReadWords(_, count):
            reply = reader.numbers(count, 2)
        case ReadRandom(words, double_words):
            reply = reader.numbers(len(words), 2) + reader.numbers(len(double_words), 4)
        case ReadBlocks(word_blocks, bit_blocks):
            reply = reader.numbers(sum(block.count for block in word_blocks + bit_blocks), 2)
        case ReadTypeName():
            name = reader.raw(_NAME_BYTES).decode("ascii", "replace").rstrip()
            reply = TypeName(reader.number(2), name)
        case SelfTest():
            reply = reader.raw(reader.number(2))
    if reader.left:
        raise FrameError(f"reply to {type(request).__name__}: {reader.left} bytes too many")
    return reply


def _put_device(writer: FrameWriter, device: Device) -> None:
    kind = KINDS[device.kind]
    if writer.is_ascii:
        number = f"{device.number:06X}" if kind.is_hexadecimal else f"{device.number:06d}"
        writer.raw(f"{kind.text_3e}{number}".encode())
    else:
        writer.number(device.number, 3)
        writer.number(kind.code_3e, 1)


def _put_head(writer: FrameWriter, first: Device, count: int) -> None:
    _put_device(writer, first)
    writer.number(count, 2)


def _put_random(writer: FrameWriter, request: ReadRandom | WriteRandomBits | WriteRandomWords) -> None:
    match request:
        case ReadRandom(words, double_words):
            writer.numbers((len(words), len(double_words)), 1)
            for device in words + double_words:
                _put_device(writer, device)
        case WriteRandomBits(levels=pairs):
            writer.number(len(pairs), 1)
            _put_values(writer, pairs, 1)
        case WriteRandomWords(pairs, double_pairs):
            writer.numbers((len(pairs), len(double_pairs)), 1)
            _put_values(writer, pairs, 2)
            _put_values(writer, double_pairs, 4)


def _put_blocks(writer: FrameWriter, request: ReadBlocks | WriteBlocks) -> None:
    blocks: tuple[ReadWords | WriteWords, ...] = (*request.word_blocks, *request.bit_blocks)
    writer.numbers((len(request.word_blocks), len(request.bit_blocks)), 1)
    for block in blocks:
        if isinstance(block, ReadWords):
            _put_head(writer, block.first, block.count)
        else:
            _put_head(writer, block.first, len(block.values))
            writer.numbers(block.values, 2)


def _put_values(writer: FrameWriter, pairs: Sequence[tuple[Device, int]], size: int) -> None:
    for device, value in pairs:
        _put_device(writer, device)
        writer.number(int(value), size)


def _device(reader: FrameReader) -> Device:
    if reader.is_ascii:
        text, digits = reader.raw(2).decode("ascii", "replace"), reader.raw(6).lstrip(b" ")
        kind = BY_TEXT_3E.get(text)
        if kind is None:
            raise RequestError(NO_SUCH_DEVICE)
        return Device(kind.name, parsed(digits, 16 if kind.is_hexadecimal else 10))
    number, code = reader.number(3), reader.number(1)
    if code not in BY_CODE_3E:
        raise RequestError(NO_SUCH_DEVICE)
    return Device(BY_CODE_3E[code].name, number)


def _head(reader: FrameReader, limit: int, code: int) -> tuple[Device, int]:
    """Return first device and count of a batch command."""
    first, count = _device(reader), reader.number(2)
    _check_count(reader, count, limit, code)
    return first, count


def _check_count(reader: FrameReader, count: int, limit: int, code: int) -> None:
    if not 1 <= count <= limit // (1 + reader.is_ascii):
        raise RequestError(code)


def _require_bits(device: Device) -> None:
    if not KINDS[device.kind].is_bit:
        raise RequestError(WRONG_CONTENTS)


def _read_bits(reader: FrameReader) -> Request:
    first, count = _head(reader, _BITS, TOO_MANY_BITS)
    _require_bits(first)
    return ReadBits(first, count)


def _read_words(reader: FrameReader) -> Request:
    return ReadWords(*_head(reader, _WORDS, TOO_MANY_WORDS))


def _write_bits(reader: FrameReader) -> Request:
    first, count = _head(reader, _BITS, TOO_MANY_BITS)
    _require_bits(first)
    return WriteBits(first, reader.bits(count))


def _write_words(reader: FrameReader) -> Request:
    first, count = _head(reader, _WORDS, TOO_MANY_WORDS)
    return WriteWords(first, reader.numbers(count, 2))


def _read_random(reader: FrameReader) -> Request:
    words, double_words = reader.numbers(2, 1)
    _check_count(reader, words + double_words, _RANDOM_WORDS_READ, TOO_MANY_RANDOM_WORDS)
    devices = tuple(_device(reader) for _ in range(words + double_words))
    return ReadRandom(devices[:words], devices[words:])


def _write_random_bits(reader: FrameReader) -> Request:
    count = reader.number(1)
    _check_count(reader, count, _RANDOM_BITS, TOO_MANY_RANDOM_BITS)
    pairs = tuple((_device(reader), reader.number(1)) for _ in range(count))
    for device, level in pairs:
        _require_bits(device)
        if level > 1:
            raise RequestError(WRONG_CONTENTS)
    return WriteRandomBits(tuple((device, bool(level)) for device, level in pairs))


def _write_random_words(reader: FrameReader) -> Request:
    words, double_words = reader.numbers(2, 1)
    cost = _WORD_COST * words + _DOUBLE_WORD_COST * double_words
    _check_count(reader, cost, _RANDOM_COST, TOO_MANY_RANDOM_WORDS)
    pairs = tuple((_device(reader), reader.number(2)) for _ in range(words))
    return WriteRandomWords(pairs, tuple((_device(reader), reader.number(4)) for _ in range(double_words)))


def _block_counts(reader: FrameReader) -> tuple[int, int]:
    word_blocks, bit_blocks = reader.numbers(2, 1)
    _check_count(reader, word_blocks + bit_blocks, _BLOCKS, TOO_MANY_BLOCKS)
    return word_blocks, bit_blocks


def _check_blocks(reader: FrameReader, devices: Sequence[Device], word_blocks: int, points: int) -> None:
    if any(KINDS[device.kind].is_bit for device in devices[:word_blocks]):
        raise RequestError(WRONG_CONTENTS)
    for device in devices[word_blocks:]:
        _require_bits(device)
    _check_count(reader, points, _WORDS, TOO_MANY_WORDS)


def _read_blocks(reader: FrameReader) -> Request:
    word_blocks, bit_blocks = _block_counts(reader)
    blocks = tuple(ReadWords(*_head(reader, _WORDS, TOO_MANY_WORDS)) for _ in range(word_blocks + bit_blocks))
    _check_blocks(reader, [block.first for block in blocks], word_blocks, sum(block.count for block in blocks))
    return ReadBlocks(blocks[:word_blocks], blocks[word_blocks:])


def _write_blocks(reader: FrameReader) -> Request:
    word_blocks, bit_blocks = _block_counts(reader)
    blocks = []
    for _ in range(word_blocks + bit_blocks):
        first, count = _head(reader, _WORDS, TOO_MANY_WORDS)
        blocks.append(WriteWords(first, reader.numbers(count, 2)))
    _check_blocks(reader, [block.first for block in blocks], word_blocks, sum(len(block.values) for block in blocks))
    return WriteBlocks(tuple(blocks[:word_blocks]), tuple(blocks[word_blocks:]))


def _remote_run(reader: FrameReader) -> Request:
    reader.numbers(2, 2)  # mode, and clear mode with a reserved byte: the memory is not cleared
    return RemoteRun()


def _remote_stop(reader: FrameReader) -> Request:
    reader.number(2)
    return RemoteStop()


def _self_test(reader: FrameReader) -> Request:
    size = reader.number(2)
    if not 1 <= size <= _LOOPBACK_BYTES:
        raise RequestError(WRONG_CONTENTS)
    return SelfTest(reader.raw(size))


_READERS: Final = {
    ReadBits: _read_bits,
    ReadWords: _read_words,
    WriteBits: _write_bits,
    WriteWords: _write_words,
    ReadRandom: _read_random,
    WriteRandomBits: _write_random_bits,
    WriteRandomWords: _write_random_words,
    ReadBlocks: _read_blocks,
    WriteBlocks: _write_blocks,
    RemoteRun: _remote_run,
    RemoteStop: _remote_stop,
    ReadTypeName: lambda _reader: ReadTypeName(),
    SelfTest: _self_test,
}
"""Function that reads the data of each request."""
