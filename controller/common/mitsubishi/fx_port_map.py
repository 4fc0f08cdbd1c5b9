"""Addresses of devices at the programming port.

The basic commands and the extended commands have different maps. Bits are numbered in the unit of a force command: byte
address times 8 plus position. Sources of the basic map: bomingfeng/Fx2N, doc/FX2N-32MR-001, and KrystianD/fxplc, which
agree. Extended map: bits from the table of forces in bomingfeng/Fx2N (FX1N) and the watch lists of GX Works2 in
brooksg44/ISU-FX2N; a recording of GPPW with a real PLC (bomingfeng/Fx2N, doc) reads M8000-M8007 at 01C0h; D0 at 4000h
and D8000 at 0E00h from these recordings; T0 at 1000h and C0 at 0A00h from the words of the watch lists of a program
with T0 and C0. C200 at 0C00h in the extended map is an assumption.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.fx_port import Space


@dataclass(frozen=True, slots=True)
class Region:
    """Consecutive devices at consecutive addresses.

    Attributes:
        address: Byte address of the first device.
        first: First device.
        count: Number of devices.
        bits: Bits per device: 1, 16, or 32.
    """

    address: int
    first: Device
    count: int
    bits: int

    @property
    def end(self) -> int:
        """Byte address after the last device."""
        return self.address + (self.count * self.bits + 7) // 8


def _bits(address: int, kind: str, number: int, count: int) -> Region:
    return Region(address, Device(kind, number), count, 1)


def _words(address: int, kind: str, number: int, count: int) -> Region:
    return Region(address, Device(kind, number), count, 16)


_COUNTERS: Final = (_words(0x0A00, "CN", 0, 200), Region(0x0C00, Device("CN", 200), 56, 32))
_SPECIAL_REGISTERS: Final = _words(0x0E00, "D", 8000, 256)

REGIONS: Final[dict[Space, tuple[Region, ...]]] = {
    "basic": (
        _bits(0x0000, "S", 0, 1000),
        _bits(0x0080, "X", 0, 256),
        _bits(0x00A0, "Y", 0, 256),
        _bits(0x00C0, "T", 0, 256),
        _bits(0x0100, "M", 0, 1536),
        _bits(0x01C0, "C", 0, 256),
        _bits(0x01E0, "M", 8000, 256),
        _words(0x0800, "TN", 0, 256),
        *_COUNTERS,
        _SPECIAL_REGISTERS,
        _words(0x1000, "D", 0, 8000),
    ),
    "extended": (
        _bits(0x0000, "M", 0, 3072),
        _bits(0x0180, "Y", 0, 256),
        _bits(0x01C0, "M", 8000, 256),
        _bits(0x01E0, "C", 0, 256),
        _bits(0x0200, "T", 0, 256),
        _bits(0x0240, "X", 0, 256),
        _bits(0x0280, "S", 0, 1000),
        *_COUNTERS,
        _SPECIAL_REGISTERS,
        _words(0x1000, "TN", 0, 256),
        _words(0x4000, "D", 0, 8000),
    ),
    "program": (),
}
"""Regions of each address space."""


def region_of(space: Space, address: int) -> Region | None:
    """Return the region that contains a byte; None if no device is there."""
    return next((region for region in REGIONS[space] if region.address <= address < region.end), None)


def bit_device(space: Space, number: int) -> Device | None:
    """Return the bit device with a number in force commands and watch lists; None if there is none.

    Examples:
        >>> str(bit_device("basic", 0x0402)), str(bit_device("extended", 0x0E24)), str(bit_device("extended", 0x1208))
        ('X2', 'M8036', 'X10')
    """
    region = region_of(space, number // 8)
    if region is None or region.bits != 1:
        return None
    index = number - 8 * region.address
    return Device(region.first.kind, region.first.number + index) if index < region.count else None


def address_of(space: Space, device: Device) -> int:
    """Return the byte address of a device (for a bit, of the byte that contains it).

    Raises:
        KeyError: The address space does not contain the device.

    Examples:
        >>> hex(address_of("basic", Device("D", 123))), hex(address_of("extended", Device("CN", 201)))
        ('0x10f6', '0xc04')
    """
    for region in REGIONS[space]:
        index = device.number - region.first.number
        if region.first.kind == device.kind and 0 <= index < region.count:
            return region.address + index * region.bits // 8
    raise KeyError(device)


def bit_number(space: Space, device: Device) -> int:
    """Return the number of a bit device in force commands and watch lists.

    Raises:
        KeyError: The address space does not contain the device.

    Examples:
        >>> hex(bit_number("basic", Device("X", 2))), hex(bit_number("extended", Device("Y", 0)))
        ('0x402', '0xc00')
    """
    region = region_of(space, address_of(space, device))
    if region is None or region.bits != 1:
        raise KeyError(device)
    return 8 * region.address + device.number - region.first.number
