"""Recording of a trial with an FX program: the PLC and the plant as a machine that can be returned to any scan.

A scan of the record begins with the plant, which advances since the scan before, and ends with the outputs. So a press
of the operator, which follows a scan, enters before the next one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from controller.common.errors import InputError
from controller.debug.fx_machine import FxMachine
from controller.debug.machine import DebugSignal, OutsideEntry, Value
from controller.debug.timeline import LENGTH, RunTimeline
from controller.fx.engine.plc import FxPlc
from controller.fx.stimulus.running import put_values
from controller.fx.stimulus.stimulus import Values
from plant_sim.devices.operator_box import OperatorBox
from plant_sim.links.io_module import IoModule
from plant_sim.machine.plant import Plant
from plant_sim.machine.terminals import BUTTONS
from plant_sim.scope.columns import Column, columns_of
from plant_sim.twin.debug.physical import PlantLadder
from plant_sim.twin.debug.plant_changes import button_changes, fault_begins, fault_ends
from plant_sim.twin.ladder.scan_timing import TrialClock


class PlantRun:
    """FX program on the plant, scan by scan.

    Attributes:
        plc: The PLC.
        module: I/O module of the plant.
        now_ms: Time of the last scan, which the plant has reached, ms; before the first scan, its time.
        held: Levels by X number that are applied to terminals in place of those of the plant.
    """

    def __init__(self, plc: FxPlc, module: IoModule, clock: TrialClock) -> None:
        """Take the parts of a trial before its first scan."""
        self.plc, self.module = plc, module
        self.now_ms = 0
        self.held: dict[int, bool] = {}
        self._clock = clock
        self._is_first = True
        """Whether the next scan is the first one, before which the plant does not advance."""

    def scanned(self, now_ms: int) -> None:
        """Take over a scan that the trial has executed."""
        self.now_ms, self._is_first = now_ms, False

    def save(self) -> Any:
        """Return the complete state."""
        own = self.now_ms, dict(self.held), self._is_first
        return own, self.plc.save(), self.module.plant.save(), self.module.save()

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        (self.now_ms, held, self._is_first), plc, plant, module = saved
        self.held = dict(held)
        self.plc.restore(plc)
        self.module.plant.restore(plant)
        self.module.restore(module)

    @property
    def next_ms(self) -> int:
        """Time of the next scan, ms."""
        return self.now_ms if self._is_first else self.now_ms + self._clock.next_ms(self.plc)

    def scan(self) -> None:
        """Advance the plant, and run one scan."""
        if not self._is_first:
            next_ms = self.next_ms
            self._clock.advance(self.module, self.plc, self.now_ms, next_ms - self.now_ms)
            self.now_ms = next_ms
        levels = list(self.module.inputs())
        for number, level in self.held.items():
            levels[number] = level
        image = self.plc.scan(self.now_ms, levels)
        self.module.write_outputs(0, image[: self.module.io_map.output_count])
        self._is_first = False

    def put(self, values: Values) -> None:
        """Set device values in memory."""
        put_values(self.plc, [], values)


class LadderMachine(FxMachine):
    """FX program on the plant as a machine whose run can be recorded and recomputed."""

    def __init__(self, running: PlantRun) -> None:
        """Take a run before its first scan."""
        self._run, self.module = running, running.module
        super().__init__(running)

    @property
    def now_ms(self) -> int:
        """Simulated time of the next scan, ms."""
        return self._run.next_ms

    @property
    def plant(self) -> Plant:
        """The plant."""
        return self.module.plant

    @cached_property
    def explained(self) -> PlantLadder:
        """Program with its plant, for questions."""
        return PlantLadder(self.ladder, self.plant, self.module.io_map, lambda: self.memory)

    @cached_property
    def _columns(self) -> dict[str, Column]:
        return {column.name: column for column in columns_of()}

    def signal(self, name: str, /) -> DebugSignal:
        """Return a device by its name, tag or comment, or a value of the plant."""
        plant, point = self.module.plant, self.module.io_map.get(name)
        if point is not None:
            return super().signal(point.address)
        column = self._columns.get(name)
        if column is None:
            return super().signal(name)

        def read() -> Value:
            value: Value = column.of(plant.state)[0].item()
            return value

        return DebugSignal(name, read, unit=column.unit)

    def change(self, name: str, value: str, /) -> tuple[OutsideEntry, Callable[[], OutsideEntry] | None]:
        """Return the entry that begins a change, and a function that returns the entry that ends it."""
        if name == "fault":
            return fault_begins(self.plant, value)
        if name == "mend":
            return fault_ends(self.plant, value), None
        if name in BUTTONS and name in self.module.io_map:
            return button_changes(self.plant, name, value)
        if name in self._columns:
            raise InputError(f"{name}={value}: a value of the plant cannot be set; change a terminal or a device")
        return super().change(name, value)

    def values(self) -> Mapping[str, Value]:
        """Return the values of the plant by name."""
        return {name: self.signal(name).read() for name in self._columns}

    def outcome(self) -> Mapping[str, Value]:
        """Return time, state of the CPU, annunciators, incidents and counts."""
        plant = self.module.plant
        incidents = ", ".join(event.kind.value for event in plant.events) or "none"
        counts = plant.counts()
        return {
            **super().outcome(),
            "incidents": incidents,
            **{name: getattr(counts, name) for name in type(counts).__slots__},
        }


@dataclass(frozen=True, slots=True)
class ButtonChange:
    """Levels of push buttons that the operator of a trial has changed.

    Attributes:
        levels: New levels by name.
    """

    levels: tuple[tuple[str, bool], ...]

    def __str__(self) -> str:
        return ", ".join(f"{name}={'on' if level else 'off'}" for name, level in self.levels)

    @property
    def is_repeatable(self) -> bool:
        """True: a branch can repeat it."""
        return True

    def apply(self, machine: LadderMachine, /) -> None:
        """Press and release the buttons."""
        for name, level in self.levels:
            setattr(machine.module.plant.box, name, level)


class LadderRecorder:
    """Recorder of a trial with an FX program."""

    def __init__(self, length: int = LENGTH) -> None:
        """Initialise a recorder that has recorded nothing.

        Args:
            length: Number of scans to keep.
        """
        self._length = length
        self._timeline: RunTimeline | None = None

    def begin(self, plc: FxPlc, module: IoModule, clock: TrialClock) -> None:
        """Begin before the first scan."""
        self._run = PlantRun(plc, module, clock)
        self._machine = LadderMachine(self._run)
        self._timeline = RunTimeline(self._machine, length=self._length)
        self._box = module.plant.box

    def scanned(self, now_ms: int) -> None:
        """Record a scan."""
        self._run.scanned(now_ms)
        self._machine.scan += 1
        self.timeline.last = self._machine.scan
        if self._machine.scan % self.timeline.interval == 0:
            self.timeline.keep()
        self._levels = self._box.save()

    def acted(self) -> None:
        """Record the presses of the operator after a scan."""
        levels = self._box.save()
        if levels != self._levels:
            rows = zip(OperatorBox.SAVED, self._levels, levels, strict=True)
            self.timeline.note(ButtonChange(tuple((name, new) for name, old, new in rows if old != new)))

    @property
    def timeline(self) -> RunTimeline:
        """The recorded run.

        Raises:
            InputError: Nothing has been recorded.
        """
        if self._timeline is None:
            raise InputError("nothing has been recorded")
        return self._timeline

    def close(self) -> RunTimeline:
        """End the recording and return the recorded run."""
        self.timeline.keep()
        return self.timeline
