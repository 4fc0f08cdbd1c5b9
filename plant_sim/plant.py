"""The whole machine: coil levels go in, terminal levels come out, seedlings are accounted for."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from controller.io_map import IoMap
from plant_sim.arm import ArmPlant
from plant_sim.crop.bed import Bed
from plant_sim.crop.incident import Incident
from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.seedling import SeedlingCounts, Seedlings
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.operator_box import OperatorBox
from plant_sim.devices.pneumatic import Records
from plant_sim.devices.sensor import Sensor
from plant_sim.devices.supply import Supply
from plant_sim.faults import Fault, FaultSchedule
from plant_sim.kernel import ARM_COILS, MACHINE, MACHINE_MAKE, SENSORS, SIGHT, advance, look
from plant_sim.parameters import Machine
from plant_sim.pneumatics.flow import REFERENCE_KG_M3

__all__ = ["ArmPlant", "Event", "Plant"]

_SIDES = ("left", "right")
_COIL_TAGS = (
    *(f"{side}.{coil}" for side in _SIDES for coil in ARM_COILS),
    "tray_run",
    "tray_forward",
)
_BUTTON_TAGS = ("start", "stop", "emergency_stop", "reset")
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
        state: One record `MACHINE`: everything that moves.
        make: One record `MACHINE_MAKE`: everything that decides how; faults change it.
        wired: Tags of the inputs that have a wire.
        broken_wires: Tags of the inputs whose terminal is off whatever the sensor says.
        faults: What breaks, and when.
    """

    def __init__(
        self, io_map: IoMap, machine: Machine, *, seed: int, trays: int = 2, faults: Iterable[Fault] = ()
    ) -> None:
        """Put a machine together; it is found as a normal stop leaves it.

        Args:
            io_map: The wires.
            machine: All parameters.
            seed: Decides what every seedling is like and where the cups stand.
            trays: How many trays there are.
            faults: What breaks, and when.

        Raises:
            FaultError: the machine has no such part, or two faults change the same thing at the same time.
            KeyError: a coil of the machine has no wire.
            ValueError: a wired input is none of this machine, or there are fewer than no trays.
        """
        self.time_ms = 0
        self.box = OperatorBox()
        self.events: list[Event] = []
        self.extrapolates = machine.crop.extrapolates
        self.state = np.zeros(1, MACHINE)
        self.make = np.zeros(1, MACHINE_MAKE)
        state, make = self.state[0], self.make[0]
        gas = make["gas"]
        air = machine.air
        gas["exponent"], gas["wall_s"] = air.stiffness_exponent, air.wall_time_s
        gas["thermal"], gas["wall_w_m2_k"] = air.thermal, air.wall_w_m2_k
        gas["step_s"] = machine.simulation.step_s
        self.supply = Supply(machine.supply, state["air"], make["air"], gas, claw_pressure_pa=machine.claw_pressure_pa)
        self.conveyor = Conveyor(machine.conveyor, state["conveyor"], make["conveyor"], trays=trays)
        self.seedlings = Seedlings(trays=trays, seed=seed)
        mechanics = Mechanics(
            machine.seedling, foam_mm=machine.crop.foam_thickness_mm, age_d=machine.crop.seedling_age_d
        )
        self._half_tray_m = machine.handling.tray_half_width_m
        self._bed = Bed(self.seedlings, pitch_m=machine.handling.cell_pitch_m)
        self._lay_bed()
        self.left, self.right = (
            ArmPlant(
                side,
                machine,
                Records(state["arms"][number], make["arms"][number], gas),
                self.seedlings,
                mechanics=mechanics,
                bed=self._bed,
                report=self._note,
                seed=f"seed {seed}, {side} cups",
            )
            for number, side in enumerate(_SIDES)
        )
        self.arms = dict(zip(_SIDES, (self.left, self.right), strict=True))
        self.sensors = self._gather_sensors()
        self.indicators = {tag: False for tag in _INDICATOR_TAGS if tag in io_map}
        self._arms_meet_from_m = (machine.picks_m[1] + machine.picks_m[2]) / 2
        self._arms_may_meet = machine.layout.arms_may_meet_in_plant
        self._arms_met = False
        self._look_ms = machine.simulation.look_ms
        self._steps_per_ms = machine.simulation.steps_per_ms
        self.broken_wires: set[str] = set()
        self._wire(io_map)
        self.faults = FaultSchedule(self, faults)
        self._advance(0)  # whatever has to be compiled is compiled now, before anything waits for an answer

    @property
    def x(self) -> list[bool]:
        """The raw X image of this instant; a new list, the caller's own."""
        look(self.state, self.make, self._terminals, self._inverted, self._image)
        image: list[bool] = self._image.tolist()
        for tag, number, inverted in self._buttons:
            image[number] = getattr(self.box, tag) != inverted
        for sensor, number, inverted in self._lone_sensors:
            image[number] = sensor.read() != inverted
        for tag in self.broken_wires:
            image[self._number_of[tag]] = False
        return image

    @property
    def y(self) -> list[bool]:
        """The raw Y image of the last step; a new list, the caller's own."""
        return list(self._y)

    @property
    def missed_cups(self) -> dict[str, int]:
        """Cups of each row that passed empty between its first and its last filled one."""
        return {side: arm.row.missed_cups for side, arm in self.arms.items()}

    @property
    def air_l(self) -> float:
        """Air that the valves of slides, lifts and claws have let in so far, L ANR."""
        arms = self.state[0]["arms"]
        drives, ports = ("slide", "lift", "claws"), ("plus", "minus")
        drawn_kg = [arms[drive][port]["drawn_kg"].sum() for drive in drives for port in ports]
        return 1e3 * float(sum(drawn_kg)) / REFERENCE_KG_M3

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
        if y is not self._y and list(y) != self._y:
            self._take(y)
        end_ms = self.time_ms + for_ms
        faults = self.faults
        while self.time_ms < end_ms:
            chunk_ms = min(self._look_ms, end_ms - self.time_ms)
            if faults.next_ms is not None:
                chunk_ms = min(chunk_ms, faults.next_ms - self.time_ms)
            self._advance(chunk_ms)
            self._follow()
            if faults.next_ms is not None:
                faults.advance(self.time_ms)

    def _advance(self, for_ms: int) -> None:
        """Let everything move; the relay of the emergency stop takes coil power and air, whatever the outputs say."""
        fed = not self.box.emergency_stop
        coils = self._coils if fed else self._no_coils
        first, steps = self.time_ms * self._steps_per_ms, for_ms * self._steps_per_ms
        advance(self.state, self.make, coils, fed, first, steps, self._sight)
        self.time_ms += for_ms

    def _take(self, y: Sequence[bool]) -> None:
        """Take note of new outputs."""
        self._y: list[bool] = list(y)
        for tag, number, inverted in self._indicator_wires:
            self.indicators[tag] = y[number] != inverted
        self._coils[:] = [y[number] != inverted for number, inverted in self._coil_wires]

    def _follow(self) -> None:
        """See what the last motion did to trays and seedlings."""
        now_s = self.time_ms / 1000
        sight: list[float] = self._sight.tolist()
        if self.conveyor.follow(sight[-1]):
            self._lay_bed()
        left, right = sight[: len(SIGHT)], sight[len(SIGHT) : -1]
        self.left.follow(now_s, left)
        self.right.follow(now_s, right)
        meet = left[0] > self._arms_meet_from_m and right[0] > self._arms_meet_from_m
        if meet and not self._arms_met and not self._arms_may_meet:
            self._note(Incident.ARMS_COLLIDE, "both arms are inward of pick 2")
        self._arms_met = meet

    def _lay_bed(self) -> None:
        conveyor = self.conveyor
        self._bed.lay(
            [(number, conveyor.offset_m(number)) for number in conveyor.front_m],
            trays_m=conveyor.trays_m,
            is_placed=conveyor.placed_tray is not None,
            turned={number: lead_m / self._half_tray_m for number, lead_m in conveyor.skewed_m.items()},
        )

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
        for point in io_map.inputs:
            if point.tag not in self.sensors and point.tag not in _BUTTON_TAGS:
                raise ValueError(f"{io_map.path}:{point.line}: {point.tag}: no such sensor or button")
        points = [io_map.get(tag) for tag in SENSORS]
        self._terminals = np.array([-1 if point is None else point.number for point in points])
        self._inverted = np.array([point is not None and point.inverted for point in points])
        self._image = np.zeros(io_map.input_count, np.bool_)
        self._number_of = {point.tag: point.number for point in io_map.inputs}
        self.wired = tuple(self._number_of)
        self._buttons = [(tag, io_map[tag].number, io_map[tag].inverted) for tag in _BUTTON_TAGS if tag in io_map]
        self._lone_sensors = [
            (self.sensors[point.tag], point.number, point.inverted)
            for point in io_map.inputs
            if point.tag in self.sensors and point.tag not in SENSORS
        ]
        self._coil_wires = [(io_map[tag].number, io_map[tag].inverted) for tag in _COIL_TAGS]
        self._coils = np.zeros(len(_COIL_TAGS), np.bool_)
        self._no_coils = np.zeros(len(_COIL_TAGS), np.bool_)
        self._indicator_wires = [(tag, io_map[tag].number, io_map[tag].inverted) for tag in self.indicators]
        self._output_count = io_map.output_count
        self._sight = np.zeros(2 * len(SIGHT) + 1)
        self._take(io_map.safe_outputs())
