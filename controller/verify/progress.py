"""Progress: every step can be left, and every stated way out leads out.

A step can be left if some state that satisfies every goal has it on and a scan later has it off; whether that state is
ever reached is not asked. A way out is stronger: from every such state it must lead to its goal, whatever else happens.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import z3

from controller.core.expr import Bit
from controller.core.specification import WayOut
from controller.verify.cells import Cell, SymbolicMemory, cell_of, condition
from controller.verify.model import Frame, Model
from controller.verify.solving import assumed, core_names, new_solver, preferred, switch, values
from controller.verify.timing import ExactTimers, FreeTimers


@dataclass(frozen=True)
class Finding:
    """The answer to one question about progress.

    Attributes:
        holds: Whether it is as it should be; None where the solver did not answer in time.
        lines: How, or why not.
        rests_on: Names of the goals that the answer rests on.
    """

    holds: bool | None
    lines: tuple[str, ...] = ()
    rests_on: frozenset[str] = frozenset()


class Exits:
    """One running scan from any state that satisfies every goal."""

    def __init__(self, model: Model) -> None:
        """Make the scan."""
        self._model = model
        self._before, facts = model.unknown("before")
        self._frame = model.frame(self._before, "scan", first=False, timing=ExactTimers.aged("scan"))
        self._solver = new_solver(facts + self._frame.limits)
        self._assumed = assumed(self._solver, model, self._before)

    def steps(self) -> list[Bit]:
        """Return the S bit of every step."""
        return [bit for sequence in self._model.program.sequences() for bit, _ in sequence]

    def consistent(self) -> Finding:
        """Tell whether there is any state that satisfies every goal: from none, everything could be proved."""
        answer = self._solver.check(*self._assumed.values())
        if answer == z3.unsat:
            names = sorted(core_names(self._solver, self._assumed))
            return Finding(holds=False, lines=(f"these contradict each other: {', '.join(names)}",))
        return Finding(holds=None if answer == z3.unknown else True)

    def step(self, bit: Bit) -> Finding:
        """Tell how a step can be left: by a transfer of its own, or, where it declares none, by a reset."""
        cell = cell_of(bit)
        left = [self._before[cell], z3.Not(self._frame.after[cell])]
        undecided = False
        transfers = self._frame.scan.fired.get(bit, [])
        for transfer, fires in transfers:
            answer, _ = self._ask([*left, fires])
            undecided |= answer == z3.unknown
            if answer == z3.sat:
                return Finding(holds=True, lines=(f"to {transfer.target} {transfer.target.name}",))
        if transfers:
            return Finding(holds=None if undecided else False, lines=("none of its transfers can ever fire",))
        answer, found = self._ask(left)
        if found is not None:
            return Finding(holds=True, lines=(f"reset in {self._resetting(cell, found)!r}",))
        if answer == z3.unknown:
            return Finding(holds=None)
        return Finding(holds=False, lines=("it has no transfer and no block resets it",))

    def _ask(self, facts: list[z3.BoolRef]) -> tuple[z3.CheckSatResult, z3.ModelRef | None]:
        literals = [switch(self._solver, fact) for fact in facts]
        answer = self._solver.check(*literals, *self._assumed.values())
        return answer, self._solver.model() if answer == z3.sat else None

    def _resetting(self, cell: Cell, found: z3.ModelRef) -> str:
        blocks = zip(self._model.program.blocks, self._frame.scan.blocks, strict=True)
        off = [block.title for block, memory in blocks if z3.is_false(found.eval(memory[cell], model_completion=True))]
        return off[0] if off else "END"


def lead_out(model: Model, way: WayOut) -> Finding:
    """Tell whether a way out leads to its goal from everywhere, with free timers and no loss of power meanwhile.

    A timer named in a scan of the way out is over in that scan, or not, if it is driven.
    """
    before, facts = model.unknown("before")
    frames: list[Frame] = []
    memory = before
    for number, orders in enumerate(way.scans):
        timing = FreeTimers(f"scan {number}")
        frame = model.frame(memory, f"scan {number}", first=False, timing=timing)
        facts += [*frame.limits, *_ordered(frame, timing, orders)]
        frames.append(frame)
        memory = frame.after
    solver = new_solver([*facts, condition(way.start, before)])
    held = assumed(solver, model, before)
    answer = solver.check(*held.values())
    if answer != z3.sat:
        never = ("its start can never be: correct the start or the invariants",)
        return Finding(holds=None) if answer == z3.unknown else Finding(holds=False, lines=never)
    missed = switch(solver, z3.Not(condition(way.goal, memory)))
    answer = solver.check(missed, *held.values())
    if answer == z3.unsat:
        return Finding(holds=True, rests_on=core_names(solver, held))
    if answer == z3.unknown:
        return Finding(holds=None)
    quiet = [switch(solver, term == cell.constant(cell.empty)) for cell, term in _free(model, before, frames)]
    found = preferred(solver, [missed, *held.values()], quiet) or solver.model()
    return Finding(holds=False, lines=tuple(_story(model, found, before, frames)))


def _ordered(frame: Frame, timing: FreeTimers, orders: Mapping[Bit, bool]) -> Iterator[z3.BoolRef]:
    for bit, on in orders.items():
        term = timing.over(bit.number) if bit.kind == "T" else frame.start[cell_of(bit)]
        yield term == z3.BoolVal(val=on)


def _free(model: Model, before: SymbolicMemory, frames: list[Frame]) -> Iterator[tuple[Cell, z3.ExprRef]]:
    yield from before.items()
    for frame in frames:
        yield from ((cell, frame.start[cell]) for cell in model.inputs)


def _story(model: Model, found: z3.ModelRef, before: SymbolicMemory, frames: list[Frame]) -> Iterator[str]:
    """Yield what is on at the start, what comes from outside, and what is on at the end."""
    names = model.names

    def on(held: Mapping[Cell, int]) -> str:
        return ", ".join(names.told(c, v) for c, v in held.items() if v != c.empty and c.kind not in {"E", "TV"})

    yield f"from: {on(values(found, before))}"
    for number, frame in enumerate(frames, start=1):
        outside = on(values(found, {c: frame.start[c] for c in model.inputs}))
        yield f"scan {number}, from outside: {outside or 'nothing'}"
        changed = {c: t for c, t in frame.after.items() if c not in model.inputs}
        yield f"after scan {number}: {on(values(found, changed))}"
