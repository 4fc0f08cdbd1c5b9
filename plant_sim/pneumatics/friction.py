"""Friction of a seal: Stribeck's curve, and sticking that is exact at any step."""

import math
from typing import Any

import numpy as np

from plant_sim.pneumatics.compiled import compiled

#: Coulomb and static friction, N; speed at which the curve has fallen half way, m/s; viscous, N s/m.
FRICTION = np.dtype([("coulomb_n", "f8"), ("static_n", "f8"), ("stribeck_m_s", "f8"), ("viscous_n_s_m", "f8")])


@compiled
def dry_n(make: Any, speed_m_s: float) -> float:
    """Friction that does not depend on the direction, N: from static to Coulomb as speed grows."""
    share = speed_m_s / make.stribeck_m_s
    dry: float = make.coulomb_n + (make.static_n - make.coulomb_n) / (1.0 + share * share)
    return dry


@compiled
def rubbed_m_s(
    make: Any, free_m_s: float, speed_m_s: float, mass_kg: float, step_s: float, brake_n: float = 0.0
) -> float:
    """Speed after a step, given the speed it would have without friction.

    Friction takes an impulse and never more than there is: what it could turn round, it stops.

    Args:
        make: The friction.
        free_m_s: Speed after the step without friction, m/s.
        speed_m_s: Speed before the step, m/s.
        mass_kg: What moves, kg.
        step_s: Length of the step, s.
        brake_n: Force of a brake on top of it, N.
    """
    left_m_s = abs(free_m_s) - step_s * (dry_n(make, speed_m_s) + brake_n) / mass_kg
    if left_m_s <= 0.0:
        return 0.0
    rubbed: float = math.copysign(left_m_s, free_m_s) / (1.0 + step_s * make.viscous_n_s_m / mass_kg)
    return rubbed
