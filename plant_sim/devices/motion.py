"""Laws of motion shared by the devices, exact for any length of a step."""


def ramp(speed_m_s: float, wanted_m_s: float, acceleration_m_s2: float, dt_s: float) -> tuple[float, float]:
    """Change a speed at a constant rate until it is the wanted one.

    Args:
        speed_m_s: Speed now, m/s.
        wanted_m_s: Speed to reach and keep, m/s.
        acceleration_m_s2: Rate of change, positive, m/s2.
        dt_s: Length of the step, s.

    Returns:
        Speed at the end of the step, m/s, and way covered in it, m.

    Half a second from rest at 2 m/s2 covers 0.25 m; with 0.4 m/s reached after 0.2 s it is
    0.04 m of ramp and 0.3 s of travel. Braking never turns round:

    >>> ramp(0.0, 1.0, 2.0, 0.5)
    (1.0, 0.25)
    >>> speed_m_s, way_m = ramp(0.0, 0.4, 2.0, 0.5)
    >>> speed_m_s, round(way_m, 9)
    (0.4, 0.16)
    >>> speed_m_s, way_m = ramp(0.2, 0.0, 4.0, 1.0)
    >>> speed_m_s, round(way_m, 9)
    (0.0, 0.005)
    """
    gap_m_s = wanted_m_s - speed_m_s
    ramp_s = abs(gap_m_s) / acceleration_m_s2
    if ramp_s > dt_s:
        reached_m_s = speed_m_s + gap_m_s * (dt_s / ramp_s)
        return reached_m_s, (speed_m_s + reached_m_s) / 2 * dt_s
    return wanted_m_s, (speed_m_s + wanted_m_s) / 2 * ramp_s + wanted_m_s * (dt_s - ramp_s)
