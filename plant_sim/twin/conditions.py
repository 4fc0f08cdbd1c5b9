"""Conditions over the state of the plant, which are compiled together with conditions over the program's devices."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np

from controller.core.devices import Memory
from controller.core.expr import And, CompiledCondition, Expr, Not, Or, evaluate
from plant_sim.machine.kernel import MACHINE

CELLS: Final = 2
"""Number of values that an `Advances` condition stores from scan to scan."""
_CELLS: Final = "c"
_STATE: Final = "s"
_DOUBLE: Final = struct.Struct("=d")


@dataclass(frozen=True)
class Quantity:
    """Value of the plant, as a field of the `MACHINE` record.

    Attributes:
        path: Names of the fields and indexes of the elements, separated by dots.
    """

    path: str

    @cached_property
    def offset(self) -> int:
        """Position of the value in the record, bytes.

        Raises:
            ValueError: The record has no such floating-point number.
        """
        kind, at = MACHINE, 0
        for name in self.path.split("."):
            if kind.subdtype is not None:
                kind = kind.subdtype[0]
                at += int(name) * kind.itemsize
            elif kind.fields is not None and name in kind.fields:
                kind, first = kind.fields[name][:2]
                at += first
            else:
                raise ValueError(f"{self.path}: no such value of the machine")
        if kind != np.float64:
            raise ValueError(f"{self.path}: not a floating-point number")
        return at

    def __gt__(self, limit: float) -> Exceeds:
        """Return a condition that is true while the value is greater than a limit."""
        return Exceeds(self, limit)

    def __lt__(self, limit: float) -> Expr:
        """Return a condition that is true while the value is less than a limit."""
        return Exceeds(self, limit, below=True)

    def read(self, state: np.ndarray) -> float:
        """Return the value in a state of the plant.

        Args:
            state: One `MACHINE` record.
        """
        return float(_DOUBLE.unpack_from(state.view(np.uint8).data, self.offset)[0])

    def load(self, code: Any) -> str:
        """Add the instructions that load the value to an LLVM function; return the name of the result."""
        return str(code.value(f"load double, ptr {code.pointer(_STATE, self.offset)}"))


@dataclass(frozen=True, slots=True)
class Exceeds(CompiledCondition):
    """Condition that is true while a value is greater (or less) than a limit.

    Attributes:
        quantity: The value.
        limit: The limit.
        below: True for less than the limit.
    """

    quantity: Quantity
    limit: float
    below: bool = False

    def emit(self, code: Any) -> str:
        """Add the comparison to an LLVM function."""
        relation = "olt" if self.below else "ogt"
        return str(code.value(f"fcmp {relation} double {self.quantity.load(code)}, {_constant(self.limit)}"))


@dataclass(frozen=True, slots=True)
class Advances(CompiledCondition):
    """Condition that is true while a value has risen by more than a tolerance since another condition became true.

    The rise is measured from the lowest value since then. As this is stored from scan to scan, the condition can be
    used in a trigger only, once.

    Attributes:
        quantity: The value.
        tolerance: Tolerated rise.
        during: The other condition.
    """

    quantity: Quantity
    tolerance: float
    during: Expr

    def emit(self, code: Any) -> str:
        """Add the comparison, and the update of the lowest value, to an LLVM function."""
        active, value = code.condition(self.during), self.quantity.load(code)
        lowest_at, started_at = code.pointer(_CELLS, 0), code.pointer(_CELLS, 8)
        lowest = code.value(f"load double, ptr {lowest_at}")
        started = code.value(f"fcmp one double {code.value(f'load double, ptr {started_at}')}, 0.0")
        is_lower = code.value(f"fcmp olt double {value}, {lowest}")
        adopted = code.value(f"or i1 {is_lower}, {code.inverse(started)}")
        lowest = code.value(f"select i1 {adopted}, double {value}, double {lowest}")
        code.add(f"store double {lowest}, ptr {lowest_at}")
        code.add(f"store double {code.value(f'uitofp i1 {active} to double')}, ptr {started_at}")
        limit = code.value(f"fadd double {lowest}, {_constant(self.tolerance)}")
        risen = code.value(f"fcmp ogt double {value}, {limit}")
        return str(code.all_of((active, risen)))


def check_advances(condition: Expr, allowed: int) -> None:
    """Check the number of `Advances` in a condition.

    Args:
        condition: The condition.
        allowed: Largest number.

    Raises:
        ValueError: There are more.
    """
    if _count_advances(condition) > allowed:
        raise ValueError("Advances: can be used in the condition of a trigger only, once")


def _count_advances(condition: Expr) -> int:
    match condition:
        case Advances(_, _, during):
            return 1 + _count_advances(during)
        case Not(operand):
            return _count_advances(operand)
        case And(operands) | Or(operands):
            return sum(_count_advances(operand) for operand in operands)
    return 0


class Interpreter:
    """Evaluation of conditions by interpretation; the reference for machine code."""

    def __init__(self, memory: Memory, state: np.ndarray) -> None:
        """Create an interpreter.

        Args:
            memory: Devices of the program.
            state: State of the plant, one `MACHINE` record.
        """
        self._memory = memory
        self._state = state

    def holds(self, condition: Expr, cells: np.ndarray | None = None) -> bool:
        """Return True if a condition is true.

        Args:
            condition: The condition.
            cells: Values stored by an `Advances` condition.
        """
        match condition:
            case Not(operand):
                return not self.holds(operand, cells)
            case And(operands):
                values = [self.holds(operand, cells) for operand in operands]  # each of them may change its cells
                return all(values)
            case Or(operands):
                values = [self.holds(operand, cells) for operand in operands]
                return any(values)
            case Exceeds(quantity, limit, below):
                value = quantity.read(self._state)
                return value < limit if below else value > limit
            case Advances(quantity, tolerance, during) if cells is not None:
                active, value = self.holds(during, cells), quantity.read(self._state)
                lowest = min(float(cells[0]), value) if cells[1] else value
                cells[:] = lowest, active
                return active and value > lowest + tolerance
        return evaluate(condition, self._memory)


def _constant(value: float) -> str:
    """Return a number as an LLVM constant that is exact."""
    return f"0x{np.float64(value).view(np.uint64):016X}"
