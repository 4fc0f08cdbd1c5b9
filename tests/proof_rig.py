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
from controller.verify.cells import SymbolicMemory, condition
from controller.verify.model import Frame, Goal, Model
from controller.verify.solving import assumed, new_solver, switch
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


def damaged(change: Change, *rules: str) -> Specification:
    """The machine with its rungs changed, and some interlock rules left out.

    Raises:
        ValueError: No rung is another one then.
    """
    machine = build(MACHINE.io_map, without=rules) if rules else MACHINE
    program = machine.program
    blocks = tuple(Block(block.title, tuple(_changed(block, change))) for block in program.blocks)
    if blocks == program.blocks:
        raise ValueError("the damage hits no rung of the program")
    return specification(replace(machine, program=replace(program, blocks=blocks)))


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


def is_breakable(of: Specification, *names: str) -> bool:
    """Tell whether one scan can break any of these goals from a state where all goals hold.

    Args:
        of: A damaged program.
        names: Names of goals; without any, all of them.
    """
    model = Model(of)
    asked = [goal for goal in _touched(model) if not names or goal.name in names]
    if not asked:
        return False
    for solver, held, after in _scans(model):
        fails = switch(solver, z3.Or([z3.Not(condition(goal.holds, after)) for goal in asked]))
        if solver.check(fails, *held) != z3.unsat:
            return True
    return False


def _scans(model: Model) -> Iterator[tuple[z3.Solver, list[z3.BoolRef], SymbolicMemory]]:
    """Yield each kind of scan: what is known of it, what is assumed before it, and the memory after it."""
    unknown, facts = model.unknown("before")
    for before, first, assuming in (
        (unknown, False, True),
        (model.powered_up(unknown), True, True),
        (model.factory("before"), True, False),
    ):
        frame = _any_scan(model, before, first=first)
        solver = new_solver([*facts, *frame.limits])
        yield solver, [*assumed(solver, model, unknown).values()] if assuming else [], frame.after


def _touched(model: Model) -> list[Goal]:
    """Return the goals whose formula after any scan is not that of the sound program: others keep their proof."""
    sound, after = _sound(), _after_any_scan(model)
    return [goal for goal in model.goals if not after[goal.name].eq(sound[goal.name])]


def _any_scan(model: Model, before: SymbolicMemory, *, first: bool) -> Frame:
    return model.frame(before, "scan", first=first, timing=ExactTimers.aged("scan"))


def _after_any_scan(model: Model) -> dict[str, z3.BoolRef]:
    before, _ = model.unknown("before")
    after = _any_scan(model, before, first=False).after
    return {goal.name: condition(goal.holds, after) for goal in model.goals}


@cache
def _sound() -> dict[str, z3.BoolRef]:
    return _after_any_scan(Model(SOUND))
