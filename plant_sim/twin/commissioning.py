"""Set-points that depend on the dimensions of a machine, as set during commissioning."""

from __future__ import annotations

from plant_sim.machine.parameters import Machine

SLIDE_M_S = 0.15
"""Slide speed to which the throttles are adjusted, m/s."""


def set_points_of(machine: Machine) -> dict[str, int]:
    """Return the initial values of the set-points that depend on the machine.

    `slide_least` is three quarters of the travel time from the first row's switch to the feed switch.
    """
    slide = machine.slide
    way_m = machine.picks_m[0] - 2 * (slide.switch_band_m + slide.switch_hysteresis_m)
    return {"slide_least": max(10, round(0.75 * way_m / SLIDE_M_S * 100))}
