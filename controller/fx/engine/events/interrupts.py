"""Interrupts: input edges, cyclic timers, and counts of high-speed counters.

An interrupt routine is executed between two scans, at the millisecond of its cause. While interrupts are disabled (DI,
and before the first EI), one request of each interrupt is stored; it is executed at the end of the scan that enables
interrupts. M8050 to M8059 suppress interrupts, which are then not stored (names verified, docs/sources/fx2n.md 1.6;
details from memory). Outputs that a routine writes reach the terminals with REF, or at the next END.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

from controller.fx.engine.cpu import Cpu
from controller.fx.language.high_speed_inputs import interrupt_terminal

INHIBIT: Final = 8050
"""Special relay that suppresses the interrupts I000 and I001; those of X1 to X5 and of the three timers follow."""
COUNTERS_INHIBIT: Final = 8059
"""Special relay that suppresses all counter interrupts."""
_FIRST_TIMER: Final = 600


class InterruptRoutines:
    """Interrupt routines that a program contains."""

    def __init__(self, numbers: Iterable[int], cpu: Cpu, execute: Callable[[int, int], None]) -> None:
        """Take the numbers of the routines, and the function that executes one of them at a time in ms."""
        self._numbers = tuple(numbers)
        self._cpu, self._execute = cpu, execute
        self._timers = {number: number % 100 for number in self._numbers if number >= _FIRST_TIMER}
        self._due_ms: dict[int, int] = {}

    @property
    def used(self) -> bool:
        """True if the program has an interrupt routine."""
        return bool(self._numbers)

    def start(self, now_ms: int) -> None:
        """Start the cyclic timers."""
        self._due_ms = {number: now_ms + period_ms for number, period_ms in self._timers.items()}

    def run_timers(self, until_ms: int) -> None:
        """Execute the timer interrupts up to a time, in the order of time and then of their numbers."""
        while self._due_ms:
            due_ms, number = min((at_ms, number) for number, at_ms in self._due_ms.items())
            if due_ms > until_ms:
                return
            self._due_ms[number] = due_ms + self._timers[number]
            self._cpu.request_interrupt(number)
            self.run_requested(due_ms)

    def request(self, before: Sequence[bool], now: Sequence[bool]) -> None:
        """Request the input interrupts of the edges between two samples of the X terminals."""
        for number in self._numbers:
            terminal = interrupt_terminal(number)
            if terminal is not None and now[terminal] != before[terminal] and now[terminal] == bool(number % 100):
                self._cpu.request_interrupt(number)

    def run_requested(self, now_ms: int) -> None:
        """Execute the requested interrupts if interrupts are enabled; suppressed ones are dropped."""
        requests = self._cpu.interrupt_requests
        requests[:] = [number for number in requests if number in self._numbers and not self._suppressed(number)]
        while requests and self._cpu.interrupts_enabled:
            self._execute(requests.pop(0), now_ms)

    def _suppressed(self, number: int) -> bool:
        counter = number < 100 and interrupt_terminal(number) is None
        return self._cpu.memory.M[COUNTERS_INHIBIT if counter else INHIBIT + number // 100]
