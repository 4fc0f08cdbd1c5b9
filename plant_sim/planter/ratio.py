"""Regimes of the ratio of chain speed to machine speed, and points of zero horizontal speed.

Source: cabbage paper, 2.1.3; docs/sources/machine.md 6.
"""

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from plant_sim.common.limits import require
from plant_sim.planter.chain import Offset
from plant_sim.planter.motion import Motion
from plant_sim.planter.motion_model import MotionModel

_SAME = 1e-12
"""Relative difference below which two speeds are considered equal."""
_SAMPLES = 1_441


class Regime(StrEnum):
    """Shape of the path of the hinge relative to the soil."""

    SHORTENED_CYCLOID = "shortened cycloid"
    CYCLOID = "cycloid"
    TROCHOID = "trochoid"


class ZeroSpeedPoint(NamedTuple):
    """Point of the bottom arc at which the horizontal speed is zero.

    Attributes:
        phase_deg: Phase on the bottom arc, degrees; 90 is the lowest point.
        time_s: First time at which planter 0 is at the point, s.
        vertical_m_s: Vertical speed, upward positive, m/s.
    """

    phase_deg: float
    time_s: float
    vertical_m_s: float


def regime_of(ratio: float) -> Regime:
    """Return the regime of a ratio; only a ratio of 1, within rounding, gives a cycloid.

    >>> regime_of(0.9964).value, regime_of(1.0).value, regime_of(1.17).value
    ('shortened cycloid', 'cycloid', 'trochoid')
    """
    if math.isclose(ratio, 1.0, rel_tol=_SAME):
        return Regime.CYCLOID
    return Regime.SHORTENED_CYCLOID if ratio < 1.0 else Regime.TROCHOID


def point_ratio(motion: Motion, offset: Offset) -> float:
    """Return the ratio of the circumferential speed of a point on the arcs to the machine speed.

    In `MotionModel.RIGID` it equals the ratio of the chain for every point. In the other models the radius of the arcs
    is R + l.
    """
    return motion.ratio * motion.radius_m(offset) / motion.chain.sprocket_radius_m


def zero_speed_points(motion: Motion, offset: Offset | None = None) -> tuple[ZeroSpeedPoint, ...]:
    """Return the points of zero horizontal speed in order of time, from the equations.

    On the bottom arc, the horizontal speed is v - a sin(phase), where v is the machine speed and a the circumferential
    speed. It is zero where sin(phase) = v/a: at no point, at the lowest point, or at two points symmetrical about it.
    In `MotionModel.PRINTED`, the wrong sign in equation 8 means that there is no such point.

    Args:
        motion: Motion of the planters.
        offset: Point of the planter; by default the tip.

    Raises:
        SpecError: The machine is at rest, so the horizontal speed is zero on all straight segments.
    """
    point = _moving_point(motion, offset)
    ratio = point_ratio(motion, point)
    if motion.model is MotionModel.PRINTED or regime_of(ratio) is Regime.SHORTENED_CYCLOID:
        return ()
    if regime_of(ratio) is Regime.CYCLOID:
        phases = [math.pi / 2]
    else:
        first = math.asin(1 / ratio)
        phases = [first, math.pi - first]
    speed_m_s = motion.radius_m(point) * motion.omega_rad_s
    return tuple(
        ZeroSpeedPoint(math.degrees(phase), motion.time_at_s(math.degrees(phase)), 0.0 - speed_m_s * math.cos(phase))
        for phase in phases
    )


def zero_speed_times_s(motion: Motion, offset: Offset | None = None) -> tuple[float, ...]:
    """Return the times of zero horizontal speed of planter 0 in its first revolution, by root finding.

    `zero_speed_points` gives the same times without the velocity function, so each function verifies the other.

    Args:
        motion: Motion of the planters.
        offset: Point of the planter; by default the tip.

    Raises:
        SpecError: The machine is at rest, so the horizontal speed is zero on all straight segments.
    """
    point = _moving_point(motion, offset)

    def forward_m_s(time_s: float) -> float:
        return float(motion.velocity_m_s(time_s, point)[0, 0, 0])

    times_s = np.linspace(0.0, motion.period_s, _SAMPLES)
    lowest = int(np.clip(np.argmin(motion.velocity_m_s(times_s, point)[0, :, 0]), 1, _SAMPLES - 2))
    around_s = (times_s[lowest - 1], times_s[lowest + 1])
    minimum = minimize_scalar(forward_m_s, bounds=around_s, method="bounded", options={"xatol": 1e-12})
    slowest_s, slowest_m_s = float(minimum.x), float(minimum.fun)
    if slowest_m_s > _SAME * motion.speed_m_s:
        return ()
    if slowest_m_s >= -_SAME * motion.speed_m_s:
        return (slowest_s,)
    sides_s: Sequence[tuple[float, float]] = ((0.0, slowest_s), (slowest_s, motion.period_s))
    return tuple(float(brentq(forward_m_s, *side_s, xtol=1e-14)) for side_s in sides_s)


def depth_m(motion: Motion) -> float:
    """Return the depth of the tip below the soil surface at the lowest point of the bottom arc, m.

    It is negative if the tip does not reach the soil.
    """
    chain = motion.chain
    return motion.radius_m(chain.tip) + chain.tip_height_m - chain.axle_height_m


def _moving_point(motion: Motion, offset: Offset | None) -> Offset:
    require(motion.speed_m_s > 0.0, "speed_m_s", "must be above 0 to have separate points of zero speed")
    return motion.chain.tip if offset is None else offset
