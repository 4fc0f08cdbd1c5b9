"""CPU state shared by the instructions of a running FX2N: memory, scan time, terminals, flags."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from controller.core.devices import MS_1, SIZES, Memory, timer_base_ms
from controller.fx.engine.peripherals.buffer_module import BufferModule
from controller.fx.engine.peripherals.serial_line import FxSerialLine
from controller.fx.language.cpu_model import FX2N, CpuModel

ZERO, BORROW, CARRY, COMPLETE = 8020, 8021, 8022, 8029
"""Arithmetic flags and the flag "execution complete"."""
RETENTIVE_TIMERS: Final = 246
"""Number of the first retentive timer."""
RETENTIVE_TIMER_NUMBERS: Final = range(RETENTIVE_TIMERS, 256)

OUT_OF_RANGE: Final = 6706
"""Error code in D8067 for an operand that is out of range (no page found)."""


def time_base_ms(timer: int) -> int:
    """Return the time base of a timer in ms; T256 to T511, which only an FX3U has, count in ms (from memory)."""
    return MS_1 if timer >= SIZES["T"] else timer_base_ms(timer)


CALL_DEPTH: Final = 5
"""Nesting limit of subroutines (no page found)."""
WATCHDOG_ERROR: Final = 6105
"""Error code in D8061: the scan took longer than the limit in D8000 (no page found)."""
CALL_ERROR: Final = 6607
"""Error code in D8066: subroutines are nested too deeply (no page found)."""


class CpuError(Exception):
    """Raised for a fatal program error; the CPU stops with its outputs off.

    Attributes:
        code: Error code.
        relay: Number of the error relay; the register with the same number contains the code.
    """

    def __init__(self, code: int, relay: int) -> None:
        super().__init__(f"CPU error {code}, M{relay}")
        self.code = code
        self.relay = relay


def watchdog_error() -> CpuError:
    """Return the error of a scan that takes too long."""
    return CpuError(WATCHDOG_ERROR, 8061)


def call_error() -> CpuError:
    """Return the error of subroutines that are nested too deeply."""
    return CpuError(CALL_ERROR, 8066)


class OperationError(ArithmeticError):
    """Raised for operands that are invalid at run time; M8067 and D8067 are set, and the CPU continues.

    Attributes:
        code: Error code in D8067.
    """

    def __init__(self, code: int = OUT_OF_RANGE) -> None:
        super().__init__(code)
        self.code = code


def index_register(name: str) -> int:
    """Return the data register of an index register (docs/sources/fx2n.md 1.5).

    Examples:
        >>> index_register("Z0"), index_register("V0"), index_register("Z1"), index_register("V7")
        (8028, 8029, 8182, 8195)
    """
    number = int(name[1:])
    first = {"Z": 8028, "V": 8029}[name[0]]
    return first if number == 0 else first + 152 + 2 * number


@dataclass(slots=True)
class Cpu:
    """State on which instructions operate.

    Attributes:
        memory: All devices; V and Z are the data registers returned by `index_register`.
        now_ms: Scan time, ms.
        scan: Scan number, from 0.
        terminals: Current raw levels at the X terminals, for REF.
        latches: Current levels at the Y terminals, as written by the last END or REF; empty = same as the Y image.
        refreshed: Y image that REF wrote to the terminals before END; None = no REF in this scan.
        model: CPU model.
        interrupts_enabled: Whether EI is in force.
        interrupt_requests: Requested interrupts that have not been executed, in order.
        after_count: Comparisons to be executed after each count, by number of the high-speed counter.
        after_rise: Functions called with the time in ms of each rising edge, by number of the X terminal.
        modules: Special function modules by position, 0 to 7.
        line: Serial line.
    """

    memory: Memory = field(default_factory=Memory)
    now_ms: int = 0
    scan: int = 0
    terminals: list[bool] = field(default_factory=list)
    latches: list[bool] = field(default_factory=list)
    refreshed: list[bool] | None = None
    model: CpuModel = FX2N
    interrupts_enabled: bool = False
    interrupt_requests: list[int] = field(default_factory=list)
    after_count: dict[int, list[Callable[[], None]]] = field(default_factory=dict)
    after_rise: dict[int, list[Callable[[int], None]]] = field(default_factory=dict)
    modules: Mapping[int, BufferModule] = field(default_factory=dict)
    line: FxSerialLine = field(default_factory=FxSerialLine)

    def request_interrupt(self, number: int) -> None:
        """Store the request of an interrupt; one request of each is stored."""
        if number not in self.interrupt_requests:
            self.interrupt_requests.append(number)

    def forget_events(self) -> None:
        """Disable interrupts, and drop all requests and comparisons."""
        self.interrupts_enabled = False
        self.interrupt_requests.clear()
        self.after_count.clear()
        self.after_rise.clear()

    def ticks(self, timer: int) -> int:
        """Return the scan time in counts of a timer's time base."""
        return self.now_ms // time_base_ms(timer)

    def set_timer(self, timer: int, value: int) -> None:
        """Write the current value of a timer; a running timer continues from this value."""
        memory = self.memory
        memory.TV[timer] = value
        if memory.TS[timer] >= 0:
            memory.TS[timer] = self.ticks(timer) - (0 if timer in RETENTIVE_TIMER_NUMBERS else value)
