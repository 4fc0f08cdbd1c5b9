"""Chordal action of the chain: path of a hinge on a chain whose links form a polygon on the sprockets.

A pin that is seated in a tooth moves on the pitch circle. The next pin ahead of it is on the straight span, so the span
is between R cos(pi/N) and R from the centre of the sprocket, with N teeth, and its speed varies with every tooth. The
upper sprocket turns at constant speed (assumption: it is the driven one); the lower one follows the span. A hinge is a
pin of the chain. The slight inclination of the span is neglected.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plant_sim.planter.chain import ChainSpec
from plant_sim.planter.motion import Motion

Lengths = NDArray[np.float64]


def polygon_path_m(motion: Motion, time_s: ArrayLike) -> Lengths:
    """Return the positions of the hinge of planter 0 on the bottom arc and on the rising span after it.

    At the lowest point, the hinge coincides with that of `Motion`, and the mean speed of the chain is the same. From
    the upper sprocket on, the path is that of `Motion`.

    Args:
        motion: Motion of the planters.
        time_s: Times in the first revolution, from joint D on, s.

    Returns:
        Array of shape (times, 2) with x and y, m, in the coordinates of `Motion`.
    """
    times_s, chain = np.atleast_1d(np.asarray(time_s, dtype=float)), motion.chain
    tooth_rad = 2 * math.pi / chain.teeth
    lowest_m = along_m(chain, -math.pi / 2)
    driver_rad = angle_rad(chain, lowest_m - chain.span_part * chain.link_m)
    turned_rad = tooth_rad * motion.chain_m_s / chain.link_m * (times_s - motion.time_at_s(90.0))
    risen_m = lowest_m + along_m(chain, driver_rad + turned_rad) - along_m(chain, driver_rad)
    angle = angle_rad(chain, risen_m)
    # a pin stays in its tooth for half a tooth beyond the joint, then the pins behind it guide the span
    behind = np.where(angle <= tooth_rad / 2, 0.0, np.rint(angle / tooth_rad))
    seated_rad = angle - behind * tooth_rad
    radius_m = chain.sprocket_radius_m
    x_m = motion.speed_m_s * times_s - radius_m * np.cos(seated_rad)
    y_m = behind * chain.link_m + radius_m * np.sin(seated_rad)
    path_m: Lengths = np.stack([x_m, y_m], axis=-1)
    above = risen_m >= chain.centre_distance_m
    if above.any():
        path_m[above] = motion.position_m(times_s[above])[0]
    return path_m


def along_m(chain: ChainSpec, angle: ArrayLike) -> Lengths:
    """Return the travel of the span along itself at an angle of the sprocket from a pin at the joint, m."""
    tooth_rad = 2 * math.pi / chain.teeth
    turned = np.asarray(angle, dtype=float)
    pins = np.rint(turned / tooth_rad)
    travel_m: Lengths = pins * chain.link_m + chain.sprocket_radius_m * np.sin(turned - pins * tooth_rad)
    return travel_m


def angle_rad(chain: ChainSpec, travel_m: ArrayLike) -> Lengths:
    """Return the angle of the sprocket at a travel of the span, rad: the inverse of `along_m`."""
    travel = np.asarray(travel_m, dtype=float)
    pins = np.rint(travel / chain.link_m)
    part = np.clip((travel - pins * chain.link_m) / chain.sprocket_radius_m, -1.0, 1.0)
    angle: Lengths = pins * 2 * math.pi / chain.teeth + np.arcsin(part)
    return angle
