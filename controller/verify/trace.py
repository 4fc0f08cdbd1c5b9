"""Counter-examples as data and as text; a soft PLC can replay them scan by scan."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import StrEnum
from operator import index

from controller.core.devices import CLOCK_1_S, MS_100, SIZES, Memory, timer_base_ms
from controller.core.expr import And, Expr, Not, Or, evaluate
from controller.core.program import Program
from controller.core.scan import Plc
from controller.verify.cells import Cell, ModelError, cell_of, parse_cell
from controller.verify.induction import Failure
from controller.verify.model import Goal, Model
from controller.verify.text import Names
from controller.verify.timing import LONG


class Start(StrEnum):
    """Initial state of a trace."""

    FACTORY = "the first power-up"
    RETAINED = "power-up with retained values that the invariants allow"
    STATE = "a state that satisfies every invariant; whether it can be reached is open"


@dataclass(frozen=True, slots=True)
class TracedScan:
    """External inputs before one scan.

    Attributes:
        at_ms: Time of the scan, ms.
        inputs: X terminals that are on, raw levels.
        written: Values written to system bits, commands and set-points, by FX name.
    """

    at_ms: int
    inputs: tuple[str, ...]
    written: Mapping[str, int]


@dataclass(frozen=True)
class Trace:
    """Consecutive scans, the last of which violates the goal.

    Attributes:
        goal: Goal name.
        start: Initial state.
        retained: Values of `Plc.retained` before the loss of power; empty for other initial states.
        forced: Other memory values before the first scan, by FX name: the state of the monitors, or a complete state.
        scans: Scans in order.
    """

    goal: str
    start: Start
    retained: Mapping[str, int]
    forced: Mapping[str, int]
    scans: tuple[TracedScan, ...]

    def to_json(self) -> str:
        """Return the trace as JSON text."""
        return json.dumps(asdict(self), indent=1)

    @classmethod
    def from_json(cls, text: str) -> Trace:
        """Parse the output of `to_json`.

        Raises:
            ModelError: The text is not a trace.
        """
        try:
            data = json.loads(text)
            scans = [
                TracedScan(index(row["at_ms"]), tuple(map(str, row["inputs"])), _numbers(row["written"]))
                for row in data["scans"]
            ]
            if not scans:
                raise ValueError("no scans")
            retained, forced = _numbers(data["retained"]), _numbers(data["forced"])
            return cls(str(data["goal"]), Start(data["start"]), retained, forced, tuple(scans))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise ModelError(f"not a trace: {error!r}; regenerate it with the proof") from error

    def lines(self, program: Program, holds: Expr) -> list[str]:
        """Return the trace as text, scan by scan, with the program's names.

        Args:
            program: Program of the trace, monitors included.
            holds: Condition that is violated at the end.
        """
        return list(_TracePrinter(program, self).lines(holds))


def _numbers(data: Mapping[str, int]) -> dict[str, int]:
    return {name: index(value) for name, value in data.items()}


def replay(program: Program, trace: Trace) -> list[Memory]:
    """Run a trace on a soft PLC.

    Args:
        program: Program of the trace, monitors included.
        trace: The trace.

    Returns:
        Memory after each scan.

    Raises:
        ValueError: The trace belongs to another program.
    """
    plc = _initialised_plc(program, trace)
    memories = []
    for scan in trace.scans:
        for name, value in scan.written.items():
            parse_cell(name).force(plc.memory, value)
        on = {parse_cell(name).number for name in scan.inputs}
        plc.scan(scan.at_ms, [number in on for number in range(SIZES["X"])])
        memories.append(copy.deepcopy(plc.memory))
    return memories


def breaks(program: Program, trace: Trace, goal: Goal) -> bool:
    """Return whether the goal is violated after the last scan of a replay."""
    return not evaluate(goal.holds, replay(program, trace)[-1])


def one_scan(model: Model, failure: Failure) -> Trace:
    """Return the scan of a failed induction as a trace that starts from the state before the scan."""
    at_ms = LONG * MS_100
    if failure.start[Cell("M", CLOCK_1_S)] != (at_ms % 1000 < 500):
        at_ms += 500

    def forced_value(cell: Cell) -> int:
        value = failure.before[cell]
        return at_ms // timer_base_ms(cell.number) - (LONG - value) if cell.kind == "TS" and value >= 0 else value

    forced = {str(cell): forced_value(cell) for cell in model.cells if failure.before[cell] != cell.default}
    scan = scan_of(model, at_ms, failure.before, failure.start)
    return Trace(failure.goal.name, Start.STATE, {}, forced, (scan,))


def scan_of(model: Model, at_ms: int, before: Mapping[Cell, int], start: Mapping[Cell, int]) -> TracedScan:
    """Return the external inputs that turn the memory before a scan into the memory at its start."""
    inputs = tuple(str(cell) for cell in model.inputs if cell.kind == "X" and start[cell])
    written = {str(c): start[c] for c in model.inputs if c.kind != "X" and start[c] != before[c]}
    return TracedScan(at_ms, inputs, written)


def _initialised_plc(program: Program, trace: Trace) -> Plc:
    plc = Plc(program, input_filter_ms=0)
    match trace.start:
        case Start.RETAINED:
            plc.restore_retained(trace.retained)
        case Start.STATE:
            plc.scans = 1
    for name, value in trace.forced.items():
        parse_cell(name).force(plc.memory, value)
    return plc


class _TracePrinter:
    """Text form of a trace, obtained by replaying it."""

    def __init__(self, program: Program, trace: Trace) -> None:
        self._program, self._trace = program, trace
        self._names = Names(program)
        self._steps = [cell_of(bit) for sequence in program.sequences() for bit, _ in sequence]
        self._outputs = sorted({cell_of(d) for d in program.devices() if d.kind == "Y"})

    def lines(self, holds: Expr) -> Iterator[str]:
        trace = self._trace
        yield f"trace to {trace.goal!r} from {trace.start}"
        memory = {**trace.retained, **trace.forced}
        non_default = {name: value for name, value in memory.items() if value != parse_cell(name).default}
        if non_default:
            yield f"  in memory: {self._text(non_default)}"
        before = _initialised_plc(self._program, trace).memory
        inputs = {name for name, on in non_default.items() if on and name.startswith("X")}
        for number, (scan, after) in enumerate(zip(trace.scans, replay(self._program, trace), strict=True), start=1):
            first = " (first scan, M8002)" if number == 1 and trace.start is not Start.STATE else ""
            yield f"scan {number} at {scan.at_ms} ms{first}"
            changed = {name: int(name in scan.inputs) for name in sorted(inputs ^ set(scan.inputs))}
            inputs = set(scan.inputs)
            steps = {str(cell): 1 for cell in self._steps if cell.read(after)}
            outputs = {str(c): c.read(after) for c in self._outputs if c.read(after) != c.read(before)}
            for title, changes in (
                ("inputs", changed),
                ("written", scan.written),
                ("steps", steps),
                ("outputs", outputs),
            ):
                if changes:
                    yield f"  {title}: {self._text(changes)}"
            before = after
        yield f"result: {true_part(~holds, before)}"

    def _text(self, memory: Mapping[str, int]) -> str:
        at_ms = self._trace.scans[0].at_ms
        cells = {parse_cell(name): value for name, value in memory.items()}
        ticks = {cell: at_ms // timer_base_ms(cell.number) for cell in cells if cell.kind == "TS"}
        return ", ".join(self._names.describe(cell, value, ticks.get(cell, 0)) for cell, value in cells.items())


def true_part(expr: Expr, memory: Memory) -> Expr:
    """Return the part of a condition that makes it true; for parallel contacts, the first one that is on.

    Examples:
        >>> from controller.core.expr import Bit
        >>> str(true_part(Bit("M", 0) | ~Bit("M", 1), Memory()))
        '~M1'
    """
    match expr:
        case Or(operands):
            return true_part(next(o for o in operands if evaluate(o, memory)), memory)
        case Not(And(operands)):
            return true_part(~next(o for o in operands if not evaluate(o, memory)), memory)
    return expr
