"""Specifications of the machine for proofs, unmodified or with deliberate mutations."""

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
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.requirements.proof import specification
from controller.verify.cells import SymbolicMemory, condition
from controller.verify.model import Frame, Goal, Model
from controller.verify.solving import goal_switches, new_solver, switch
from controller.verify.timing import ExactTimers

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
TAGS = MACHINE.tags
SOUND = specification(MACHINE)
CLOCK = MonotonicClock()

Change = Callable[[str, Rung], Rung | None]
"""Function that returns the mutated rung for a block title and a rung of the block, or None to remove the rung."""


def seconds() -> float:
    """Return the current time of the clock that measures the duration of proofs, s."""
    return CLOCK.now_ms() / 1000


def without(*rules: str) -> Specification:
    """Return the specification of the machine with the given interlock rules removed."""
    return specification(build(MACHINE.io_map, without=rules))


def mutated(change: Change, *rules: str) -> Specification:
    """Return the specification of the machine with mutated rungs and with the given interlock rules removed.

    Raises:
        ValueError: The change matches no rung.
    """
    machine = build(MACHINE.io_map, without=rules) if rules else MACHINE
    program = machine.program
    blocks = tuple(Block(block.title, tuple(_changed(block, change))) for block in program.blocks)
    if blocks == program.blocks:
        raise ValueError("the change matches no rung of the program")
    return specification(replace(machine, program=replace(program, blocks=blocks)))


def _changed(block: Block, change: Change) -> Iterator[Rung | Sequence]:
    for item in block.items:
        changed = item if isinstance(item, Sequence) else change(block.title, item)
        if changed is not None:
            yield changed


def put(expr: Expr, part: Expr, by: Expr) -> Expr:
    """Return a condition in which all occurrences of a part are replaced."""
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
    """Return whether one scan can violate any of these goals, starting from a state in which all goals hold.

    Args:
        of: Specification of a mutated program.
        names: Names of goals; all goals if no name is passed.
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
    """Yield, for each kind of scan, the solver, the assumptions before the scan, and the memory after it."""
    unknown, facts = model.unknown("before")
    for before, first, assuming in (
        (unknown, False, True),
        (model.powered_up(unknown), True, True),
        (model.factory("before"), True, False),
    ):
        frame = _any_scan(model, before, first=first)
        solver = new_solver([*facts, *frame.limits])
        yield solver, [*goal_switches(solver, model, unknown).values()] if assuming else [], frame.after


def _touched(model: Model) -> list[Goal]:
    """Return the goals whose formula after a scan differs from that of the unmodified program."""
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
