"""Execution of MC protocol requests on the devices of a PLC."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.common.mitsubishi.devices import KINDS, Device
from controller.common.mitsubishi.requests import (
    BITS_PER_WORD,
    ReadBits,
    ReadBlocks,
    ReadRandom,
    ReadTypeName,
    ReadWords,
    RemoteRun,
    RemoteStop,
    Reply,
    Request,
    SelfTest,
    TypeName,
    WriteBits,
    WriteBlocks,
    WriteRandomBits,
    WriteRandomWords,
    WriteWords,
    bits_of_words,
    has_two_words,
    words_of_bits,
)
from controller.hmi.serving.devices import AccessRefusal, AccessRefusedError, DeviceAccess

_SPECIAL_DEVICES: Final = {"SM": "M", "SD": "D"}
_FIRST_SPECIAL: Final = 8000

BitPairs = list[tuple[Device, bool]]
WordPairs = list[tuple[Device, int]]


async def execute(access: DeviceAccess, request: Request, model: TypeName) -> Reply:
    """Execute a request and return its reply.

    Args:
        access: Devices of the PLC as the client may read and write them.
        request: The request.
        model: Model that the PLC reports.

    Raises:
        AccessRefusedError: The request is refused; nothing has changed.
    """
    reply: Reply = None
    match request:
        case ReadBits() | ReadWords() | ReadRandom() | ReadBlocks():
            reply = _read(access, request)
        case SelfTest(data):
            reply = data
        case ReadTypeName():
            reply = model
        case RemoteRun() | RemoteStop():
            await access.set_running(running=isinstance(request, RemoteRun))
        case _:
            await _write(access, request)
    return reply


def _read(access: DeviceAccess, request: ReadBits | ReadWords | ReadRandom | ReadBlocks) -> Reply:
    match request:
        case ReadBits(first, count):
            return tuple(access.read_bits(_own(first), count))
        case ReadWords(first, count):
            return _words(access, first, count)
        case ReadRandom(words, double_words):
            values = [_words(access, device, 1)[0] for device in words]
            pairs = [_words(access, device, 2) for device in double_words]
            return (*values, *(low | high << 16 for low, high in pairs))
        case ReadBlocks(word_blocks, bit_blocks):
            blocks = (_words(access, block.first, block.count) for block in word_blocks + bit_blocks)
            return tuple(word for block in blocks for word in block)


def _words(access: DeviceAccess, first: Device, count: int) -> tuple[int, ...]:
    if KINDS[first.kind].is_bit:
        return words_of_bits(tuple(access.read_bits(_own(first), BITS_PER_WORD * count)))
    return tuple(access.read_words(_own(first), count))


async def _write(access: DeviceAccess, request: Request) -> None:
    """Write all bits and words of a request, or none."""
    try:
        bits, words = _written(request)
    except AccessRefusedError as error:
        raise access.refused(type(request).__name__, "", error.refusal) from error
    if bits:
        await access.write_bits(bits)
    else:
        await access.write_words(words)


def _written(request: Request) -> tuple[BitPairs, WordPairs]:
    """Return the bits or the words that a request writes.

    Raises:
        AccessRefusedError: A device does not exist, a value is not complete, or there are bits and words.
    """
    bits: BitPairs = []
    words: WordPairs = []
    match request:
        case WriteBits(first, levels):
            bits = _following(first, levels)
        case WriteWords(first, values):
            _add_words(first, values, bits, words)
        case WriteRandomBits(pairs):
            bits = [(_own(device), level) for device, level in pairs]
        case WriteRandomWords(word_pairs, double_pairs):
            for device, value in word_pairs:
                _add_words(device, (value,), bits, words)
            for device, value in double_pairs:
                _add_words(device, (value & 0xFFFF, value >> 16), bits, words)
        case WriteBlocks(word_blocks, bit_blocks):
            for block in word_blocks + bit_blocks:
                _add_words(block.first, block.values, bits, words)
    if bits and words:  # they could not be refused together
        raise AccessRefusedError(AccessRefusal.NOT_SUPPORTED)
    return bits, words


def _add_words(first: Device, values: Sequence[int], bits: BitPairs, words: WordPairs) -> None:
    """Append the words from a device on; those of bit devices as bits, two words of a 32-bit counter as one value."""
    if KINDS[first.kind].is_bit:
        bits += _following(first, bits_of_words(tuple(values)))
        return
    number, left = first.number, list(values)
    while left:
        device = _own(Device(first.kind, number))
        value = left.pop(0)
        if has_two_words(device):
            if not left:
                raise AccessRefusedError(AccessRefusal.BAD_VALUE)
            value |= left.pop(0) << 16
        words.append((device, value))
        number += 1


def _following(first: Device, levels: Sequence[bool]) -> BitPairs:
    start = _own(first)
    return [(Device(start.kind, start.number + index), level) for index, level in enumerate(levels)]


def _own(device: Device) -> Device:
    """Return the device of an FX2N; the special devices of an FX5 from SM8000 and SD8000 on are M8000 and D8000."""
    kind = _SPECIAL_DEVICES.get(device.kind)
    if kind is None:
        return device
    if device.number < _FIRST_SPECIAL:
        raise AccessRefusedError(AccessRefusal.NO_DEVICE)
    return Device(kind, device.number)
