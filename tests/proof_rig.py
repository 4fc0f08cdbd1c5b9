"""The machine's program to prove, as it is or damaged on purpose."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import z3

from controller.core.clock import MonotonicClock
from controller.core.expr import And, Expr, Not, Or, all_of, any_of
from controller.core.program import Block
from controller.core.rungs import Rung
from controller.core.sequence import Sequence
from controller.core.specification import Specification
from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.proof import specification
from controller.verify.cells import condition
from controller.verify.induction import Induction
from controller.verify.model import Goal, Model
from controller.verify.timing import ExactTimers

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
TAGS = MACHINE.tags
SOUND = specification(MACHINE)
CLOCK = MonotonicClock()

Change = Callable[[str, Rung], Rung | None]
"""From the title of a block and a rung of it to the damaged rung; None = left out."""


def seconds() -> float:
    """The clock of a proof."""
    return CLOCK.now_ms() / 1000


def without(*rules: str) -> Specification:
    """The machine without some of its interlock rules."""
    return specification(build(MACHINE.io_map, without=rules))


def damaged(change: Change) -> Specification:
    """The machine with its rungs changed.

    Raises:
        ValueError: No rung is another one then.
    """
    program = MACHINE.program
    blocks = tuple(Block(block.title, tuple(_changed(block, change))) for block in program.blocks)
    if blocks == program.blocks:
        raise ValueError("the damage hits no rung of the program")
    return specification(replace(MACHINE, program=replace(program, blocks=blocks)))


def _changed(block: Block, change: Change) -> Iterator[Rung | Sequence]:
    for item in block.items:
        changed = item if isinstance(item, Sequence) else change(block.title, item)
        if changed is not None:
            yield changed


def put(expr: Expr, part: Expr, by: Expr) -> Expr:
    """Return a condition with one of its parts replaced wherever it occurs."""
    if expr == part:
        return by
    match expr:
        case Not(operand):
            return ~put(operand, part, by)
        case And(operands):
            return all_of(*(put(each, part, by) for each in operands))
        case Or(operands):
            return any_of(*(put(each, part, by) for each in operands))
    return expr


def not_proved(of: Specification) -> list[Goal]:
    """Return the goals of a damaged program that one scan can break, those that the damage cannot touch left out.

    Where the condition of a goal after any scan is the same formula as for the sound program, its proof is the same.
    """
    model = Model(of)
    induction, after, sound = Induction(model), _after_any_scan(model), _sound()
    touched = (goal for goal in model.goals if not after[goal.name].eq(sound[goal.name]))
    return [goal for goal in touched if not induction.prove(goal).proved]


def _after_any_scan(model: Model) -> dict[str, z3.BoolRef]:
    before, _ = model.unknown("before")
    after = model.frame(before, "scan", first=False, timing=ExactTimers.aged("scan")).after
    return {goal.name: condition(goal.holds, after) for goal in model.goals}


@cache
def _sound() -> dict[str, z3.BoolRef]:
    return _after_any_scan(Model(SOUND))
