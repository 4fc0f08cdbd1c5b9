"""Reader of whole scans: the memory at END of a scan and of the scans before it, over Modbus."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Final

from controller.common.modbus.client_requests import ExceptionReplyError
from controller.core.devices import WORD_MAX, Memory, is_32_bit_counter
from controller.fx.language.cpu_model import FX3U
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.fx3u_map import (
    HELD_SCAN,
    Span,
    bit_spans,
    coil_address,
    discrete_address,
    register_address,
    register_spans,
)
from controller.hmi.serving.snapshot import HELD_SCANS, HELD_WORDS, HOLD

MOST_BITS: Final = 2_000
MOST_WORDS: Final = 124
"""Numbers of values in one request; an even number of words keeps the two words of a counter together."""
_BIT_GAP, _WORD_GAP = 400, 25
"""Unused devices that are read because another request would take longer: those of about 50 bytes."""
_WORD_KINDS: Final = {"D": "D", "R": "R", "T": "TN", "C": "CN"}

Used = Collection[tuple[str, int]]
"""Kinds and numbers of devices; X and Y by the value of the octal label."""


@dataclass(frozen=True, slots=True)
class HeldScan:
    """Scan that was held while it was read.

    Attributes:
        number: Number of the scan.
        at_ms: Time of the scan, ms.
        memory: Memory at END of the scan; devices that are not read are off or 0.
    """

    number: int
    at_ms: int
    memory: Memory


class HeldScanReader:
    """Reader of the devices of one program."""

    def __init__(self, connection: ModbusConnection, used: Used) -> None:
        """Initialise a reader.

        Args:
            connection: Connection on which scans are held; all its other reads concern the held scan as well.
            used: Devices to read; the current value of a timer or counter is read with its contact. Devices without a
                Modbus address are ignored.
        """
        self._connection = connection
        self._bits = list(_blocks(bit_spans("discrete"), used, _BIT_GAP, MOST_BITS))
        words = {(_WORD_KINDS[kind], number) for kind, number in used if kind in _WORD_KINDS}
        self._words = list(_blocks(register_spans(), words, _WORD_GAP, MOST_WORDS))

    async def read(self, scans: int = 1) -> tuple[HeldScan, ...]:
        """Hold the last scan, and return it and the scans before it; the connection holds them until the next call.

        Args:
            scans: Number of scans to read, 1 to `HELD_SCANS`; after the start there are fewer.

        Raises:
            ModbusClientError: The server did not respond.
            ExceptionReplyError: No scan has been completed yet, or the server cannot hold scans.
            ValueError: The number of scans is invalid.
        """
        if not 1 <= scans <= HELD_SCANS:
            raise ValueError(f"{scans} scans cannot be held; 1 to {HELD_SCANS} can")
        await self._connection.write_word(HELD_SCAN, HOLD)
        held = [await self._scan()]
        for before in range(1, scans):
            try:
                await self._connection.write_word(HELD_SCAN, HOLD + before)
            except ExceptionReplyError:  # too few scans since the start
                break
            held.append(await self._scan())
        return tuple(held)

    async def _scan(self) -> HeldScan:
        _, *words = await self._connection.read_words(HELD_SCAN, HELD_WORDS)
        return HeldScan(words[0] | words[1] << 16, words[2] | words[3] << 16, await self._memory())

    async def _memory(self) -> Memory:
        memory = Memory()
        if any(block.kind == "R" for block in self._words):
            memory.D += [0] * (FX3U.sizes["D"] - len(memory.D))
        for block in self._bits:
            if block.kind == "X":
                bits = await self._connection.read_bits(discrete_address("X", block.number), block.count, discrete=True)
            else:
                bits = await self._connection.read_bits(coil_address(block.kind, block.number), block.count)
            memory.bits(block.kind)[block.number : block.number + block.count] = bits
        for block in self._words:
            words = await self._connection.read_words(register_address(block.kind, block.number), block.count)
            kind = block.kind.removesuffix("N")
            for number, value in _values(block, words):
                memory.set_word(kind, number, value)
        return memory


def _blocks(spans: Collection[Span], used: Used, gap: int, most: int) -> Iterator[Span]:
    """Yield the requests for devices: spans of addresses with their first device."""
    for span in spans:
        addresses = sorted(
            address
            for kind, number in used
            if kind == span.kind and span.first <= (address := _address(span, number)) < span.end
        )
        while addresses:
            first = last = addresses[0]
            for address in addresses:
                if address - last > gap or address + _width(span, address) - first > most:
                    break
                last = address
            yield Span(first, span.kind, _number(span, first), last + _width(span, last) - first)
            addresses = [address for address in addresses if address > last]


def _address(span: Span, number: int) -> int:
    if span.kind == "CN":
        return register_address("CN", number)
    return span.first + number - span.number


def _number(span: Span, address: int) -> int:
    offset = address - span.first
    if span.kind == "CN" and is_32_bit_counter(offset):
        return _FIRST_LONG + (offset - _FIRST_LONG) // 2
    return span.number + offset


_FIRST_LONG: Final = next(number for number in range(256) if is_32_bit_counter(number))


def _width(span: Span, address: int) -> int:
    """Return the number of addresses of a device."""
    return 2 if span.kind == "CN" and is_32_bit_counter(address - span.first) else 1


def _values(block: Span, words: list[int]) -> Iterator[tuple[int, int]]:
    """Yield the numbers and signed values of the devices of a block."""
    number, index = block.number, 0
    while index < len(words):
        value, index = words[index], index + 1
        if block.kind == "CN" and is_32_bit_counter(number):
            value, index = value | words[index] << 16, index + 1
            value = value - 2**32 if value >= 2**31 else value
        elif value > WORD_MAX:
            value -= 2**16
        yield number, value
        number += 1
