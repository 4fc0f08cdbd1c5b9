"""What slide, lift and claws are made of: valves, ports, friction, and the views of a cylinder."""

import math
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

from plant_sim.devices.sensor import Sensor, place_switch
from plant_sim.devices.view import View
from plant_sim.pneumatics.chamber import fill
from plant_sim.pneumatics.compiled import compiled_and_kept
from plant_sim.pneumatics.flow import ATMOSPHERE_PA, tube_conductance_m3_s_pa
from plant_sim.spec import require, require_within

_WAVE_M_S = 343.0  # speed of sound: how fast a tube passes on a change of pressure; PLANT.md 1.3


@dataclass(frozen=True, slots=True)
class AirSpec:
    """How air behaves in every chamber.

    Attributes:
        polytropic_exponent: 1 (slow, isothermal) to 1.4 (fast, adiabatic).
        wall_time_s: Time in which the air takes the temperature of the walls, s.
        thermal: Whether its temperature follows the energy balance instead.
        wall_w_m2_k: Heat transfer to the walls in that case, W/(m2 K).
    """

    polytropic_exponent: float
    wall_time_s: float
    thermal: bool
    wall_w_m2_k: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 1.0, 1.4, "polytropic_exponent")
        require_within(self, 0.01, 100.0, "wall_time_s")
        require_within(self, 0.0, 1000.0, "wall_w_m2_k")

    @property
    def stiffness_exponent(self) -> float:
        """Exponent with which the pressure follows within a step."""
        return 1.4 if self.thermal else self.polytropic_exponent


@dataclass(frozen=True, slots=True)
class ValveSpec:
    """Switching of a solenoid valve.

    Attributes:
        on_delay_s: From coil on until the spool moves, s.
        off_delay_s: From coil off until the spool moves, s.
        spool_s: Time of the spool from the middle to an end, s.
    """

    on_delay_s: float
    off_delay_s: float
    spool_s: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 0.5, "on_delay_s", "off_delay_s")
        require_within(self, 0.0005, 0.1, "spool_s")


@dataclass(frozen=True, slots=True)
class CheckValveSpec:
    """Pilot check valve in each port of a cylinder.

    Attributes:
        crack_pa: It opens inward at this difference, Pa.
        pilot_ratio: It opens outward when the pilot has this part of the gauge pressure behind it.
        pilot_least_pa: The pilot needs at least this gauge pressure, Pa.
    """

    crack_pa: float
    pilot_ratio: float
    pilot_least_pa: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 1e5, "crack_pa")
        require_within(self, 0.05, 1.0, "pilot_ratio")
        require_within(self, 0.0, 0.5e6, "pilot_least_pa")


@dataclass(frozen=True, slots=True)
class PortSpec:
    """The way from a valve to the cylinder, the same at either port.

    Attributes:
        valve_conductance_m3_s_pa: Valve, m3/(s Pa).
        valve_critical_ratio: Critical pressure ratio of the valve.
        tube_inner_m: Inner diameter of the tube, m.
        tube_length_m: Its length, m.
        tubes: How many tubes lie side by side.
        fitting_conductance_m3_s_pa: Speed controller (free flow), check valve and port, m3/(s Pa).
        fitting_critical_ratio: Critical pressure ratio of these, and of the throttle.
        dead_volume_m3: Volume of the cylinder's chamber at the end of the stroke, m3.
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
        """Refuse impossible values."""
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
    def delay_s(self) -> float:
        """How much later the cylinder feels the valve, s."""
        return self.tube_length_m / _WAVE_M_S


@dataclass(frozen=True, slots=True)
class FrictionSpec:
    """Friction of seals and guides (Stribeck).

    Attributes:
        coulomb_n: While it moves, N.
        static_n: Before it moves, N.
        stribeck_m_s: Speed at which it has fallen half way from the one to the other, m/s.
        viscous_n_s_m: What it grows with the speed, N s/m.
    """

    coulomb_n: float
    static_n: float
    stribeck_m_s: float
    viscous_n_s_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 2000.0, "coulomb_n", "static_n")
        require_within(self, 0.001, 1.0, "stribeck_m_s")
        require_within(self, 0.0, 10000.0, "viscous_n_s_m")
        require(self.coulomb_n <= self.static_n, "static_n", "must be at least coulomb_n")


@dataclass(frozen=True, slots=True)
class Pneumatics:
    """What is common to every cylinder."""

    air: AirSpec
    valve: ValveSpec
    check_valve: CheckValveSpec


class Records(NamedTuple):
    """Where an arm lies in the memory of the kernel.

    Attributes:
        state: Its record, `ARM`.
        make: Its record, `ARM_MAKE`.
        gas: How air behaves, `GAS`.
    """

    state: Any
    make: Any
    gas: Any


@compiled_and_kept
def put(c: Any, make: Any, position_m: float, mean_pa: float, gas: Any) -> None:
    """Put a cylinder somewhere, at rest, its chambers holding the load: a starting situation."""
    c.position_m = c.piston_m = position_m
    c.speed_m_s = c.piston_m_s = c.magnet_n = 0.0
    c.decoupled = 0
    plus_m2, minus_m2 = make.plus_area_m2, make.minus_area_m2
    # the load is held where plus_pa plus_m2 - minus_pa minus_m2 = atmosphere (plus_m2 - minus_m2) - weight
    minus_pa = mean_pa
    plus_pa = (minus_pa * minus_m2 + ATMOSPHERE_PA * (plus_m2 - minus_m2) - make.weight_n) / plus_m2
    fill(c.plus.chamber, make.plus.dead_m3 + plus_m2 * position_m, plus_pa, gas)
    fill(c.minus.chamber, make.minus.dead_m3 + minus_m2 * (make.stroke_m - position_m), minus_pa, gas)


@compiled_and_kept
def vent_tubes(c: Any, make: Any, gas: Any) -> None:
    """Empty both tubes: the valve stands in the middle."""
    fill(c.plus.tube, make.plus.tube_m3, ATMOSPHERE_PA, gas)
    fill(c.minus.tube, make.minus.tube_m3, ATMOSPHERE_PA, gas)


class Cylinder(View):
    """A view of a cylinder with its valve and switches.

    Attributes:
        state: Its record, `CYLINDER`.
        make: Its record, `CYLINDER_MAKE`; what can break is changed here.
    """

    __slots__ = ("_gas", "_hold_pa", "_switches")

    def __init__(
        self,
        state: Any,
        make: Any,
        gas: Any,
        port: PortSpec,
        friction: FrictionSpec,
        common: Pneumatics,
        *,
        hold_pa: float,
    ) -> None:
        """Build the parts that every cylinder has.

        Args:
            state: Its record.
            make: Its record.
            gas: How air behaves.
            port: The way to either chamber.
            friction: Its friction.
            common: Valves, check valves and air.
            hold_pa: Absolute pressure that its chambers keep at rest, Pa.
        """
        super().__init__(state, make)
        self._gas = gas
        self._hold_pa = hold_pa
        self._switches: tuple[tuple[Any, Any], ...] = ()
        make["friction"] = astuple(friction)
        valve, check = common.valve, common.check_valve
        make["valve"]["on_delay_s"] = valve.on_delay_s + port.delay_s
        make["valve"]["off_delay_s"] = valve.off_delay_s + port.delay_s
        make["valve"]["spool_s"] = valve.spool_s
        make["valve"]["conductance_m3_s_pa"] = port.valve_conductance_m3_s_pa
        make["valve"]["critical_ratio"] = port.valve_critical_ratio
        for line in (make["plus"], make["minus"]):
            line["tube_m3_s_pa"] = port.tube_conductance_m3_s_pa
            line["tube_m3"] = port.tube_m3
            line["dead_m3"] = port.dead_volume_m3
            line["free_m3_s_pa"] = port.fitting_conductance_m3_s_pa
            line["critical_ratio"] = port.fitting_critical_ratio
            line["checked"] = 1
            line["crack_pa"] = check.crack_pa
            line["pilot_ratio"] = check.pilot_ratio
            line["pilot_least_pa"] = check.pilot_least_pa

    @property
    def position_m(self) -> float:
        """From the end stop at 0, m."""
        return float(self.state["position_m"])

    @property
    def speed_m_s(self) -> float:
        """Positive away from 0, m/s."""
        return float(self.state["speed_m_s"])

    def place(self, position_m: float) -> None:
        """Put it somewhere, at rest: a starting situation, not a motion.

        Args:
            position_m: Where, m; clipped to the stroke that the bumpers leave.
        """
        bumper_m = float(self.make["bumper_m"])
        position_m = min(max(position_m, bumper_m), float(self.make["stroke_m"]) - bumper_m)
        put(self.state, self.make, position_m, self._hold_pa, self._gas)
        for state, make in self._switches:
            place_switch(state, make, position_m)

    def _mount(self, states: Any, makes: Any, places_m: tuple[float, ...], spec: Any, bounce_s: float) -> list[Sensor]:
        """Mount position switches; return their views."""
        for make, at_m in zip(makes, places_m, strict=True):
            make["at_m"], make["forced"], make["bounce_s"] = at_m, -1, bounce_s
            make["band_m"], make["hysteresis_m"] = spec.switch_band_m, spec.switch_hysteresis_m
        self._switches = tuple((states[number], makes[number]) for number in range(len(places_m)))
        return [Sensor(state, make) for state, make in self._switches]
