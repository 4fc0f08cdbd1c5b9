"""Closed-form speed of a cylinder with throttled exhaust."""

import math

from plant_sim.pneumatics.flow import REFERENCE_PA


def meter_out_speed_m_s(conductance_m3_s_pa: float, exhaust_area_m2: float) -> float:
    """Return the steady speed of a piston while its exhaust throttle is choked.

    The volume flow through a choked throttle, measured at ANR, is the conductance times the absolute pressure of the
    exhausting chamber. Converted to that pressure, the flow is independent of supply and load, and so is the speed.

    Args:
        conductance_m3_s_pa: Sonic conductance C of the speed controller, m3/(s Pa).
        exhaust_area_m2: Piston area on the exhausting side, m2.

    Returns:
        Speed, m/s.

    Slide of the machine, and a textbook example (50/20 cylinder, C = 0.54 dm3/(s bar), 0.33 m/s):

    >>> round(meter_out_speed_m_s(0.7e-9, piston_area_m2(0.025)), 4)
    0.1426
    >>> round(meter_out_speed_m_s(0.54e-8, annulus_area_m2(0.050, 0.020)), 2)
    0.33

    Source: docs/sources/plant.md 1.7 and 2, case V4.
    """
    return conductance_m3_s_pa * REFERENCE_PA / exhaust_area_m2


def piston_area_m2(bore_m: float) -> float:
    """Return the area of a piston on the side without a rod, m2."""
    return math.pi / 4 * bore_m**2


def annulus_area_m2(bore_m: float, rod_m: float) -> float:
    """Return the annular area on the rod side of a piston, m2."""
    return piston_area_m2(bore_m) - piston_area_m2(rod_m)
