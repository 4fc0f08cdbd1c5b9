"""The spreader: a DC motor with a belt that sets the pitch of the claws."""

from dataclasses import dataclass

from plant_sim.devices.motion import ramp
from plant_sim.devices.sensor import PositionSwitch
from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class SpreaderSpec:
    """What is bolted to the machine.

    Attributes:
        travel_m: Belt travel of the front claw from converged to spread, m.
        speed_m_s: Belt speed, m/s.
        acceleration_m_s2: Rate at which the motor runs up, m/s2.
        coast_m_s2: Rate at which it runs down without current, m/s2.
        switch_band_m: How near to its end an end switch comes on, m.
        switch_hysteresis_m: How far beyond the band it goes off, m.
    """

    travel_m: float
    speed_m_s: float
    acceleration_m_s2: float
    coast_m_s2: float
    switch_band_m: float
    switch_hysteresis_m: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.01, 1.0, "travel_m")
        require_within(self, 0.01, 2.0, "speed_m_s")
        require_within(self, 0.1, 100.0, "acceleration_m_s2", "coast_m_s2")
        require_within(self, 0.0, 0.02, "switch_band_m")
        require_within(self, 0.0, 0.005, "switch_hysteresis_m")
        reach_m = self.switch_band_m + self.switch_hysteresis_m
        require(2 * reach_m < self.travel_m, "switch_band_m", "lets both end switches be on at once")


class Spreader:
    """Inputs: the two directions of the motor; both at once stop it.

    Attributes:
        travel_m: Belt travel, m: 0 is converged (tray pitch), the full travel is spread (cup pitch).
        speed_m_s: Positive while spreading, m/s.
        spread_switch: End switch at cup pitch.
        converged_switch: End switch at tray pitch.
        moving: Whether the travel changed in the last step.
        jammed: While True the belt stands dead.
    """

    __slots__ = (
        "_spec",
        "converged_switch",
        "jammed",
        "moving",
        "speed_m_s",
        "spread_switch",
        "travel_m",
    )

    def __init__(self, spec: SpreaderSpec, *, travel_m: float) -> None:
        """Start at rest.

        Args:
            spec: What it is.
            travel_m: Where the belt stands, m.
        """
        self.converged_switch, self.spread_switch = (
            PositionSwitch(
                at_m,
                band_m=spec.switch_band_m,
                hysteresis_m=spec.switch_hysteresis_m,
                position_m=travel_m,
            )
            for at_m in (0.0, spec.travel_m)
        )
        self._spec = spec
        self.travel_m = travel_m
        self.speed_m_s = 0.0
        self.moving = False
        self.jammed = False

    def place(self, travel_m: float) -> None:
        """Put the belt somewhere, at rest: a starting situation, not a motion.

        Args:
            travel_m: Where, m; clipped to the travel.
        """
        self.speed_m_s = 0.0
        self._settle(travel_m)

    def step(self, dt_s: float, *, spread: bool, converge: bool) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
            spread: Motor towards cup pitch.
            converge: Motor towards tray pitch.
        """
        self.moving = False
        drive = spread - converge
        if drive == 0 and self.speed_m_s == 0.0:
            return
        if self.jammed:
            self.speed_m_s = 0.0
            return
        spec = self._spec
        rate_m_s2 = spec.acceleration_m_s2 if drive else spec.coast_m_s2
        self.speed_m_s, way_m = ramp(self.speed_m_s, drive * spec.speed_m_s, rate_m_s2, dt_s)
        before_m = self.travel_m
        self._settle(before_m + way_m)
        self.moving = self.travel_m != before_m

    def _settle(self, travel_m: float) -> None:
        """Take up a new place, unless an end stop is in the way."""
        clipped_m = min(max(travel_m, 0.0), self._spec.travel_m)
        if clipped_m != travel_m:
            self.speed_m_s = 0.0
        self.travel_m = clipped_m
        self.converged_switch.update(clipped_m)
        self.spread_switch.update(clipped_m)
