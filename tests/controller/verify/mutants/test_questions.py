"""Questions to the solver: undecided and wrong answers do not affect later ones."""

from __future__ import annotations

from collections.abc import Iterable

import pytest
import z3

from controller.verify.mutants import questions
from controller.verify.mutants.questions import Questions, UndecidedError
from controller.verify.solving import new_solver

A, B = z3.Bools("a b")
ONE, TWO = z3.BitVecs("one two", 32)
FACTORS = [ONE * TWO == 2147483629, z3.UGT(ONE, 1), z3.UGT(TWO, 1), z3.ULT(ONE, 65536), z3.ULT(TWO, 65536)]
"""Factors of a prime number, which a solver does not decide within a small effort."""


def test_a_question_does_not_affect_the_next() -> None:
    asked = Questions([z3.Or(A, B)])
    assert asked.solution([z3.Not(A), z3.Not(B)]) is None
    found = asked.solution([z3.Not(A)])
    assert found is not None
    assert z3.is_true(found.eval(B))


def test_after_an_undecided_question_the_next_is_answered() -> None:
    asked = Questions([z3.Or(A, B)])
    with pytest.raises(UndecidedError, match="limit"):
        asked.solution(FACTORS, effort=1_000)
    assert asked.solution([z3.Not(A), z3.Not(B)]) is None
    assert asked.solution([A]) is not None


def test_a_solution_that_violates_a_fact_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first solver has lost the fixed facts; its solution is rejected, and a new solver is asked."""
    solvers: list[z3.Solver] = []

    def forgetful(facts: Iterable[z3.BoolRef]) -> z3.Solver:
        solvers.append(new_solver(facts if solvers else ()))
        return solvers[-1]

    monkeypatch.setattr(questions, "new_solver", forgetful)
    assert Questions([A]).solution([z3.Not(A)]) is None
    assert len(solvers) == 2


def test_a_solver_that_is_always_wrong_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(questions, "new_solver", lambda facts: new_solver())
    with pytest.raises(UndecidedError, match="does not satisfy"):
        Questions([A]).solution([z3.Not(A)])
