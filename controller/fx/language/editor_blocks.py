"""Size of the ladder blocks of a program as GX Works2 draws them; it edits only blocks up to a number of lines.

All limits and widths are from memory (fx2n.md 2.4): a ladder block has at most 24 lines, and a line has 12 cells, of
which 11 can hold contacts. A longer series of contacts continues in the next line. A contact and a coil take one cell
each; a comparison and an applied instruction take one cell for the name and one for each operand.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from controller.fx.language.instruction import Instruction, Ladder
from controller.fx.language.rung_shapes import Contact, Leg, Parallel, Rung, Series, Shape, rungs_of

MOST_LINES: Final = 24
"""Lines of the largest ladder block that GX Works2 edits (from memory)."""
CELLS: Final = 12
"""Cells of a line, including the one of the coil (from memory)."""
_COILS: Final = frozenset({"OUT", "SET", "RST", "PLS", "PLF"})


@dataclass(frozen=True, slots=True)
class EditorBlock:
    """Drawn size of one ladder block.

    Attributes:
        first: Index of its first instruction.
        lines: Number of lines, including continuations.
        widest: Cells of the widest group of contacts that cannot be continued in another line.
    """

    first: int
    lines: int
    widest: int

    @property
    def fits(self) -> bool:
        """True if GX Works2 can edit the block."""
        return self.lines <= MOST_LINES and self.widest < CELLS


def editor_blocks(ladder: Ladder) -> Iterator[EditorBlock]:
    """Yield the size of each ladder block, in order; instructions directly on the bus take one line."""
    for rung in rungs_of(ladder):
        yield _size(rung, ladder.instructions)


def condition_lines(contacts: Sequence[Instruction]) -> int:
    """Return the number of lines that the contacts of a condition take in front of one coil.

    Examples:
        >>> from controller.fx.language.instruction import DeviceOperand
        >>> m = DeviceOperand("M", 0)
        >>> condition_lines([Instruction("LD", (m,)), Instruction("OR", (m,)), Instruction("AND", (m,))])
        2
    """
    ladder = Ladder((*contacts, Instruction("INC")))
    return sum(block.lines for block in editor_blocks(ladder))


def _size(rung: Rung, program: Sequence[Instruction]) -> EditorBlock:
    if rung.leg is None:
        return EditorBlock(rung.first, 1, 1)
    lines, widest = _leg_lines(rung.leg, 0, program)
    return EditorBlock(rung.first, lines, widest)


def _leg_lines(leg: Leg, column: int, program: Sequence[Instruction]) -> tuple[int, int]:
    """Return the lines of a leg that begins in a column, and the cells of its widest indivisible part."""
    done = rows = widest = 0
    parts = leg.head.parts if isinstance(leg.head, Series) else () if leg.head is None else (leg.head,)
    for part in parts:
        cells, height = _cells(part, program)
        widest = max(widest, cells)
        if column and column + cells >= CELLS:  # the last cell is for the coil or the continuation
            done, rows, column = done + max(rows, 1), 0, 0
        column, rows = column + cells, max(rows, height)
    below = 0
    for item in leg.items:
        if isinstance(item, Leg):
            height, inner = _leg_lines(item, column, program)
            widest = max(widest, inner)
        else:
            height = 1 + (column > 0 and column + _output_cells(program[item]) > CELLS)
        below += height
    return done + max(rows, below), widest


def _cells(shape: Shape, program: Sequence[Instruction]) -> tuple[int, int]:
    """Return the cells and lines of contacts."""
    if isinstance(shape, Contact):
        operands = len(program[shape.at].operands)
        return (1 + operands if operands > 1 else 1), 1
    cells, lines = zip(*(_cells(part, program) for part in shape.parts), strict=True)
    return (max(cells), sum(lines)) if isinstance(shape, Parallel) else (sum(cells), max(lines))


def _output_cells(instruction: Instruction) -> int:
    return 1 if instruction.name in _COILS else 1 + len(instruction.operands)
