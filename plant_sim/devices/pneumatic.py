"""Common parts of slide, lift and claws: valves, ports, friction, and the view of a cylinder."""

import math
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

from plant_sim.common.compiled import compiled, compiled_and_cached
from plant_sim.common.limits import require, require_within
from plant_sim.devices.sensor import Sensor, place_switch
from plant_sim.devices.view import View
from plant_sim.pneumatics.chamber import fill, set_ambient
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, tube_conductance_m3_s_pa, tube_critical_ratio
from plant_sim.pneumatics.meter_out import annulus_area_m2

_WAVE_M_S = 343.0
"""Speed of sound, at which a pressure change travels through a tube, m/s. Source: docs/sources/plant.md 1.3."""


@dataclass(frozen=True, slots=True)
class AirSpec:
    """Gas model common to all chambers.

    Attributes:
        polytropic_exponent: Polytropic exponent of air, 1 (slow, isothermal) to 1.4 (fast, adiabatic).
        wall_time_s: Time constant of the relaxation to wall temperature, s.
        thermal: True if the temperature is computed from the energy balance instead of the two parameters above.
        wall_w_m2_k: Heat transfer coefficient of the walls, used if `thermal` is True, W/(m2 K).
    """

    polytropic_exponent: float
    wall_time_s: float
    thermal: bool
    wall_w_m2_k: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 1.0, 1.4, "polytropic_exponent")
        require_within(self, 0.01, 100.0, "wall_time_s")
        require_within(self, 0.0, 1000.0, "wall_w_m2_k")

    @property
    def stiffness_exponent(self) -> float:
        """Exponent that relates changes of pressure and density within a step."""
        return 1.4 if self.thermal else self.polytropic_exponent


@dataclass(frozen=True, slots=True)
class ValveSpec:
    """Switching times of a solenoid valve.

    Attributes:
        on_delay_s: Delay from coil on to spool motion, s; a shorter pulse has no effect.
        off_delay_s: Delay from coil off to spool motion, s; a shorter gap has no effect.
        spool_s: Travel time of the spool from the middle to an end, s.
    """

    on_delay_s: float
    off_delay_s: float
    spool_s: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 0.5, "on_delay_s", "off_delay_s")
        require_within(self, 0.0005, 0.1, "spool_s")


@dataclass(frozen=True, slots=True)
class CheckValveSpec:
    """Parameters of the pilot check valves at both ports of a cylinder.

    Attributes:
        crack_pa: Pressure difference at which it opens inward, Pa.
        pilot_ratio: Ratio of pilot to chamber gauge pressure at which it opens outward.
        pilot_least_pa: Minimum pilot gauge pressure, Pa.
    """

    crack_pa: float
    pilot_ratio: float
    pilot_least_pa: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 1e5, "crack_pa")
        require_within(self, 0.05, 1.0, "pilot_ratio")
        require_within(self, 0.0, 0.5e6, "pilot_least_pa")


@dataclass(frozen=True, slots=True)
class PortSpec:
    """Path from a valve to the cylinder, identical at both ports.

    Attributes:
        valve_conductance_m3_s_pa: Sonic conductance of the valve, m3/(s Pa).
        valve_critical_ratio: Critical pressure ratio of the valve.
        tube_inner_m: Inner diameter of the tube, m.
        tube_length_m: Length of the tube, m.
        tubes: Number of parallel tubes.
        fitting_conductance_m3_s_pa: Combined sonic conductance of speed controller (free flow), check valve and port,
            m3/(s Pa). That of a throttle also includes check valve and port.
        fitting_critical_ratio: Critical pressure ratio of these components and of the throttle.
        dead_volume_m3: Chamber volume at the end of the stroke, m3.
    """

    valve_conductance_m3_s_pa: float
    valve_critical_ratio: float
    tube_inner_m: float
    tube_length_m: float
    tubes: int
    fitting_conductance_m3_s_pa: float
    fitting_critical_ratio: float
    dead_volume_m3: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 1e-10, 1e-6, "valve_conductance_m3_s_pa", "fitting_conductance_m3_s_pa")
        require_within(self, 0.05, 0.6, "valve_critical_ratio", "fitting_critical_ratio")
        require_within(self, 0.0005, 0.05, "tube_inner_m")
        require_within(self, 0.05, 50.0, "tube_length_m")
        require_within(self, 1, 100, "tubes")
        require_within(self, 1e-6, 1e-3, "dead_volume_m3")

    @property
    def tube_m3(self) -> float:
        """Volume of the tubes, m3."""
        return self.tubes * math.pi / 4 * self.tube_inner_m**2 * self.tube_length_m

    @property
    def tube_conductance_m3_s_pa(self) -> float:
        """Sonic conductance of the tubes, m3/(s Pa)."""
        return self.tubes * tube_conductance_m3_s_pa(self.tube_inner_m, self.tube_length_m)

    @property
    def tube_ratio(self) -> float:
        """Critical pressure ratio of the tubes."""
        return tube_critical_ratio(self.tube_inner_m, self.tube_length_m)

    @property
    def tube_wall_m2(self) -> float:
        """Inner wall area of the tubes, m2."""
        return self.tubes * math.pi * self.tube_inner_m * self.tube_length_m

    @property
    def delay_s(self) -> float:
        """Travel time of a pressure change from the valve to the cylinder, s."""
        return self.tube_length_m / _WAVE_M_S


@dataclass(frozen=True, slots=True)
class FrictionSpec:
    """Friction of seals and guides, described by a Stribeck curve.

    Attributes:
        coulomb_n: Friction in motion, N.
        static_n: Breakaway friction, N.
        stribeck_m_s: Speed at which half of the difference between `static_n` and `coulomb_n` has decayed, m/s.
        viscous_n_s_m: Viscous coefficient, N s/m.
    """

    coulomb_n: float
    static_n: float
    stribeck_m_s: float
    viscous_n_s_m: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 2000.0, "coulomb_n", "static_n")
        require_within(self, 0.001, 1.0, "stribeck_m_s")
        require_within(self, 0.0, 10000.0, "viscous_n_s_m")
        require(self.coulomb_n <= self.static_n, "static_n", "must be at least coulomb_n")


@dataclass(frozen=True, slots=True)
class Pneumatics:
    """Specs common to all cylinders."""

    air: AirSpec
    valve: ValveSpec
    check_valve: CheckValveSpec


class Records(NamedTuple):
    """Records of an arm in the kernel memory.

    Attributes:
        state: State record, `ARM`.
        params: Parameter record, `ARM_PARAMS`.
        gas: Gas model, `GAS`.
    """

    state: Any
    params: Any
    gas: Any


def annular_wall(outer_m: float, inner_m: float, *, count: int = 1) -> tuple[float, float]:
    """Return the wall area of annular chambers as a `WALL` record: both end faces, and the walls per volume.

    Args:
        outer_m: Bore, m.
        inner_m: Diameter of the rod or plunger, m; 0 for none.
        count: Number of chambers that share the volume.
    """
    area_m2 = annulus_area_m2(outer_m, inner_m)
    return 2 * count * area_m2, math.pi * (outer_m + inner_m) / area_m2


@compiled_and_cached
def place_cylinder(c: Any, params: Any, position_m: float, mean_pa: float, gas: Any) -> None:
    """Set a cylinder to a position at rest as an initial condition; see `fill_cylinder`."""
    c.position_m = c.piston_m = position_m
    c.speed_m_s = c.piston_m_s = c.magnet_n = 0.0
    c.decoupled = 0
    c.braked, c.brake_s = 1, 0.0
    fill_cylinder(c, params, mean_pa, gas)


@compiled_and_cached
def fill_cylinder(c: Any, params: Any, mean_pa: float, gas: Any) -> None:
    """Set the pressure of both chambers without motion.

    The pressures balance the load, unless that requires less than the ambient pressure: a load without air rests on its
    end stop or moves to it.

    Args:
        c: The cylinder.
        params: Its parameters.
        mean_pa: Absolute pressure of the chamber that drives towards 0, Pa.
        gas: Gas model.
    """
    plus_m2, minus_m2 = params.plus_area_m2, params.minus_area_m2
    # force balance of the load: plus_pa plus_m2 - minus_pa minus_m2 = atmosphere (plus_m2 - minus_m2) - weight
    minus_pa = mean_pa
    plus_pa = (minus_pa * minus_m2 + ATMOSPHERE_PA * (plus_m2 - minus_m2) - params.weight_n) / plus_m2
    plus_pa = max(plus_pa, ATMOSPHERE_PA)
    ahead_m = params.stroke_m - c.piston_m
    plus_m3 = params.plus.dead_m3 + plus_m2 * c.piston_m
    minus_m3 = params.minus.dead_m3 + minus_m2 * ahead_m
    _fill_line(c.plus, params.plus, plus_m3, c.piston_m, params.cushion_m, plus_pa, gas)
    _fill_line(c.minus, params.minus, minus_m3, ahead_m, params.cushion_m, minus_pa, gas)


@compiled
def _fill_line(
    n: Any, params: Any, volume_m3: float, from_end_m: float, cushion_m: float, pressure_pa: float, gas: Any
) -> None:
    """Fill a chamber, and its cushion if the plunger closes it off at this distance from the end of the stroke."""
    set_ambient(n.cushion)
    n.cushion.volume_m3 = n.cushion.pressure_pa = 0.0
    if from_end_m < cushion_m:
        closed_m3 = params.cushion_m3 + params.cushion_m2 * from_end_m
        fill(n.cushion, closed_m3, pressure_pa, gas)
        volume_m3 -= closed_m3
    fill(n.chamber, volume_m3, pressure_pa, gas)


@compiled_and_cached
def vent_tubes(c: Any, params: Any, gas: Any) -> None:
    """Vent both tubes; the valve is in its middle position."""
    fill(c.plus.tube, params.plus.tube_m3, ATMOSPHERE_PA, gas)
    fill(c.minus.tube, params.minus.tube_m3, ATMOSPHERE_PA, gas)


class Cylinder(View):
    """View of a cylinder with its valve and switches.

    Attributes:
        state: Its state record, `CYLINDER`.
        params: Its parameter record, `CYLINDER_PARAMS`; faults change it.
    """

    __slots__ = ("_gas", "_hold_pa", "_switches")

    def __init__(
        self,
        state: Any,
        params: Any,
        gas: Any,
        port: PortSpec,
        friction: FrictionSpec,
        common: Pneumatics,
        *,
        hold_pa: float,
    ) -> None:
        """Initialise the parts common to all cylinders.

        Args:
            state: State record of the cylinder.
            params: Parameter record of the cylinder.
            gas: Gas model.
            port: Path from the valve to either chamber.
            friction: Friction of the cylinder.
            common: Valves, check valves and air.
            hold_pa: Absolute pressure of the chambers at rest, Pa.
        """
        super().__init__(state, params)
        self._gas = gas
        self._hold_pa = hold_pa
        self._switches: tuple[tuple[Any, Any], ...] = ()
        params["friction"] = astuple(friction)
        valve, check = common.valve, common.check_valve
        params["valve"]["on_delay_s"] = valve.on_delay_s
        params["valve"]["off_delay_s"] = valve.off_delay_s
        params["valve"]["tube_s"] = port.delay_s
        params["valve"]["spool_s"] = valve.spool_s
        params["valve"]["conductance_m3_s_pa"] = port.valve_conductance_m3_s_pa
        params["valve"]["critical_ratio"] = port.valve_critical_ratio
        for line in (params["plus"], params["minus"]):
            line["tube_m3_s_pa"] = port.tube_conductance_m3_s_pa
            line["tube_ratio"] = port.tube_ratio
            line["tube_m3"] = port.tube_m3
            line["tube_wall"]["m2"] = port.tube_wall_m2
            line["dead_m3"] = port.dead_volume_m3
            line["free_m3_s_pa"] = port.fitting_conductance_m3_s_pa
            line["critical_ratio"] = port.fitting_critical_ratio
            line["checked"] = 1
            line["crack_pa"] = check.crack_pa
            line["pilot_ratio"] = check.pilot_ratio
            line["pilot_least_pa"] = check.pilot_least_pa

    @property
    def position_m(self) -> float:
        """Distance from the end stop at 0, m."""
        return float(self.state["position_m"])

    @property
    def speed_m_s(self) -> float:
        """Speed, m/s, positive away from 0."""
        return float(self.state["speed_m_s"])

    @property
    def fastest_m_s(self) -> float:
        """Highest speed so far in either direction, m/s; may be set to 0 at any time."""
        return float(self.state["fastest_m_s"])

    @fastest_m_s.setter
    def fastest_m_s(self, speed_m_s: float) -> None:
        self.state["fastest_m_s"] = speed_m_s

    def place(self, position_m: float) -> None:
        """Set the position at rest as an initial condition, without motion.

        Args:
            position_m: Position, m; clipped to the stroke between the bumpers.
        """
        bumper_m = float(self.params["bumper_m"])
        position_m = min(max(position_m, bumper_m), float(self.params["stroke_m"]) - bumper_m)
        place_cylinder(self.state, self.params, position_m, self._hold_pa, self._gas)
        for state, params in self._switches:
            place_switch(state, params, position_m)

    def set_air(self, gauge_pa: float) -> None:
        """Set the pressure of both chambers at once, without motion; see `fill_cylinder`.

        Args:
            gauge_pa: Gauge pressure of the chamber that drives towards 0, Pa; 0 vents both chambers.
        """
        fill_cylinder(self.state, self.params, ATMOSPHERE_PA + gauge_pa, self._gas)

    def _fit_meter_in(self, conductance_m3_s_pa: float) -> None:
        """Replace the free flow inward by meter-in throttles, if there are any."""
        if conductance_m3_s_pa > 0.0:
            for line in (self.params["plus"], self.params["minus"]):
                line["free_m3_s_pa"] = conductance_m3_s_pa

    def _add_switches(
        self, states: Any, all_params: Any, places_m: tuple[float, ...], spec: Any, bounce_s: float
    ) -> list[Sensor]:
        """Initialise the position switches; return their views."""
        for params, at_m in zip(all_params, places_m, strict=True):
            params["at_m"], params["forced"], params["bounce_s"] = at_m, -1, bounce_s
            params["band_m"], params["hysteresis_m"] = spec.switch_band_m, spec.switch_hysteresis_m
        self._switches = tuple((states[number], all_params[number]) for number in range(len(places_m)))
        return [Sensor(state, params) for state, params in self._switches]
