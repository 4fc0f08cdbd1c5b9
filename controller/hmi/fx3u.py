"""The device map an FX3U serves over Modbus, for the devices that an FX2N has.

An FX2N has no Modbus slave; panels of the trade know the map of its successor (FX.md 3.1: bit devices, D and D8000
seen in the manual, TN and CN too; two words for C200 and above is common knowledge that fits the arithmetic). The R
area, which an FX2N lacks, carries what the operator's side itself knows (`own_registers`).
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
_16_BIT_COUNTERS: Final = 200
_SPECIAL: Final = 8000
_RELAYS: Final = 3072
"""M0-M3071; behind them comes M8000."""


@dataclass(frozen=True, slots=True)
class Span:
    """Neighbouring addresses that hold neighbouring devices.

    Attributes:
        first: First address.
        kind: Device kind, as TN and CN for the current values of timers and counters.
        number: Device at the first address; X and Y by octal value.
        count: Addresses in the span: one a device, but two for a counter of 32 bits.
    """

    first: int
    kind: str
    number: int
    count: int

    @property
    def end(self) -> int:
        """Address behind the last."""
        return self.first + self.count


def bit_spans(table: Table) -> tuple[Span, ...]:
    """Return the spans of the coils, or of the discrete inputs, which hold X too."""
    spans = [
        Span(_COILS["M"], "M", 0, _RELAYS),
        Span(_M8000, "M", _SPECIAL, SIZES["M"] - _SPECIAL),
        *(Span(_COILS[kind], kind, 0, SIZES[kind]) for kind in "STCY"),
    ]
    if table == "discrete":
        spans.append(Span(_X, "X", 0, SIZES["X"]))
    return tuple(spans)


def register_spans(own_words: int) -> tuple[Span, ...]:
    """Return the spans of the registers; holding and input registers are the same.

    Args:
        own_words: Length of the R area.
    """
    counters_32_bit = SIZES["C"] - _16_BIT_COUNTERS
    return (
        Span(_REGISTERS["D"], "D", 0, SIZES["D"]),
        Span(_REGISTERS["R"], "R", 0, own_words),
        Span(_REGISTERS["TN"], "TN", 0, SIZES["T"]),
        Span(_REGISTERS["CN"], "CN", 0, _16_BIT_COUNTERS + 2 * counters_32_bit),
    )


def coil_address(kind: str, number: int) -> int:
    """Return the coil, and discrete input, of a bit M S T C Y.

    Examples:
        >>> hex(coil_address("M", 8002)), hex(coil_address("Y", 0o10))
        ('0x1e02', '0x3308')
    """
    if kind == "M" and number >= _SPECIAL:
        return _M8000 + number - _SPECIAL
    return _COILS[kind] + number


def discrete_address(kind: str, number: int) -> int:
    """Return the discrete input of any bit.

    Examples:
        >>> hex(discrete_address("X", 0o25))
        '0x3415'
    """
    return _X + number if kind == "X" else coil_address(kind, number)


def register_address(kind: str, number: int) -> int:
    """Return the register of a word D R TN CN.

    Examples:
        >>> [hex(register_address(*word)) for word in (("D", 8010), ("R", 0), ("CN", 201))]
        ['0x1f4a', '0x2140', '0xa40a']
    """
    if kind == "CN" and is_32_bit_counter(number):
        number += number - _16_BIT_COUNTERS
    return _REGISTERS[kind] + number
