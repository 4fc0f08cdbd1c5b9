"""Questions to an incremental solver whose answers are checked; the solver is replaced when its state is in doubt."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import z3

from controller.verify.solving import new_solver

NO_LIMIT_MS: Final = 2**32 - 1
QUESTIONS_A_SOLVER: Final = 25
"""Number of questions after which a new solver is used; it bounds the memory for formulas that are no longer needed."""


class UndecidedError(RuntimeError):
    """Raised if the solver exceeds its limit, or if its answer does not satisfy the formulas."""


class Questions:
    """Questions whether facts are possible together with fixed facts.

    An incremental solver can keep a wrong state after a question that it did not decide. It is therefore replaced after
    such a question. Every solution is checked by evaluating all formulas, and a wrong one is asked again.
    """

    def __init__(self, facts: Iterable[z3.BoolRef]) -> None:
        """Store the fixed facts."""
        self._facts = list(facts)
        self._solver: z3.Solver | None = None
        self._asked = 0

    def solution(self, facts: Sequence[z3.BoolRef], effort: int = 0) -> z3.ModelRef | None:
        """Return a solution of the fixed facts and these facts; None if there is none.

        Args:
            facts: Further facts of this question.
            effort: Limit in the solver's unit of work; 0 = the time limit of `new_solver` applies instead.

        Raises:
            UndecidedError: The solver exceeded its limit, or answered wrongly twice.
        """
        for _ in range(2):
            found = self._asked_once(facts, effort)
            if found is None:
                return None
            if all(z3.is_true(found.eval(fact, model_completion=True)) for fact in (*facts, *self._facts)):
                return found
            self._solver = None
        raise UndecidedError("the solver returned a solution that does not satisfy the formulas")

    def _asked_once(self, facts: Sequence[z3.BoolRef], effort: int) -> z3.ModelRef | None:
        if self._solver is None or self._asked >= QUESTIONS_A_SOLVER or effort:
            self._solver, self._asked = new_solver(self._facts), 0
        self._asked += 1
        solver = self._solver
        if effort:
            solver.set("timeout", NO_LIMIT_MS)
            solver.set("rlimit", effort)
            self._solver = None
        solver.push()
        solver.add(*facts)
        answer = solver.check()
        found = solver.model() if answer == z3.sat else None
        solver.pop()
        if answer == z3.unknown:
            self._solver = None
            raise UndecidedError("the solver exceeded its limit")
        return found
