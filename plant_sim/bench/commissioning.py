"""Set-points that follow from a machine's dimensions, as whoever commissions it would set them."""

from __future__ import annotations

from plant_sim.parameters import Machine

SLIDE_M_S = 0.15
"""Slide speed that the throttles are set for."""


def set_points_of(machine: Machine) -> dict[str, int]:
    """Return the first values of the set-points that differ from machine to machine.

    `slide_least` is three quarters of the time from the switch of the first row to that of feed.
    """
    slide = machine.slide
    way_m = machine.picks_m[0] - 2 * (slide.switch_band_m + slide.switch_hysteresis_m)
    return {"slide_least": max(10, round(0.75 * way_m / SLIDE_M_S * 100))}
