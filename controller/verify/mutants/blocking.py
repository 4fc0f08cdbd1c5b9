"""Interlock rules that prevent the harm of a mutant: without the rule, it violates a goal that the original upholds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import z3

from controller.core.program import Program
from controller.core.specification import Specification
from controller.verify.cells import SymbolicMemory, condition
from controller.verify.model import Model
from controller.verify.mutants.sample import Mutant, mutants_of
from controller.verify.solving import goal_switches, new_solver
from controller.verify.symbolic import execute
from controller.verify.timing import ExactTimers


class Block(NamedTuple):
    """Rule that blocks a mutant.

    Attributes:
        rule: Name of the rule.
        goal: Goal that the mutant violates without the rule, in a scan in which the original without it does not.
    """

    rule: str
    goal: str


class Blocking:
    """Search for the rule that prevents the harm of a mutant."""

    def __init__(self, specification: Specification, rules: Mapping[str, Callable[[], Program]]) -> None:
        """Prepare the search.

        Args:
            specification: Specification of the original program.
            rules: Functions that return the program without one rule, by name of the rule.
        """
        self._specification, self._rules = specification, rules
        self._model = Model(specification)
        before, facts = self._model.unknown("before")
        frame = self._model.frame(before, "scan", first=False, timing=ExactTimers.aged("scan"))
        self._start, self._after = frame.start, frame.after
        self._solver = new_solver(facts + frame.limits)
        self._assumed = [*goal_switches(self._solver, self._model, before).values()]
        self._without = cache(self._program_without)

    def rule_that_blocks(self, mutant: Mutant) -> Block | None:
        """Return the first rule without which a mutant does harm in one scan, in which the original does none.

        The mutant must not violate a goal with all rules. None = no such rule, or the solver exceeded its time limit.
        """
        changed = self._executed(mutant.program)
        if all(term.eq(changed[cell]) for cell, term in self._after.items() if cell.kind == "Y"):
            return None
        found = (self._harm(rule, mutant) for rule in self._rules)
        return next((block for block in found if block is not None), None)

    def _harm(self, rule: str, mutant: Mutant) -> Block | None:
        original, after = self._without(rule)
        same = _same_change(mutant, original)
        if same is None:
            return None
        changed = self._executed(same)
        if all(term.eq(changed[cell]) for cell, term in after.items()):
            return None
        goals = {goal.name: condition(goal.holds, changed) for goal in self._model.goals}
        self._solver.push()
        self._solver.add(*(condition(goal.holds, after) for goal in self._model.goals))
        self._solver.add(z3.Or([z3.Not(holds) for holds in goals.values()]))
        harmed = self._solver.check(*self._assumed) == z3.sat
        solution = self._solver.model() if harmed else None
        self._solver.pop()
        if solution is None:
            return None
        broken = [name for name, holds in goals.items() if z3.is_false(solution.eval(holds, model_completion=True))]
        return Block(rule, broken[-1])  # requirements follow the invariants

    def _program_without(self, rule: str) -> tuple[Program, SymbolicMemory]:
        program = self._rules[rule]()
        return program, self._executed(program)

    def _executed(self, program: Program) -> SymbolicMemory:
        watched = replace(self._specification, program=program).watched
        return execute(watched, self._start, ExactTimers.aged("scan")).after


def _same_change(mutant: Mutant, program: Program) -> Program | None:
    """Return a program with the change of a mutant; None if the program has no such place."""
    if program.block(mutant.block).items == mutant.original.block(mutant.block).items:
        return replace(program, blocks=tuple(mutant.changed if b.title == mutant.block else b for b in program.blocks))
    alone = replace(program, blocks=(program.block(mutant.block),), outputs=mutant.block)
    same = next((each for each in mutants_of(alone) if each.text == mutant.text), None)
    if same is None:
        return None
    return replace(program, blocks=tuple(same.changed if b.title == mutant.block else b for b in program.blocks))
