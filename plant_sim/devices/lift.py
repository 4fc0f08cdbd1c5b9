"""The lift: a cushioned cylinder that lowers the arm by extending, and carries its weight."""

from dataclasses import dataclass

from plant_sim.devices.pneumatic import Cylinder, FrictionSpec, Pneumatics, PortSpec, Records, vent_tubes
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.meter_out import annulus_area_m2, meter_out_speed_m_s, piston_area_m2
from plant_sim.spec import require, require_within

_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class LiftSpec:
    """What is bolted to the machine: SC 50x150.

    Attributes:
        bore_m: Bore, m.
        rod_m: Diameter of the piston rod, m.
        stroke_m: Stroke, m.
        carried_kg: What hangs on the rod, with rod and piston, kg.
        extend_conductance_m3_s_pa: Sonic conductance of the throttle at the rod side, m3/(s Pa).
        retract_conductance_m3_s_pa: The same at the full side, m3/(s Pa).
        cushion_m: Length of the cushions, m.
        cushion_share: What a cushion leaves of the throttle.
        switch_band_m: Half width in which an end switch comes on, m.
        switch_hysteresis_m: How far beyond the band it goes off, m.
    """

    bore_m: float
    rod_m: float
    stroke_m: float
    carried_kg: float
    extend_conductance_m3_s_pa: float
    retract_conductance_m3_s_pa: float
    cushion_m: float
    cushion_share: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.006, 0.2, "bore_m")
        require_within(self, 0.01, 1.0, "stroke_m")
        require_within(self, 0.1, 500.0, "carried_kg")
        require_within(self, 1e-11, 1e-7, "extend_conductance_m3_s_pa", "retract_conductance_m3_s_pa")
        require_within(self, 0.0, 0.05, "cushion_m")
        require_within(self, 0.02, 1.0, "cushion_share")
        require_within(self, 0.0, 0.02, "switch_band_m")
        require_within(self, 0.0, 0.005, "switch_hysteresis_m")
        require(0.0 < self.rod_m < self.bore_m, "rod_m", "must be thinner than the bore")
        reach_m = self.switch_band_m + self.switch_hysteresis_m
        require(2 * reach_m < self.stroke_m, "switch_band_m", "lets both end switches be on at once")
        require(2 * self.cushion_m < self.stroke_m, "cushion_m", "lets both cushions act at once")
        for key, speed_m_s in (
            ("extend_conductance_m3_s_pa", self.extend_m_s),
            ("retract_conductance_m3_s_pa", self.retract_m_s),
        ):
            possible = 0.01 <= speed_m_s <= 1.0
            require(possible, key, f"gives {speed_m_s:.3g} m/s; it must give 0.01 to 1 m/s")

    @property
    def area_m2(self) -> float:
        """Area of the full piston, m2."""
        return piston_area_m2(self.bore_m)

    @property
    def extend_m_s(self) -> float:
        """Steady speed of the arm going down, m/s; the rod side is emptied."""
        area_m2 = annulus_area_m2(self.bore_m, self.rod_m)
        return meter_out_speed_m_s(self.extend_conductance_m3_s_pa, area_m2)

    @property
    def retract_m_s(self) -> float:
        """Steady speed of the arm going up, m/s; the full side is emptied."""
        return meter_out_speed_m_s(self.retract_conductance_m3_s_pa, piston_area_m2(self.bore_m))


class Lift(Cylinder):
    """A view of a lift. Coils: extend (arm down), retract (arm up). Switches: down, up.

    Attributes:
        down: Switch at full extension.
        up: Switch at 0.
    """

    __slots__ = ("_stroke_m", "down", "up")

    def __init__(
        self,
        spec: LiftSpec,
        port: PortSpec,
        friction: FrictionSpec,
        common: Pneumatics,
        arm: Records,
        *,
        pressure_pa: float,
        bounce_s: float,
    ) -> None:
        """Build it, arm down, at rest.

        Args:
            spec: What it is.
            port: The way to either chamber.
            friction: Its friction.
            common: Valves, check valves and air.
            arm: Where the arm lies in the memory of the kernel.
            pressure_pa: Gauge pressure of the main line, Pa.
            bounce_s: For how long a closing contact bounces, s.
        """
        make = arm.make["lift"]
        super().__init__(
            arm.state["lift"], make, arm.gas, port, friction, common, hold_pa=ATMOSPHERE_PA + 0.9 * pressure_pa
        )
        self._stroke_m = spec.stroke_m
        make["stroke_m"] = spec.stroke_m
        make["plus_area_m2"] = piston_area_m2(spec.bore_m)
        make["minus_area_m2"] = annulus_area_m2(spec.bore_m, spec.rod_m)
        make["load_kg"] = spec.carried_kg
        make["weight_n"] = spec.carried_kg * _GRAVITY_M_S2
        make["cushion_m"], make["cushion_share"] = spec.cushion_m, spec.cushion_share
        make["minus"]["throttle_m3_s_pa"] = spec.extend_conductance_m3_s_pa
        make["plus"]["throttle_m3_s_pa"] = spec.retract_conductance_m3_s_pa
        self.up, self.down = self._mount(
            arm.state["lift_switches"], arm.make["lift_switches"], (0.0, spec.stroke_m), spec, bounce_s
        )
        vent_tubes(self.state, make, arm.gas)
        self.place(spec.stroke_m)

    @property
    def y_m(self) -> float:
        """Extension, m: 0 is arm up, the stroke is arm down."""
        return self.position_m

    @property
    def rise_m(self) -> float:
        """How high the arm is above its lower limit, m."""
        return self._stroke_m - self.position_m
