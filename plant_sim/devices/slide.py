"""The slide: a rodless cylinder that carries an arm between the cups and the tray."""

from dataclasses import dataclass

from plant_sim.devices.cylinder import Cylinder, CylinderMotion
from plant_sim.devices.sensor import PositionSwitch
from plant_sim.devices.valve import ValveSpec
from plant_sim.pneumatics.meter_out import meter_out_speed_m_s, piston_area_m2
from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class SlideSpec:
    """What is bolted to the machine: CY1S, magnetically coupled, same area on both sides.

    Attributes:
        bore_m: Bore, m.
        stroke_m: Stroke, m.
        conductance_m3_s_pa: Sonic conductance of the meter-out throttles, m3/(s Pa).
        dead_time_s: From the valve acting until the carriage starts, s.
        build_up_s: Time constant of the speed building up, s.
        stop_s: Time constant of the stop once the check valves have closed, s.
        switch_band_m: Half width in which a position switch comes on, m.
        switch_hysteresis_m: How far beyond the band it goes off, m.
    """

    bore_m: float
    stroke_m: float
    conductance_m3_s_pa: float
    dead_time_s: float
    build_up_s: float
    stop_s: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.006, 0.2, "bore_m")
        require_within(self, 1e-11, 1e-7, "conductance_m3_s_pa")
        require_within(self, 0.0005, 0.015, "switch_band_m")
        require_within(self, 0.0, 0.005, "switch_hysteresis_m")
        require(
            0.01 <= self.speed_m_s <= 1.0,
            "conductance_m3_s_pa",
            f"gives {self.speed_m_s:.3g} m/s; it must give 0.01 to 1 m/s",
        )
        self.motion()

    @property
    def speed_m_s(self) -> float:
        """Steady speed either way, m/s."""
        return meter_out_speed_m_s(self.conductance_m3_s_pa, piston_area_m2(self.bore_m))

    def motion(self) -> CylinderMotion:
        """How it moves."""
        return CylinderMotion(
            stroke_m=self.stroke_m,
            plus_m_s=self.speed_m_s,
            minus_m_s=self.speed_m_s,
            dead_time_s=self.dead_time_s,
            build_up_s=self.build_up_s,
            stop_s=self.stop_s,
        )


class Slide(Cylinder):
    """Coils: inward, outward. Switches: one at feed (the outer end stop), one a pick position.

    Attributes:
        at_feed: Switch at 0.
        at_pick: Switches at the pick positions, nearest to the feed first.
    """

    __slots__ = ("at_feed", "at_pick")

    def __init__(self, spec: SlideSpec, valve: ValveSpec, picks_m: tuple[float, ...], *, x_m: float) -> None:
        """Start at rest.

        Args:
            spec: What it is.
            valve: How its valve switches.
            picks_m: Pick positions from the feed inward, m.
            x_m: Where it stands, m.
        """
        self.at_feed, *at_pick = (
            PositionSwitch(
                at_m,
                band_m=spec.switch_band_m,
                hysteresis_m=spec.switch_hysteresis_m,
                position_m=x_m,
            )
            for at_m in (0.0, *picks_m)
        )
        self.at_pick = tuple(at_pick)
        super().__init__(spec.motion(), valve, (self.at_feed, *self.at_pick), position_m=x_m)

    @property
    def x_m(self) -> float:
        """Position from the feed inward, m."""
        return self.position_m

    def step(self, dt_s: float, *, inward: bool, outward: bool) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
            inward: Coil towards the tray.
            outward: Coil towards the cups.
        """
        self._advance(dt_s, inward, outward)
