"""Execution of changed programs as formulas, in which only what a change affects is executed again."""

from __future__ import annotations

from collections.abc import Callable

import z3

from controller.core.program import Program
from controller.core.rungs import Pulse, PulseFalling, Rung
from controller.core.sequence import Sequence
from controller.verify.cells import Cell, SymbolicMemory
from controller.verify.mutants.influence import Access, accesses
from controller.verify.symbolic import SymbolicRun
from controller.verify.timing import Timing


class SharedRun:
    """One scan of an original program, item by item, and of changed programs with equally many items.

    Attributes:
        after: Memory after the scan of the original program.
    """

    def __init__(self, program: Program, start: SymbolicMemory, timing: Callable[[], Timing]) -> None:
        """Execute the original program.

        Args:
            program: The program.
            start: Memory at the start of the scan.
            timing: Function that returns the timer model of the scan.
        """
        self._start, self._timing = start, timing
        self._items = _items(program)
        self._cells = [_union(item) for item in accesses(program)]
        self._written: list[dict[Cell, z3.ExprRef]] = []
        self._left: list[dict[Cell, z3.BoolRef]] = []
        run = SymbolicRun(dict(start), timing())
        for item, cells in zip(self._items, self._cells, strict=True):
            run.item(item)
            self._written.append({cell: run.memory[cell] for cell in cells.written})
            self._left.append({cell: run.leaving[cell] for cell in cells.written if cell in run.leaving})
        run.end()
        self.after = run.memory

    def executed(self, program: Program) -> SymbolicMemory:
        """Return the memory after the scan of a changed program from the same memory."""
        items = _items(program)
        run = SymbolicRun(dict(self._start), self._timing())
        cells_of = accesses(program)
        changed: set[Cell] = set()
        for number, (item, original) in enumerate(zip(items, self._items, strict=True)):
            if item is original and changed.isdisjoint(self._cells[number].read):
                run.memory |= self._written[number]
                run.leaving |= self._left[number]
                run.edges += isinstance(item, Pulse | PulseFalling)
                continue
            run.item(item)
            self._note_changes(number, _union(cells_of[number]), run, changed)
        run.end()
        return run.memory

    def _note_changes(self, number: int, cells: Access, run: SymbolicRun, changed: set[Cell]) -> None:
        """Add the cells that differ from the original after an item, and remove those that do not."""
        for cell in cells.written | self._cells[number].written:
            original = self._written[number].get(cell)
            # a cell that only one of the programs writes here counts as changed
            same = original is not None and cell in cells.written and run.memory[cell].eq(original)
            left, original_left = run.leaving.get(cell), self._left[number].get(cell)
            same = same and ((left is None) == (original_left is None)) and (left is None or left.eq(original_left))
            if same:
                changed.discard(cell)
            else:
                changed.add(cell)


def _items(program: Program) -> list[Rung | Sequence]:
    return [item for block in program.blocks for item in block.items]


def _union(item: list[Access]) -> Access:
    reads, writes = zip(*item, strict=True) if item else ((), ())
    return Access(frozenset().union(*reads), frozenset().union(*writes))
