"""Proof of a specification for many mutants of its program, with one solver for each kind of scan.

The formulas before a scan are those of the original program; only the formulas that a change affects are new. A mutant
is killed by the goals that a scan can violate, from a memory in which all goals hold, or by a way out that no longer
leads to its goal. These are the goals that `controller.verify.report.prove` would report.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Final

import z3

from controller.core.expr import Bit
from controller.core.program import Program
from controller.core.specification import Specification, WayOut
from controller.verify.cells import Cell, SymbolicMemory, cell_of, condition
from controller.verify.induction import Moment
from controller.verify.model import REQUIREMENT, Goal, Model
from controller.verify.progress import Exits
from controller.verify.solving import goal_switches, new_solver, switch
from controller.verify.symbolic import execute
from controller.verify.timing import ExactTimers, FreeTimers

MOMENTS: Final = (Moment.RUNNING, Moment.POWER_UP, Moment.FACTORY)
"""Kinds of scan; most violations are found in a running scan."""
LONGEST_WAY: Final = 2
"""Number of scans of the longest way out."""


class UndecidedError(RuntimeError):
    """Raised if the solver exceeds its time limit."""


class MutantProof:
    """Proof of the goals and ways out of a specification for changed programs."""

    def __init__(self, specification: Specification) -> None:
        """Translate the original program."""
        self._specification = specification
        self._model = Model(specification)

    @cached_property
    def _scans(self) -> list[_SharedScan]:
        return [_SharedScan(self._model, moment) for moment in MOMENTS]

    @cached_property
    def _ways(self) -> _SharedWays:
        return _SharedWays(self._model)

    def violated(self, program: Program) -> list[str]:
        """Return the goals that one scan of a changed program can violate together; empty if all goals are proved.

        Raises:
            UndecidedError: The solver exceeded its time limit.
        """
        watched = self._watched(program)
        return next((found for scan in self._scans if (found := scan.violated(watched))), [])

    def blocked_way_out(self, program: Program) -> str:
        """Return the name of the first way out that no longer leads to its goal; empty if there is none."""
        return self._ways.blocked(self._watched(program))

    def step_without_exit(self, program: Program) -> str:
        """Return the name of the first step that can no longer be left; empty if there is none."""
        return _step_without_exit(Model(self._with(program)))

    def equals(self, program: Program) -> bool:
        """Return True if every device has the same value after every scan of both programs.

        Both programs start from the same memory, in which all goals hold, with the same inputs and the same time.
        """
        watched = self._watched(program)
        return not any(scan.differs(watched) for scan in self._scans)

    def _with(self, program: Program) -> Specification:
        specification = self._specification
        return Specification(
            program,
            specification.monitors,
            specification.remembered,
            specification.requirements,
            specification.invariants,
            specification.ways_out,
            specification.ranges,
        )

    def _watched(self, program: Program) -> Program:
        return self._with(program).watched


def _step_without_exit(model: Model) -> str:
    exits = Exits(model)
    return next((bit.name for bit in exits.steps() if exits.step(bit).holds is False), "")


@contextmanager
def _retracted(solver: z3.Solver) -> Iterator[None]:
    """Remove the facts added in the `with` block."""
    solver.push()
    try:
        yield
    finally:
        solver.pop()


def _is_possible(solver: z3.Solver, facts: Iterable[z3.BoolRef]) -> bool:
    answer = solver.check(*facts)
    if answer == z3.unknown:
        raise UndecidedError("the solver exceeded its time limit")
    return bool(answer == z3.sat)


class _SharedScan:
    """One scan of the original program, and of changed programs from the same memory with the same inputs."""

    def __init__(self, model: Model, moment: Moment) -> None:
        self._goals = model.goals
        unknown, facts = model.unknown("before")
        before = {
            Moment.FACTORY: lambda: model.factory("before"),
            Moment.POWER_UP: lambda: model.powered_up(unknown),
            Moment.RUNNING: lambda: unknown,
        }[moment]()
        first = moment is not Moment.RUNNING
        frame = model.frame(before, "scan", first=first, timing=ExactTimers.aged("scan"))
        self._start, self._after = frame.start, frame.after
        self._holds = self._goal_formulas(frame.after)
        self._solver = new_solver(facts + frame.limits)
        assumed = {} if moment is Moment.FACTORY else goal_switches(self._solver, model, unknown)
        self._assumed = list(assumed.values())

    def violated(self, program: Program) -> list[str]:
        """Return the goals that the scan can violate together, requirements first."""
        holds = self._goal_formulas(self._executed(program))
        affected = [goal for goal in self._goals if not holds[goal.name].eq(self._holds[goal.name])]
        if not affected:
            return []
        with _retracted(self._solver):
            self._solver.add(z3.Or([z3.Not(holds[goal.name]) for goal in affected]))
            if not _is_possible(self._solver, self._assumed):
                return []
            solution = self._solver.model()
        broken = [g for g in affected if z3.is_false(solution.eval(holds[g.name], model_completion=True))]
        return [goal.name for goal in sorted(broken, key=lambda goal: goal.kind != REQUIREMENT)]

    def differs(self, program: Program) -> bool:
        """Return True if a device can have different values after the scan."""
        after = self._executed(program)
        different = [term != after[cell] for cell, term in self._after.items() if not term.eq(after[cell])]
        if not different:
            return False
        with _retracted(self._solver):
            self._solver.add(z3.Or(different))
            return _is_possible(self._solver, self._assumed)

    def _executed(self, program: Program) -> SymbolicMemory:
        return execute(program, self._start, ExactTimers.aged("scan")).after

    def _goal_formulas(self, after: Mapping[Cell, z3.ExprRef]) -> dict[str, z3.BoolRef]:
        return {goal.name: condition(goal.holds, after) for goal in self._goals}


class _SharedWays:
    """The scans of all ways out, with free timers."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._ways: tuple[WayOut, ...] = model.specification.ways_out
        self._before, facts = model.unknown("before")
        self._timings = [FreeTimers(f"scan {number}") for number in range(LONGEST_WAY)]
        limits: list[z3.BoolRef] = []
        memory = self._before
        for number, timing in enumerate(self._timings):
            frame = model.frame(memory, f"scan {number}", first=False, timing=timing)
            limits += frame.limits
            memory = frame.after
        self._solver = new_solver(facts + limits)
        self._assumed = [*goal_switches(self._solver, model, self._before).values()]
        self._starts = [switch(self._solver, self._started(way)) for way in self._ways]
        self._reached = self._goal_formulas(model.program)

    def blocked(self, program: Program) -> str:
        """Return the name of the first way out that a changed program can miss; empty if there is none."""
        for way, start, one, other in zip(
            self._ways, self._starts, self._reached, self._goal_formulas(program), strict=True
        ):
            if other.eq(one):
                continue
            with _retracted(self._solver):
                self._solver.add(z3.Not(other))
                if _is_possible(self._solver, [start, *self._assumed]):
                    return way.name
        return ""

    def _started(self, way: WayOut) -> z3.BoolRef:
        commanded = (
            self._level(bit, number) == z3.BoolVal(val=on)
            for number, scan in enumerate(way.scans)
            for bit, on in scan.items()
        )
        return z3.And(condition(way.start, self._before), *commanded)

    def _level(self, bit: Bit, number: int) -> z3.BoolRef:
        if bit.kind == "T":
            return self._timings[number].elapsed(bit.number)
        return cell_of(bit).variable(f"scan {number}")

    def _goal_formulas(self, program: Program) -> list[z3.BoolRef]:
        """Return, for each way out, the formula of its goal after its last scan."""
        memories = []
        memory = self._before
        for number, timing in enumerate(self._timings):
            start = self._model.start(memory, f"scan {number}", first=False, timing=timing)
            memory = execute(program, start, timing).after
            memories.append(memory)
        return [condition(way.goal, memories[len(way.scans) - 1]) for way in self._ways]


def names_of(goals: Iterable[Goal]) -> list[str]:
    """Return the names of goals."""
    return [goal.name for goal in goals]
