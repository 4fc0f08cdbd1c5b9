"""Electrical nodes of a rung: wires that always have the same power."""

from __future__ import annotations

from typing import Final

from controller.fx.language.rung_shapes import Contact, Leg, Parallel, Series, Shape

RAIL: Final = 0
"""Node of the left rail."""


class Wiring:
    """Nodes of one rung, numbered from `RAIL`.

    Attributes:
        before: Node to the left of each contact, by the index of its instruction.
        after: Node to the right of each contact.
        outputs: Node to the left of each output.
        count: Number of nodes.
    """

    def __init__(self, leg: Leg) -> None:
        """Number the nodes of a rung."""
        self.before: dict[int, int] = {}
        self.after: dict[int, int] = {}
        self.outputs: dict[int, int] = {}
        self.count = 1
        self._leg(leg, RAIL)

    def start(self, shape: Shape) -> int:
        """Return the node to the left of contacts."""
        while not isinstance(shape, Contact):
            shape = shape.parts[0]
        return self.before[shape.at]

    def end(self, shape: Shape) -> int:
        """Return the node to the right of contacts."""
        while not isinstance(shape, Contact):
            shape = shape.parts[-1]
        return self.after[shape.at]

    def _leg(self, leg: Leg, left: int) -> None:
        fork = left if leg.head is None else self._shape(leg.head, left, self._new())
        for item in leg.items:
            if isinstance(item, Leg):
                self._leg(item, fork)
            else:
                self.outputs[item] = fork

    def _shape(self, shape: Shape, left: int, right: int) -> int:
        match shape:
            case Contact(at):
                self.before[at], self.after[at] = left, right
            case Series(parts):
                *first, last = parts
                for part in first:
                    left = self._shape(part, left, self._new())
                self._shape(last, left, right)
            case Parallel(parts):
                for part in parts:
                    self._shape(part, left, right)
        return right

    def _new(self) -> int:
        self.count += 1
        return self.count - 1
