"""Proof by induction over one scan: if all goals hold before the scan, they hold after it, for all inputs.

A goal is proved if it holds after the first scan at the first power-up, and if no other scan that starts from a memory
state in which all goals hold can violate it, either in normal operation or as the first scan after a loss of power. The
solver reports which goals a proof depends on; the proof is valid only if these are proved too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Final

import z3

from controller.verify.cells import Cell, condition
from controller.verify.model import Frame, Goal, Model, leaves_of
from controller.verify.solving import (
    core_names,
    goal_switches,
    new_solver,
    preferred_model,
    smallest_core,
    switch,
    unknowns,
    values,
)
from controller.verify.timing import ExactTimers

CAUSE_LINES: Final = 12
"""Maximum number of lines of a short description."""


class Moment(StrEnum):
    """Kind of scan."""

    FACTORY = "the first scan at the first power-up"
    POWER_UP = "the first scan after a loss of power"
    RUNNING = "a running scan"


@dataclass(frozen=True)
class Failure:
    """Scan that violates a goal, starting from a memory state, reachable or not, in which every goal holds.

    Attributes:
        goal: The goal.
        moment: Kind of scan.
        before: Memory before the scan, with as few non-default values as possible.
        start: The same memory with the inputs of the scan.
        after: Memory after the scan.
        causes: Cells of `before` whose values, together with those in `input_causes`, are sufficient to violate the
            goal.
        input_causes: Cells written externally before the scan whose values are part of the cause.
    """

    goal: Goal
    moment: Moment
    before: Mapping[Cell, int]
    start: Mapping[Cell, int]
    after: Mapping[Cell, int]
    causes: tuple[Cell, ...]
    input_causes: tuple[Cell, ...]

    @property
    def results(self) -> list[Cell]:
        """Cells in the condition of the goal whose values after the scan differ from the default."""
        return [cell for cell in leaves_of(self.goal.holds) if self.after[cell] != cell.default]


@dataclass(frozen=True)
class Verdict:
    """Result of the induction for one goal.

    Attributes:
        goal: The goal.
        proved: Whether the goal is proved; None = solver timeout.
        rests_on: Names of the goals that must hold before the scan.
        failure: Scan that violates the goal.
    """

    goal: Goal
    proved: bool | None
    rests_on: frozenset[str] = frozenset()
    failure: Failure | None = None


class Induction:
    """Inductive proof of a model, with one solver for each of the three kinds of scan, created on first use."""

    def __init__(self, model: Model) -> None:
        """Store the model; solving starts on demand."""
        self._model = model

    @cached_property
    def _scans(self) -> list[_Scan]:
        return [_Scan(self._model, moment) for moment in Moment]

    def prove(self, goal: Goal) -> Verdict:
        """Try to prove that no scan violates a goal."""
        rests_on: frozenset[str] = frozenset()
        for scan in self._scans:
            verdict = scan.prove(goal)
            if not verdict.proved:
                return verdict
            rests_on |= verdict.rests_on
        return Verdict(goal, proved=True, rests_on=rests_on - {goal.name})

    def prove_together(self, goals: Iterable[Goal]) -> frozenset[str] | None:
        """Try to prove that no scan violates any of these goals.

        A joint proof takes about as long as the proof of one goal. If it fails, it does not show which goal fails.

        Returns:
            Names of the goals that must hold before the scan, or None if the joint proof fails or the solver times out.
        """
        goals = tuple(goals)
        rests_on: frozenset[str] = frozenset()
        for scan in self._scans:
            core = scan.prove_together(goals)
            if core is None:
                return None
            rests_on |= core
        return rests_on


class _Scan:
    def __init__(self, model: Model, moment: Moment) -> None:
        self._model, self._moment = model, moment
        unknown, facts = model.unknown("before")
        self.before = unknown
        if moment is Moment.FACTORY:
            self.before = model.factory("before")
        elif moment is Moment.POWER_UP:
            self.before = model.powered_up(unknown)
        timing = ExactTimers.aged("scan")
        self._frame: Frame = model.frame(self.before, "scan", first=moment is not Moment.RUNNING, timing=timing)
        self._solver = new_solver(facts + self._frame.limits)
        self._assumed = {} if moment is Moment.FACTORY else goal_switches(self._solver, model, unknown)

    def prove(self, goal: Goal) -> Verdict:
        after = condition(goal.holds, self._frame.after)
        broken = switch(self._solver, z3.Not(after), "broken")
        answer = self._solver.check(broken, *self._assumed.values())
        if answer == z3.unknown:
            return Verdict(goal, proved=None)
        if answer == z3.unsat:
            return Verdict(goal, proved=True, rests_on=core_names(self._solver, self._assumed))
        return Verdict(goal, proved=False, failure=self._failure(goal, after, broken, self._solver.model()))

    def prove_together(self, goals: Iterable[Goal]) -> frozenset[str] | None:
        after = z3.And([condition(goal.holds, self._frame.after) for goal in goals])
        broken = switch(self._solver, z3.Not(after), "any broken")
        if self._solver.check(broken, *self._assumed.values()) != z3.unsat:
            return None
        return core_names(self._solver, self._assumed)

    def _failure(self, goal: Goal, after: z3.BoolRef, broken: z3.BoolRef, any_model: z3.ModelRef) -> Failure:
        quiet = [switch(self._solver, term == cell.constant(cell.default)) for cell, term in self._unknown()]
        solution = preferred_model(self._solver, [broken, *self._assumed.values()], quiet) or any_model
        before, start = values(solution, self.before), values(solution, self._frame.start)
        causes = self._causes(after, start)
        inputs = set(self._model.inputs)
        return Failure(
            goal,
            self._moment,
            before,
            start,
            values(solution, self._frame.after),
            tuple(cell for cell in causes if cell not in inputs),
            tuple(cell for cell in causes if cell in inputs),
        )

    def _unknown(self) -> list[tuple[Cell, z3.ExprRef]]:
        """Return the unknown terms at the start of the scan."""
        terms = {**self.before, **{cell: self._frame.start[cell] for cell in self._model.inputs}}
        return [(cell, term) for cell, term in terms.items() if next(unknowns(term), None) is not None]

    def _causes(self, after: z3.BoolRef, start: Mapping[Cell, int]) -> list[Cell]:
        """Return the cells whose values at the start of the scan are sufficient to violate the goal."""
        relevant = {term.get_id() for term in unknowns(after)}
        solver = new_solver([after])
        literals = {
            cell: switch(solver, term == cell.constant(start[cell]))
            for cell, term in self._frame.start.items()
            if term.get_id() in relevant
        }
        core = {literal.get_id() for literal in smallest_core(solver, literals.values()) or ()}
        return [cell for cell, literal in literals.items() if literal.get_id() in core]


def describe_failure(model: Model, failure: Failure) -> list[str]:
    """Return a description of the scan that violates the goal, for the author of the invariants."""
    others = [
        cell
        for cell, value in failure.before.items()
        if value != cell.default and cell not in failure.causes and cell not in model.inputs and cell.kind != "TV"
    ]
    lines = [f"{failure.goal.name!r} is violated by {failure.moment}:"]
    for title, cells, memory in (
        ("cause, before the scan", failure.causes, failure.start),
        ("cause, external inputs", failure.input_causes, failure.start),
        ("other values before the scan", others, failure.before),
        ("after the scan", failure.results, failure.after),
    ):
        if cells:
            lines.append(f"  {title}: {', '.join(model.names.describe(cell, memory[cell]) for cell in cells)}")
    return lines


def cause_of(model: Model, failure: Failure) -> list[str]:
    """Return a short description of the scan that violates the goal, in at most `CAUSE_LINES` lines.

    It lists the values in the cause that differ from the default, such as devices that are on, and counts the others.
    """
    causes = [*failure.causes, *failure.input_causes]
    listed = [cell for cell in causes if failure.start[cell] != cell.default]
    shown = listed[: CAUSE_LINES - 4]
    lines = [f"in {failure.moment}, sufficient:"]
    lines += [f"  {model.names.describe(cell, failure.start[cell])}" for cell in shown]
    if len(listed) > len(shown):
        lines.append(f"  and {len(listed) - len(shown)} other values")
    if len(causes) > len(listed):
        lines.append(f"  and {len(causes) - len(listed)} devices that are off or 0")
    if results := failure.results:
        lines.append(f"  then: {', '.join(model.names.describe(cell, failure.after[cell]) for cell in results)}")
    return lines


def unproved(verdicts: Iterable[Verdict]) -> dict[str, frozenset[str]]:
    """Return the unproved goals, each with the unproved goals that its own proof depends on.

    Goals that depend on each other are proved together; each is proved independently for the first scan.
    """
    verdicts = tuple(verdicts)
    failed: dict[str, frozenset[str]] = {v.goal.name: frozenset() for v in verdicts if not v.proved}
    while True:
        dependent = {
            v.goal.name: v.rests_on & failed.keys()
            for v in verdicts
            if v.goal.name not in failed and v.rests_on & failed.keys()
        }
        if not dependent:
            return failed
        failed |= dependent
