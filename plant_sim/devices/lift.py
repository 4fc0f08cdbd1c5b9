"""The lift: a cylinder that lowers the arm by extending."""

from dataclasses import dataclass

from plant_sim.devices.cylinder import Cylinder, CylinderMotion
from plant_sim.devices.sensor import PositionSwitch
from plant_sim.devices.valve import ValveSpec
from plant_sim.pneumatics.meter_out import annulus_area_m2, meter_out_speed_m_s, piston_area_m2
from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class LiftSpec:
    """What is bolted to the machine: SC 50x150.

    Attributes:
        bore_m: Bore, m.
        rod_m: Diameter of the piston rod, m.
        stroke_m: Stroke, m.
        extend_conductance_m3_s_pa: Sonic conductance of the throttle at the rod side, m3/(s Pa).
        retract_conductance_m3_s_pa: The same at the full side, m3/(s Pa).
        dead_time_s: From the valve acting until the piston starts, s.
        build_up_s: Time constant of the speed building up, s.
        stop_s: Time constant of the stop once the check valves have closed, s.
        switch_band_m: Half width in which an end switch comes on, m.
        switch_hysteresis_m: How far beyond the band it goes off, m.
    """

    bore_m: float
    rod_m: float
    stroke_m: float
    extend_conductance_m3_s_pa: float
    retract_conductance_m3_s_pa: float
    dead_time_s: float
    build_up_s: float
    stop_s: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.006, 0.2, "bore_m")
        require_within(self, 1e-11, 1e-7, "extend_conductance_m3_s_pa", "retract_conductance_m3_s_pa")
        require_within(self, 0.0, 0.02, "switch_band_m")
        require_within(self, 0.0, 0.005, "switch_hysteresis_m")
        require(0.0 < self.rod_m < self.bore_m, "rod_m", "must be thinner than the bore")
        reach_m = self.switch_band_m + self.switch_hysteresis_m
        require(2 * reach_m < self.stroke_m, "switch_band_m", "lets both end switches be on at once")
        for key, speed_m_s in (
            ("extend_conductance_m3_s_pa", self.extend_m_s),
            ("retract_conductance_m3_s_pa", self.retract_m_s),
        ):
            possible = 0.01 <= speed_m_s <= 1.0
            require(possible, key, f"gives {speed_m_s:.3g} m/s; it must give 0.01 to 1 m/s")
        self.motion()

    @property
    def extend_m_s(self) -> float:
        """Steady speed of the arm going down, m/s; the rod side is emptied."""
        area_m2 = annulus_area_m2(self.bore_m, self.rod_m)
        return meter_out_speed_m_s(self.extend_conductance_m3_s_pa, area_m2)

    @property
    def retract_m_s(self) -> float:
        """Steady speed of the arm going up, m/s; the full side is emptied."""
        return meter_out_speed_m_s(self.retract_conductance_m3_s_pa, piston_area_m2(self.bore_m))

    def motion(self) -> CylinderMotion:
        """How it moves."""
        return CylinderMotion(
            stroke_m=self.stroke_m,
            plus_m_s=self.extend_m_s,
            minus_m_s=self.retract_m_s,
            dead_time_s=self.dead_time_s,
            build_up_s=self.build_up_s,
            stop_s=self.stop_s,
        )


class Lift(Cylinder):
    """Coils: extend (arm down), retract (arm up). Switches: down, up.

    Attributes:
        down: Switch at full extension.
        up: Switch at 0.
    """

    __slots__ = ("_stroke_m", "down", "up")

    def __init__(self, spec: LiftSpec, valve: ValveSpec, *, y_m: float) -> None:
        """Start at rest.

        Args:
            spec: What it is.
            valve: How its valve switches.
            y_m: How far it is extended, m.
        """
        self.up, self.down = (
            PositionSwitch(
                at_m,
                band_m=spec.switch_band_m,
                hysteresis_m=spec.switch_hysteresis_m,
                position_m=y_m,
            )
            for at_m in (0.0, spec.stroke_m)
        )
        self._stroke_m = spec.stroke_m
        super().__init__(spec.motion(), valve, (self.up, self.down), position_m=y_m)

    @property
    def y_m(self) -> float:
        """Extension, m: 0 is arm up, the stroke is arm down."""
        return self.position_m

    @property
    def rise_m(self) -> float:
        """How high the arm is above its lower limit, m."""
        return self._stroke_m - self.position_m

    def step(self, dt_s: float, *, extend: bool, retract: bool) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
            extend: Coil that lowers the arm.
            retract: Coil that raises it.
        """
        self._advance(dt_s, extend, retract)
