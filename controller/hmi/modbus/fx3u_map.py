"""Modbus address map of the FX3U, restricted to the devices of the FX2N.

An FX2N has no Modbus slave, but commercial panels support the map of its successor (fx2n.md 3.1: bit devices, D, D8000,
TN and CN are documented in the manual; that counters from C200 have two words is general knowledge and fits
the addresses). An FX2N has no R registers; the R area is for the registers of an FX3U, or for those that the machine's
program is served with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

from controller.core.devices import SIZES, is_32_bit_counter

Table = Literal["coil", "discrete", "holding"]

_COILS: Final = {"M": 0x0000, "S": 0x2000, "T": 0x3000, "C": 0x3200, "Y": 0x3300}
_M8000: Final = 0x1E00
_X: Final = 0x3400
_REGISTERS: Final = {"D": 0x0000, "R": 0x2140, "TN": 0xA140, "CN": 0xA340}
HELD_SCAN: Final = 0xA500
"""First register of the held scan (`HeldSnapshot.words`), behind the devices of the FX3U. The first one is writable."""
_16_BIT_COUNTERS: Final = 200
_SPECIAL: Final = 8000
_RELAYS: Final = 3072
"""Number of general relays, M0-M3071; M8000 starts the next span."""


@dataclass(frozen=True, slots=True)
class Span:
    """Contiguous addresses of consecutive devices.

    Attributes:
        first: First address.
        kind: Device kind; TN and CN are the current values of timers and counters.
        number: Number of the device at the first address; for X and Y, the value of the octal label.
        count: Number of addresses: one per device, two per 32-bit counter.
    """

    first: int
    kind: str
    number: int
    count: int

    @property
    def end(self) -> int:
        """Address after the last address of the span."""
        return self.first + self.count


def bit_spans(table: Table) -> tuple[Span, ...]:
    """Return the spans of the coils, or those of the discrete inputs, which also include X."""
    spans = [
        Span(_COILS["M"], "M", 0, _RELAYS),
        Span(_M8000, "M", _SPECIAL, SIZES["M"] - _SPECIAL),
        *(Span(_COILS[kind], kind, 0, SIZES[kind]) for kind in "STCY"),
    ]
    if table == "discrete":
        spans.append(Span(_X, "X", 0, SIZES["X"]))
    return tuple(spans)


def register_spans() -> tuple[Span, ...]:
    """Return the register spans; holding and input registers are identical."""
    counters_32_bit = SIZES["C"] - _16_BIT_COUNTERS
    return (
        Span(_REGISTERS["D"], "D", 0, SIZES["D"]),
        Span(_REGISTERS["R"], "R", 0, _REGISTERS["TN"] - _REGISTERS["R"]),
        Span(_REGISTERS["TN"], "TN", 0, SIZES["T"]),
        Span(_REGISTERS["CN"], "CN", 0, _16_BIT_COUNTERS + 2 * counters_32_bit),
    )


def coil_address(kind: str, number: int) -> int:
    """Return the coil (and discrete input) address of an M, S, T, C or Y bit.

    Examples:
        >>> hex(coil_address("M", 8002)), hex(coil_address("Y", 0o10))
        ('0x1e02', '0x3308')
    """
    if kind == "M" and number >= _SPECIAL:
        return _M8000 + number - _SPECIAL
    return _COILS[kind] + number


def discrete_address(kind: str, number: int) -> int:
    """Return the discrete input address of any bit device.

    Examples:
        >>> hex(discrete_address("X", 0o25))
        '0x3415'
    """
    return _X + number if kind == "X" else coil_address(kind, number)


def register_address(kind: str, number: int) -> int:
    """Return the register address of a D, R, TN or CN word.

    Examples:
        >>> [hex(register_address(*word)) for word in (("D", 8010), ("R", 0), ("CN", 201))]
        ['0x1f4a', '0x2140', '0xa40a']
    """
    if kind == "CN" and is_32_bit_counter(number):
        number += number - _16_BIT_COUNTERS
    return _REGISTERS[kind] + number
