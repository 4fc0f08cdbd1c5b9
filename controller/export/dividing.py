"""Division of conditions that are taller than a ladder block of GX Works2.

Parts of such a condition are evaluated into auxiliary relays, directly before the rung. A relay is written in every
scan before it is read, so neither its previous value nor a power failure has an effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from controller.core.expr import And, Bit, Expr, Not, Or, all_of, any_of, leaves
from controller.core.program import Block, Program
from controller.core.rungs import Out, Rung, written_devices
from controller.core.sequence import Sequence as Steps


def divided(program: Program, free: Iterator[int], lines: Callable[[Expr], int], most_lines: int) -> Program:
    """Return an equivalent program in which the condition of every rung has at most a number of lines.

    The conditions of sequences are unchanged, because their relays would have to be evaluated outside the steps.

    Args:
        program: The program.
        free: Numbers of relays that the program does not use.
        lines: Function that returns the drawn lines of a condition.
        most_lines: Largest number of lines.
    """
    divider = _Divider(free, lines, most_lines)
    blocks = (Block(block.title, tuple(divider.items(block.items))) for block in program.blocks)
    return replace(program, blocks=tuple(blocks))


class _Divider:
    def __init__(self, free: Iterator[int], lines: Callable[[Expr], int], most_lines: int) -> None:
        self._free = free
        self._lines = lines
        self._most = most_lines
        self._pending: list[Rung] = []

    def items(self, items: tuple[Rung | Steps, ...]) -> Iterator[Rung | Steps]:
        """Yield the items; the rungs of the relays directly precede the rung that reads them."""
        before: Expr | None = None
        fitting: Expr | None = None
        for item in items:
            if isinstance(item, Steps):
                before = None
                yield item
                continue
            if item.when != before or fitting is None:
                before, fitting = item.when, self._fitting(item.when)
            yield from self._pending
            self._pending.clear()
            yield item if fitting == item.when else replace(item, when=fitting)
            if set(written_devices(item)) & set(leaves(item.when)):
                before = None  # the relay has the value before the write

    def _fitting(self, when: Expr) -> Expr:
        """Return a condition of at most the largest number of lines; its parts may be relays."""
        contacts = sum(1 for _ in leaves(when))  # each takes at most one line
        if contacts <= self._most or self._lines(when) <= self._most:
            return when
        match when:
            case Not(operand):
                return ~self._relay(operand)
            case And(operands):
                return all_of(*(self._relay(o) if self._lines(o) > 1 else o for o in operands))
            case Or(operands):
                return self._fitting_parallel(operands)
        return when

    def _fitting_parallel(self, operands: tuple[Expr, ...]) -> Expr:
        """Return a parallel connection whose first operands are combined in a relay, as often as necessary."""
        waiting = [operand if self._lines(operand) < self._most else self._relay(operand) for operand in operands]
        while self._lines(any_of(*waiting)) > self._most:
            counts = range(len(waiting) - 1, 1, -1)
            count = next(n for n in counts if self._lines(any_of(*waiting[:n])) <= self._most)
            waiting[:count] = [self._relay(any_of(*waiting[:count]))]
        return any_of(*waiting)

    def _relay(self, condition: Expr) -> Expr:
        fitting = self._fitting(condition)
        relay = Bit("M", next(self._free), "auxiliary: part of a condition")
        self._pending.append(Out(relay, fitting))
        return relay
