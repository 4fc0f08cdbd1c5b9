"""Limits within which the motion of an arm cannot affect any seedling.

The crop is evaluated after every look at the motion. The evaluation changes nothing while all positions remain between
two neighbouring thresholds of its rules, so that it can be omitted until a position leaves these limits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

AXES = ("slide_m", "lift_m", "claws_m", "spreader_m")
"""Positions with limits, in the order of the first outputs of the kernel."""


class Quiet(NamedTuple):
    """Limits of one arm, and the loads on its seedlings since the last look at which they were evaluated.

    Attributes:
        low: Exclusive lower limits of the positions in the order of `AXES`, m.
        high: Exclusive upper limits of the positions, m.
        chain_below_m: Exclusive upper limit of the chain travel, m.
        until_s: Exclusive upper limit of the plant time, s.
        clamp_below_pa: Exclusive upper limit of the clamping pressure, Pa.
        slips: Number of losses of the clamping force.
        down_m: Position of the lift at its lower limit, m.
        gripped_rise_m: Height of the arm above which the gripped plugs are being pulled, m.
        slide_m: Latest slide position, m.
        peak_pa: Highest clamping pressure, Pa.
        least_pa: Lowest clamping pressure while plugs are being pulled, Pa.
        outside: `POSE_OUTSIDE` or `ROW_OUTSIDE` if a value was outside its limits at the latest look, else 0.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    chain_below_m: float
    until_s: float
    clamp_below_pa: float
    slips: float
    down_m: float
    gripped_rise_m: float
    slide_m: float
    peak_pa: float = -math.inf
    least_pa: float = math.inf
    outside: float = 0.0


QUIET = np.dtype([(name, "f8", (len(AXES),) if name in {"low", "high"} else ()) for name in Quiet._fields])
"""Record of `Quiet` for compiled functions."""

TRAYS = np.dtype([("followed_m", "f8"), ("passed_m", "f8"), ("low_m", "f8"), ("high_m", "f8")])
"""Limits of the tray travel.

`followed_m` is the travel at the latest look at which the trays were evaluated, and `passed_m` at the latest look;
`low_m` and `high_m` are exclusive limits.
"""

POSE_OUTSIDE, ROW_OUTSIDE = 1.0, 2.0
"""A position or the clamping pressure is outside its limits; or only the chain travel or the time, which affect
nothing but the row of cups."""

_MARGIN_M = 1e-9
"""Distance from a threshold within which a position counts as having reached it, m; covers rounding errors."""


def between(value: float, thresholds: Sequence[float]) -> tuple[float, float]:
    """Return the limits of a value between its neighbouring thresholds.

    Args:
        value: Current value, m.
        thresholds: Values at which a rule changes its result, m.

    Returns:
        Exclusive lower and upper limit, m. A value at a threshold is outside its limits.

    Examples:
        >>> [round(limit, 6) for limit in between(0.5, (0.2, 0.4, 0.6))]
        [0.4, 0.6]
    """
    low, high = -math.inf, math.inf
    for threshold in thresholds:
        if low < threshold <= value:
            low = threshold
        if value <= threshold < high:
            high = threshold
    return low + _MARGIN_M, high - _MARGIN_M
