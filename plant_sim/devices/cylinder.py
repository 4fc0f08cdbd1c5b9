"""A pneumatic cylinder on a centred valve, throttled at its exhaust: what slide and lift share."""

import math
from dataclasses import dataclass

from plant_sim.devices.sensor import PositionSwitch
from plant_sim.devices.valve import CentredValve, ValveSpec
from plant_sim.spec import require_within

_AT_REST_M_S = 1e-4  # what is left of a stop below this speed is about a micrometre
_ROUNDING_S = 1e-9


@dataclass(frozen=True, slots=True)
class CylinderMotion:
    """How a cylinder moves.

    Attributes:
        stroke_m: From end stop to end stop, m.
        plus_m_s: Steady speed away from 0, m/s.
        minus_m_s: Steady speed towards 0, m/s.
        dead_time_s: From the valve acting until the piston starts, s.
        build_up_s: Time constant of the speed building up, s.
        stop_s: Time constant of the speed dying away once the check valves have closed, s. The
            stopping distance is the speed times this.
    """

    stroke_m: float
    plus_m_s: float
    minus_m_s: float
    dead_time_s: float
    build_up_s: float
    stop_s: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.01, 2.0, "stroke_m")
        require_within(self, 0.001, 3.0, "plus_m_s", "minus_m_s")
        require_within(self, 0.0, 1.0, "dead_time_s")
        require_within(self, 0.001, 1.0, "build_up_s", "stop_s")


class Cylinder:
    """State: position, speed, valve.

    The speed is a first-order lag: it builds up to the meter-out speed after a dead time, and dies
    away when the pilot check valves close. End stops take all speed at once (rubber bumpers).

    Attributes:
        position_m: From the end stop at 0, m.
        speed_m_s: Positive away from 0, m/s.
        moving: Whether the position changed in the last step.
        jammed: While True the piston stands dead; its valve still switches.
    """

    __slots__ = (
        "_dead_s",
        "_drive",
        "_dt_s",
        "_keep_build_up",
        "_keep_stop",
        "_motion",
        "_switches",
        "_valve",
        "jammed",
        "moving",
        "position_m",
        "speed_m_s",
    )

    def __init__(
        self,
        motion: CylinderMotion,
        valve: ValveSpec,
        switches: tuple[PositionSwitch, ...],
        *,
        position_m: float,
    ) -> None:
        """Start at rest, valve centred.

        Args:
            motion: How it moves.
            valve: How its valve switches.
            switches: Mounted along it.
            position_m: Where it stands, m.
        """
        self._motion = motion
        self._valve = CentredValve(valve)
        self._switches = switches
        self._drive = 0
        self._dead_s = 0.0
        self._dt_s = 0.0  # the step that the two factors below belong to
        self._keep_build_up = self._keep_stop = 0.0
        self.position_m = position_m
        self.speed_m_s = 0.0
        self.moving = False
        self.jammed = False

    def place(self, position_m: float) -> None:
        """Put it somewhere, at rest: a starting situation, not a motion.

        Args:
            position_m: Where, m; clipped to the stroke.
        """
        self.position_m = min(max(position_m, 0.0), self._motion.stroke_m)
        self.speed_m_s = 0.0
        for switch in self._switches:
            switch.update(self.position_m)

    def _advance(self, dt_s: float, plus: bool, minus: bool) -> None:
        """Let time pass; the valve acts on the piston as it stood when the step began."""
        drive = self._valve.flow
        self._valve.step(dt_s, plus, minus)
        self.moving = False
        if drive != self._drive:
            self._drive = drive
            self._dead_s = self._motion.dead_time_s
        if self.jammed:
            self.speed_m_s = 0.0
        elif drive != 0 or self.speed_m_s != 0.0:
            self._move(dt_s, drive)

    def _move(self, dt_s: float, drive: int) -> None:
        motion = self._motion
        if dt_s != self._dt_s:
            self._dt_s = dt_s
            self._keep_build_up = math.exp(-dt_s / motion.build_up_s)
            self._keep_stop = math.exp(-dt_s / motion.stop_s)
        wanted_m_s, lag_s, keep = 0.0, motion.stop_s, self._keep_stop
        if drive != 0 and self._dead_s > _ROUNDING_S:
            self._dead_s -= dt_s
            if self.speed_m_s == 0.0:
                return
        elif drive != 0:
            wanted_m_s = motion.plus_m_s if drive > 0 else -motion.minus_m_s
            lag_s, keep = motion.build_up_s, self._keep_build_up
        excess_m_s = self.speed_m_s - wanted_m_s
        way_m = wanted_m_s * dt_s + excess_m_s * lag_s * (1.0 - keep)
        speed_m_s = wanted_m_s + excess_m_s * keep
        if wanted_m_s == 0.0 and abs(speed_m_s) < _AT_REST_M_S:
            speed_m_s = 0.0
        self._settle(self.position_m + way_m, speed_m_s)

    def _settle(self, position_m: float, speed_m_s: float) -> None:
        """Take up a new position and speed, unless an end stop is in the way."""
        if position_m <= 0.0:
            position_m, speed_m_s = 0.0, 0.0
        elif position_m >= self._motion.stroke_m:
            position_m, speed_m_s = self._motion.stroke_m, 0.0
        self.speed_m_s = speed_m_s
        if position_m != self.position_m:
            self.position_m = position_m
            self.moving = True
            for switch in self._switches:
                switch.update(position_m)
