"""Symbolic scan over z3 terms: the same blocks in the same order as `controller.core.compile` and `scan`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import z3

from controller.core.devices import (
    ANNUNCIATOR_ON,
    ANNUNCIATORS,
    LOWEST_ANNUNCIATOR,
    MS_100,
    WORD_MAX,
    is_32_bit_counter,
)
from controller.core.expr import Bit, Counter, Timer, Word
from controller.core.program import Program
from controller.core.rungs import (
    Add,
    Annunciate,
    Arithmetic,
    Count,
    Inc,
    Mov,
    OnDelay,
    Out,
    Pulse,
    PulseFalling,
    Rst,
    Rung,
    Scale,
    Set,
    Subtract,
    ZoneReset,
)
from controller.core.sequence import Sequence, Transfer
from controller.verify.cells import (
    STOPPED,
    Cell,
    ModelError,
    SymbolicMemory,
    cell_of,
    compare,
    condition,
    operand_of,
    widened,
)
from controller.verify.timing import Timing


@dataclass(frozen=True)
class SymbolicScan:
    """Effect of a scan on a memory.

    Attributes:
        after: Memory after END.
        blocks: Memory after each block, in order.
        fired: Firing condition of each transfer of a step's S bit, in order.
    """

    after: SymbolicMemory
    blocks: tuple[SymbolicMemory, ...]
    fired: dict[Bit, list[tuple[Transfer, z3.BoolRef]]]


def execute(program: Program, memory: SymbolicMemory, timing: Timing) -> SymbolicScan:
    """Execute the program once.

    Args:
        program: The program.
        memory: Memory at the start of the scan, including X image, special relays and external inputs; it is not
            changed.
        timing: Timer model of the scan.

    Returns:
        Memory after the scan, with intermediate results.

    Raises:
        ModelError: A rung moves more than 16 bits into a register.
    """
    run = SymbolicRun(dict(memory), timing)
    blocks = []
    for block in program.blocks:
        for item in block.items:
            run.item(item)
        blocks.append(dict(run.memory))
    run.end()
    return SymbolicScan(run.memory, tuple(blocks), run.fired)


@dataclass
class SymbolicRun:
    """Execution of one scan, item by item.

    Attributes:
        memory: Memory after the items executed so far.
        timing: Timer model of the scan.
        edges: Number of edge rungs executed so far.
        leaving: Condition for each step to be reset at END.
        fired: Firing condition of each transfer of a step's S bit, in order.
    """

    memory: SymbolicMemory
    timing: Timing
    edges: int = 0
    leaving: SymbolicMemory = field(default_factory=dict)
    fired: dict[Bit, list[tuple[Transfer, z3.BoolRef]]] = field(default_factory=dict)

    def item(self, item: Rung | Sequence) -> None:
        """Execute a rung or a sequence."""
        if isinstance(item, Sequence):
            self._sequence(item)
        else:
            self._rung(item)

    def _rung(self, rung: Rung) -> None:
        memory, driven = self.memory, condition(rung.when, self.memory)
        match rung:
            case Out(target):
                memory[cell_of(target)] = driven
            case Set(target):
                self._put(cell_of(target), 1, driven)
            case Rst(target):
                self._reset(target, driven)
            case ZoneReset(first, last):
                for number in range(first.number, last.number + 1):
                    self._put(Cell(first.kind, number), 0, driven)
            case Pulse(target) | PulseFalling(target):
                edge = Cell("E", self.edges)
                self.edges += 1
                before, rising = memory[edge], isinstance(rung, Pulse)
                memory[cell_of(target)] = z3.And(driven, z3.Not(before)) if rising else z3.And(z3.Not(driven), before)
                memory[edge] = driven
            case OnDelay(timer):
                self.timing.run(memory, timer, rung.counts, driven)
            case Annunciate(timer, preset, target):
                self.timing.run(memory, timer, preset // MS_100, driven)
                self._put(cell_of(target), 1, memory[Cell("T", timer.number)])
            case Count():
                self._count(rung, driven)
            case Mov(source, target):
                self._move(source, cell_of(target), driven)
            case Inc() | Add() | Subtract() | Scale():
                self._calculate(rung, cell_of(rung.target), driven)

    def _sequence(self, sequence: Sequence) -> None:
        for bit, step in sequence:
            on = self.memory[cell_of(bit)]
            dwell = sequence.dwell_rung(step)
            if dwell is not None:
                driven = z3.And(on, condition(dwell.when, self.memory))
                self.timing.run(self.memory, dwell.timer, dwell.counts, driven)
            self._transfers(sequence, bit, sequence.transfers[step.title], on)

    def end(self) -> None:
        """Reset the sources of the scan's transfers, then update the annunciator devices."""
        memory = self.memory
        for cell, left in self.leaving.items():
            memory[cell] = z3.And(memory[cell], z3.Not(left))
        set_now = [cell for cell in memory if cell.kind == "S" and cell.number in ANNUNCIATORS]
        on, lowest = Cell("M", ANNUNCIATOR_ON), Cell("D", LOWEST_ANNUNCIATOR)
        number = lowest.constant(0)
        for cell in sorted(set_now, reverse=True):
            number = z3.If(memory[cell], lowest.constant(cell.number), number)
        active = z3.Or([memory[cell] for cell in set_now])
        memory[lowest] = z3.If(z3.Or(active, memory[on]), number, memory[lowest])
        memory[on] = active

    def _transfers(self, sequence: Sequence, bit: Bit, transfers: Iterable[Transfer], on: z3.BoolRef) -> None:
        # The conditions exclude each other, and all of them are evaluated before any transfer fires.
        for transfer, true in [(t, condition(t.when, self.memory)) for t in transfers]:
            fires = z3.And(on, true)
            self.fired.setdefault(bit, []).append((transfer, fires))
            source, target = cell_of(bit), cell_of(transfer.target)
            self._put(target, 1, fires)
            if target in self.leaving:
                self.leaving[target] = z3.And(self.leaving[target], z3.Not(fires))
            if source != target:
                self.leaving[source] = z3.Or(self.leaving.get(source, z3.BoolVal(val=False)), fires)
            if sequence.consumes is not None:
                self._put(cell_of(sequence.consumes), 0, fires)

    def _put(self, cell: Cell, value: int, driven: z3.BoolRef) -> None:
        self.memory[cell] = z3.If(driven, cell.constant(value), self.memory[cell])

    def _reset(self, target: Bit | Word | Timer | Counter, driven: z3.BoolRef) -> None:
        match target:
            case Bit() | Word():
                self._put(cell_of(target), 0, driven)
            case Timer(number):
                self._put(Cell("T", number), 0, driven)
                self._put(Cell("TV", number), 0, driven)
                self._put(Cell("TS", number), STOPPED, driven)
            case Counter(number):
                self._put(Cell("C", number), 0, driven)
                self._put(Cell("CV", number), 0, driven)

    def _move(self, source: Word | int, target: Cell, driven: z3.BoolRef) -> None:
        moved = operand_of(source, self.memory)
        if not isinstance(moved, int) and moved.size() > target.width:
            raise ModelError(f"MOV {source} to {target}: 32 bits do not fit into a register; compare {source} instead")
        value = target.constant(moved) if isinstance(moved, int) else moved
        self.memory[target] = z3.If(driven, value, self.memory[target])

    def _calculate(self, rung: Arithmetic | Scale, target: Cell, driven: z3.BoolRef) -> None:
        before = self.memory[target]
        match rung:
            case Inc():
                self.memory[target] = z3.If(driven, before + 1, before)
            case Add(one, two):
                self.memory[target] = z3.If(driven, self._term(one, target) + self._term(two, target), before)
            case Subtract(one, two):
                self.memory[target] = z3.If(driven, self._term(one, target) - self._term(two, target), before)
            case Scale():
                self._scale(rung, target)

    def _term(self, operand: Word | int, target: Cell) -> z3.BitVecRef:
        """Return an operand with the width of a target; sums of such terms wrap as in the FX2N."""
        return widened(operand_of(operand, self.memory), target.width)

    def _scale(self, rung: Scale, target: Cell) -> None:
        before, operands = self.memory[target], (rung.source, rung.factor, rung.divisor)
        source, factor, divisor = (widened(operand_of(operand, self.memory), 2 * target.width) for operand in operands)
        quotient = source * factor / divisor
        value = z3.If(quotient > WORD_MAX, target.constant(WORD_MAX), z3.Extract(target.width - 1, 0, quotient))
        value = z3.If(quotient < 0, target.constant(0), value)
        self.memory[target] = z3.If(condition(rung.driven, self.memory), value, before)

    def _count(self, rung: Count, now: z3.BoolRef) -> None:
        memory, number = self.memory, rung.counter.number
        done, value, input_on = Cell("C", number), Cell("CV", number), Cell("CE", number)
        edge, before = z3.And(now, z3.Not(memory[input_on])), memory[value]
        preset = widened(operand_of(rung.preset, memory), value.width)
        if is_32_bit_counter(number):
            counted = z3.If(memory[Cell("M", 8000 + number)], before - 1, before + 1)
            reached = z3.And(before == preset - 1, counted == preset)
            passed_down = z3.And(before == preset, counted == preset - 1)
            contact = z3.Or(reached, z3.And(memory[done], z3.Not(passed_down)))
        else:
            below = compare("<", before, preset)
            counted = z3.If(below, before + 1, before)
            contact = z3.Or(memory[done], compare(">=", counted, preset))
        memory[value] = z3.If(edge, counted, before)
        memory[done] = z3.If(edge, contact, memory[done])
        memory[input_on] = now
