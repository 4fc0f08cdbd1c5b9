"""The slide: a rodless cylinder, magnetically coupled, that carries an arm between the cups and the tray."""

from dataclasses import dataclass

from plant_sim.devices.pneumatic import Cylinder, FrictionSpec, Pneumatics, PortSpec, Records, vent_tubes
from plant_sim.pneumatics.flow import ATMOSPHERE_PA
from plant_sim.pneumatics.meter_out import meter_out_speed_m_s, piston_area_m2
from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class SlideSpec:
    """What is bolted to the machine: CY1S, magnetically coupled, same area on both sides.

    Attributes:
        bore_m: Bore, m.
        stroke_m: Stroke, m.
        carried_kg: Carriage and arm, kg.
        piston_kg: Piston, kg.
        throttle_conductance_m3_s_pa: Sonic conductance of the meter-out throttles, m3/(s Pa).
        magnet_holds_n: Force above which the magnets let go, N.
        magnet_n_m: Stiffness of the magnetic coupling, N/m.
        magnet_n_s_m: Its damping, N s/m.
        recouples_m_s: They catch each other again below this difference of speed, m/s.
        bumper_m: Thickness of the rubber bumpers, m.
        bumper_n_m: Their stiffness, N/m.
        bumper_n_s_m: Their damping, N s/m.
        overtravel_m: How far the piston can run beyond the carriage's stroke, m.
        brake_n: Force of the brake on the guide, applied by a spring and lifted by the pressure of
            either line; 0 for none, N.
        brake_bites_pa: It bites when both lines are below this gauge pressure, Pa.
        switch_band_m: Half width in which a position switch comes on, m.
        switch_hysteresis_m: How far beyond the band it goes off, m.
    """

    bore_m: float
    stroke_m: float
    carried_kg: float
    piston_kg: float
    throttle_conductance_m3_s_pa: float
    magnet_holds_n: float
    magnet_n_m: float
    magnet_n_s_m: float
    recouples_m_s: float
    bumper_m: float
    bumper_n_m: float
    bumper_n_s_m: float
    overtravel_m: float
    brake_n: float
    brake_bites_pa: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.006, 0.2, "bore_m")
        require_within(self, 0.05, 2.0, "stroke_m")
        require_within(self, 0.1, 500.0, "carried_kg")
        require_within(self, 0.01, 50.0, "piston_kg")
        require_within(self, 1e-11, 1e-7, "throttle_conductance_m3_s_pa")
        require_within(self, 1.0, 1e5, "magnet_holds_n")
        require_within(self, 1e3, 1e7, "magnet_n_m")
        require_within(self, 0.0, 1e5, "magnet_n_s_m")
        require_within(self, 0.001, 1.0, "recouples_m_s")
        require_within(self, 0.0, 0.02, "bumper_m", "overtravel_m")
        require_within(self, 0.0, 5000.0, "brake_n")
        require_within(self, 0.0, 0.5e6, "brake_bites_pa")
        require_within(self, 0.0, 1e8, "bumper_n_m")
        require_within(self, 0.0, 1e5, "bumper_n_s_m")
        require_within(self, 0.0005, 0.015, "switch_band_m")
        require_within(self, 0.0, 0.005, "switch_hysteresis_m")
        require(
            0.01 <= self.speed_m_s <= 1.0,
            "throttle_conductance_m3_s_pa",
            f"gives {self.speed_m_s:.3g} m/s; it must give 0.01 to 1 m/s",
        )

    @property
    def area_m2(self) -> float:
        """Piston area, m2."""
        return piston_area_m2(self.bore_m)

    @property
    def speed_m_s(self) -> float:
        """Steady speed either way, m/s, while the exhaust is choked."""
        return meter_out_speed_m_s(self.throttle_conductance_m3_s_pa, self.area_m2)

    @property
    def decouples_pa(self) -> float:
        """Gauge pressure at which a blocked carriage loses its piston, Pa."""
        return self.magnet_holds_n / self.area_m2


class Slide(Cylinder):
    """A view of a slide. Coils: inward, outward. Switches: one at feed (the outer end), one a pick position.

    Attributes:
        at_feed: Switch at 0.
        at_pick: Switches at the pick positions, nearest to the feed first.
    """

    __slots__ = ("at_feed", "at_pick")

    def __init__(
        self,
        spec: SlideSpec,
        port: PortSpec,
        friction: FrictionSpec,
        common: Pneumatics,
        arm: Records,
        *,
        picks_m: tuple[float, ...],
        pressure_pa: float,
        bounce_s: float,
    ) -> None:
        """Build it, at feed, at rest.

        Args:
            spec: What it is.
            port: The way to either chamber.
            friction: Its friction.
            common: Valves, check valves and air.
            arm: Where the arm lies in the memory of the kernel.
            picks_m: Pick positions from the feed inward, m.
            pressure_pa: Gauge pressure of the main line, Pa.
            bounce_s: For how long a closing contact bounces, s.
        """
        make = arm.make["slide"]
        super().__init__(
            arm.state["slide"], make, arm.gas, port, friction, common, hold_pa=ATMOSPHERE_PA + 0.9 * pressure_pa
        )
        make["stroke_m"] = spec.stroke_m
        make["plus_area_m2"] = make["minus_area_m2"] = spec.area_m2
        make["load_kg"], make["piston_kg"] = spec.carried_kg, spec.piston_kg
        make["cushion_share"] = 1.0
        for name in ("magnet_holds_n", "magnet_n_m", "magnet_n_s_m", "recouples_m_s"):
            make[name] = getattr(spec, name)
        for name in ("bumper_m", "bumper_n_m", "bumper_n_s_m", "overtravel_m", "brake_n", "brake_bites_pa"):
            make[name] = getattr(spec, name)
        for line in (make["plus"], make["minus"]):
            line["throttle_m3_s_pa"] = spec.throttle_conductance_m3_s_pa
        places_m = (0.0, *picks_m)
        self.at_feed, *at_pick = self._mount(
            arm.state["slide_switches"], arm.make["slide_switches"], places_m, spec, bounce_s
        )
        self.at_pick = tuple(at_pick)
        vent_tubes(self.state, make, arm.gas)
        self.place(0.0)

    @property
    def x_m(self) -> float:
        """Position from the feed inward, m."""
        return self.position_m

    @property
    def decoupled(self) -> bool:
        """Whether the carriage has lost its piston."""
        return bool(self.state["decoupled"])
