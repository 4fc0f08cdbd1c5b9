"""What the instructions of a running FX2N share: its memory, the time of the scan, its terminals, its flags."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from controller.core.devices import MS_10, MS_100, Memory, timer_base_ms

ZERO, BORROW, CARRY, COMPLETE = 8020, 8021, 8022, 8029
"""Flags of arithmetic, and "execution complete"."""
RETENTIVE_TIMERS: Final = 246

OUT_OF_RANGE: Final = 6706
"""Code of an operand outside its range (GK), in D8067 with M8067."""


class OperationError(ArithmeticError):
    """An applied instruction that cannot be executed as its operands are now: M8067, D8067; the CPU goes on.

    Attributes:
        code: What D8067 holds.
    """

    def __init__(self, code: int = OUT_OF_RANGE) -> None:
        super().__init__(code)
        self.code = code


def index_register(name: str) -> int:
    """Return the data register that an index register is (FX.md 1.5).

    Examples:
        >>> index_register("Z0"), index_register("V0"), index_register("Z1"), index_register("V7")
        (8028, 8029, 8182, 8195)
    """
    number = int(name[1:])
    first = {"Z": 8028, "V": 8029}[name[0]]
    return first if number == 0 else first + 152 + 2 * number


@dataclass(slots=True)
class Cpu:
    """The state that instructions work on.

    Attributes:
        memory: All devices; V and Z are the data registers `index_register` gives.
        now_ms: Time of the scan, ms.
        scan: Number of the scan, from 0.
        terminals: Raw levels at the X terminals now, for REF.
        latches: Levels at the Y terminals now, as the last END or REF put them there; empty = taken as the Y image.
        refreshed: Y image handed to the terminals before END, by REF; None = not in this scan.
    """

    memory: Memory = field(default_factory=Memory)
    now_ms: int = 0
    scan: int = 0
    terminals: list[bool] = field(default_factory=list)
    latches: list[bool] = field(default_factory=list)
    refreshed: list[bool] | None = None

    def ticks(self, timer: int) -> int:
        """Return the scan's time in counts of a timer's base."""
        return self.now_ms // {MS_100: 100, MS_10: 10}.get(timer_base_ms(timer), 1)

    def set_timer(self, timer: int, value: int) -> None:
        """Write the current value of a timer; one that runs goes on from there."""
        memory = self.memory
        memory.TV[timer] = value
        if memory.TS[timer] >= 0:
            memory.TS[timer] = self.ticks(timer) - (value if timer < RETENTIVE_TIMERS else 0)
