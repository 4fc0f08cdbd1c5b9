"""Blocks of points that are transferred in one request."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from controller.common.modbus.client_requests import (
    WORD_TABLES,
    ModbusRequest,
    read,
    unpacked,
    write_coils,
    write_registers,
)
from controller.common.modbus.io_map import ModbusTable
from controller.io.field.field_file import place_of
from controller.io.field.schema import ModuleTraits

_BITS_A_WORD = 16


@dataclass(frozen=True, slots=True)
class PointBlock:
    """Points with consecutive offsets, or in consecutive registers.

    Attributes:
        table: Modbus table.
        first: First offset or register.
        count: Number of bits or registers.
        places: Number of each point and its bit in the block, by ascending bit.
    """

    table: ModbusTable
    first: int
    count: int
    places: tuple[tuple[int, int], ...]

    @property
    def is_packed(self) -> bool:
        """True for points in registers."""
        return self.table in WORD_TABLES

    def read(self, what: str, first: int | None = None) -> ModbusRequest:
        """Return the request that reads the block.

        Args:
            what: Noun for messages.
            first: First offset, if it is not that of the block.
        """
        return read(self.table, self.first if first is None else first, self.count, what)

    def write(self, image: Sequence[bool]) -> ModbusRequest:
        """Return the request that writes the levels of an image."""
        if self.is_packed:
            return write_registers(self.first, self.words(image))
        return write_coils(self.first, self.count, self._bits(image), "outputs")

    def words(self, image: Sequence[bool]) -> list[int]:
        """Return the registers of the levels of an image; bits without a point are 0."""
        bits = self._bits(image)
        return [bits >> _BITS_A_WORD * n & 0xFFFF for n in range(self.count)]

    def store(self, data: bytes, image: list[bool]) -> None:
        """Write the levels in the data of an answer to an image."""
        if self.is_packed:
            bits = sum(word << _BITS_A_WORD * n for n, word in enumerate(unpacked(data)))
        else:
            bits = int.from_bytes(data, "little")
        for number, bit in self.places:
            image[number] = bool(bits >> bit & 1)

    def _bits(self, image: Sequence[bool]) -> int:
        return sum(1 << bit for number, bit in self.places if image[number])


def blocks_of(letter: str, wires: Iterable[tuple[int, int]], traits: ModuleTraits) -> tuple[PointBlock, ...]:
    """Return the smallest number of blocks without an offset or a register that has no point.

    Strict modules reject a request for an undeclared offset; a register without a point may have another use.

    Args:
        letter: X or Y.
        wires: Number and offset of each point.
        traits: Properties of the module.
    """
    runs: list[tuple[ModbusTable, int, list[tuple[int, int]]]] = []
    places = [(place, number) for number, offset in wires if (place := place_of(letter, offset, traits)) is not None]
    last = None
    for (table, offset, bit), number in sorted(places, key=lambda each: (each[0][1], each[0][2] or 0)):
        if last is None or offset > last + 1:
            runs.append((table, offset, []))
        last = offset
        run = runs[-1]
        run[2].append((number, offset - run[1] if bit is None else _BITS_A_WORD * (offset - run[1]) + bit))
    return tuple(PointBlock(table, first, _count(table, points), tuple(points)) for table, first, points in runs)


def _count(table: ModbusTable, points: Sequence[tuple[int, int]]) -> int:
    last = points[-1][1]
    return last // _BITS_A_WORD + 1 if table in WORD_TABLES else last + 1


def register_runs(registers: Iterable[tuple[int, int]]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Return the first offset and the numbers of each run of consecutive registers."""
    runs: list[tuple[int, list[int]]] = []
    for offset, number in sorted((offset, number) for number, offset in registers):
        if not runs or offset != runs[-1][0] + len(runs[-1][1]):
            runs.append((offset, []))
        runs[-1][1].append(number)
    return tuple((first, tuple(numbers)) for first, numbers in runs)
