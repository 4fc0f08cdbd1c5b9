"""Actions that depend on conditions, and the interpretation of conditions without machine code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from controller.core.devices import Memory
from controller.core.expr import And, Expr, Not, Or, evaluate
from plant_sim.twin.conditions import CELLS, Advances, Exceeds


@dataclass(eq=False)
class Trigger:
    """Action to be executed after each scan in which a condition has become true.

    Attributes:
        condition: Condition over the devices of the program and the state of the plant.
        action: The action.
        holds: Latest value of the condition.
        cells: Values stored by an `Advances` condition.
    """

    condition: Expr
    action: Callable[[], None]
    holds: bool = False
    cells: np.ndarray = field(default_factory=lambda: np.zeros(CELLS))

    def save(self) -> Any:
        """Return the current state."""
        return self.holds, self.cells.copy()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        self.holds, self.cells[:] = saved


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

    def holds(self, condition: Expr, cells: np.ndarray) -> bool:
        """Return True if a condition is true.

        Args:
            condition: The condition.
            cells: Values stored from scan to scan.
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
            case Advances(quantity, tolerance, during):
                active, value = self.holds(during, cells), quantity.read(self._state)
                lowest = min(float(cells[0]), value) if cells[1] else value
                cells[:] = lowest, active
                return active and value > lowest + tolerance
        return evaluate(condition, self._memory)
