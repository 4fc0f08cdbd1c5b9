"""Parameters of the simulated machine, and the reader of ``machine.yaml``."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from controller.common.errors import InputError
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.common.limits import require
from plant_sim.common.parameter_file import ParameterReader, Value
from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.mechanics import SeedlingSpec
from plant_sim.crop.response import CropSpec
from plant_sim.crop.seedling import CELLS_ALONG, COLUMNS
from plant_sim.devices.claws import ClawsSpec
from plant_sim.devices.conveyor_spec import ConveyorSpec
from plant_sim.devices.cups import CupsSpec
from plant_sim.devices.ground_wheel import GroundWheelSpec
from plant_sim.devices.lift import LiftSpec
from plant_sim.devices.pneumatic import (
    AirSpec,
    CheckValveSpec,
    FrictionSpec,
    Pneumatics,
    PortSpec,
    ValveSpec,
)
from plant_sim.devices.sensor import ContactSpec
from plant_sim.devices.slide import SlideSpec
from plant_sim.devices.spreader import SpreaderSpec
from plant_sim.devices.supply import SupplySpec
from plant_sim.devices.yield_sensors import YieldSensorsSpec
from plant_sim.machine.layout import LayoutSpec, RatingSpec, SimulationSpec, StartSpec
from plant_sim.machine.time_step import MOST_STEPS_PER_MS, steps_per_ms_by_key
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, REFERENCE_K

COLDEST_K, HOTTEST_K = 150.0, 500.0
"""Temperatures between which air is an ideal gas with constant heat capacities, to a few per cent, K. Assumed."""

LOAD_RATIO = 0.7
"""Largest ratio of the weight on a lift to its force. Assumed; handbooks recommend 0.5 to 0.7."""

_MPA = 1e6


class MachineError(InputError):
    """Invalid machine parameters; the one-line message states the location, the key and the problem."""


@dataclass(frozen=True, slots=True)
class Machine:
    """Parameters of one machine: one frozen spec per section of ``machine.yaml``, one field per parameter.

    Attributes:
        simulation: Time resolution of the simulation.
        start: State at the start.
        rating: Manufacturers' ratings.
        layout: Layout of the machine.
        air: Gas model.
        supply: Compressed-air supply.
        valve: Switching times of all valves.
        check_valve: Pilot check valves of slides and lifts.
        contact: Contacts of the switches.
        slide: The slides.
        slide_port: Path from the valve of a slide to its cylinder.
        slide_friction: Friction of a slide.
        lift: The lifts.
        lift_port: Path from the valve of a lift to its cylinder.
        lift_friction: Friction of a lift.
        claws: The claws.
        claws_port: Path from the claw valve of an arm to its cylinders.
        claws_friction: Friction of one gripper.
        spreader: The spreaders.
        conveyor: Tray conveyor and magazine.
        cups: The rotating cups.
        ground: Drive from the ground and the sensor of its speed.
        yield_sensors: Optional sensors of held and planted rows.
        crop: Seedling age, foam thickness and claw pressure.
        seedling: Properties of seedlings and foam.
        handling: Distances that determine the outcome of handling.
    """

    simulation: SimulationSpec
    start: StartSpec
    rating: RatingSpec
    layout: LayoutSpec
    air: AirSpec
    supply: SupplySpec
    valve: ValveSpec
    check_valve: CheckValveSpec
    contact: ContactSpec
    slide: SlideSpec
    slide_port: PortSpec
    slide_friction: FrictionSpec
    lift: LiftSpec
    lift_port: PortSpec
    lift_friction: FrictionSpec
    claws: ClawsSpec
    claws_port: PortSpec
    claws_friction: FrictionSpec
    spreader: SpreaderSpec
    conveyor: ConveyorSpec
    cups: CupsSpec
    ground: GroundWheelSpec
    yield_sensors: YieldSensorsSpec
    crop: CropSpec
    seedling: SeedlingSpec
    handling: HandlingSpec

    def __post_init__(self) -> None:
        """Validate the relations between sections; the key in the error is dotted."""
        require(
            self.columns_m[COLUMNS // 2 - 1] + self.handling.reach_m < self.slide.stroke_m,
            "slide.stroke_m",
            "is too short to reach pick 3; increase it or reduce layout.row_spacing_m",
        )
        require(
            self.slide.overtravel_m * self.slide.area_m2 < 0.5 * self.slide_port.dead_volume_m3,
            "slide.overtravel_m",
            "takes more than half of slide_port.dead_volume_m3",
        )
        self._require_affordable_steps()
        self._require_possible_temperatures()
        self._require_plausible_cylinders()
        switch_reach_m = self.slide.switch_band_m + self.slide.switch_hysteresis_m
        require(
            2 * switch_reach_m < self.handling.cell_pitch_m,
            "slide.switch_band_m",
            "allows the switches of two pick positions to be on at the same time; reduce it",
        )
        require(
            self.handling.stem_clearance_rise_m < self.lift.stroke_m,
            "handling.stem_clearance_rise_m",
            "must be less than lift.stroke_m for an arm to clear the seedlings",
        )
        claw_pitch_m = self.handling.cell_pitch_m + self.spreader.travel_m / (CELLS_ALONG - 1)
        require(
            abs(claw_pitch_m - self.cups.pitch_m) < 0.001,
            "spreader.travel_m",
            f"spreads the claws to {claw_pitch_m:.4g} m; it must equal cups.pitch_m to 1 mm",
        )

    def _require_affordable_steps(self) -> None:
        """Reject a machine whose air requires shorter time steps than are affordable."""
        key, per_ms = max(steps_per_ms_by_key(self).items(), key=lambda need: need[1])
        require(
            per_ms <= MOST_STEPS_PER_MS,
            key,
            f"is too small for the flow through it or the mass on it: {per_ms:.0f} time steps per millisecond would be "
            f"required (limit {MOST_STEPS_PER_MS}); increase it, or reduce the conductances or the area",
        )

    def _require_possible_temperatures(self) -> None:
        """Reject a pressure between which and the ambient one air leaves the temperature range of the gas model."""
        exponent = self.air.stiffness_exponent
        for key, gauge_pa in (
            ("supply.pressure_pa", self.supply.pressure_pa),
            ("crop.claw_pressure_mpa", self.claw_pressure_pa),
        ):
            ratio = (1 + gauge_pa / ATMOSPHERE_PA) ** ((exponent - 1) / exponent)
            require(
                REFERENCE_K / ratio >= COLDEST_K,
                key,
                f"cools vented air to {REFERENCE_K / ratio:.0f} K with the exponent {exponent:g} (limit "
                f"{COLDEST_K:.0f} K); reduce it",
            )
            require(
                self.air.thermal or REFERENCE_K * ratio <= HOTTEST_K,
                "air.polytropic_exponent",
                f"heats air that fills a chamber at {key} to {REFERENCE_K * ratio:.0f} K (limit {HOTTEST_K:.0f} K); "
                "reduce it, or set air.thermal",
            )

    def _require_plausible_cylinders(self) -> None:
        """Reject a brake, a cushion, friction or a load with which a cylinder cannot start or work."""
        require(
            self.slide.brake_n == 0.0 or self.slide.brake_bites_pa < self.rating.slide_least_pa,
            "slide.brake_bites_pa",
            "must be less than rating.slide_least_pa, otherwise the brake stops a slide that is within its rating",
        )
        require(
            self.lift.cushion_volume_m3 <= 0.5 * self.lift_port.dead_volume_m3,
            "lift.cushion_volume_m3",
            "takes more than half of lift_port.dead_volume_m3",
        )
        for section, friction, least_pa, area_m2 in (
            ("slide", self.slide_friction, self.rating.slide_least_pa, self.slide.area_m2),
            ("lift", self.lift_friction, self.rating.lift_least_pa, self.lift.lifting_area_m2),
            ("claws", self.claws_friction, self.rating.claws_least_pa, self.claws.area_m2 / self.claws.grippers),
        ):
            require(
                friction.static_n < least_pa * area_m2,
                f"{section}_friction.static_n",
                f"must be less than {least_pa * area_m2:.3g} N, the force at rating.{section}_least_pa",
            )
        require(
            self.slide.bumper_m < self.slide.switch_band_m,
            "slide.bumper_m",
            "must be thinner than slide.switch_band_m, otherwise the switch at the feed does not detect the slide",
        )
        lifted_n = LOAD_RATIO * self.supply.pressure_pa * self.lift.lifting_area_m2
        require(
            self.lift.weight_n < lifted_n,
            "lift.carried_kg",
            f"weighs {self.lift.weight_n:.4g} N, but the lift may carry only {lifted_n:.4g} N, {LOAD_RATIO:g} of its "
            "force on the rod side; reduce it, or increase supply.pressure_pa or lift.bore_m",
        )

    @property
    def steps_per_ms(self) -> int:
        """Number of time steps per millisecond: each `simulation.step_s`, divided for the most demanding volume."""
        whole = self.simulation.steps_per_ms
        return whole * max(1, math.ceil(max(steps_per_ms_by_key(self).values()) / whole))

    @property
    def step_s(self) -> float:
        """Length of a time step, s."""
        return 1e-3 / self.steps_per_ms

    @property
    def columns_m(self) -> tuple[float, ...]:
        """Slide positions of the six columns of a tray, nearest first, m; identical on both sides.

        Source: docs/sources/machine.md 1, half the row spacing minus 2.5, 1.5, 0.5 cell pitches.
        """
        middle_m = self.layout.row_spacing_m / 2
        return tuple(middle_m + (index - (COLUMNS - 1) / 2) * self.handling.cell_pitch_m for index in range(COLUMNS))

    @property
    def pneumatics(self) -> Pneumatics:
        """Specs common to all cylinders."""
        return Pneumatics(self.air, self.valve, self.check_valve)

    @property
    def claw_pressure_pa(self) -> float:
        """Set pressure of the claw regulator, gauge, Pa."""
        return self.crop.claw_pressure_mpa * _MPA

    @property
    def held_pressure_pa(self) -> float:
        """Gauge pressure of the chambers of slides and lifts at the start, Pa."""
        return self.start.chamber_share * self.supply.pressure_pa

    @property
    def held_claw_pressure_pa(self) -> float:
        """Gauge pressure of the claws at the start: the set pressure, or that of their reservoir if it is lower, Pa."""
        supply = self.supply
        reservoir_pa = 0.5 * (supply.compressor_on_pa + supply.compressor_off_pa) - supply.check_crack_pa
        return min(self.claw_pressure_pa, reservoir_pa)

    @property
    def warnings(self) -> list[str]:
        """Values outside the manufacturers' ratings, one line each, beginning with the parameter."""
        rating, main_pa, claws_pa = self.rating, self.supply.pressure_pa, self.claw_pressure_pa
        checks = [
            (
                "supply.pressure_pa",
                main_pa,
                rating.slide_least_pa,
                min(rating.slide_pa, self.slide.decouples_pa),
                "MPa",
                _MPA,
                "CY1S slide",
            ),
            ("supply.pressure_pa", main_pa, 0.0, rating.lift_pa, "MPa", _MPA, "SC50 lift"),
            ("crop.claw_pressure_mpa", claws_pa, rating.claws_least_pa, rating.claws_pa, "MPa", _MPA, "MHC2 claws"),
            (
                "slide.throttle_conductance_m3_s_pa",
                self.slide.speed_m_s,
                rating.slide_least_m_s,
                rating.slide_m_s,
                "m/s",
                1.0,
                "CY1S slide",
            ),
            ("lift.extend_conductance_m3_s_pa", self.lift.extend_m_s, 0.0, rating.lift_m_s, "m/s", 1.0, "SC50 lift"),
            ("lift.retract_conductance_m3_s_pa", self.lift.retract_m_s, 0.0, rating.lift_m_s, "m/s", 1.0, "SC50 lift"),
        ]
        beyond = [
            f"{name}: {value / unit:.3g} {symbol} is outside the rating of the {part}, "
            f"{low / unit:g} to {high / unit:.3g} {symbol}"
            for name, value, low, high, symbol, unit, part in checks
            if not low <= value <= high
        ]
        held_pa = self.supply.compressor_on_pa - self.supply.check_crack_pa
        if claws_pa > held_pa:
            beyond.append(
                f"crop.claw_pressure_mpa: {claws_pa / _MPA:.4g} MPa exceeds the lowest pressure behind the claw "
                f"check valve, {held_pa / _MPA:.4g} MPa; raise supply.compressor_on_pa"
            )
        if self.slide.recouples_m_s < self.slide.speed_m_s:
            beyond.append(
                f"slide.recouples_m_s: {self.slide.recouples_m_s:.3g} m/s is less than the speed of the piston, "
                f"{self.slide.speed_m_s:.3g} m/s: a decoupled carriage never recouples"
            )
        return beyond

    @property
    def picks_m(self) -> tuple[float, ...]:
        """Slide positions of pick 1, 2 and 3, m."""
        return self.columns_m[: COLUMNS // 2]

    def with_values(self, values: Mapping[str, Value]) -> "Machine":
        """Return a machine with some parameters changed.

        Args:
            values: New values by dotted name, for example
                ``{"cups.planting_frequency_per_min": 60}``.

        Raises:
            MachineError: A name is unknown or a value is invalid.
        """
        return _READER.changed(self, values)


_READER = ParameterReader(Machine, MachineError, subject="machine")


def load_machine(path: Path = DEFAULT_MACHINE) -> Machine:
    """Read and validate the parameters of a machine.

    Args:
        path: Parameter file; by default the one in the package.

    Raises:
        MachineError: The file cannot be read or is invalid.
    """
    return _READER.load(path)
