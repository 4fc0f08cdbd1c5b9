"""Simulated FX2N, in RUN or STOP, with a program in instruction-list form.

The module `special_devices` lists the special devices that have a function; all others are plain memory.
"""

from __future__ import annotations

from collections.abc import Sequence as Rows
from datetime import datetime, timedelta
from typing import Any, Final

from controller.common.object_state import ObjectState
from controller.core.devices import (
    ANNUNCIATOR_ON,
    ANNUNCIATORS,
    EXTENSION,
    LOWEST_ANNUNCIATOR,
    SIZES,
)
from controller.core.input_filter import InputFilter
from controller.fx.engine.applied.pulse import DEFAULT_RAMP_MS, RAMP_MS
from controller.fx.engine.applied.serial import HEADER, TERMINATOR
from controller.fx.engine.code import DEPTH, TRANSFERRED
from controller.fx.engine.cpu import RETENTIVE_TIMER_NUMBERS, Cpu, CpuError, index_register
from controller.fx.engine.events.high_speed import HighSpeedCounters
from controller.fx.engine.events.interrupts import InterruptRoutines
from controller.fx.engine.execution import FxExecutionFactory
from controller.fx.engine.operations import WATCHDOG_MS, Operations, Watchdog
from controller.fx.engine.parts import parts_of
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.python_functions import PythonFunctions
from controller.fx.engine.translate import translate
from controller.fx.language.instruction import Ladder

FILTER_MS: Final = 8020
BATTERY_LOW: Final = 8005
POWER_UP_WATCHDOG_MS: Final = 200
CLOCK_REGISTERS: Final = 8013
_STX, _ETX = 0x02, 0x03
_FAST_TERMINALS: Final = 8
"""Terminals X0 to X7, whose levels matter between two scans."""

_STATEFUL: Final = ("controller.fx.engine", "controller.core.input_filter", "controller.core.devices")
"""Modules whose objects have state."""
_STATELESS: Final = frozenset({"FxMachineCode", "Operations"})
"""Classes of objects without state."""


class FxPlc:
    """Simulated FX2N.

    Attributes:
        ladder: Program.
        cpu: State on which the instructions operate.
        memory: All devices.
        running: Whether the PLC is in RUN.
        error: Error that has stopped the PLC; None = none.
        scans: Number of scans since the change from STOP to RUN.
        battery_low: Whether the CPU reports a low battery (M8005).
        execution: Execution of the program.
        is_sampled: Whether the program depends on the terminals between two scans.
    """

    def __init__(
        self,
        ladder: Ladder,
        *,
        input_filter_ms: int = 10,
        clock: datetime | None = None,
        execution: FxExecutionFactory | None = None,
        peripherals: Peripherals | None = None,
    ) -> None:
        """Load the program and go to RUN.

        Args:
            ladder: Parsed program.
            input_filter_ms: Filter time of X0-X17, ms; 0 disables all filters.
            clock: Time of day at 0 ms; None = 2000-01-01 00:00:00.
            execution: Factory of the execution; None = `PythonFunctions`.
            peripherals: Special function modules and serial line; None = none.

        Raises:
            LadderError: The program contains a part that this engine does not support.
            ValueError: The input filter is invalid.
        """
        self.ladder = ladder
        self._translated = translate(ladder)
        self.execution = (execution or PythonFunctions)(self._translated)
        self.memory = self.execution.memory
        connected = peripherals or Peripherals()
        self.cpu = Cpu(self.memory, model=ladder.cpu, modules=connected.modules, line=connected.line)
        self._watchdog = Watchdog(self.cpu, self.execution.registers)
        self._operations = Operations(ladder, self.cpu, self._watchdog)
        self._link_operations()
        self._no_outputs: list[bool] = [False] * SIZES["Y"]
        self._counters = HighSpeedCounters(ladder, self.cpu)
        self._interrupts = InterruptRoutines(parts_of(ladder).interrupts, self.cpu, self._run_interrupt)
        self.is_sampled = self._counters.used or self._interrupts.used or _measures_speed(ladder)
        self._sampled = self._no_outputs.copy()
        self.running = True
        self.error: CpuError | None = None
        self.scans = 0
        self._filter, self._filter_ms = InputFilter(self.memory.X, input_filter_ms), input_filter_ms
        self.battery_low = False
        self._clock = clock or datetime(2000, 1, 1)
        self._last_ms: int | None = None
        self.cpu.latches = self._no_outputs.copy()
        self._first_registers()

    def save(self) -> Any:
        """Return the complete state, with that of the special function modules and the serial line."""
        return self.execution.save(), ObjectState(self, _STATEFUL, _STATELESS)

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`; it can be restored several times."""
        memory, objects = saved
        objects.restore()
        self.execution.restore(memory)

    @property
    def constant_scan_ms(self) -> int:
        """Scan period requested by the program with M8039 and D8039, ms; 0 = as fast as possible."""
        return max(0, self.memory.D[8039]) if self.memory.M[8039] else 0

    def scan(self, now_ms: int, levels: Rows[bool]) -> list[bool]:
        """Run one scan.

        Args:
            now_ms: Scan time, ms, non-decreasing.
            levels: Raw levels of the X terminals in numerical order from X0.

        Returns:
            Copy of the raw levels of the Y terminals in numerical order; all are off in STOP unless M8033 retains them.
        """
        if self.is_sampled:
            self._sample(now_ms, levels)
        self.cpu.refreshed = None
        self.cpu.latches = self._scan(now_ms, levels)
        if self._interrupts.used:
            refreshed, self.cpu.refreshed = self.cpu.refreshed, None
            if self.running and self.scans == 1:
                self._interrupts.start(now_ms)
            self._interrupts.run_requested(now_ms)
            self.cpu.refreshed = refreshed
        return self.cpu.latches.copy()

    def sample(self, now_ms: int, levels: Rows[bool]) -> list[bool]:
        """Process the terminals between two scans: input filter, fast inputs, high-speed counters and interrupts.

        Args:
            now_ms: Time, ms, non-decreasing.
            levels: Raw levels of the X terminals, as for `scan`.

        Returns:
            Copy of the raw levels of the Y terminals.
        """
        if self.running:
            self._filter.sample(now_ms, levels)
        if self.is_sampled:
            self._sample(now_ms, levels)
        return self.cpu.latches.copy()

    def _sample(self, now_ms: int, levels: Rows[bool]) -> None:
        now = [*levels, *self._no_outputs[len(levels) : _FAST_TERMINALS]]
        before, self._sampled = self._sampled, now
        if not (self.running and self.scans):
            return
        self.cpu.terminals[:] = levels
        self._interrupts.run_timers(now_ms)
        if before == now:
            return
        for number, watches in self.cpu.after_rise.items():
            if now[number] and not before[number]:
                for watch in watches:
                    watch(now_ms)
        self._counters.count(before, now)
        self._interrupts.request(before, now)
        self._interrupts.run_requested(now_ms)

    def _run_interrupt(self, number: int, now_ms: int) -> None:
        """Execute an interrupt routine; outputs that it refreshes reach the terminals."""
        if not self.running:
            return
        self._begin_routine(now_ms)
        try:
            self.execution.run_interrupt(number, now_ms)
        except CpuError as error:
            self._fail(error)
            self.cpu.latches = self._no_outputs.copy()
            return
        if self.cpu.refreshed is not None and not self.memory.M[8034]:
            self.cpu.latches = self.cpu.refreshed
        self.cpu.refreshed = None

    def _begin_routine(self, now_ms: int) -> None:
        self.cpu.now_ms, self.cpu.refreshed = now_ms, None
        self._watchdog.start()

    @property
    def refreshed(self) -> list[bool] | None:
        """Copy of the Y terminal levels written by the last REF before END of the last scan; None = no REF."""
        if self.cpu.refreshed is None:
            return None
        return self._no_outputs.copy() if self.memory.M[8034] else self.cpu.refreshed.copy()

    def _scan(self, now_ms: int, levels: Rows[bool]) -> list[bool]:
        memory, special = self.memory, self.memory.M
        if special[8037]:
            special[8035] = special[8036] = special[8037] = False
            self.stop()
        elif special[8035] and special[8036] and not self.running:
            special[8036] = False
            self.run()
        if not self.running:
            return memory.Y.copy() if special[8033] and self.error is None else self._no_outputs.copy()
        self.cpu.now_ms, self.cpu.scan = now_ms, self.scans
        self.cpu.terminals[:] = levels
        self._filter.latch(now_ms, levels)
        self._set_special_devices(now_ms)
        if self.scans == 0:
            self._resume_timers()
        self._watchdog.start()
        self.execution.registers[DEPTH] = 0
        try:
            self.execution.run(now_ms)
        except CpuError as error:
            self._fail(error)
            return self._no_outputs.copy()
        self._end()
        self.scans += 1
        return self._no_outputs.copy() if special[8034] else memory.Y.copy()

    def run(self) -> None:
        """Go from STOP to RUN: M8002 is on in the first scan, and the state of all instructions is reset."""
        self.running, self.error, self.scans = True, None, 0
        for relay in (8004, 8061, 8066, 8067):
            self.memory.M[relay], self.memory.D[relay] = False, 0
        self.cpu.forget_events()
        for timer in RETENTIVE_TIMER_NUMBERS:
            self.memory.TS[timer] = -1  # time in STOP or without power does not count
        self._last_ms, self.memory.D[8010:8013] = None, [0] * 3
        self._link_operations()

    def stop(self) -> None:
        """Go from RUN to STOP: turn off outputs and clear non-latched memory, unless M8033 retains them."""
        self.running = False
        if not self.memory.M[8033]:
            self.clear(latched=False)
            self.cpu.latches = self._no_outputs.copy()

    def power_cycle(self) -> None:
        """Cycle the power: non-latched memory is cleared, and the CPU starts in RUN."""
        self.clear(latched=False)
        for number in range(8000, len(self.memory.M)):
            self.memory.M[number] = False
        self._first_registers()
        self.cpu.latches = self._no_outputs.copy()
        self.run()

    def _first_registers(self) -> None:
        """Set watchdog, filter, V, Z, RS and ramps to their power-up values; other special registers are unchanged."""
        for name in (f"{kind}{number}" for kind in "VZ" for number in range(8)):
            self.memory.D[index_register(name)] = 0
        self.memory.D[WATCHDOG_MS] = POWER_UP_WATCHDOG_MS
        self.memory.D[FILTER_MS] = self._filter_ms
        self.memory.D[HEADER], self.memory.D[TERMINATOR] = _STX, _ETX
        if self.ladder.cpu.is_fx3:
            for register in RAMP_MS:
                self.memory.D[register] = DEFAULT_RAMP_MS

    def _resume_timers(self) -> None:
        """Resume the timers retained in STOP by M8033 from their current values."""
        memory = self.memory
        for timer in range(len(memory.TS)):
            if memory.TS[timer] >= 0 and timer not in RETENTIVE_TIMER_NUMBERS:
                memory.TS[timer] = self.cpu.ticks(timer) - memory.TV[timer]

    def clear(self, *, latched: bool) -> None:
        """Clear the latched or the non-latched memory; special devices are unchanged."""
        memory = self.memory
        for kind in "YMSTC":
            bits = memory.bits(kind)
            for number in self._numbers(kind, latched=latched):
                bits[number] = False
        for number in self._numbers("D", latched=latched):
            memory.D[number] = 0
        if latched:
            memory.D[EXTENSION:] = [0] * len(memory.D[EXTENSION:])
        for number in self._numbers("T", latched=latched):
            memory.TV[number], memory.TS[number] = 0, -1
        for number in self._numbers("C", latched=latched):
            memory.CV[number], memory.CE[number] = 0, False
        self._clear_transfers()
        if not latched:
            for row in (memory.E, self.execution.activity):
                row[:] = [False] * len(row)

    def _clear_transfers(self) -> None:
        self.execution.registers[TRANSFERRED] = 0
        for state in self._translated.sources:
            self.execution.leaving[state] = False

    def _link_operations(self) -> None:
        """Link new applied instructions, which have no state of earlier scans."""
        self.execution.link(self._operations.functions(self._translated.operations))

    def _numbers(self, kind: str, *, latched: bool) -> list[int]:
        """Return the numbers of the latched or the non-latched devices of a kind, excluding special devices."""
        model = self.ladder.cpu
        latched_numbers = {number for span in model.retentive.get(kind, ()) for number in span}
        return [number for number in range(min(model.sizes[kind], 8000)) if (number in latched_numbers) == latched]

    def _set_special_devices(self, now_ms: int) -> None:
        """Set the special devices driven by the CPU."""
        special, words = self.memory.M, self.memory.D
        first = self.scans == 0
        special[8000], special[8001], special[8002], special[8003] = True, False, first, not first
        special[BATTERY_LOW] = self.battery_low
        for relay, period_ms in ((8011, 10), (8012, 100), (8013, 1_000), (8014, 60_000)):
            special[relay] = now_ms % period_ms < period_ms // 2
        if self._last_ms is not None:
            took = min((now_ms - self._last_ms) * 10, 32767)
            words[8011] = took if not words[8011] else min(words[8011], took)
            words[8010], words[8012] = took, max(words[8012], took)
        if self._last_ms is None or now_ms // 1_000 != self._last_ms // 1_000:
            now = self._clock + timedelta(milliseconds=now_ms)
            words[CLOCK_REGISTERS : CLOCK_REGISTERS + 7] = [
                now.second,
                now.minute,
                now.hour,
                now.day,
                now.month,
                now.year % 100,
                now.isoweekday() % 7,
            ]
        self._last_ms = now_ms

    def _end(self) -> None:
        """Execute END: reset the source states of transfers, and update special devices."""
        memory, special = self.memory, self.memory.M
        if self.execution.registers[TRANSFERRED]:
            for state in self._translated.sources:
                if self.execution.leaving[state]:
                    memory.S[state] = False
            self._clear_transfers()
        if special[8031]:
            special[8031] = False
            self.clear(latched=False)
        if special[8032]:
            special[8032] = False
            self.clear(latched=True)
        special[ANNUNCIATOR_ON] = on = special[8049] and True in memory.S[ANNUNCIATORS.start : ANNUNCIATORS.stop]
        memory.D[LOWEST_ANNUNCIATOR] = memory.S.index(True, ANNUNCIATORS.start) if on else 0
        if special[8047]:
            active = [n for n, on in enumerate(memory.S) if on and n not in ANNUNCIATORS][:8]
            special[8046] = bool(active)
            memory.D[8040:8048] = active + [-1] * (8 - len(active))
        if memory.D[FILTER_MS] != self._filter.filter_ms:
            self._filter.filter_ms = max(0, min(60, memory.D[FILTER_MS]))

    def _fail(self, error: CpuError) -> None:
        self.error, self.running = error, False
        self.memory.M[error.relay], self.memory.D[error.relay] = True, error.code
        self.memory.M[8004], self.memory.D[8004] = True, error.relay
        self._clear_transfers()


def _measures_speed(ladder: Ladder) -> bool:
    return any(instruction.name == "SPD" for instruction in ladder.instructions)
