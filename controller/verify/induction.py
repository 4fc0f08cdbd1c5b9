"""Proof by induction over one scan: what holds before it, whatever the inputs are, holds after it.

A goal is proved when it holds after the first scan at the first power-up, and when one more scan, running or the
first after a loss of power, cannot break it where all goals held before. The solver tells which of them the proof
rests on; a proof counts only as far as those are proved too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import z3

from controller.verify.cells import Cell, condition
from controller.verify.model import Frame, Goal, Model, leaves_of
from controller.verify.solving import (
    assumed,
    core_names,
    new_solver,
    preferred,
    smallest_core,
    switch,
    unknowns,
    values,
)
from controller.verify.timing import ExactTimers


class Moment(StrEnum):
    """Which scan it is."""

    FACTORY = "the first scan at the first power-up"
    POWER_UP = "the first scan after a loss of power"
    RUNNING = "a running scan"


@dataclass(frozen=True)
class Failure:
    """A scan that breaks a goal, from a memory where every goal holds. Whether that memory is ever reached is open.

    Attributes:
        goal: The goal.
        moment: Which scan it is.
        before: The memory before the scan, with as little on as possible.
        start: The same with the inputs of the scan.
        after: The memory after the scan.
        because: Cells of `before` whose values, with those in `because_inputs`, are enough to break the goal.
        because_inputs: Cells written from outside before the scan whose values matter.
    """

    goal: Goal
    moment: Moment
    before: Mapping[Cell, int]
    start: Mapping[Cell, int]
    after: Mapping[Cell, int]
    because: tuple[Cell, ...]
    because_inputs: tuple[Cell, ...]


@dataclass(frozen=True)
class Verdict:
    """What induction says of a goal.

    Attributes:
        goal: The goal.
        proved: Whether one scan cannot break it; None where the solver did not answer in time.
        rests_on: Names of the goals that must hold before the scan.
        failure: The scan that breaks it.
    """

    goal: Goal
    proved: bool | None
    rests_on: frozenset[str] = frozenset()
    failure: Failure | None = None


class Induction:
    """The three kinds of scan of a model, each with its solver, made when first asked for."""

    def __init__(self, model: Model) -> None:
        """Take the model; nothing is solved yet."""
        self._model = model

    @cached_property
    def _scans(self) -> list[_Scan]:
        return [_Scan(self._model, moment) for moment in Moment]

    def prove(self, goal: Goal) -> Verdict:
        """Try to prove that no scan breaks a goal."""
        rests_on: frozenset[str] = frozenset()
        for scan in self._scans:
            verdict = scan.prove(goal)
            if not verdict.proved:
                return verdict
            rests_on |= verdict.rests_on
        return Verdict(goal, proved=True, rests_on=rests_on - {goal.name})


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
        self._assumed = {} if moment is Moment.FACTORY else assumed(self._solver, model, unknown)

    def prove(self, goal: Goal) -> Verdict:
        after = condition(goal.holds, self._frame.after)
        broken = switch(self._solver, z3.Not(after), "broken")
        answer = self._solver.check(broken, *self._assumed.values())
        if answer == z3.unknown:
            return Verdict(goal, proved=None)
        if answer == z3.unsat:
            return Verdict(goal, proved=True, rests_on=core_names(self._solver, self._assumed))
        return Verdict(goal, proved=False, failure=self._failure(goal, after, broken, self._solver.model()))

    def _failure(self, goal: Goal, after: z3.BoolRef, broken: z3.BoolRef, any_model: z3.ModelRef) -> Failure:
        quiet = [switch(self._solver, term == cell.constant(cell.empty)) for cell, term in self._unknown()]
        found = preferred(self._solver, [broken, *self._assumed.values()], quiet) or any_model
        before, start = values(found, self.before), values(found, self._frame.start)
        because = self._because(after, start)
        inputs = set(self._model.inputs)
        return Failure(
            goal,
            self._moment,
            before,
            start,
            values(found, self._frame.after),
            tuple(cell for cell in because if cell not in inputs),
            tuple(cell for cell in because if cell in inputs),
        )

    def _unknown(self) -> list[tuple[Cell, z3.ExprRef]]:
        """Return what the scan starts from as far as it is unknown."""
        terms = {**self.before, **{cell: self._frame.start[cell] for cell in self._model.inputs}}
        return [(cell, term) for cell, term in terms.items() if next(unknowns(term), None) is not None]

    def _because(self, after: z3.BoolRef, start: Mapping[Cell, int]) -> list[Cell]:
        """Return the cells whose values at the start of the scan are enough for the goal not to hold after it."""
        matter = {term.get_id() for term in unknowns(after)}
        solver = new_solver([after])
        literals = {
            cell: switch(solver, term == cell.constant(start[cell]))
            for cell, term in self._frame.start.items()
            if term.get_id() in matter
        }
        core = {literal.get_id() for literal in smallest_core(solver, literals.values()) or ()}
        return [cell for cell, literal in literals.items() if literal.get_id() in core]


def account(model: Model, failure: Failure) -> list[str]:
    """Return lines that tell somebody who writes invariants what the failed scan is about."""
    others = [
        cell
        for cell, held in failure.before.items()
        if held != cell.empty and cell not in failure.because and cell not in model.inputs and cell.kind != "TV"
    ]
    lines = [f"{failure.goal.name!r} is broken by {failure.moment}:"]
    for title, cells, memory in (
        ("enough for that, before the scan", failure.because, failure.start),
        ("enough for that, from outside", failure.because_inputs, failure.start),
        ("not empty either before the scan", others, failure.before),
        ("after the scan", [c for c in leaves_of(failure.goal.holds) if failure.after[c] != c.empty], failure.after),
    ):
        if cells:
            lines.append(f"  {title}: {', '.join(model.names.told(cell, memory[cell]) for cell in cells)}")
    return lines


def unproved(verdicts: Iterable[Verdict]) -> dict[str, frozenset[str]]:
    """Return the goals that are not proved, each with the goals not proved that its own proof rests on, if it has one.

    Goals that hold up each other are proved together: each holds at the first power-up by itself.
    """
    verdicts = tuple(verdicts)
    failed: dict[str, frozenset[str]] = {v.goal.name: frozenset() for v in verdicts if not v.proved}
    while True:
        shaken = {
            v.goal.name: v.rests_on & failed.keys()
            for v in verdicts
            if v.goal.name not in failed and v.rests_on & failed.keys()
        }
        if not shaken:
            return failed
        failed |= shaken
