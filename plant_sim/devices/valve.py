"""Solenoid valves with the delay of their pilots."""

from dataclasses import dataclass

from plant_sim.spec import require_within

_ROUNDING_S = 1e-9  # three steps of 5 ms are 15 ms, whatever their floating-point sum says


@dataclass(frozen=True, slots=True)
class ValveSpec:
    """Switching of a solenoid valve.

    Attributes:
        on_delay_s: From coil on until the spool acts, s.
        off_delay_s: From coil off until the spool acts, s.
    """

    on_delay_s: float
    off_delay_s: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 0.5, "on_delay_s", "off_delay_s")


class _Pilot:
    """One coil and its pilot: follows the coil after a delay; a shorter pulse passes unseen."""

    __slots__ = ("_pending_s", "_spec", "acts")

    def __init__(self, spec: ValveSpec) -> None:
        self._spec = spec
        self._pending_s = 0.0
        self.acts = False

    def step(self, dt_s: float, coil: bool) -> None:
        if coil == self.acts:
            self._pending_s = 0.0
            return
        self._pending_s += dt_s
        delay_s = self._spec.on_delay_s if coil else self._spec.off_delay_s
        if self._pending_s >= delay_s - _ROUNDING_S:
            self.acts = coil
            self._pending_s = 0.0


class CentredValve:
    """5/3 valve, exhaust centre, with a pilot check valve in each port.

    Without a coil the centre vents the pilots of the checks, which close and hold the cylinder;
    with both coils on the spool stays centred too.

    Attributes:
        flow: What the cylinder gets: +1 or -1 to drive it, 0 to hold it.
    """

    __slots__ = ("_minus", "_plus", "flow")

    def __init__(self, spec: ValveSpec) -> None:
        """Start centred."""
        self._plus = _Pilot(spec)
        self._minus = _Pilot(spec)
        self.flow = 0

    def step(self, dt_s: float, plus: bool, minus: bool) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
            plus: Coil for +1.
            minus: Coil for -1.
        """
        self._plus.step(dt_s, plus)
        self._minus.step(dt_s, minus)
        self.flow = self._plus.acts - self._minus.acts


class LatchingValve:
    """5/2 double solenoid valve: keeps its last position without a coil, and with both.

    Attributes:
        is_set: Whether the last coil that acted alone was the one that sets.
    """

    __slots__ = ("_reset_pilot", "_set_pilot", "is_set")

    def __init__(self, spec: ValveSpec, *, is_set: bool) -> None:
        """Start in the position in which it was left."""
        self._set_pilot = _Pilot(spec)
        self._reset_pilot = _Pilot(spec)
        self.is_set = is_set

    def step(self, dt_s: float, set_coil: bool, reset_coil: bool) -> None:
        """Let time pass.

        Args:
            dt_s: How long, s.
            set_coil: Coil that sets.
            reset_coil: Coil that resets.
        """
        self._set_pilot.step(dt_s, set_coil)
        self._reset_pilot.step(dt_s, reset_coil)
        if self._set_pilot.acts != self._reset_pilot.acts:
            self.is_set = self._set_pilot.acts
