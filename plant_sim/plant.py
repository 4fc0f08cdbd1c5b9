"""The whole machine: coil levels go in, terminal levels come out, seedlings are accounted for."""

import random
from collections.abc import Callable, Sequence
from typing import NamedTuple

from controller.io_map import IoMap
from plant_sim.arm import ARM_COILS, ArmPlant
from plant_sim.crop.bed import Bed
from plant_sim.crop.incident import Incident
from plant_sim.crop.seedling import SeedlingCounts, Seedlings
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.operator_box import OperatorBox
from plant_sim.devices.sensor import Sensor
from plant_sim.devices.supply import Supply
from plant_sim.parameters import Machine

__all__ = ["ArmPlant", "Event", "Plant"]

_SIDES = ("left", "right")
_COIL_TAGS = (
    *(f"{side}.{coil}" for side in _SIDES for coil in ARM_COILS),
    "tray_run",
    "tray_forward",
)
_INDICATOR_TAGS = ("horn", "lamp_red", "lamp_amber", "lamp_green")


class Event(NamedTuple):
    """Something that must not happen, and did."""

    time_ms: int
    kind: Incident
    text: str


class Plant:
    """The simulated transplanter.

    The same seed and the same outputs at the same times give the same plant, bit for bit.

    Attributes:
        time_ms: Plant time, ms; only `step` advances it.
        box: The push buttons.
        left: The left arm with its row of cups.
        right: The right arm with its row of cups.
        arms: Both by name.
        conveyor: Trays and magazine.
        supply: Compressed air.
        seedlings: Every one of them.
        sensors: Every sensor by the tag of its wire, wired or not; the buttons are in `box`.
        indicators: Horn and lamps by tag, so far as they are wired.
        events: Every incident so far.
        extrapolates: Whether the crop settings lie outside the trials of the paper.
    """

    def __init__(self, io_map: IoMap, machine: Machine, *, seed: int, trays: int = 2) -> None:
        """Put a machine together; it is found as a normal stop leaves it.

        Args:
            io_map: The wires.
            machine: All parameters.
            seed: Decides the fate of every seedling and where the cups stand.
            trays: How many trays there are.

        Raises:
            KeyError: a coil of the machine has no wire.
            ValueError: a wired input is none of this machine, or there are fewer than no trays.
        """
        self.time_ms = 0
        self.box = OperatorBox()
        self.events: list[Event] = []
        self.extrapolates = machine.crop.extrapolates
        self.conveyor = Conveyor(machine.conveyor, trays=trays)
        self.supply = Supply(machine.supply)
        self.seedlings = Seedlings(trays=trays, failure_share=machine.crop.failure_share, seed=seed)
        self._bed = Bed(self.seedlings, pitch_m=machine.handling.cell_pitch_m)
        self._lay_bed()
        self.left, self.right = (
            ArmPlant(
                side,
                machine,
                self.seedlings,
                self._bed,
                self._note,
                chain_m=random.Random(f"seed {seed}, {side} cups").uniform(0, machine.cups.pitch_m),
            )
            for side in _SIDES
        )
        self.arms = dict(zip(_SIDES, (self.left, self.right), strict=True))
        self.sensors = self._gather_sensors()
        self.indicators = {tag: False for tag in _INDICATOR_TAGS if tag in io_map}
        self._arms_meet_from_m = (machine.picks_m[1] + machine.picks_m[2]) / 2
        self._arms_may_meet = machine.layout.arms_may_meet_in_plant
        self._arms_met = False
        self._substep_ms = machine.simulation.substep_ms
        self._wire(io_map)

    @property
    def x(self) -> list[bool]:
        """The raw X image of this instant; a new list, the caller's own."""
        image = self._dark.copy()
        for number, inverted, read in self._inputs:
            image[number] = read() != inverted
        return image

    @property
    def missed_cups(self) -> dict[str, int]:
        """Cups of each row that passed empty between its first and its last filled one."""
        return {side: arm.row.missed_cups for side, arm in self.arms.items()}

    @property
    def planting_frequency_per_min(self) -> float:
        """Cups a minute and row at the speed the tractor wants; may be set any time."""
        return self.left.cups.planting_frequency_per_min

    @planting_frequency_per_min.setter
    def planting_frequency_per_min(self, per_min: float) -> None:
        for arm in self.arms.values():
            arm.cups.planting_frequency_per_min = per_min

    def counts(self) -> SeedlingCounts:
        """How many seedlings are where; each is counted once."""
        return self.seedlings.counts()

    def step(self, for_ms: int, y: Sequence[bool]) -> None:
        """Let time pass under constant outputs.

        Args:
            for_ms: How long, ms.
            y: Raw Y image.

        Raises:
            ValueError: time would run backward, or the image lacks an output.
        """
        if for_ms < 0:
            raise ValueError(f"for_ms is {for_ms}: plant time never runs backward")
        if len(y) < self._output_count:
            raise ValueError(f"Y image has {len(y)} levels, the map {self._output_count}")
        for tag, number, inverted in self._indicator_wires:
            self.indicators[tag] = y[number] != inverted
        # the relay of the emergency stop takes the coil power, whatever the outputs say
        powered = not self.box.emergency_stop
        coils = [powered and y[number] != inverted for number, inverted in self._coils]
        left, right = coils[: len(ARM_COILS)], coils[len(ARM_COILS) : 2 * len(ARM_COILS)]
        run, forward = coils[-2:]
        end_ms = self.time_ms + for_ms
        while self.time_ms < end_ms:
            step_ms = min(self._substep_ms, end_ms - self.time_ms)
            self.time_ms += step_ms
            self._substep(step_ms / 1000, left, right, run, forward)

    def _substep(self, dt_s: float, left: Sequence[bool], right: Sequence[bool], run: bool, forward: bool) -> None:
        self.conveyor.step(dt_s, run=run, forward=forward)
        if self.conveyor.moving:
            self._lay_bed()
        self.left.step(dt_s, left)
        self.right.step(dt_s, right)
        self._watch_arms()

    def _lay_bed(self) -> None:
        conveyor = self.conveyor
        self._bed.lay(
            [(number, conveyor.offset_m(number)) for number in conveyor.front_m],
            belt_m=conveyor.belt_m,
            is_placed=conveyor.placed_tray is not None,
        )

    def _watch_arms(self) -> None:
        inward_m = self._arms_meet_from_m
        meet = self.left.slide.position_m > inward_m and self.right.slide.position_m > inward_m
        if meet and not self._arms_met and not self._arms_may_meet:
            self._note(Incident.ARMS_COLLIDE, "both arms are inward of pick 2")
        self._arms_met = meet

    def _note(self, kind: Incident, text: str) -> None:
        self.events.append(Event(self.time_ms, kind, text))

    def _gather_sensors(self) -> dict[str, Sensor]:
        return {
            **{f"{side}.{tag}": sensor for side, arm in self.arms.items() for tag, sensor in arm.sensors.items()},
            "tray_front_edge": self.conveyor.beam,
            "air_pressure_ok": self.supply.pressure_ok,
            "magazine_empty": self.conveyor.magazine_empty,
        }

    def _wire(self, io_map: IoMap) -> None:
        """Connect terminals with what they belong to; resolved once, so that a scan is cheap."""
        box = self.box
        readers: dict[str, Callable[[], bool]] = {
            **{tag: sensor.read for tag, sensor in self.sensors.items()},
            "start": lambda: box.start,
            "stop": lambda: box.stop,
            "emergency_stop": lambda: box.emergency_stop,
            "reset": lambda: box.reset,
        }
        for point in io_map.inputs:
            if point.tag not in readers:
                raise ValueError(f"{io_map.path}:{point.line}: {point.tag}: no such sensor or button")
        self._inputs = [(p.number, p.inverted, readers[p.tag]) for p in io_map.inputs]
        self._dark = [False] * io_map.input_count
        self._coils = [(io_map[tag].number, io_map[tag].inverted) for tag in _COIL_TAGS]
        self._indicator_wires = [(tag, io_map[tag].number, io_map[tag].inverted) for tag in self.indicators]
        self._output_count = io_map.output_count
