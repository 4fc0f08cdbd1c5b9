"""Lift: a cushioned cylinder that lowers the arm by extending, and carries its weight."""

from dataclasses import dataclass

from plant_sim.common.limits import require, require_within
from plant_sim.devices.pneumatic import (
    Cylinder,
    FrictionSpec,
    Pneumatics,
    PortSpec,
    Records,
    annular_wall,
    vent_tubes,
)
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.meter_out import annulus_area_m2, meter_out_speed_m_s, piston_area_m2

_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True, slots=True)
class LiftSpec:
    """Parameters of a lift, a cylinder SC 50x150.

    Attributes:
        bore_m: Bore, m.
        rod_m: Diameter of the piston rod, m.
        stroke_m: Stroke, m.
        carried_kg: Mass on the rod, including rod and piston, kg.
        extend_conductance_m3_s_pa: Sonic conductance of the throttle at the rod side, m3/(s Pa).
        retract_conductance_m3_s_pa: Sonic conductance of the throttle at the cap side, m3/(s Pa).
        meter_in_conductance_m3_s_pa: Sonic conductance of the meter-in throttles, including check valve and port,
            m3/(s Pa); 0 if there are none.
        damper_n_s_m: Damping of a hydraulic speed regulator parallel to the cylinder, N s/m; 0 if there is none.
        cushion_m: Length of the cushions, m.
        cushion_plunger_m: Diameter of the cushion plungers, m.
        cushion_volume_m3: Volume that a plunger closes off at the end of the stroke, m3.
        needle_conductance_m3_s_pa: Sonic conductance of the cushion needles, m3/(s Pa).
        stop_n_m: Stiffness of the end stops, with rod and arm, N/m.
        stop_n_s_m: Damping of the end stops, N s/m.
        switch_band_m: Half width of the range in which an end switch turns on, m.
        switch_hysteresis_m: Distance beyond the band at which it turns off, m.
    """

    bore_m: float
    rod_m: float
    stroke_m: float
    carried_kg: float
    extend_conductance_m3_s_pa: float
    retract_conductance_m3_s_pa: float
    meter_in_conductance_m3_s_pa: float
    damper_n_s_m: float
    cushion_m: float
    cushion_plunger_m: float
    cushion_volume_m3: float
    needle_conductance_m3_s_pa: float
    stop_n_m: float
    stop_n_s_m: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.006, 0.2, "bore_m")
        require_within(self, 0.01, 1.0, "stroke_m")
        require_within(self, 0.1, 500.0, "carried_kg")
        require_within(self, 1e-11, 1e-7, "extend_conductance_m3_s_pa", "retract_conductance_m3_s_pa")
        require_within(self, 0.0, 1e-7, "meter_in_conductance_m3_s_pa")
        require_within(self, 0.0, 5000.0, "damper_n_s_m")
        require_within(self, 0.0, 0.05, "cushion_m")
        require_within(self, 1e-7, 1e-3, "cushion_volume_m3")
        require_within(self, 1e-12, 1e-7, "needle_conductance_m3_s_pa")
        require_within(self, 1e5, 1e8, "stop_n_m")
        require_within(self, 0.0, 1e6, "stop_n_s_m")
        require_within(self, 0.0, 0.02, "switch_band_m")
        require_within(self, 0.0, 0.005, "switch_hysteresis_m")
        require(0.0 < self.rod_m < self.bore_m, "rod_m", "must be thinner than the bore")
        require(
            self.rod_m < self.cushion_plunger_m < self.bore_m,
            "cushion_plunger_m",
            "must be thicker than the rod and thinner than the bore",
        )
        reach_m = self.switch_band_m + self.switch_hysteresis_m
        require(2 * reach_m < self.stroke_m, "switch_band_m", "lets both end switches be on at the same time")
        require(2 * self.cushion_m < self.stroke_m, "cushion_m", "lets both cushions act at the same time")
        for key, speed_m_s in (
            ("extend_conductance_m3_s_pa", self.extend_m_s),
            ("retract_conductance_m3_s_pa", self.retract_m_s),
        ):
            possible = 0.01 <= speed_m_s <= 1.0
            require(possible, key, f"gives {speed_m_s:.3g} m/s; it must give 0.01 to 1 m/s")

    @property
    def area_m2(self) -> float:
        """Piston area on the cap side, m2."""
        return piston_area_m2(self.bore_m)

    @property
    def cushion_area_m2(self) -> float:
        """Piston area around a cushion plunger, m2."""
        return annulus_area_m2(self.bore_m, self.cushion_plunger_m)

    @property
    def lifting_area_m2(self) -> float:
        """Piston area on the rod side, m2."""
        return annulus_area_m2(self.bore_m, self.rod_m)

    @property
    def weight_n(self) -> float:
        """Weight of the carried mass, N."""
        return self.carried_kg * _GRAVITY_M_S2

    @property
    def extend_m_s(self) -> float:
        """Steady downward speed of the arm, m/s; the rod side exhausts."""
        return meter_out_speed_m_s(self.extend_conductance_m3_s_pa, self.lifting_area_m2)

    @property
    def retract_m_s(self) -> float:
        """Steady upward speed of the arm, m/s; the cap side exhausts."""
        return meter_out_speed_m_s(self.retract_conductance_m3_s_pa, piston_area_m2(self.bore_m))


class Lift(Cylinder):
    """View of a lift. Coils: extend (arm down), retract (arm up). Switches: down, up.

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
        held_pa: float,
        bounce_s: float,
    ) -> None:
        """Initialise the lift at rest with the arm down.

        Args:
            spec: Parameters of the lift.
            port: Path from the valve to either chamber.
            friction: Friction of the lift.
            common: Valves, check valves and air.
            arm: Records of the arm in the kernel memory.
            held_pa: Gauge pressure of the chambers at rest, Pa.
            bounce_s: Bounce time of a closing contact, s.
        """
        params = arm.params["lift"]
        super().__init__(arm.state["lift"], params, arm.gas, port, friction, common, hold_pa=ATMOSPHERE_PA + held_pa)
        self._stroke_m = spec.stroke_m
        params["stroke_m"] = spec.stroke_m
        params["plus_area_m2"] = piston_area_m2(spec.bore_m)
        params["minus_area_m2"] = spec.lifting_area_m2
        params["load_kg"], params["weight_n"] = spec.carried_kg, spec.weight_n
        params["bumper_n_m"], params["bumper_n_s_m"] = spec.stop_n_m, spec.stop_n_s_m
        self._fit_meter_in(spec.meter_in_conductance_m3_s_pa)
        params["friction"]["viscous_n_s_m"] += spec.damper_n_s_m
        params["cushion_m"] = spec.cushion_m
        least_m3 = min(spec.cushion_volume_m3, port.dead_volume_m3 - spec.cushion_volume_m3)
        params["overtravel_m"] = 0.5 * least_m3 / spec.area_m2
        for line, inner_m in ((params["plus"], 0.0), (params["minus"], spec.rod_m)):
            line["chamber_wall"] = annular_wall(spec.bore_m, inner_m)
            line["cushion_wall"] = annular_wall(spec.bore_m, spec.cushion_plunger_m)
            line["cushion_m3"], line["cushion_m2"] = spec.cushion_volume_m3, spec.cushion_area_m2
            line["needle_m3_s_pa"] = spec.needle_conductance_m3_s_pa
        params["minus"]["throttle_m3_s_pa"] = spec.extend_conductance_m3_s_pa
        params["plus"]["throttle_m3_s_pa"] = spec.retract_conductance_m3_s_pa
        self.up, self.down = self._add_switches(
            arm.state["lift_switches"], arm.params["lift_switches"], (0.0, spec.stroke_m), spec, bounce_s
        )
        vent_tubes(self.state, params, arm.gas)
        self.place(spec.stroke_m)

    @property
    def y_m(self) -> float:
        """Extension, m: 0 is arm up, the stroke is arm down."""
        return self.position_m

    @property
    def rise_m(self) -> float:
        """Height of the arm above its lower limit, m."""
        return self._stroke_m - self.position_m
