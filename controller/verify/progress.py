"""Progress: every step can be left, and every specified way out reaches its goal.

A step can be left if it is off one scan after some state in which it is on and all requirements and invariants hold;
the state need not be reachable. A way out must meet a stronger condition: it reaches its goal from every state in which
its start condition and all requirements and invariants hold.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import z3

from controller.core.expr import Bit
from controller.core.specification import WayOut
from controller.verify.cells import Cell, SymbolicMemory, cell_of, condition
from controller.verify.model import Frame, Model
from controller.verify.solving import core_names, goal_switches, new_solver, preferred_model, switch, values
from controller.verify.timing import ExactTimers, FreeTimers


@dataclass(frozen=True)
class ProgressResult:
    """Result of one progress check.

    Attributes:
        holds: Whether the property holds; None = solver timeout.
        lines: Explanation.
        rests_on: Names of the goals that the result depends on.
    """

    holds: bool | None
    lines: tuple[str, ...] = ()
    rests_on: frozenset[str] = frozenset()


class Exits:
    """One scan in normal operation from any state in which every goal holds."""

    def __init__(self, model: Model) -> None:
        """Build the scan."""
        self._model = model
        self._before, facts = model.unknown("before")
        self._frame = model.frame(self._before, "scan", first=False, timing=ExactTimers.aged("scan"))
        self._solver = new_solver(facts + self._frame.limits)
        self._assumed = goal_switches(self._solver, model, self._before)

    def steps(self) -> list[Bit]:
        """Return the S bit of every step."""
        return [bit for sequence in self._model.program.sequences() for bit, _ in sequence]

    def consistent(self) -> ProgressResult:
        """Check that there is a state in which all goals hold; otherwise anything could be proved."""
        answer = self._solver.check(*self._assumed.values())
        if answer == z3.unsat:
            names = sorted(core_names(self._solver, self._assumed))
            return ProgressResult(holds=False, lines=(f"these contradict each other: {', '.join(names)}",))
        return ProgressResult(holds=None if answer == z3.unknown else True)

    def step(self, bit: Bit) -> ProgressResult:
        """Check that a step can be left: by one of its transfers or, if it declares none, by a reset."""
        cell = cell_of(bit)
        left = [self._before[cell], z3.Not(self._frame.after[cell])]
        undecided = False
        transfers = self._frame.scan.fired.get(bit, [])
        for transfer, fires in transfers:
            answer, _ = self._ask([*left, fires])
            undecided |= answer == z3.unknown
            if answer == z3.sat:
                return ProgressResult(holds=True, lines=(f"to {transfer.target} {transfer.target.name}",))
        if transfers:
            return ProgressResult(holds=None if undecided else False, lines=("none of its transfers can ever fire",))
        answer, solution = self._ask(left)
        if solution is not None:
            return ProgressResult(holds=True, lines=(f"reset in {self._resetting(cell, solution)!r}",))
        if answer == z3.unknown:
            return ProgressResult(holds=None)
        return ProgressResult(holds=False, lines=("it has no transfer and no block resets it",))

    def _ask(self, facts: list[z3.BoolRef]) -> tuple[z3.CheckSatResult, z3.ModelRef | None]:
        literals = [switch(self._solver, fact) for fact in facts]
        answer = self._solver.check(*literals, *self._assumed.values())
        return answer, self._solver.model() if answer == z3.sat else None

    def _resetting(self, cell: Cell, solution: z3.ModelRef) -> str:
        blocks = zip(self._model.program.blocks, self._frame.scan.blocks, strict=True)
        off = [b.title for b, memory in blocks if z3.is_false(solution.eval(memory[cell], model_completion=True))]
        return off[0] if off else "END"


def lead_out(model: Model, way: WayOut) -> ProgressResult:
    """Check that a way out always reaches its goal, with free timers and no loss of power.

    A scan of the way out may specify whether a timer has elapsed; this applies only if the timer is driven.
    """
    before, facts = model.unknown("before")
    frames: list[Frame] = []
    memory = before
    for number, commands in enumerate(way.scans):
        timing = FreeTimers(f"scan {number}")
        frame = model.frame(memory, f"scan {number}", first=False, timing=timing)
        facts += [*frame.limits, *_commanded(frame, timing, commands)]
        frames.append(frame)
        memory = frame.after
    solver = new_solver([*facts, condition(way.start, before)])
    switches = goal_switches(solver, model, before)
    answer = solver.check(*switches.values())
    if answer != z3.sat:
        never = ("its start condition can never be true; correct it or the invariants",)
        return ProgressResult(holds=None) if answer == z3.unknown else ProgressResult(holds=False, lines=never)
    missed = switch(solver, z3.Not(condition(way.goal, memory)))
    answer = solver.check(missed, *switches.values())
    if answer == z3.unsat:
        return ProgressResult(holds=True, rests_on=core_names(solver, switches))
    if answer == z3.unknown:
        return ProgressResult(holds=None)
    quiet = [switch(solver, term == cell.constant(cell.default)) for cell, term in _free_terms(model, before, frames)]
    solution = preferred_model(solver, [missed, *switches.values()], quiet) or solver.model()
    return ProgressResult(holds=False, lines=tuple(_counter_example(model, solution, before, frames)))


def _commanded(frame: Frame, timing: FreeTimers, commands: Mapping[Bit, bool]) -> Iterator[z3.BoolRef]:
    for bit, on in commands.items():
        term = timing.elapsed(bit.number) if bit.kind == "T" else frame.start[cell_of(bit)]
        yield term == z3.BoolVal(val=on)


def _free_terms(model: Model, before: SymbolicMemory, frames: list[Frame]) -> Iterator[tuple[Cell, z3.ExprRef]]:
    yield from before.items()
    for frame in frames:
        yield from ((cell, frame.start[cell]) for cell in model.inputs)


def _counter_example(model: Model, solution: z3.ModelRef, before: SymbolicMemory, frames: list[Frame]) -> Iterator[str]:
    """Yield the non-default values at the start, then the external inputs and the non-default values of each scan."""
    names = model.names

    def on(memory: Mapping[Cell, int]) -> str:
        return ", ".join(
            names.describe(c, v) for c, v in memory.items() if v != c.default and c.kind not in {"E", "TV"}
        )

    yield f"from: {on(values(solution, before))}"
    for number, frame in enumerate(frames, start=1):
        outside = on(values(solution, {c: frame.start[c] for c in model.inputs}))
        yield f"scan {number}, external inputs: {outside or 'none'}"
        changed = {c: t for c, t in frame.after.items() if c not in model.inputs}
        yield f"after scan {number}: {on(values(solution, changed))}"
