"""Judgement of mutants: by proof, by stories played elsewhere, and the classification of the survivors by proof."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Protocol

from controller.core.program import Program
from controller.core.specification import Specification
from controller.verify.mutants.blocking import Blocking
from controller.verify.mutants.change import Kind
from controller.verify.mutants.proof import MutantProof
from controller.verify.mutants.questions import UndecidedError
from controller.verify.mutants.result import Fate, MutantResult
from controller.verify.mutants.sample import Mutant


class Stories(Protocol):
    """Player of stories with the machine, which the controller does not know."""

    def begin(self, mutant: Mutant) -> None:
        """Begin to play the stories with a mutant."""

    def results(self) -> Iterator[tuple[int, str]]:
        """Yield the number of every mutant that was begun, with the story that kills it; empty if none does."""


class Judgement:
    """Judgement of the mutants of a program."""

    def __init__(self, specification: Specification, rules: Mapping[str, Callable[[], Program]]) -> None:
        """Prepare the judgement.

        Args:
            specification: Specification of the original program.
            rules: Functions that return the program without one interlock rule, by name of the rule.
        """
        self._proof = MutantProof(specification)
        self._specification, self._rules = specification, rules
        self._blocking: Blocking | None = None

    def results(self, mutants: Iterable[Mutant], stories: Stories | None) -> list[MutantResult]:
        """Return the results of mutants in the same order.

        Args:
            mutants: Mutants of the program.
            stories: Player of the stories; None = survivors of the proof are only classified.
        """
        chosen = list(mutants)
        decided: dict[int, MutantResult] = {}
        for mutant in chosen:
            result = self.by_proof(mutant)
            if result is not None:
                decided[mutant.number] = result
            elif stories is not None:
                stories.begin(mutant)
        killers = {} if stories is None else dict(stories.results())
        for mutant in chosen:
            if mutant.number in decided:
                continue
            killer = killers.get(mutant.number, "")
            decided[mutant.number] = _result(mutant, Fate.STORY, killer) if killer else self.of_survivor(mutant)
        return [decided[mutant.number] for mutant in chosen]

    def by_proof(self, mutant: Mutant) -> MutantResult | None:
        """Return the result of a mutant if it is killed by proof, otherwise None."""
        for check in self._specification.checks:
            if check.of_program is not None and not check.of_program(mutant.program).holds:
                return _result(mutant, Fate.PROOF, check.name)
        try:
            violated = self._proof.violated(mutant.program)
            if violated:
                return _result(mutant, Fate.PROOF, violated[0])
            way = self._proof.blocked_way_out(mutant.program)
            if way:
                return _result(mutant, Fate.PROOF, f"way out: {way}")
        except UndecidedError:
            return None
        return None

    def of_survivor(self, mutant: Mutant) -> MutantResult:
        """Return the class of a mutant that neither a proof nor any story kills."""
        if mutant.kind is Kind.PRESET and self._proof.differs_in_time_only(mutant.program):
            return _result(mutant, Fate.DURATION, "equal to the original if every timer may elapse at any time")
        if mutant.kind is not Kind.PRESET and self._proof.equals(mutant.program):
            return _result(mutant, Fate.EQUIVALENT, "every device has the same value after every scan")
        if self._proof.acts_equally(mutant.program):
            return _result(mutant, Fate.DISPLAY, "only registers and relays differ that influence no output")
        if self._blocking is None:
            self._blocking = Blocking(self._specification, self._rules)
        block = self._blocking.rule_that_blocks(mutant)
        if block is not None:
            return _result(mutant, Fate.BLOCKED, f"{block.rule}; without it, it violates {block.goal!r}")
        return _result(mutant, Fate.OPEN, "")


def _result(mutant: Mutant, fate: Fate, evidence: str) -> MutantResult:
    return MutantResult(str(mutant), mutant.kind, fate, evidence)
