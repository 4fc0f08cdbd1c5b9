"""Two models of a timer: exact ones as the scan has them, and free ones that may be over at any time.

Free timers allow everything exact ones do and more: what is proved with them holds for any presets and scan times.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Protocol

import z3

from controller.core.devices import MS_1, MS_10, MS_100, WORD_MAX, is_retentive
from controller.core.expr import Timer, Word
from controller.verify.cells import STANDING, Cell, SymbolicMemory, operand_of, widened

LONG: Final = WORD_MAX + 1
"""A count that no preset reaches: a timer that has run for longer behaves as if it had run for so long."""


class Timing(Protocol):
    """What time does to the timers in one scan."""

    @property
    def clock_1_s(self) -> z3.BoolRef:
        """The 1 s clock M8013."""

    def run(self, memory: SymbolicMemory, timer: Timer, counts: int | Word, driven: z3.BoolRef) -> None:
        """Execute a timer's coil; counts is its preset in counts of its base."""


class FreeTimers:
    """Every driven timer may be over or not, and its current value is anything."""

    def __init__(self, label: str) -> None:
        """Make the unknowns of one scan; the label tells scans apart."""
        self._label = label
        self.clock_1_s: z3.BoolRef = z3.Bool(f"1 s clock@{label}")

    def over(self, timer: int) -> z3.BoolRef:
        """Return the unknown that says whether a timer's time is over in this scan, if it is driven."""
        return z3.Bool(f"T{timer} over@{self._label}")

    def run(self, memory: SymbolicMemory, timer: Timer, counts: int | Word, driven: z3.BoolRef) -> None:  # noqa: ARG002
        """Execute a timer's coil with any outcome."""
        done, value = Cell("T", timer.number), Cell("TV", timer.number)
        over, some = self.over(timer.number), value.variable(f"{self._label} counted")
        if is_retentive("T", timer.number):
            memory[done] = z3.Or(memory[done], z3.And(driven, over))
            memory[value] = z3.If(driven, some, memory[value])
        else:
            memory[done] = z3.And(driven, over)
            memory[value] = z3.If(driven, some, value.constant(0))


class ExactTimers:
    """Timers count the scan's ticks by the rules of `controller.core.compile`."""

    def __init__(self, ticks: Mapping[int, z3.BitVecRef], clock_1_s: z3.BoolRef) -> None:
        """Take the time of one scan.

        Args:
            ticks: For each base in ms the scan's tick, 32 bits, not negative.
            clock_1_s: The 1 s clock M8013.
        """
        self._ticks = ticks
        self.clock_1_s = clock_1_s

    @classmethod
    def aged(cls, label: str) -> ExactTimers:
        """Return the time of a scan before which timers may have run for any time: their start is what is unknown."""
        tick = z3.BitVecVal(LONG, 32)
        return cls(dict.fromkeys((MS_1, MS_10, MS_100), tick), z3.Bool(f"1 s clock@{label}"))

    @classmethod
    def at_tenths(cls, tenths: z3.BitVecRef) -> ExactTimers:
        """Return the time of a scan at an instant in tenths of a second, 32 bits."""
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
        over = counted >= preset
        dropped = z3.And(z3.Not(driven), runs)
        current = z3.Extract(15, 0, z3.If(over, preset, counted))
        memory[done] = z3.If(driven, over, z3.And(memory[done], z3.Not(dropped)))
        memory[value] = z3.If(driven, current, z3.If(dropped, value.constant(0), memory[value]))
        memory[started] = z3.If(driven, start, started.constant(STANDING))

    @staticmethod
    def _run_retentive(
        memory: SymbolicMemory, number: int, tick: z3.BitVecRef, preset: z3.BitVecRef, driven: z3.BoolRef
    ) -> None:
        done, value, started = Cell("T", number), Cell("TV", number), Cell("TS", number)
        summed = widened(memory[value], 32) + tick - memory[started]
        capped = z3.If(summed > WORD_MAX, z3.BitVecVal(WORD_MAX, 32), summed)
        counts = z3.And(driven, memory[started] >= 0)
        memory[value] = z3.If(counts, z3.Extract(15, 0, capped), memory[value])
        memory[started] = z3.If(driven, tick, started.constant(STANDING))
        memory[done] = z3.Or(memory[done], z3.And(driven, widened(memory[value], 32) >= preset))


def possible(memory: SymbolicMemory) -> list[z3.BoolRef]:
    """Return what is so of every timer between two scans, where the next one is at the tick of `ExactTimers.aged`."""
    facts = []
    for cell, start in memory.items():
        if cell.kind != "TS":
            continue
        done, value = memory[Cell("T", cell.number)], memory[Cell("TV", cell.number)]
        runs = z3.And(start >= 0, start <= LONG)
        empty = z3.BoolVal(val=True) if is_retentive("T", cell.number) else z3.And(z3.Not(done), value == 0)
        facts.append(z3.Or(runs, z3.And(start == STANDING, empty)))
    return facts
