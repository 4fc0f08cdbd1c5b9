"""Simulated machine, with coil levels as inputs, terminal levels as outputs, and the location of every seedling."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from controller.common.modbus.io_map import IoMap
from controller.common.saved import Saved
from plant_sim.crop.bed import Bed
from plant_sim.crop.incident import Incident
from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.seedling import SeedlingCounts, Seedlings
from plant_sim.devices.conveyor import Conveyor
from plant_sim.devices.ground_wheel import GroundWheel
from plant_sim.devices.operator_box import OperatorBox
from plant_sim.devices.pneumatic import Records
from plant_sim.devices.sensor import Sensor
from plant_sim.devices.supply import Supply
from plant_sim.faults import Fault, FaultSchedule
from plant_sim.machine.arm import ArmPlant
from plant_sim.machine.crop_limits import CropLimits
from plant_sim.machine.kernel import ARM_COILS, MACHINE, MACHINE_PARAMS, POSITIONS, advance
from plant_sim.machine.parameters import Machine
from plant_sim.machine.terminals import Terminals
from plant_sim.pneumatics.flow import REFERENCE_KG_M3

__all__ = ["ArmPlant", "Event", "Plant"]

_SIDES = ("left", "right")
_COIL_TAGS = (*(f"{side}.{coil}" for side in _SIDES for coil in ARM_COILS), "tray_run", "tray_forward")
_INDICATOR_TAGS = ("horn", "lamp_red", "lamp_amber", "lamp_green")
_PLAIN_SENSORS: dict[str, bool] = {"guard": False}
"""On/off sensors without a device model: level at power-up by tag."""


class Event(NamedTuple):
    """An incident with its time."""

    time_ms: int
    kind: Incident
    text: str


class Plant(Saved):
    """The simulated transplanter.

    The same seed and the same outputs at the same times give bit-identical results.

    Attributes:
        time_ms: Plant time, ms; advanced only by `step`.
        box: Push buttons and guard.
        left: Left arm with its row of cups.
        right: Right arm with its row of cups.
        arms: Both arms by side.
        conveyor: Trays and magazine.
        supply: Compressed-air supply.
        ground: Travel of the tractor and the sensor of its speed.
        seedlings: All seedlings.
        sensors: All sensors by I/O tag, wired or not; the buttons are in `box`.
        indicators: States of the wired horn and lamps by tag.
        events: All incidents so far.
        extrapolates: True if the crop settings are outside the range tested in the paper.
        state: State of the machine, one `MACHINE` record.
        params: Parameters of the machine, one `MACHINE_PARAMS` record; faults change it.
        limits: Limits within which no motion can affect a seedling.
        positions: Latest positions of all moving parts, as `advance` returns them.
        terminals: Input terminals.
        coil_wires: Y number and polarity of every coil in kernel order.
        coils: Levels of the coils in kernel order.
        no_coils: Levels of the coils without coil power.
        look_ms: Longest time between two looks at the motion, ms.
        steps_per_ms: Number of kernel steps per millisecond.
        faults: Fault schedule.
    """

    SAVED = ("_arms_met", "_planter_m_s", "_y", "events", "indicators", "time_ms")

    def __init__(
        self, io_map: IoMap, machine: Machine, *, seed: int, trays: int = 2, faults: Iterable[Fault] = ()
    ) -> None:
        """Initialise a machine in the state after a normal stop.

        Args:
            io_map: I/O map.
            machine: All parameters.
            seed: Seed of the seedling traits and of the cups.
            trays: Number of trays.
            faults: Faults to schedule.

        Raises:
            FaultError: The machine has no such part, or two faults change the same value at the same time.
            DeclarationError: A coil of the machine is not wired.
            ValueError: A wired input is not part of the machine, or the number of trays is negative.
        """
        self.time_ms = 0
        self.box = OperatorBox()
        self.events: list[Event] = []
        self.extrapolates = machine.crop.extrapolates
        self.state = np.zeros(1, MACHINE)
        self.params = np.zeros(1, MACHINE_PARAMS)
        state, params = self.state[0], self.params[0]
        gas = params["gas"]
        air = machine.air
        gas["exponent"], gas["wall_s"] = air.stiffness_exponent, air.wall_time_s
        gas["thermal"], gas["wall_w_m2_k"] = air.thermal, air.wall_w_m2_k
        gas["step_s"] = machine.step_s
        self.supply = Supply(
            machine.supply, state["air"], params["air"], gas, claw_pressure_pa=machine.claw_pressure_pa
        )
        self.conveyor = Conveyor(machine.conveyor, state["conveyor"], params["conveyor"], trays=trays)
        self.seedlings = Seedlings(trays=trays, seed=seed)
        mechanics = Mechanics(
            machine.seedling, foam_mm=machine.crop.foam_thickness_mm, age_d=machine.crop.seedling_age_d
        )
        self._half_tray_m = machine.handling.tray_half_width_m
        self._bed = Bed(self.seedlings, pitch_m=machine.handling.cell_pitch_m)
        self._update_bed()
        self.left, self.right = (
            ArmPlant(
                side,
                machine,
                Records(state["arms"][number], params["arms"][number], gas),
                self.seedlings,
                mechanics=mechanics,
                bed=self._bed,
                report=self._report,
                seed=f"seed {seed}, {side} cups",
            )
            for number, side in enumerate(_SIDES)
        )
        self.arms = dict(zip(_SIDES, (self.left, self.right), strict=True))
        self._cups = state["arms"]["cups"]
        self._cup_pitch_m = machine.cups.pitch_m
        self.ground = GroundWheel(machine.ground)
        self.ground.place(self._plants)
        self._planter_m_s = 0.0
        self._plain_sensors = [Sensor.alone(on=on) for on in _PLAIN_SENSORS.values()]
        self.sensors = self._all_sensors()
        self.indicators = {tag: False for tag in _INDICATOR_TAGS if tag in io_map}
        self._arms_meet_from_m = (machine.picks_m[1] + machine.picks_m[2]) / 2
        self._arms_may_meet = machine.layout.arms_may_meet_in_plant
        self._arms_met = False
        self.look_ms = machine.simulation.look_ms
        self.steps_per_ms = machine.steps_per_ms
        self._wire(io_map)
        self.faults = FaultSchedule(self, faults)
        arrays = (self.state, self.params, self.coils, self.positions, self.terminals.levels)
        self._bytes = [array.view(np.uint8) for array in arrays]
        self._parts = (
            *self.arms.values(),
            self.box,
            self.conveyor,
            self.ground,
            self.seedlings,
            self._bed,
            self.faults,
        )
        self._advance(0)  # triggers compilation now, before a client waits for a response

    def save(self) -> Any:
        """Return the complete state of the machine."""
        return (
            super().save(),
            [array.tobytes() for array in self._bytes],
            [part.save() for part in self._parts],
            [sensor.save() for sensor in self._plain_sensors],
            self.broken_wires.copy(),
        )

    def restore(self, saved: Any) -> None:
        """Restore a state returned by `save`."""
        own, arrays, parts, sensors, broken_wires = saved
        events = self.events
        super().restore(own)
        events[:], self.events = self.events, events
        for array, values in zip(self._bytes, arrays, strict=True):
            array[:] = np.frombuffer(values, np.uint8)
        for part, state in zip(self._parts, parts, strict=True):
            part.restore(state)
        for sensor, state in zip(self._plain_sensors, sensors, strict=True):
            sensor.restore(state)
        self.broken_wires.clear()
        self.broken_wires.update(broken_wires)

    @property
    def x(self) -> list[bool]:
        """Current raw X image, as a new list."""
        return self.terminals.read(self.state, self.params)

    @property
    def wired(self) -> tuple[str, ...]:
        """Tags of the wired inputs."""
        return self.terminals.wired

    @property
    def broken_wires(self) -> set[str]:
        """Tags of the inputs whose terminals are off regardless of their sensors."""
        return self.terminals.broken_wires

    @property
    def y(self) -> list[bool]:
        """Raw Y image of the last step, as a new list."""
        return list(self._y)

    @property
    def missed_cups(self) -> dict[str, int]:
        """Cups of each row that passed empty between the first and the last filled cup."""
        return {side: arm.row.missed_cups for side, arm in self.arms.items()}

    @property
    def air_l(self) -> float:
        """Air admitted so far by the valves of slides, lifts and claws, L ANR."""
        arms = self.state[0]["arms"]
        drives, ports = ("slide", "lift", "claws"), ("plus", "minus")
        drawn_kg = [arms[drive][port]["drawn_kg"].sum() for drive in drives for port in ports]
        return 1e3 * float(sum(drawn_kg)) / REFERENCE_KG_M3

    @property
    def planting_frequency_per_min(self) -> float:
        """Cups per minute per row at the current set-point of the tractor speed; may be set at any time."""
        return self.left.cups.planting_frequency_per_min

    @planting_frequency_per_min.setter
    def planting_frequency_per_min(self, per_min: float) -> None:
        for arm in self.arms.values():
            arm.cups.planting_frequency_per_min = per_min

    @property
    def planter_speed_m_s(self) -> float:
        """Set-point of a planter with its own motor, m/s, 0 without coil power; the cups do not depend on it."""
        return self._planter_m_s if self.box.powered else 0.0

    @planter_speed_m_s.setter
    def planter_speed_m_s(self, speed_m_s: float) -> None:
        self._planter_m_s = speed_m_s

    @property
    def _plants(self) -> float:
        """Plants per row that the drive wheel has counted out; a jammed carousel is passed by the other one."""
        chains_m: list[float] = self._cups["chain_m"].tolist()
        return max(chains_m) / self._cup_pitch_m

    @property
    def _plants_per_s(self) -> float:
        """Speed of the drive wheel, plants per row and second."""
        speeds_m_s: list[float] = self._cups["speed_m_s"].tolist()
        return max(speeds_m_s) / self._cup_pitch_m

    def counts(self) -> SeedlingCounts:
        """Return the number of seedlings at each location; each is counted once."""
        return self.seedlings.counts()

    def step(self, for_ms: int, y: Sequence[bool]) -> None:
        """Advance plant time with constant outputs.

        Args:
            for_ms: Duration, ms.
            y: Raw Y image.

        Raises:
            ValueError: `for_ms` is negative, or the image is too short.
        """
        if for_ms < 0:
            raise ValueError(f"for_ms is {for_ms}: must be 0 or more")
        if len(y) < self._output_count:
            raise ValueError(f"Y image has {len(y)} levels; the I/O map has {self._output_count}")
        if y is not self._y and list(y) != self._y:
            self._latch_outputs(y)
        end_ms = self.time_ms + for_ms
        faults = self.faults
        while self.time_ms < end_ms:
            chunk_ms = min(self.look_ms, end_ms - self.time_ms)
            if faults.next_ms is not None:
                chunk_ms = min(chunk_ms, faults.next_ms - self.time_ms)
            self._advance(chunk_ms)
            self._apply_motion()
            if faults.next_ms is not None:
                faults.advance(self.time_ms)

    def _advance(self, for_ms: int) -> None:
        """Advance all moving parts; the safety relay removes coil power, and the air too, regardless of the outputs."""
        coils, fed = self.coils if self.box.powered else self.no_coils, not self.box.emergency_stop
        self.limits.show_seedlings()
        first, steps = self.time_ms * self.steps_per_ms, for_ms * self.steps_per_ms
        advance(self.state, self.params, coils, fed, first, steps, self.positions)
        self.time_ms += for_ms

    def look(self) -> bool:
        """Apply the motion since the last look, of which only the latest part can affect a seedling.

        Returns:
            True if a seedling has been moved, or an incident reported.
        """
        happenings = self.happenings
        positions: list[float] = self.positions.tolist()
        self.limits.look(self.time_ms / 1000, positions)
        self._check_meeting(positions[0], positions[len(POSITIONS)])
        return self.happenings != happenings

    @property
    def happenings(self) -> tuple[int, int]:
        """Number of moves of seedlings and number of incidents so far."""
        return self.seedlings.move_count, len(self.events)

    def limit(self) -> None:
        """Set the limits within which no motion can affect a seedling."""
        self.limits.set(self.positions.tolist())

    def follow_drive(self) -> None:
        """Update the travel of the tractor."""
        self.ground.follow(self._plants, self._plants_per_s)

    def adopt(self, time_ms: int, y: Sequence[bool]) -> None:
        """Adopt the time and the outputs of a run on the records of this plant.

        Args:
            time_ms: Plant time, ms.
            y: Raw Y image.
        """
        self.time_ms = time_ms
        self._latch_outputs(y)
        self.limits.catch_up()
        self.follow_drive()
        self.faults.advance(time_ms)

    def _latch_outputs(self, y: Sequence[bool]) -> None:
        """Latch new outputs."""
        self._y: list[bool] = list(y)
        for tag, number, inverted in self._indicator_wires:
            self.indicators[tag] = y[number] != inverted
        self.coils[:] = [y[number] != inverted for number, inverted in self.coil_wires]

    def _apply_motion(self) -> None:
        """Apply the latest motion to tractor, trays and seedlings."""
        self.follow_drive()
        now_s = self.time_ms / 1000
        positions: list[float] = self.positions.tolist()
        self._follow_trays(positions[-1])
        left, right = positions[: len(POSITIONS)], positions[len(POSITIONS) : -1]
        self.left.follow(now_s, left)
        self.right.follow(now_s, right)
        self._check_meeting(left[0], right[0])

    def _follow_trays(self, trays_m: float) -> bool:
        """Update the trays to a new travel; return True if they have moved."""
        moved = self.conveyor.follow(trays_m)
        if moved:
            self._update_bed()
        return moved

    def _check_meeting(self, left_m: float, right_m: float) -> None:
        """Report an incident when both slides have come inward of pick 2."""
        meet = left_m > self._arms_meet_from_m and right_m > self._arms_meet_from_m
        if meet and not self._arms_met and not self._arms_may_meet:
            self._report(Incident.ARMS_COLLIDE, "both arms are inward of pick 2")
        self._arms_met = meet

    def _update_bed(self) -> None:
        conveyor = self.conveyor
        self._bed.lay(
            [(number, conveyor.offset_m(number)) for number in conveyor.front_m],
            trays_m=conveyor.followed_m,
            is_placed=conveyor.placed_tray is not None,
            turned={number: lead_m / self._half_tray_m for number, lead_m in conveyor.skewed_m.items()},
        )

    def _report(self, kind: Incident, text: str) -> None:
        self.events.append(Event(self.time_ms, kind, text))

    def _all_sensors(self) -> dict[str, Sensor]:
        return {
            **{f"{side}.{tag}": sensor for side, arm in self.arms.items() for tag, sensor in arm.sensors.items()},
            "tray_front_edge": self.conveyor.beam,
            "air_pressure_ok": self.supply.pressure_ok,
            "magazine_empty": self.conveyor.magazine_empty,
            "ground_pulse": self.ground.pulse,
            **dict(zip(_PLAIN_SENSORS, self._plain_sensors, strict=True)),
        }

    def _wire(self, io_map: IoMap) -> None:
        """Connect terminals, coils and indicators once, so that a scan is fast."""
        self.terminals = Terminals(io_map, self.sensors, self.box)
        self.coil_wires = [(io_map[tag].number, io_map[tag].inverted) for tag in _COIL_TAGS]
        self.coils = np.zeros(len(_COIL_TAGS), np.bool_)
        self.no_coils = np.zeros(len(_COIL_TAGS), np.bool_)
        self._indicator_wires = [(tag, io_map[tag].number, io_map[tag].inverted) for tag in self.indicators]
        for side, arm in self.arms.items():
            arm.watches_yield = any(f"{side}.{tag}" in io_map for tag in arm.yield_sensors)
        self._output_count = io_map.output_count
        self.positions = np.zeros(2 * len(POSITIONS) + 1)
        self.limits = CropLimits(
            tuple(self.arms.values()),
            self.conveyor,
            self._bed,
            follow_trays=self._follow_trays,
            meet_m=self._arms_meet_from_m,
        )
        self._latch_outputs(io_map.safe_outputs())
