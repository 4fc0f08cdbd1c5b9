"""Memory cells of a scan as z3 terms: devices, current values, timer starts, edge memories.

A cell is named after its list in `controller.core.devices.Memory`, so that a z3 model can be loaded into a soft PLC and
compared with it.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

import z3

from controller.core.devices import (
    ANNUNCIATOR_ON,
    CLOCK_1_S,
    INITIAL_PULSE,
    LOWEST_ANNUNCIATOR,
    RUN_MONITOR,
    SIZES,
    Memory,
    device_name,
    is_32_bit_counter,
)
from controller.core.expr import And, Bit, Compare, Const, Expr, Not, Or, Word, leaves
from controller.core.program import Program
from controller.core.rungs import Count, Pulse, PulseFalling

# Z3 itself checks the sorts of all terms; the same checks in its Python layer take a sixth of the time of a proof.
z3.z3.Z3_DEBUG = False

BIT_KINDS: Final = ("X", "Y", "M", "S", "T", "C", "CE", "E")
STOPPED: Final = -1
"""Start tick of a stopped timer."""

_VALUES: Final = {"D": "D", "T": "TV", "C": "CV"}
_FX_NAMES: Final = {"TV": "TN", "CV": "CN"}
_KINDS: Final = {fx: kind for kind, fx in _FX_NAMES.items()}


class ModelError(ValueError):
    """Raised for an invalid specification, goal name or trace, or a program that cannot be expressed as formulas."""


class Cell(NamedTuple):
    """One cell in the memory of a PLC.

    Attributes:
        kind: List of `controller.core.devices.Memory` that contains the cell.
        number: Index in that list.
    """

    kind: str
    number: int

    @property
    def is_bit(self) -> bool:
        """True for a bit, False for a number."""
        return self.kind in BIT_KINDS

    @property
    def width(self) -> int:
        """Width of a number in bits: 32 for start ticks and for counters from C200, otherwise 16."""
        return 32 if self.kind == "TS" or (self.kind == "CV" and is_32_bit_counter(self.number)) else 16

    def __str__(self) -> str:
        return device_name(_FX_NAMES.get(self.kind, self.kind), self.number)

    def variable(self, label: str) -> z3.ExprRef:
        """Return a z3 variable for the cell; the label distinguishes variables of the same cell."""
        name = f"{self}@{label}"
        return z3.Bool(name) if self.is_bit else z3.BitVec(name, self.width)

    def constant(self, value: int) -> z3.ExprRef:
        """Return a value of the cell as a z3 constant."""
        return z3.BoolVal(bool(value)) if self.is_bit else z3.BitVecVal(value, self.width)

    @property
    def default(self) -> int:
        """Value before the cell is first written."""
        return STOPPED if self.kind == "TS" else 0

    def read(self, memory: Memory) -> int:
        """Read the cell in the memory of a soft PLC."""
        return int(getattr(memory, self.kind)[self.number])

    def force(self, memory: Memory, value: int) -> None:
        """Write a value to the cell in the memory of a soft PLC."""
        getattr(memory, self.kind)[self.number] = bool(value) if self.is_bit else value


SymbolicMemory = dict[Cell, z3.ExprRef]


def cell_of(device: Bit | Word) -> Cell:
    """Return the cell of a contact or word."""
    return Cell(_VALUES[device.kind] if isinstance(device, Word) else device.kind, device.number)


def parse_cell(name: str) -> Cell:
    """Parse the name of a cell, the inverse of `str`.

    Raises:
        ModelError: The name is not a valid cell name.

    Examples:
        >>> parse_cell("X10"), str(parse_cell("TN246"))
        (Cell(kind='X', number=8), 'TN246')
    """
    match = re.fullmatch(r"([XY](?=[0-7]+$)|(?![XY])[A-Z]+)(\d+)", name)
    kind = _KINDS.get(match[1], match[1]) if match else ""
    if match is None or kind not in Memory.__slots__:
        raise ModelError(f"{name!r}: unknown device; use a name such as X10, M8, D512 or TN246")
    cell = Cell(kind, int(match[2], 8 if kind in "XY" else 10))
    if cell.number >= SIZES.get(kind[0], cell.number + 1):
        raise ModelError(f"{name!r}: out of range for an FX2N")
    return cell


def cells_of(program: Program, conditions: Iterable[Expr]) -> list[Cell]:
    """Return all cells that the program or these conditions use, sorted."""
    cells = {Cell("M", n) for n in (RUN_MONITOR, INITIAL_PULSE, CLOCK_1_S, ANNUNCIATOR_ON)}
    cells.add(Cell("D", LOWEST_ANNUNCIATOR))
    devices = [*program.devices(), *(device for condition in conditions for device in leaves(condition))]
    parts = {"T": ("T", "TV", "TS"), "C": ("C", "CV", "CE")}
    cells |= {Cell(kind, d.number) for d in devices for kind in parts.get(d.kind, (d.kind,))}
    rungs = list(program.rungs())
    edges = sum(isinstance(rung, Pulse | PulseFalling) for rung in rungs)
    cells |= {Cell("E", n) for n in range(edges)}
    cells |= {Cell("M", 8000 + n) for r in rungs if isinstance(r, Count) and is_32_bit_counter(n := r.counter.number)}
    return sorted(cells)


def condition(expr: Expr, memory: Mapping[Cell, z3.ExprRef]) -> z3.BoolRef:
    """Return a condition as a formula over a memory."""
    match expr:
        case Bit():
            return memory[cell_of(expr)]
        case Not(operand):
            term = condition(operand, memory)
            return z3.BoolRef(z3.Z3_mk_not(term.ctx_ref(), term.ast), term.ctx)
        case And(operands):
            return _joined(z3.Z3_mk_and, [condition(o, memory) for o in operands])
        case Or(operands):
            return _joined(z3.Z3_mk_or, [condition(o, memory) for o in operands])
        case Const(value):
            return z3.BoolVal(value)
        case Compare(relation, left, right):
            return compare(relation, memory[cell_of(left)], operand_of(right, memory))
    raise TypeError(f"not a condition: {expr!r}")


def _joined(join: Callable[[z3.ContextObj, int, ctypes.Array[z3.Ast]], z3.Ast], terms: list[z3.BoolRef]) -> z3.BoolRef:
    """Return the conjunction or disjunction of formulas of the default context.

    `z3.And` and `z3.Or` also convert each operand and compare its sort, which takes most of the time of their calls.
    """
    context = z3.main_ctx()
    operands = (z3.Ast * len(terms))(*[term.ast for term in terms])
    return z3.BoolRef(join(context.ref(), len(terms), operands), context)


def operand_of(operand: Word | int, memory: Mapping[Cell, z3.ExprRef]) -> z3.BitVecRef | int:
    """Return an integer unchanged, or the term for a word."""
    return operand if isinstance(operand, int) else memory[cell_of(operand)]


def compare(relation: str, left: z3.BitVecRef, right: z3.BitVecRef | int) -> z3.BoolRef:
    """Return the comparison of two signed numbers of any width as a formula."""
    needed = right.bit_length() + 1 if isinstance(right, int) else right.size()
    width = max(left.size(), needed)
    one, two = widened(left, width), widened(right, width)
    match relation:
        case "==":
            return one == two
        case "!=":
            return one != two
        case "<":
            return one < two
        case "<=":
            return one <= two
        case ">":
            return one > two
    return one >= two


def widened(number: z3.BitVecRef | int, width: int) -> z3.BitVecRef:
    """Return a signed number sign-extended to at least this width."""
    if isinstance(number, int):
        return z3.BitVecVal(number, width)
    return z3.SignExt(width - number.size(), number) if number.size() < width else number
