"""Interlock rules that prevent the harm of a mutant: without the rule, it violates a goal that the original upholds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Final, NamedTuple

import z3

from controller.core.program import Program
from controller.core.specification import Specification
from controller.verify.cells import condition
from controller.verify.model import Model
from controller.verify.mutants.questions import Questions, UndecidedError
from controller.verify.mutants.sample import Mutant, mutants_of
from controller.verify.mutants.shared_run import SharedRun
from controller.verify.timing import ExactTimers

EFFORT: Final = 30_000_000
"""Limit for one rule, in the solver's unit of work; about 5 s of processor time, the same on a busy computer."""


class Blocked(NamedTuple):
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
        self._start = frame.start
        self._run = self._shared_run(specification.program)
        held = [condition(goal.holds, before) for goal in self._model.goals]
        self._questions = Questions([*facts, *frame.limits, *held])
        self._without = cache(self._program_without)

    def rule_that_blocks(self, mutant: Mutant) -> Blocked | None:
        """Return the first rule without which a mutant does harm in one scan, in which the original does none.

        With all rules, a scan of the mutant must turn on no output that the original leaves off, unless the rungs of
        the outputs themselves are changed.

        For a change of a block of one arm or of the tray, only the rules for its outputs are tried. The mutant must not
        violate a goal with all rules. None = no such rule, or the solver exceeded `EFFORT`.
        """
        changed = self._run.executed(self._watched(mutant.program))
        outputs = [(term, changed[cell]) for cell, term in self._run.after.items() if cell.kind == "Y"]
        more = [z3.And(other, z3.Not(term)) for term, other in outputs if not term.eq(other)]
        if not more or (mutant.block != mutant.original.outputs and self._is_possible(z3.Or(more))):
            return None
        group = mutant.block.partition(" ")[0]
        of_group = [rule for rule in self._rules if rule.startswith(f"{group}: ")]
        found = (self._harm(rule, mutant) for rule in of_group or self._rules)
        return next((block for block in found if block is not None), None)

    def _is_possible(self, fact: z3.BoolRef) -> bool:
        """Return False if a fact is proved to be impossible in a scan."""
        try:
            return self._questions.solution([fact], EFFORT) is not None
        except UndecidedError:
            return True

    def _harm(self, rule: str, mutant: Mutant) -> Blocked | None:
        original, run = self._without(rule)
        same = _same_change(mutant, original)
        if same is None:
            return None
        after, changed = run.after, run.executed(self._watched(same))
        if all(term.eq(changed[cell]) for cell, term in after.items()):
            return None
        goals = {goal.name: condition(goal.holds, changed) for goal in self._model.goals}
        original_holds = [condition(goal.holds, after) for goal in self._model.goals]
        harm = z3.Or([z3.Not(holds) for holds in goals.values()])
        try:
            solution = self._questions.solution([*original_holds, harm], EFFORT)
        except UndecidedError:
            return None
        if solution is None:
            return None
        broken = [name for name, holds in goals.items() if z3.is_false(solution.eval(holds, model_completion=True))]
        return Blocked(rule, broken[-1])  # requirements follow the invariants

    def _program_without(self, rule: str) -> tuple[Program, SharedRun]:
        program = self._rules[rule]()
        return program, self._shared_run(program)

    def _shared_run(self, program: Program) -> SharedRun:
        return SharedRun(self._watched(program), self._start, lambda: ExactTimers.aged("scan"))

    def _watched(self, program: Program) -> Program:
        return replace(self._specification, program=program).watched


def _same_change(mutant: Mutant, program: Program) -> Program | None:
    """Return a program with the change of a mutant; None if the program has no such place."""
    if program.block(mutant.block).items == mutant.original.block(mutant.block).items:
        return replace(program, blocks=tuple(mutant.changed if b.title == mutant.block else b for b in program.blocks))
    alone = replace(program, blocks=(program.block(mutant.block),), outputs=mutant.block)
    same = next((each for each in mutants_of(alone) if each.text == mutant.text), None)
    if same is None:
        return None
    return replace(program, blocks=tuple(same.changed if b.title == mutant.block else b for b in program.blocks))
