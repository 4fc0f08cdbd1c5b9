"""The twelve claws of an arm, opened and closed together by one latching valve."""

from dataclasses import dataclass

from plant_sim.devices.valve import LatchingValve, ValveSpec
from plant_sim.spec import require, require_within


@dataclass(frozen=True, slots=True)
class ClawsSpec:
    """What is bolted to the machine: MHC2, finger angle positive when open.

    Attributes:
        closed_deg: Finger angle at the closed end, degrees.
        open_deg: Finger angle at the open end, degrees.
        travel_s: Time of the way from one end to the other, s.
        grips_below_deg: At this angle or less a stem is gripped, degrees.
        frees_above_deg: At this angle or more a stem is free, degrees.
    """

    closed_deg: float
    open_deg: float
    travel_s: float
    grips_below_deg: float
    frees_above_deg: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, -45.0, 90.0, "closed_deg", "open_deg")
        require_within(self, 0.005, 2.0, "travel_s")
        require(
            self.closed_deg < self.grips_below_deg,
            "grips_below_deg",
            "must lie above the closed end, or nothing is ever gripped",
        )
        require(
            self.grips_below_deg < self.frees_above_deg < self.open_deg,
            "frees_above_deg",
            "must lie between grips_below_deg and the open end",
        )


class Claws:
    """State: one finger angle for all claws, and the valve that keeps its position.

    Attributes:
        angle_deg: Finger angle, degrees.
        moving: Whether the angle changed in the last step.
        jammed: While True the fingers stand dead; the valve still switches.
    """

    __slots__ = ("_rate_deg_s", "_spec", "_valve", "angle_deg", "jammed", "moving")

    def __init__(self, spec: ClawsSpec, valve: ValveSpec, *, is_open: bool) -> None:
        """Start at one end.

        Args:
            spec: What they are.
            valve: How the valve switches.
            is_open: Whether they were left open.
        """
        self._spec = spec
        self._valve = LatchingValve(valve, is_set=is_open)
        self._rate_deg_s = (spec.open_deg - spec.closed_deg) / spec.travel_s
        self.angle_deg = spec.open_deg if is_open else spec.closed_deg
        self.moving = False
        self.jammed = False

    @property
    def gripping(self) -> bool:
        """Whether what is between the fingers is gripped."""
        return self.angle_deg <= self._spec.grips_below_deg

    @property
    def free(self) -> bool:
        """Whether nothing between the fingers is touched."""
        return self.angle_deg >= self._spec.frees_above_deg

    def place(self, *, is_open: bool) -> None:
        """Put fingers and valve at one end: a starting situation, not a motion."""
        self._valve.is_set = is_open
        self.angle_deg = self._spec.open_deg if is_open else self._spec.closed_deg

    def step(self, dt_s: float, *, open_coil: bool, close_coil: bool) -> None:
        """Let time pass; the valve acts on the fingers as it stood when the step began.

        Args:
            dt_s: How long, s.
            open_coil: Coil that opens.
            close_coil: Coil that closes.
        """
        opens = self._valve.is_set
        self._valve.step(dt_s, open_coil, close_coil)
        end_deg = self._spec.open_deg if opens else self._spec.closed_deg
        self.moving = self.angle_deg != end_deg and not self.jammed
        if not self.moving:
            return
        turn_deg = self._rate_deg_s * dt_s
        if opens:
            self.angle_deg = min(self.angle_deg + turn_deg, end_deg)
        else:
            self.angle_deg = max(self.angle_deg - turn_deg, end_deg)
