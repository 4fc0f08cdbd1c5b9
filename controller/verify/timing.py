"""Timer models: exact timers as in the scan, and free timers that may elapse at any time.

Free timers allow every behaviour of exact timers and more, so proofs that use them hold for all presets and scan times.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Protocol

import z3

from controller.core.devices import MS_1, MS_10, MS_100, WORD_MAX, is_retentive
from controller.core.expr import Timer, Word
from controller.verify.cells import STOPPED, Cell, SymbolicMemory, operand_of, widened

LONG: Final = WORD_MAX + 1
"""Count that exceeds every preset; timers that have run longer behave identically."""


class Timing(Protocol):
    """Behaviour of the timers in one scan."""

    @property
    def clock_1_s(self) -> z3.BoolRef:
        """The 1 s clock M8013."""

    def run(self, memory: SymbolicMemory, timer: Timer, counts: int | Word, driven: z3.BoolRef) -> None:
        """Execute a timer's coil; `counts` is its preset in counts of its base."""


class FreeTimers:
    """Timers that may or may not have elapsed whenever they are driven, with any current value."""

    def __init__(self, label: str) -> None:
        """Create the unknowns of one scan; the label distinguishes scans."""
        self._label = label
        self.clock_1_s: z3.BoolRef = z3.Bool(f"1 s clock@{label}")

    def elapsed(self, timer: int) -> z3.BoolRef:
        """Return the unknown that determines whether a driven timer has elapsed in this scan."""
        return z3.Bool(f"T{timer} over@{self._label}")

    def run(self, memory: SymbolicMemory, timer: Timer, counts: int | Word, driven: z3.BoolRef) -> None:  # noqa: ARG002
        """Execute a timer's coil; a driven timer may or may not have elapsed."""
        done, value = Cell("T", timer.number), Cell("TV", timer.number)
        elapsed, some = self.elapsed(timer.number), value.variable(f"{self._label} counted")
        if is_retentive("T", timer.number):
            memory[done] = z3.Or(memory[done], z3.And(driven, elapsed))
            memory[value] = z3.If(driven, some, memory[value])
        else:
            memory[done] = z3.And(driven, elapsed)
            memory[value] = z3.If(driven, some, value.constant(0))


class ExactTimers:
    """Timers that count the ticks of the scan according to the rules of `controller.core.compile`."""

    def __init__(self, ticks: Mapping[int, z3.BitVecRef], clock_1_s: z3.BoolRef) -> None:
        """Set the time of one scan.

        Args:
            ticks: Tick of the scan for each base in ms, 32 bits, not negative.
            clock_1_s: The 1 s clock M8013.
        """
        self._ticks = ticks
        self.clock_1_s = clock_1_s

    @classmethod
    def aged(cls, label: str) -> ExactTimers:
        """Return the timers of a scan at so late a tick that a running timer may have reached any count."""
        tick = z3.BitVecVal(LONG, 32)
        return cls(dict.fromkeys((MS_1, MS_10, MS_100), tick), z3.Bool(f"1 s clock@{label}"))

    @classmethod
    def at_tenths(cls, tenths: z3.BitVecRef) -> ExactTimers:
        """Return the timers of a scan at the given time in tenths of a second, 32 bits."""
        return cls({MS_1: tenths * 100, MS_10: tenths * 10, MS_100: tenths}, z3.URem(tenths, 10) < 5)

    def run(self, memory: SymbolicMemory, timer: Timer, counts: int | Word, driven: z3.BoolRef) -> None:
        """Execute a timer's coil."""
        started = Cell("TS", timer.number)
        tick, preset = self._ticks[timer.base_ms], widened(operand_of(counts, memory), 32)
        if is_retentive("T", timer.number):
            self._run_retentive(memory, timer.number, tick, preset, driven)
            return
        done, value = Cell("T", timer.number), Cell("TV", timer.number)
        runs = memory[started] >= 0
        start = z3.If(runs, memory[started], tick)
        counted = tick - start
        elapsed = counted >= preset
        dropped = z3.And(z3.Not(driven), runs)
        current = z3.Extract(15, 0, z3.If(elapsed, preset, counted))
        memory[done] = z3.If(driven, elapsed, z3.And(memory[done], z3.Not(dropped)))
        memory[value] = z3.If(driven, current, z3.If(dropped, value.constant(0), memory[value]))
        memory[started] = z3.If(driven, start, started.constant(STOPPED))

    @staticmethod
    def _run_retentive(
        memory: SymbolicMemory, number: int, tick: z3.BitVecRef, preset: z3.BitVecRef, driven: z3.BoolRef
    ) -> None:
        done, value, started = Cell("T", number), Cell("TV", number), Cell("TS", number)
        summed = widened(memory[value], 32) + tick - memory[started]
        capped = z3.If(summed > WORD_MAX, z3.BitVecVal(WORD_MAX, 32), summed)
        counts = z3.And(driven, memory[started] >= 0)
        memory[value] = z3.If(counts, z3.Extract(15, 0, capped), memory[value])
        memory[started] = z3.If(driven, tick, started.constant(STOPPED))
        memory[done] = z3.Or(memory[done], z3.And(driven, widened(memory[value], 32) >= preset))


def timer_facts(memory: SymbolicMemory) -> list[z3.BoolRef]:
    """Return the facts about every timer between two scans, with the next scan at the tick of `ExactTimers.aged`."""
    facts = []
    for cell, start in memory.items():
        if cell.kind != "TS":
            continue
        done, value = memory[Cell("T", cell.number)], memory[Cell("TV", cell.number)]
        runs = z3.And(start >= 0, start <= LONG)
        empty = z3.BoolVal(val=True) if is_retentive("T", cell.number) else z3.And(z3.Not(done), value == 0)
        facts.append(z3.Or(runs, z3.And(start == STOPPED, empty)))
    return facts
