"""Proof of a specification for many mutants of its program, with one solver for each kind of scan.

The formulas before a scan are those of the original program; only the formulas that a change affects are new. A mutant
is killed by the goals that a scan can violate, from a memory in which all goals hold, or by a way out that no longer
leads to its goal. These are the goals that `controller.verify.report.prove` would report.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property
from typing import Final

import z3

from controller.core.expr import Bit
from controller.core.program import Program
from controller.core.specification import Specification, WayOut
from controller.verify.cells import Cell, cell_of, condition
from controller.verify.induction import Moment
from controller.verify.model import REQUIREMENT, Model, leaves_of
from controller.verify.mutants.influence import influences_outputs
from controller.verify.mutants.questions import Questions, UndecidedError
from controller.verify.mutants.shared_run import SharedRun
from controller.verify.symbolic import execute
from controller.verify.timing import ExactTimers, FreeTimers

MOMENTS: Final = (Moment.RUNNING, Moment.POWER_UP, Moment.FACTORY)
"""Kinds of scan; most violations are found in a running scan."""
EQUAL_EFFORT: Final = 30_000_000
"""Limit for a proof that two programs are equal, in the solver's unit of work; about 5 s of processor time. In contrast
to a time limit, it gives the same result on a busy computer."""
LONGEST_WAY: Final = 2
"""Number of scans of the longest way out."""


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

    def equals(self, program: Program) -> bool:
        """Return True if every device is proved to have the same value after every scan of both programs.

        Both programs start from the same memory, in which all goals hold, with the same inputs and the same time. The
        result is False if the solver does not decide within `EQUAL_EFFORT`.
        """
        watched = self._watched(program)
        return all(scan.equals(watched) for scan in self._scans)

    def acts_equally(self, program: Program) -> bool:
        """Return True if a changed program differs only in devices that influence no output, in any scan."""
        relevant = influences_outputs(program) | influences_outputs(self._specification.program)
        watched = self._watched(program)
        return all(scan.equals(watched, relevant) for scan in self._scans)

    def differs_in_time_only(self, program: Program) -> bool:
        """Return True if a changed program equals the original if every driven timer may elapse at any time."""
        before, _ = self._model.unknown("before")
        timing = FreeTimers("scan")
        start = self._model.start(before, "scan", first=False, timing=timing)
        one, other = (execute(each, start, timing).after for each in (self._model.program, self._watched(program)))
        return all(term.eq(other[cell]) for cell, term in one.items())

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


class _SharedScan:
    """One scan of the original program, and of changed programs from the same memory with the same inputs."""

    def __init__(self, model: Model, moment: Moment) -> None:
        self._goals = model.goals
        unknown, facts = model.unknown("before")
        before = unknown
        if moment is Moment.FACTORY:
            before = model.factory("before")
        elif moment is Moment.POWER_UP:
            before = model.powered_up(unknown)
        first = moment is not Moment.RUNNING
        frame = model.frame(before, "scan", first=first, timing=ExactTimers.aged("scan"))
        self._run = SharedRun(model.program, frame.start, lambda: ExactTimers.aged("scan"))
        self._cells = {goal.name: frozenset(leaves_of(goal.holds)) for goal in model.goals}
        held = [] if moment is Moment.FACTORY else [condition(goal.holds, unknown) for goal in model.goals]
        self._questions = Questions(facts + frame.limits + held)

    def violated(self, program: Program) -> list[str]:
        """Return the goals that the scan can violate together, requirements first."""
        after = self._run.executed(program)
        changed = {cell for cell, term in self._run.after.items() if not term.eq(after[cell])}
        affected = [goal for goal in self._goals if not changed.isdisjoint(self._cells[goal.name])]
        if not affected:
            return []
        holds = {goal.name: condition(goal.holds, after) for goal in affected}
        solution = self._questions.solution([z3.Or([z3.Not(each) for each in holds.values()])])
        if solution is None:
            return []
        broken = [g for g in affected if z3.is_false(solution.eval(holds[g.name], model_completion=True))]
        return [goal.name for goal in sorted(broken, key=lambda goal: goal.kind != REQUIREMENT)]

    def equals(self, program: Program, cells: Collection[Cell] | None = None) -> bool:
        """Return True if these devices, or all, are proved to have the same values after the scan."""
        after = self._run.executed(program)
        different = [
            term != after[cell]
            for cell, term in self._run.after.items()
            if (cells is None or cell in cells) and not term.eq(after[cell])
        ]
        if not different:
            return True
        try:
            return self._questions.solution([z3.Or(different)], EQUAL_EFFORT) is None
        except UndecidedError:
            return False


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
        start = model.start(self._before, "scan 0", first=False, timing=self._timings[0])
        self._run = SharedRun(model.program, start, lambda: self._timings[0])
        held = [condition(goal.holds, self._before) for goal in model.goals]
        self._questions = Questions([*facts, *limits, *held])
        self._starts = [self._started(way) for way in self._ways]
        self._reached = self._goal_formulas(model.program)

    def blocked(self, program: Program) -> str:
        """Return the name of the first way out that a changed program can miss; empty if there is none."""
        for way, start, one, other in zip(
            self._ways, self._starts, self._reached, self._goal_formulas(program), strict=True
        ):
            if other.eq(one):
                continue
            if self._questions.solution([start, z3.Not(other)]) is not None:
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
        memories = [self._run.executed(program)]
        for number in range(len(memories), LONGEST_WAY):
            timing = self._timings[number]
            start = self._model.start(memories[-1], f"scan {number}", first=False, timing=timing)
            memories.append(execute(program, start, timing).after)
        return [condition(way.goal, memories[len(way.scans) - 1]) for way in self._ways]
