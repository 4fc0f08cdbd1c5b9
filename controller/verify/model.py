"""Formulas of a specification: arbitrary memory, the memory after power-up, and one scan with arbitrary inputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import z3

from controller.core.devices import CLOCK_1_S, INITIAL_PULSE, RUN_MONITOR
from controller.core.expr import Expr, leaves
from controller.core.program import Program
from controller.core.specification import Specification
from controller.verify.cells import Cell, ModelError, SymbolicMemory, cell_of, cells_of, compare
from controller.verify.symbolic import SymbolicScan, execute
from controller.verify.text import Names
from controller.verify.timing import FreeTimers, Timing, timer_facts

REQUIREMENT: Final = "requirement"
INVARIANT: Final = "invariant"
LIMIT: Final = "limit"


@dataclass(frozen=True, slots=True)
class Goal:
    """A condition that must be true after every scan.

    Attributes:
        name: Name of the requirement or invariant.
        kind: REQUIREMENT, INVARIANT or LIMIT.
        holds: The condition.
        reason: Rationale.
    """

    name: str
    kind: str
    holds: Expr
    reason: str = ""


def goals_of(specification: Specification) -> tuple[Goal, ...]:
    """Return all goals for the proof by induction, invariants first.

    Raises:
        ModelError: Two goals have the same name.
    """
    goals = (
        *(Goal(i.name, INVARIANT, i.holds) for i in specification.invariants),
        *(Goal(r.name, REQUIREMENT, ~r.never, r.reason) for r in specification.requirements),
    )
    names = [goal.name for goal in goals]
    names += [way.name for way in specification.ways_out] + [limit.name for limit in specification.limits]
    duplicates = sorted({name for name in names if names.count(name) > 1})
    if duplicates:
        raise ModelError(f"two goals are named {duplicates[0]!r}; use unique names")
    return goals


@dataclass(frozen=True)
class Frame:
    """One scan, starting from a given memory state.

    Attributes:
        start: Memory with the inputs of the scan.
        limits: Constraints on the inputs.
        scan: Symbolic result of the scan.
    """

    start: SymbolicMemory
    limits: list[z3.BoolRef]
    scan: SymbolicScan

    @property
    def after(self) -> SymbolicMemory:
        """Memory after the scan."""
        return self.scan.after


@dataclass
class Model:
    """The monitored program of a specification.

    Attributes:
        specification: Specification to prove.
        goals: Requirements and invariants.
        limits: Conditions that must not be provable.
        cells: All cells that the program or the specification reads or writes.
        inputs: Cells written externally before every scan: X image, system bits and commands, set-points.
        retained_cells: Cells retained through a loss of power: retentive devices, and the state of the monitors.
        program: Program with monitors.
        names: Device names.
        remembered: State of the monitors.
        set_points: Words written externally, with their initial values.
    """

    specification: Specification
    goals: tuple[Goal, ...] = field(init=False)
    limits: tuple[Goal, ...] = field(init=False)
    cells: list[Cell] = field(init=False)
    inputs: list[Cell] = field(init=False)
    retained_cells: frozenset[Cell] = field(init=False)
    program: Program = field(init=False)
    names: Names = field(init=False)
    remembered: list[Cell] = field(init=False)
    set_points: dict[Cell, int] = field(init=False)

    def __post_init__(self) -> None:
        specification = self.specification
        self.program = specification.watched
        self.names = Names(self.program)
        self.goals = goals_of(specification)
        self.limits = tuple(Goal(each.name, LIMIT, ~each.condition, each.reason) for each in specification.limits)
        self.cells = cells_of(self.program, self._conditions())
        self.remembered = [cell_of(bit) for bit in specification.remembered]
        self.set_points = {cell_of(word): value for word, value in self.program.set_points}
        system = {cell_of(bit) for bit in self.program.system}
        self.inputs = [c for c in self.cells if c.kind == "X" or c in system or c in self.set_points]
        self.retained_cells = frozenset(cell_of(device) for device in self.program.retentive) | {*self.remembered}
        self._ranges = {cell_of(word): limits for word, limits in specification.ranges.items()}
        self._untouched = self._never_written()
        self._check()

    def unknown(self, label: str) -> tuple[SymbolicMemory, list[z3.BoolRef]]:
        """Return an arbitrary state between scans, with the facts that always hold for timers and unwritten cells."""
        memory = {cell: cell.variable(label) for cell in self.cells}
        facts = [memory[cell] == cell.constant(cell.default) for cell in self._untouched]
        return memory, facts + timer_facts(memory)

    def factory(self, label: str) -> SymbolicMemory:
        """Return the memory at the first power-up; the state of the monitors is unknown."""
        memory = {cell: cell.constant(cell.default) for cell in self.cells}
        memory |= {cell: cell.constant(value) for cell, value in self.set_points.items()}
        return memory | {cell: cell.variable(label) for cell in self.remembered}

    def powered_up(self, memory: SymbolicMemory) -> SymbolicMemory:
        """Return the memory after a loss of power."""
        lost = {cell: cell.constant(cell.default) for cell in self.cells}
        lost |= {cell: cell.constant(value) for cell, value in self.set_points.items()}
        return lost | {cell: memory[cell] for cell in self.retained_cells}

    def frame(self, before: SymbolicMemory, label: str, *, first: bool, timing: Timing) -> Frame:
        """Return one scan with arbitrary inputs.

        Args:
            before: Memory before the scan.
            label: Label that distinguishes the unknown inputs of different scans.
            first: Whether it is the first scan after power-up (M8002).
            timing: Timer model of the scan.
        """
        start = self.start(before, label, first=first, timing=timing)
        limits = list(self._limits({cell: start[cell] for cell in self.inputs}))
        return Frame(start, limits, execute(self.program, start, timing))

    def start(self, before: SymbolicMemory, label: str, *, first: bool, timing: Timing) -> SymbolicMemory:
        """Return the memory at the start of a scan with arbitrary inputs; the arguments are those of `frame`."""
        special = {
            Cell("M", RUN_MONITOR): z3.BoolVal(val=True),
            Cell("M", INITIAL_PULSE): z3.BoolVal(val=first),
            Cell("M", CLOCK_1_S): timing.clock_1_s,
        }
        return {**before, **special, **{cell: cell.variable(label) for cell in self.inputs}}

    def _limits(self, inputs: SymbolicMemory) -> Iterator[z3.BoolRef]:
        # A set-point that the program also writes may contain the program's value or its initial value.
        for cell, (least, greatest) in self._ranges.items():
            if cell in self._outside_only:
                allowed = z3.And(compare(">=", inputs[cell], least), compare("<=", inputs[cell], greatest))
                yield z3.Or(allowed, inputs[cell] == cell.constant(self.set_points[cell]))

    def _never_written(self) -> list[Cell]:
        before = {cell: cell.variable("any") for cell in self.cells}
        after = execute(self.program, before, FreeTimers("any")).after
        same = {cell for cell in self.cells if after[cell].eq(before[cell])}
        self._outside_only = same.intersection(self.inputs)
        special = {Cell("M", number) for number in (RUN_MONITOR, INITIAL_PULSE, CLOCK_1_S)}
        written = {*self.inputs, *self.remembered, *special} | {cell for cell in same if cell.kind == "TS"}
        return sorted(same - written)

    def _conditions(self) -> Iterator[Expr]:
        yield from (goal.holds for goal in (*self.goals, *self.limits))
        yield from self.specification.remembered
        for way in self.specification.ways_out:
            yield way.start
            yield way.goal
            yield from (bit for scan in way.scans for bit in scan)

    def _check(self) -> None:
        for cell in self._ranges:
            if cell not in self.set_points:
                raise ModelError(f"range of {cell}: not a set-point of {self.program.name!r}; remove the range")
        for way in self.specification.ways_out:
            for cell in (cell_of(bit) for scan in way.scans for bit in scan):
                if cell not in self.inputs and cell.kind != "T":
                    raise ModelError(f"way out {way.name!r}: {cell} is not an input, command or timer; remove it")


def leaves_of(expr: Expr) -> list[Cell]:
    """Return the cells that a condition reads, without duplicates, sorted."""
    return sorted({cell_of(device) for device in leaves(expr)})
