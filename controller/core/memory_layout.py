"""Arrangement of device memory in one region, for programs executed as machine code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

from controller.core.devices import SIZES

WORD_BYTES: Final = 8


class MemoryRow(NamedTuple):
    """Devices of one kind in the memory region.

    Attributes:
        offset: Position of the first device, bytes.
        length: Number of devices.
    """

    offset: int
    length: int


class MemoryLayout:
    """Arrangement of the device memory of a program in one region.

    Attributes:
        words: Rows of 64-bit words, by name of the list in `Memory`.
        bits: Rows of bytes, by name of the list in `Memory`; "L" contains the states left by a transfer in this scan.
        size: Size of the region, bytes.
    """

    def __init__(self, edges: int, devices: Mapping[str, int] = SIZES) -> None:
        """Arrange the memory of a program.

        Args:
            edges: Number of PLS and PLF rungs.
            devices: Number of devices of each kind.
        """
        kinds = (("TV", "T"), ("TS", "T"), ("CV", "C"), ("CE", "C"), ("L", "S"))
        sizes = {name: devices[kind] for name, kind in kinds}
        sizes |= dict(devices) | {"E": max(edges, 1)}
        self.words: dict[str, MemoryRow] = {}
        self.bits: dict[str, MemoryRow] = {}
        at = 0
        for name in ("D", "TV", "TS", "CV"):
            self.words[name] = MemoryRow(at, sizes[name])
            at += sizes[name] * WORD_BYTES
        for name in ("X", "Y", "M", "S", "T", "C", "CE", "E", "L"):
            self.bits[name] = MemoryRow(at, sizes[name])
            at += sizes[name]
        self.size = at

    def bit(self, row: str, number: int) -> int:
        """Return the byte offset of a bit."""
        return self.bits[row].offset + number

    def word(self, row: str, number: int) -> int:
        """Return the byte offset of a word."""
        return self.words[row].offset + number * WORD_BYTES
