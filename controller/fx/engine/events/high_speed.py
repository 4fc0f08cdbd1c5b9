"""High-speed counters C235 to C255: they count edges at terminals, independently of the scan.

The coil of a counter only enables it. Terminals are sampled whenever their levels are given to `FxPlc.sample`, usually
every millisecond, so the simulation counts up to 500 pulses a second at each terminal; the input filter has no effect.
After each count, the instructions HSCS, HSCR and HSZ compare the counter and act at once, not at END.

A counter with one counting terminal counts its rising edges, down while M8235 to M8245 is on. A counter with two
terminals counts up at the rising edges of the first and down at those of the second. A counter of two phases counts
while A is on: up at a rising edge of B, and down at a falling edge. For the counters with two terminals, M8246 to M8255
show the direction of the last count, on = down. The reset terminal holds the counter at 0; without its start terminal
the counter does not count. The counting rules are from memory.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from controller.fx.engine.access import Reader, reader, signed
from controller.fx.engine.cpu import Cpu
from controller.fx.language.high_speed_inputs import COUNTER_INPUTS, CounterInputs, high_speed_coils
from controller.fx.language.instruction import Ladder

_DIRECTION: Final = 8000
"""Number of the direction relay of counter 0."""


class HighSpeedCounters:
    """High-speed counters that a program uses."""

    def __init__(self, ladder: Ladder, cpu: Cpu) -> None:
        self._counters = [
            _HighSpeedCounter(cpu, number, COUNTER_INPUTS[number], reader(cpu, coil.operands[1], wide=True))
            for number, coil in high_speed_coils(ladder).items()
        ]

    @property
    def used(self) -> bool:
        """True if the program has a high-speed counter."""
        return bool(self._counters)

    def count(self, before: Sequence[bool], now: Sequence[bool]) -> None:
        """Count the edges between two samples of the X terminals."""
        for counter in self._counters:
            counter.process(before, now)


class _HighSpeedCounter:
    """One high-speed counter."""

    def __init__(self, cpu: Cpu, number: int, inputs: CounterInputs, preset: Reader) -> None:
        self._cpu, self._number, self._inputs, self._preset = cpu, number, inputs, preset

    def process(self, before: Sequence[bool], now: Sequence[bool]) -> None:
        """Process one sample of the terminals."""
        memory, inputs = self._cpu.memory, self._inputs
        if not memory.CE[self._number]:
            return
        if inputs.reset is not None and now[inputs.reset]:
            memory.CV[self._number], memory.C[self._number] = 0, False
            return
        if inputs.start is not None and not now[inputs.start]:
            return
        for step in self._steps(before, now):
            if inputs.phases != "direction":
                memory.M[_DIRECTION + self._number] = step < 0
            self._add(step)

    def _steps(self, before: Sequence[bool], now: Sequence[bool]) -> list[int]:
        """Return the counts of one sample: 1 = up, -1 = down."""
        first = self._inputs.count[0]
        rises = [now[number] and not before[number] for number in self._inputs.count]
        match self._inputs.phases:
            case "direction":
                down = self._cpu.memory.M[_DIRECTION + self._number]
                return [-1 if down else 1] if rises[0] else []
            case "up and down":
                return [step for step, rise in zip((1, -1), rises, strict=True) if rise]
            case "A and B":
                second = self._inputs.count[1]
                if now[first] and before[first] and now[second] != before[second]:
                    return [1 if rises[1] else -1]
        return []

    def _add(self, step: int) -> None:
        """Count, switch the contact at the preset, and execute the comparisons."""
        memory, number = self._cpu.memory, self._number
        old, limit = memory.CV[number], self._preset()
        value = memory.CV[number] = signed(old + step, 32)
        if (old, value) == (limit - 1, limit):
            memory.C[number] = True
        elif (old, value) == (limit, limit - 1):
            memory.C[number] = False
        for compare in tuple(self._cpu.after_count.get(number, ())):
            compare()
