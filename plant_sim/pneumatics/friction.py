"""Seal friction: Stribeck curve with exact sticking for any step length."""

import math
from typing import Any

import numpy as np

from plant_sim.common.compiled import compiled

FRICTION = np.dtype([("coulomb_n", "f8"), ("static_n", "f8"), ("stribeck_m_s", "f8"), ("viscous_n_s_m", "f8")])
"""Coulomb and static friction, N; speed at which half of their difference has decayed, m/s; viscous friction, N s/m."""


@compiled
def speed_after_friction_m_s(
    params: Any, free_m_s: float, speed_m_s: float, mass_kg: float, step_s: float, brake_n: float = 0.0
) -> float:
    """Apply friction to the speed computed for a step without friction; return the resulting speed.

    Dry friction is static friction at rest and decreases with the speed towards Coulomb friction. The curve is steepest
    at rest, as in Stribeck curves with the exponent 1 (Tustin): if slow motion sticks and slips at some speed, it
    does so at every lower speed. With a curve that is flat at rest, the viscous friction would make very slow motion
    smooth again. The friction is that at the speed after the step, which is the root of a quadratic equation. Its
    impulse never exceeds the momentum, so it can stop the motion but not reverse it.

    Args:
        params: Parameters of the friction.
        free_m_s: Speed after the step without friction, m/s.
        speed_m_s: Speed before the step, m/s.
        mass_kg: Moving mass, kg.
        step_s: Length of the step, s.
        brake_n: Additional force of a brake, N.
    """
    falls_n = params.static_n - params.coulomb_n
    impulse_n_s = mass_kg * abs(free_m_s) - step_s * (params.coulomb_n + brake_n)
    # from rest, or at a reversal, the force must exceed static friction
    slips = impulse_n_s > step_s * falls_n
    if impulse_n_s <= 0.0 or not (slips or speed_m_s * free_m_s > 0.0):
        return 0.0
    # inertia v + step falls / (1 + v / stribeck) = impulse
    inertia_kg = mass_kg + step_s * params.viscous_n_s_m
    half = 0.5 * (impulse_n_s / inertia_kg - params.stribeck_m_s)
    squared = half * half + params.stribeck_m_s * (impulse_n_s - step_s * falls_n) / inertia_kg
    # friction falls too steeply with the speed: no speed after the step is in balance, so the motion sticks
    if squared < 0.0:
        return 0.0
    return math.copysign(max(half + math.sqrt(squared), 0.0), free_m_s)
