"""Bounded search for a trace from power-up, with exact timers, adding one scan at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Final

import z3

from controller.core.devices import MS_100
from controller.verify.cells import SymbolicMemory, cell_of, compare, condition
from controller.verify.model import Frame, Goal, Model
from controller.verify.solving import CHECK_LIMIT_MS, goal_switches, new_solver, preferred_model, switch, value, values
from controller.verify.timing import ExactTimers
from controller.verify.trace import Start, Trace, scan_of

PAUSE_BITS: Final = 8
"""Number of bits for the pause between scans in tenths of a second, at most 25.6 s; longer waits need more scans."""


class Search:
    """Consecutive scans from power-up, created on demand.

    The search starts from the first power-up, or from a loss of power in any state in which every goal holds; only
    retentive devices keep their values through a loss of power. Traces from the first power-up have priority.
    """

    def __init__(self, model: Model, clock: Callable[[], float]) -> None:
        """Start at power-up.

        Args:
            model: Model to search.
            clock: Monotonic clock, s.
        """
        self._model, self._clock = model, clock
        unknown, facts = model.unknown("retained")
        self._solver = new_solver(facts)
        self._factory = z3.Bool("first power-up")
        for goal_holds in goal_switches(self._solver, model, unknown).values():
            self._solver.add(z3.Implies(z3.Not(self._factory), goal_holds))
        new, retained_cells = model.factory("remembered"), model.powered_up(unknown)
        self._start: SymbolicMemory = {
            cell: z3.If(self._factory, new[cell], retained_cells[cell]) for cell in model.cells
        }
        self._solver.add(list(self._restorable()))
        self._frames: list[Frame] = []
        self._pauses: list[z3.BitVecRef] = []
        self._tenths: list[z3.BitVecRef] = []

    def _restorable(self) -> Iterator[z3.BoolRef]:
        """Yield that the retained words have values that a start accepts."""
        for word, valid in self._model.program.valid.items():
            cell = cell_of(word)
            if cell in self._model.retained_cells:
                term = self._start[cell]
                if isinstance(valid, range):
                    yield z3.And(compare(">=", term, valid[0]), compare("<=", term, valid[-1]))
                else:
                    yield z3.Or([compare("==", term, number) for number in valid])

    def find(self, goals: Iterable[Goal], scans: int, seconds: float) -> dict[str, Trace]:
        """Search for traces after which a goal does not hold, the shortest first.

        Args:
            goals: The goals.
            scans: Maximum length of a trace, scans.
            seconds: Time limit for all goals together.

        Returns:
            Traces found, by goal name.
        """
        until_s = self._clock() + seconds
        wanted = list(goals)
        found: dict[str, Trace] = {}
        for number in range(1, scans + 1):
            wanted = [goal for goal in wanted if goal.name not in found]
            if not wanted or self._clock() >= until_s:
                break
            if number > len(self._frames):
                self._extend()
            for goal in wanted:
                trace = self._after(goal, number, until_s)
                if trace is not None:
                    found[goal.name] = trace
        return found

    def _after(self, goal: Goal, scans: int, until_s: float) -> Trace | None:
        """Search for a trace of exactly this number of scans."""
        holds = condition(goal.holds, self._frames[scans - 1].after)
        broken = switch(self._solver, z3.Not(holds), "broken")
        for origin in (self._factory, z3.Not(self._factory)):
            left_ms = int((until_s - self._clock()) * 1000)
            if left_ms <= 0:
                return None
            self._solver.set("timeout", min(left_ms, CHECK_LIMIT_MS))
            if self._solver.check(broken, origin) == z3.sat:
                return self._trace(goal, scans, [broken, origin])
        return None

    def _extend(self) -> None:
        number = len(self._frames)
        before = self._memory(number)
        pause = z3.BitVec(f"pause@{number}", PAUSE_BITS)
        longer = z3.ZeroExt(32 - PAUSE_BITS, pause)
        # In the first scan only the phase of the 1 s clock is free.
        tenths = z3.URem(longer, 10) if number == 0 else self._tenths[-1] + 1 + longer
        timing = ExactTimers.at_tenths(tenths)
        frame = self._model.frame(before, f"scan {number}", first=number == 0, timing=timing)
        self._solver.add(frame.limits)
        self._frames.append(frame)
        self._pauses.append(pause)
        self._tenths.append(tenths)

    def _memory(self, number: int) -> SymbolicMemory:
        """Return the memory before a scan."""
        return self._frames[number - 1].after if number else self._start

    def _trace(self, goal: Goal, scans: int, hard: list[z3.BoolRef]) -> Trace:
        self._solver.set("timeout", CHECK_LIMIT_MS)
        first_model = self._solver.model()
        quiet = [switch(self._solver, fact) for fact in self._quiet(scans)]
        solution = preferred_model(self._solver, hard, quiet) or first_model
        model = self._model
        rows = []
        for number in range(scans):
            before, start = values(solution, self._memory(number)), values(solution, self._frames[number].start)
            rows.append(scan_of(model, value(solution, self._tenths[number]) * MS_100, before, start))
        memory = values(solution, self._start)
        first_ever = bool(value(solution, self._factory))
        retained_cells = {} if first_ever else {cell_of(device): device for device in model.program.retentive}
        retained = {str(cell): memory[cell] for cell in retained_cells}
        forced = {str(cell): memory[cell] for cell in model.remembered if cell not in retained_cells}
        start_of = Start.FACTORY if first_ever else Start.RETAINED
        return Trace(goal.name, start_of, retained, forced, tuple(rows))

    def _quiet(self, scans: int) -> Iterator[z3.BoolRef]:
        """Yield optional facts that simplify a trace: short pauses, unchanged inputs, default memory values."""
        for cell, term in self._start.items():
            if cell in self._model.retained_cells:
                yield term == cell.constant(self._model.set_points.get(cell, cell.default))
        for number in range(scans):
            yield from (z3.Extract(bit, bit, self._pauses[number]) == 0 for bit in reversed(range(PAUSE_BITS)))
            before, start = self._memory(number), self._frames[number].start
            for cell in self._model.inputs:
                if cell.kind == "X" and number:
                    yield start[cell] == self._frames[number - 1].start[cell]
                elif cell in self._model.set_points:
                    yield start[cell] == before[cell]
                else:
                    yield z3.Not(start[cell])
