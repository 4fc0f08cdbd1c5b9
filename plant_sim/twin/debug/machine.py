"""Twin as a machine whose run can be recorded and recomputed."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from controller.common.errors import InputError
from controller.core.devices import Memory
from controller.core.expr import Bit, Compare, Expr, Word, all_of, any_of
from controller.core.machine_code import MachineExecution
from controller.core.memory_layout import WORD_BYTES
from controller.debug.condition import Condition, SignalComparison, SignalContact, SignalInverse, SignalJoined
from controller.debug.machine import DebugSignal, OutsideEntry, RunEvent, Value, copied
from controller.debug.scan_observer import ScanStart, TranslatedScanObserver
from controller.events.kinds import as_sentence
from controller.export.instruction_list import SCRATCH
from controller.fx.language.instruction import Ladder
from controller.fx.language.operand_rules import Key
from plant_sim.machine.plant import Plant
from plant_sim.twin.conditions import Quantity
from plant_sim.twin.debug.changes import change_of
from plant_sim.twin.debug.outside import ordered
from plant_sim.twin.debug.physical import TwinProgram
from plant_sim.twin.debug.signals import Signals
from plant_sim.twin.lock_step import SCAN_MS, Twin, TwinSnapshot

_NO_WATCHERS: tuple[Any, ...] = ([], [], [])


class TwinMachine:
    """Twin as a machine whose run can be recorded and recomputed.

    Attributes:
        twin: The twin.
        scan: Number of scans since the recording began.
        owner: RunTimeline whose state the twin is in; None = unknown.
    """

    def __init__(self, twin: Twin) -> None:
        """Take a twin in its present state, which becomes scan 0.

        Args:
            twin: The twin.

        Raises:
            InputError: The twin does not execute machine code.
        """
        self.twin = twin
        self.scan = 0
        self.owner: object | None = None
        self._conditions: dict[Condition, Expr] = {}
        _ = self.execution

    @cached_property
    def _signals(self) -> Signals:
        return Signals(self.twin)

    @cached_property
    def explained(self) -> TwinProgram:
        """Program of the twin, for questions."""
        return TwinProgram(self.twin)

    @cached_property
    def observer(self) -> TranslatedScanObserver:
        """Observer of the scans of recorded runs."""
        return TranslatedScanObserver(self)

    @property
    def execution(self) -> MachineExecution:
        """Execution of the running controller."""
        execution = self.twin.plc.execution
        if not isinstance(execution, MachineExecution):
            raise InputError("a run step by step cannot be recorded; run it as machine code")
        return execution

    @property
    def ladder(self) -> Ladder:
        """The program as a ladder."""
        return self.explained.reference.ladder

    @property
    def work(self) -> Collection[Key]:
        """Work registers of the ladder, which the controller does not have."""
        return [("D", number) for number in SCRATCH]

    @property
    def plant(self) -> Plant:
        """The plant."""
        return self.twin.plant

    @property
    def memory(self) -> Memory:
        """Devices, which the controller changes in each scan."""
        return self.twin.plc.memory

    def scan_start(self) -> ScanStart:
        """Return the state in which the next scan begins."""
        plc = self.twin.plc
        memory = copied(plc.memory)
        for device, value in ordered(self.twin):
            if isinstance(device, Bit):
                memory.bits(device.kind)[device.number] = bool(value)
            else:
                memory.set_word(device.kind, device.number, value)
        return ScanStart(memory, self.now_ms, first=plc.scans == 0)

    @property
    def region(self) -> np.ndarray:
        """Devices of the running controller as bytes; writable."""
        return np.frombuffer(self.execution.region, np.uint8)

    @property
    def now_ms(self) -> int:
        """Simulated time of the next scan, ms."""
        return self.twin.now_ms

    def save(self) -> Any:
        """Return the complete state."""
        saved = self.twin.snapshot()
        bridged = self.twin.plant.terminals.bridged
        events, retained, releases = saved.events, saved.retained, saved.releases
        return saved.controller, saved.states, events, retained, releases, dict(bridged), self.scan

    def restore(self, saved: Any, /) -> None:
        """Restore a state returned by `save`; monitors and observers are not called in what follows."""
        controller, states, events, retained, releases, bridged, self.scan = saved
        self.twin.restore(TwinSnapshot(controller, states, events, retained, releases, _NO_WATCHERS))
        terminals = self.twin.plant.terminals
        terminals.bridged.clear()
        terminals.bridged.update(bridged)
        self.twin.drop_observers()

    def run(self, to: int, until: Condition | None = None, /) -> bool:
        """Execute scans up to a number; return True at the first scan that meets a condition."""
        twin, for_ms = self.twin, (to - self.scan) * SCAN_MS
        since_ms = twin.now_ms
        if until is None:
            twin.run_for(for_ms)
            met = False
        else:
            met = twin.runs_until(self._expression(until), for_ms=for_ms)
        self.scan += (twin.now_ms - since_ms) // SCAN_MS
        return met

    def changes(self, to: int, signals: Sequence[DebugSignal], before: list[Value], /) -> list[int]:
        """Execute scans up to a number; return those in which one of the devices has changed."""
        twin, scan, since_ms = self.twin, self.scan, self.twin.now_ms
        reads = [signal.read for signal in signals]
        found: list[int] = []

        def compare(_twin: Twin) -> None:
            now = [read() for read in reads]
            if now != before:
                before[:] = now
                found.append(scan + (twin.now_ms - since_ms) // SCAN_MS + 1)

        twin.watch(compare, devices=[_device(signal) for signal in signals])
        try:
            self.run(to)
        finally:
            twin.unwatch()
        return found

    def signal(self, name: str, /) -> DebugSignal:
        """Return a device or value by its name or tag."""
        return self._signals.find(name)

    def check(self, condition: Condition, /) -> None:
        """Check that a condition can be compiled."""
        self._expression(condition)

    def devices(self) -> Mapping[str, Value]:
        """Return the values of all devices by name."""
        return self._signals.devices()

    def image(self, kinds: str, /) -> object:
        """Return a copy of all devices of some kinds."""
        layout, region = self.execution.layout, self.execution.region
        rows = [(row, layout.bits[row], 1) for row in "XYMSTC"]
        rows += [(row, layout.words[row], WORD_BYTES) for row in ("TV", "CV", "D")]
        return [
            bytes(region[row.offset : row.offset + row.length * size])
            for name, row, size in rows
            if not kinds or name[0] in kinds
        ]

    def values(self) -> Mapping[str, Value]:
        """Return the values of the plant by name."""
        return self._signals.values()

    def steps(self) -> Sequence[DebugSignal]:
        """Return the states of all steps of all sequences."""
        return self._signals.steps

    def outcome(self) -> Mapping[str, Value]:
        """Return the state, alarms and counts by name."""
        twin = self.twin
        counts = twin.plant.counts()
        return {
            "time": f"{twin.now_ms / 1000:.2f} s",
            "state": twin.state.name,
            "alarms": ", ".join(twin.alarms()) or "none",
            "cycles": len(twin.cycles()),
            "incidents": ", ".join(event.kind.value for event in twin.plant.events) or "none",
            **{name: getattr(counts, name) for name in type(counts).__slots__},
        }

    def events(self) -> Iterable[RunEvent]:
        """Return every event so far."""
        for event in self.twin.events:
            yield RunEvent(event.at_ms, event.event, as_sentence(event))

    def change(self, name: str, value: str, /) -> tuple[OutsideEntry, Callable[[], OutsideEntry] | None]:
        """Return the entry that begins a change, and a function that returns the entry that ends it."""
        return change_of(self.twin, name, value)

    def _expression(self, condition: Condition) -> Expr:
        """Return a condition that the twin compiles."""
        expression = self._conditions.get(condition)
        if expression is None:
            expression = self._conditions[condition] = _expression_of(condition)
        return expression


def _expression_of(condition: Condition) -> Expr:
    match condition:
        case SignalContact(signal):
            source = signal.source
            if isinstance(source, Bit):
                return source
            if isinstance(source, Word):
                return source.differs(0)
            raise InputError(f"{signal.name}: a condition compares it with < or > to a number")
        case SignalComparison(relation, left, right):
            return _comparison(relation, left, right)
        case SignalInverse(operand):
            return ~_expression_of(operand)
        case SignalJoined(every, operands):
            return (all_of if every else any_of)(*map(_expression_of, operands))


def _comparison(relation: str, left: DebugSignal, right: DebugSignal | float) -> Expr:
    source = left.source
    if isinstance(source, Quantity):
        if not isinstance(right, int | float):
            raise InputError(f"{left.name}: a condition compares it with a number, not with {right.name}")
        match relation:
            case "<":
                return source < right
            case ">":
                return source > right
            case "<=":
                return ~(source > right)
            case ">=":
                return ~(source < right)
        raise InputError(f"{left.name}: a condition compares it with < or >, because it is never exactly a number")
    other = right if isinstance(right, int | float) else right.source
    if isinstance(source, Bit) and relation in {"==", "!="} and other in {0, 1}:
        return source if (relation == "==") == (other == 1) else ~source
    if isinstance(source, Word) and isinstance(other, int | Word):
        return Compare(relation, source, other)
    raise InputError(f"{left.name} {relation} {_named(right)}: a condition compares words with whole numbers or words")


def _named(side: DebugSignal | float) -> str:
    return f"{side:g}" if isinstance(side, int | float) else side.name


def _device(signal: DebugSignal) -> Bit | Word:
    if isinstance(signal.source, Bit | Word):
        return signal.source
    raise InputError(f"{signal.name}: changes in nearly every scan; ask for a condition, such as {signal.name} < 0.05")
