"""Separation of a released block from the plates of the planter.

The separation time is the time from the release of the block until the tip of the planter has risen above the top of
the block. The block leaves at the vertical speed of the planter and then falls freely, without friction at the plates,
air resistance or soil. The separation time depends on the motion only.
"""

import math
from typing import Final

import numpy as np
from scipy.optimize import brentq

from plant_sim.common.limits import require
from plant_sim.planter.motion import Motion, PathSegment
from plant_sim.planter.motion_model import MotionModel

GRAVITY_M_S2: Final = 9.80665
"""Standard gravity, m/s2."""

_SAMPLES = 2_001
_NO_PATH = "printed has no continuous path, and therefore no separation time; use corrected or rigid"


def separation_time_s(motion: Motion, release_s: float) -> float:
    """Return the separation time of a block of planter 0, by root finding, s.

    Args:
        motion: Motion of the planters.
        release_s: Time of the release, s; see `Motion.time_at_s` for a phase of the bottom arc.

    Raises:
        SpecError: The model is `MotionModel.PRINTED`, whose path is not continuous.
    """
    require(motion.model is not MotionModel.PRINTED, "model", _NO_PATH)
    tip, top_m = motion.chain.tip, motion.chain.block_top_m
    start_m = float(motion.position_m(release_s, tip)[0, 0, 1])
    start_m_s = float(motion.velocity_m_s(release_s, tip)[0, 0, 1])

    def clearance_m(after_s: float | np.ndarray) -> np.ndarray:
        """Return the height of the tip above the top of the block, m."""
        block_m = start_m + top_m + start_m_s * after_s - GRAVITY_M_S2 / 2 * np.square(after_s)
        clearance: np.ndarray = motion.position_m(release_s + after_s, tip)[0, :, 1] - block_m
        return clearance

    after_s = np.linspace(0.0, _longest_s(motion, start_m_s), _SAMPLES)
    first = int(np.argmax(clearance_m(after_s) >= 0.0))
    return float(brentq(lambda time_s: float(clearance_m(time_s)[0]), after_s[first - 1], after_s[first], xtol=1e-14))


def separation_closed_form_s(motion: Motion, release_s: float) -> float | None:
    """Return the separation time of a block of planter 0 in closed form, s; None if there is none.

    The closed form is the root of a quadratic equation. It exists if the block leaves the plates on a straight segment
    after a release on the same segment or on the preceding bottom arc. On the arcs the equation is transcendental.
    The top arc accelerates the planter downward, possibly faster than the block falls, so that the tip may pass the
    block several times; a release there has no closed form.

    Args:
        motion: Motion of the planters.
        release_s: Time of the release, s.

    Raises:
        SpecError: The model is `MotionModel.PRINTED`, whose path is not continuous.
    """
    require(motion.model is not MotionModel.PRINTED, "model", _NO_PATH)
    since_s = release_s % motion.period_s
    segment = int(motion.segment(since_s)[0, 0])
    if segment == PathSegment.TOP:
        return None
    line = segment if segment in (PathSegment.FALL, PathSegment.RISE) else segment + 1
    line_m_s = motion.chain_m_s if line == PathSegment.RISE else -motion.chain_m_s
    tip = motion.chain.tip
    start_m = float(motion.position_m(since_s, tip)[0, 0, 1])
    start_m_s = float(motion.velocity_m_s(since_s, tip)[0, 0, 1])
    line_s = max(motion.starts_s[line], since_s)
    line_m = float(motion.position_m(line_s, tip)[0, 0, 1])
    # tip above the top of the block: gravity/2 t^2 + linear t + constant
    linear = line_m_s - start_m_s
    constant = line_m - line_m_s * (line_s - since_s) - start_m - motion.chain.block_top_m
    inner = linear**2 - 2 * GRAVITY_M_S2 * constant
    if inner < 0.0:
        return None
    time_s = (math.sqrt(inner) - linear) / GRAVITY_M_S2
    before_s = line_s - since_s
    is_held = GRAVITY_M_S2 / 2 * before_s**2 + linear * before_s + constant < 0.0
    return time_s if is_held and line_s <= since_s + time_s <= motion.starts_s[line + 1] else None


def _longest_s(motion: Motion, start_m_s: float) -> float:
    """Return a time after which a block is certain to be below the entire path of the tip, s."""
    chain = motion.chain
    height_m = chain.centre_distance_m + 2 * motion.radius_m(chain.tip) + chain.tip_height_m + chain.block_top_m
    rising_m_s = max(start_m_s, 0.0)
    return (rising_m_s + math.sqrt(rising_m_s**2 + 2 * GRAVITY_M_S2 * 2 * height_m)) / GRAVITY_M_S2
