"""Slide: a magnetically coupled rodless cylinder that carries an arm between the cups and the tray."""

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
from plant_sim.pneumatics.meter_out import meter_out_speed_m_s, piston_area_m2


@dataclass(frozen=True, slots=True)
class SlideSpec:
    """Parameters of a slide, a magnetically coupled cylinder CY1S with equal areas on both sides.

    Attributes:
        bore_m: Bore, m.
        stroke_m: Stroke, m.
        carried_kg: Mass of carriage and arm, kg.
        piston_kg: Mass of the piston, kg.
        throttle_conductance_m3_s_pa: Sonic conductance of the meter-out throttles, m3/(s Pa).
        meter_in_conductance_m3_s_pa: Sonic conductance of the meter-in throttles, including check valve and port,
            m3/(s Pa); 0 if there are none.
        magnet_holds_n: Force above which the magnets decouple, N.
        magnet_n_m: Stiffness of the magnetic coupling, N/m.
        magnet_n_s_m: Damping of the coupling, N s/m.
        recouples_m_s: Speed difference below which the magnets recouple, m/s.
        bumper_m: Thickness of the rubber bumpers, m.
        bumper_n_m: Stiffness of the bumpers, N/m.
        bumper_n_s_m: Damping of the bumpers, N s/m.
        overtravel_m: Travel of the piston beyond the stroke of the carriage, m.
        brake_n: Force of the spring-applied brake on the guide, N; 0 means no brake. Its valve is wired to both coils
            of the slide and releases the brake with air from the main line.
        brake_bites_pa: Gauge pressure of the main line below which the brake engages, Pa.
        brake_delay_s: Time from the switching of its valve until the brake engages, s.
        switch_band_m: Half width of the range in which a position switch turns on, m.
        switch_hysteresis_m: Distance beyond the band at which it turns off, m.
    """

    bore_m: float
    stroke_m: float
    carried_kg: float
    piston_kg: float
    throttle_conductance_m3_s_pa: float
    meter_in_conductance_m3_s_pa: float
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
    brake_delay_s: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.006, 0.2, "bore_m")
        require_within(self, 0.05, 2.0, "stroke_m")
        require_within(self, 0.1, 500.0, "carried_kg")
        require_within(self, 0.01, 50.0, "piston_kg")
        require_within(self, 1e-11, 1e-7, "throttle_conductance_m3_s_pa")
        require_within(self, 0.0, 1e-7, "meter_in_conductance_m3_s_pa")
        require_within(self, 1.0, 1e5, "magnet_holds_n")
        require_within(self, 1e3, 1e7, "magnet_n_m")
        require_within(self, 0.0, 1e5, "magnet_n_s_m")
        require_within(self, 0.001, 1.0, "recouples_m_s")
        require_within(self, 0.0, 0.02, "bumper_m", "overtravel_m")
        require_within(self, 0.0, 5000.0, "brake_n")
        require_within(self, 0.0, 0.5e6, "brake_bites_pa")
        require_within(self, 0.001, 0.5, "brake_delay_s")
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
        """Steady speed in either direction while the exhaust is choked, m/s."""
        return meter_out_speed_m_s(self.throttle_conductance_m3_s_pa, self.area_m2)

    @property
    def decouples_pa(self) -> float:
        """Gauge pressure at which a blocked carriage decouples from its piston, Pa."""
        return self.magnet_holds_n / self.area_m2


class Slide(Cylinder):
    """View of a slide. Coils: inward, outward. Switches: one at feed (the outer end), one at each pick position.

    Attributes:
        at_feed: Switch at 0.
        at_pick: Switches at the pick positions, the one nearest to the feed first.
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
        held_pa: float,
        bounce_s: float,
    ) -> None:
        """Initialise the slide at rest in the feed position.

        Args:
            spec: Parameters of the slide.
            port: Path from the valve to either chamber.
            friction: Friction of the slide.
            common: Valves, check valves and air.
            arm: Records of the arm in the kernel memory.
            picks_m: Pick positions from the feed inward, m.
            held_pa: Gauge pressure of the chambers at rest, Pa.
            bounce_s: Bounce time of a closing contact, s.
        """
        params = arm.params["slide"]
        super().__init__(
            arm.state["slide"],
            params,
            arm.gas,
            port,
            friction,
            common,
            hold_pa=ATMOSPHERE_PA + held_pa,
        )
        params["stroke_m"] = spec.stroke_m
        params["plus_area_m2"] = params["minus_area_m2"] = spec.area_m2
        params["load_kg"], params["piston_kg"] = spec.carried_kg, spec.piston_kg
        for name in ("magnet_holds_n", "magnet_n_m", "magnet_n_s_m", "recouples_m_s"):
            params[name] = getattr(spec, name)
        for name in ("bumper_m", "bumper_n_m", "bumper_n_s_m", "overtravel_m"):
            params[name] = getattr(spec, name)
        for name in ("brake_n", "brake_bites_pa", "brake_delay_s"):
            params[name] = getattr(spec, name)
        self._fit_meter_in(spec.meter_in_conductance_m3_s_pa)
        for line in (params["plus"], params["minus"]):
            line["chamber_wall"] = annular_wall(spec.bore_m, 0.0)
            line["throttle_m3_s_pa"] = spec.throttle_conductance_m3_s_pa
        places_m = (0.0, *picks_m)
        self.at_feed, *at_pick = self._add_switches(
            arm.state["slide_switches"], arm.params["slide_switches"], places_m, spec, bounce_s
        )
        self.at_pick = tuple(at_pick)
        vent_tubes(self.state, params, arm.gas)
        self.place(0.0)

    @property
    def x_m(self) -> float:
        """Position from the feed inward, m."""
        return self.position_m

    @property
    def decoupled(self) -> bool:
        """True if the carriage is decoupled from its piston."""
        return bool(self.state["decoupled"])
