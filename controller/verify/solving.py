"""Solver helpers: incremental solvers, simple models, and dependencies of a formula."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

import z3

from controller.verify.cells import Cell, SymbolicMemory, condition
from controller.verify.model import Model

CHECK_LIMIT_MS: Final = 60_000
"""Timeout of one solver call, ms; the search may set a shorter one."""


def new_solver(facts: Iterable[z3.BoolRef] = ()) -> z3.Solver:
    """Return an incremental solver for bits and numbers of fixed width."""
    solver = z3.SolverFor("QF_FD")
    solver.set("timeout", CHECK_LIMIT_MS)
    solver.add(*facts)
    return solver


def switch(solver: z3.Solver, fact: z3.BoolRef, name: str = "switch") -> z3.BoolRef:
    """Add a fact that applies only to solver calls that assume the returned switch."""
    literal = z3.FreshBool(name)
    solver.add(z3.Implies(literal, fact))
    return literal


def goal_switches(solver: z3.Solver, model: Model, memory: SymbolicMemory) -> dict[str, z3.BoolRef]:
    """Return, by goal name, a switch that asserts the goal in this memory."""
    return {goal.name: switch(solver, condition(goal.holds, memory), goal.name) for goal in model.goals}


def core_names(solver: z3.Solver, switches: Mapping[str, z3.BoolRef]) -> frozenset[str]:
    """Return the names of the switches in the last unsatisfiable core."""
    core = {literal.get_id() for literal in solver.unsat_core()}
    return frozenset(name for name, literal in switches.items() if literal.get_id() in core)


def value(model: z3.ModelRef, term: z3.ExprRef) -> int:
    """Return the value of a bit or signed number in a model."""
    found = model.eval(term, model_completion=True)
    return int(z3.is_true(found)) if z3.is_bool(found) else int(found.as_signed_long())


def values(model: z3.ModelRef, memory: SymbolicMemory) -> dict[Cell, int]:
    """Return the values of a memory in a model."""
    return {cell: value(model, term) for cell, term in memory.items()}


def preferred_model(solver: z3.Solver, hard: Sequence[z3.BoolRef], soft: Iterable[z3.BoolRef]) -> z3.ModelRef | None:
    """Return a model of the hard literals that satisfies as many soft literals as possible, in order of priority.

    Returns:
        The model, or None if the hard literals are unsatisfiable or the solver timed out.
    """
    wanted = list(soft)
    dropped: set[int] = set()
    while (answer := solver.check(*hard, *(w for w in wanted if w.get_id() not in dropped))) == z3.unsat:
        conflicting = {literal.get_id() for literal in solver.unsat_core()} & {w.get_id() for w in wanted}
        if not conflicting:
            return None
        dropped |= conflicting
    if answer != z3.sat:
        return None
    found = solver.model()
    accepted = [literal for literal in wanted if literal.get_id() not in dropped]
    for literal in (w for w in wanted if w.get_id() in dropped):
        if solver.check(*hard, *accepted, literal) == z3.sat:
            found = solver.model()
            accepted.append(literal)
    return found


def smallest_core(solver: z3.Solver, literals: Iterable[z3.BoolRef]) -> list[z3.BoolRef] | None:
    """Return a minimal unsatisfiable subset of the literals; None if unsatisfiability is not shown."""
    if solver.check(*literals) != z3.unsat:
        return None
    core = list(solver.unsat_core())
    for literal in tuple(core):
        rest = [other for other in core if not other.eq(literal)]
        if solver.check(*rest) == z3.unsat:
            core = rest
    return core


def unknowns(term: z3.ExprRef) -> Iterator[z3.ExprRef]:
    """Yield each unknown of a term once."""
    seen: set[int] = set()
    waiting = [term]
    while waiting:
        node = waiting.pop()
        if node.get_id() in seen:
            continue
        seen.add(node.get_id())
        waiting.extend(node.children())
        if z3.is_const(node) and node.decl().kind() == z3.Z3_OP_UNINTERPRETED:
            yield node
