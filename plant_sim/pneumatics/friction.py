"""Seal friction: Stribeck curve with exact sticking for any step length."""

import math
from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled

FRICTION = np.dtype([("coulomb_n", "f8"), ("static_n", "f8"), ("stribeck_m_s", "f8"), ("viscous_n_s_m", "f8")])
"""Coulomb and static friction, N; speed at which half of their difference has decayed, m/s; viscous friction, N s/m."""


@compiled
def dry_friction_n(params: Any, speed_m_s: float) -> float:
    """Return the magnitude of the dry friction, N: static friction at rest, Coulomb friction at high speed.

    The curve is steepest at rest, as in Stribeck curves with the exponent 1 (Tustin). If slow motion sticks and slips at
    some speed, it does so at every lower speed. With a curve that is flat at rest, the viscous friction would make very
    slow motion smooth again.
    """
    dry: float = params.coulomb_n + (params.static_n - params.coulomb_n) / (1.0 + abs(speed_m_s) / params.stribeck_m_s)
    return dry


@compiled
def speed_after_friction_m_s(
    params: Any, free_m_s: float, speed_m_s: float, mass_kg: float, step_s: float, brake_n: float = 0.0
) -> float:
    """Apply friction to the speed computed for a step without friction; return the resulting speed.

    The friction impulse never exceeds the momentum, so it can stop the motion but not reverse it.

    Args:
        params: Parameters of the friction.
        free_m_s: Speed after the step without friction, m/s.
        speed_m_s: Speed before the step, m/s.
        mass_kg: Moving mass, kg.
        step_s: Length of the step, s.
        brake_n: Additional force of a brake, N.
    """
    left_m_s = abs(free_m_s) - step_s * (dry_friction_n(params, speed_m_s) + brake_n) / mass_kg
    if left_m_s <= 0.0:
        return 0.0
    rubbed: float = math.copysign(left_m_s, free_m_s) / (1.0 + step_s * params.viscous_n_s_m / mass_kg)
    return rubbed
