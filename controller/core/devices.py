"""FX2N devices: ranges, retention and device memory.

Ranges and retention follow the FX2N (fx2n.md 1.5, based on independent summaries of the manuals, not on the
manuals themselves). X and Y numbers are octal in text and plain integers here: X10 is number 8.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from controller.common.declarations import DeclarationError

MS_10: Final = 10
MS_100: Final = 100
MS_1: Final = 1
WORD_MIN: Final = -32768
WORD_MAX: Final = 32767

SIZES: Final = {"X": 256, "Y": 256, "M": 8256, "S": 1000, "T": 256, "C": 256, "D": 8256}
"""Number of devices of each kind; M and D include the special ranges M8000-M8255 and D8000-D8255."""

_GAPS: Final = {"M": range(3072, 8000), "D": range(8000, 8000)}

RETENTIVE: Final = {
    "M": (range(500, 3072),),
    "S": (range(500, 1000),),
    "T": (range(246, 256),),
    "C": (range(100, 200), range(220, 256)),
    "D": (range(200, 8000),),
}
"""Battery-backed ranges. Within them M1024-M3071 and D512-D7999 are latched regardless of the parameter settings."""

ANNUNCIATORS: Final = range(900, 1000)
MS_100_TIMERS: Final = range(200)
"""Non-retentive 100 ms timers; T250-T255 have the same base but are retentive."""
PROGRAM_RANGES: Final = {
    "M": ((range(500), "not retentive"), (range(1024, 3072), "retentive")),
    "T": ((MS_100_TIMERS, "100 ms"), (range(200, 246), "10 ms")),
    "C": ((range(100), "not retentive"),),
    "D": ((range(200), "not retentive"), (range(512, 8000), "retentive")),
    "S": ((range(20, 500), "steps"), (ANNUNCIATORS, "alarms")),
}
"""Ranges that a program allocates: those whose retention does not depend on the parameter settings."""
EXTENSION: Final = 8512
"""Place of R0 in the list of data registers: those of an FX3U are followed by its extension registers R."""
RUN_MONITOR: Final = 8000
INITIAL_PULSE: Final = 8002
CLOCK_1_S: Final = 8013
ANNUNCIATOR_ON: Final = 8048
LOWEST_ANNUNCIATOR: Final = 8049


class DeviceError(DeclarationError):
    """Raised for a device that an FX2N does not have or does not support for this use."""


def device_name(kind: str, number: int) -> str:
    """Return the FX name of a device.

    Examples:
        >>> device_name("X", 8), device_name("M", 8)
        ('X10', 'M8')
    """
    return f"{kind}{number:o}" if kind in "XY" else f"{kind}{number}"


def check_device(kind: str, number: int) -> None:
    """Raise DeviceError unless the FX2N has this device."""
    size = SIZES.get(kind)
    if size is None:
        raise DeviceError(f"{kind}{number}: unknown device kind {kind!r}; use one of {', '.join(SIZES)}")
    if not 0 <= number < size or number in _GAPS.get(kind, ()):
        raise DeviceError(f"{device_name(kind, number)}: outside the range of an FX2N")


def is_retentive(kind: str, number: int) -> bool:
    """Return True if the device retains its value through a power failure."""
    return any(number in span for span in RETENTIVE.get(kind, ()))


def free_spans(within: range, used: Collection[int]) -> list[range]:
    """Return the spans of unused numbers within a range.

    Examples:
        >>> free_spans(range(10), {0, 1, 5})
        [range(2, 5), range(6, 10)]
    """
    bounds = [within.start - 1, *sorted(number for number in used if number in within), within.stop]
    return [range(one + 1, two) for one, two in pairwise(bounds) if one + 1 < two]


def next_free(kind: str, number: int, used: Collection[int]) -> str:
    """Return the name of the first unused device of the program range that contains a number, or "none"."""
    for within, _ in PROGRAM_RANGES.get(kind, ()):
        if number in within:
            return next((device_name(kind, span.start) for span in free_spans(within, used)), "none")
    return "none"


def timer_base_ms(number: int) -> int:
    """Return the time base of timer T<number> in ms (docs/sources/fx2n.md 1.5).

    Examples:
        >>> timer_base_ms(0), timer_base_ms(200), timer_base_ms(246), timer_base_ms(250)
        (100, 10, 1, 100)
    """
    check_device("T", number)
    if number < 200 or number >= 250:
        return MS_100
    return MS_10 if number < 246 else MS_1


def is_32_bit_counter(number: int) -> bool:
    """Return True if C<number> is a 32-bit up/down counter (C200 and above)."""
    return number >= 200


@dataclass(slots=True)
class Memory:
    """Device memory of one PLC. Bits are bools and words are ints. Compiled code refers to these list objects.

    Attributes:
        X: Input image (terminal levels after the input filter).
        Y: Output image (terminal levels).
        M: Auxiliary relays and special relays.
        S: States; S900-S999 are annunciators.
        T: Timer contacts.
        C: Counter contacts.
        D: Data registers, in an FX3U followed by the extension registers.
        TV: Current values of the timers, in their time base.
        TS: Tick at which a running timer was started or last incremented; -1 while it is stopped.
        CV: Current values of the counters.
        CE: Input of each counter at its last execution.
        E: Input of each PLS and PLF at its last execution, in program order.
    """

    X: list[bool] = field(default_factory=lambda: [False] * SIZES["X"])
    Y: list[bool] = field(default_factory=lambda: [False] * SIZES["Y"])
    M: list[bool] = field(default_factory=lambda: [False] * SIZES["M"])
    S: list[bool] = field(default_factory=lambda: [False] * SIZES["S"])
    T: list[bool] = field(default_factory=lambda: [False] * SIZES["T"])
    C: list[bool] = field(default_factory=lambda: [False] * SIZES["C"])
    D: list[int] = field(default_factory=lambda: [0] * SIZES["D"])
    TV: list[int] = field(default_factory=lambda: [0] * SIZES["T"])
    TS: list[int] = field(default_factory=lambda: [-1] * SIZES["T"])
    CV: list[int] = field(default_factory=lambda: [0] * SIZES["C"])
    CE: list[bool] = field(default_factory=lambda: [False] * SIZES["C"])
    E: list[bool] = field(default_factory=list)

    @classmethod
    def of_size(cls, sizes: Mapping[str, int], edges: int = 0) -> Memory:
        """Return a memory with the given number of devices of each kind and of edge levels."""
        x, y, m, s, t, c = ([False] * sizes[kind] for kind in "XYMSTC")
        timers, counters = [0] * sizes["T"], [0] * sizes["C"]
        return cls(x, y, m, s, t, c, [0] * sizes["D"], timers, [-1] * sizes["T"], counters, c.copy(), [False] * edges)

    def bits(self, kind: str) -> list[bool]:
        """Return the list of bits of one device kind (X Y M S T C)."""
        bits: list[bool] = getattr(self, kind)
        return bits

    def word(self, kind: str, number: int) -> int:
        """Return a word: a data or extension register, or the current value of a timer or counter."""
        if kind == "R":
            return self.D[EXTENSION + number]
        words = {"D": self.D, "T": self.TV, "C": self.CV}[kind]
        return words[number]

    def set_word(self, kind: str, number: int, value: int) -> None:
        """Write a word: a data or extension register, or the current value of a timer or counter."""
        if kind == "R":
            kind, number = "D", EXTENSION + number
        words = {"D": self.D, "T": self.TV, "C": self.CV}[kind]
        words[number] = value
