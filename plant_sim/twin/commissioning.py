"""Set-points that depend on the dimensions of a machine, as set during commissioning."""

from __future__ import annotations

import math
from typing import Final

from controller.program.set_points import SetPoints
from plant_sim.machine.parameters import Machine

SLIDE_M_S = 0.15
"""Slide speed to which the throttles are adjusted, m/s."""

OPENING_MS: Final = 126
"""Time from energising the coil to the release of the plugs, ms; simulated at 0.40 MPa (controller/program/tags.py)."""
READING_MS: Final = 15
"""Input filter and half a scan, ms."""
DELAY_UNIT_MS: Final = 10
_NO_CUPS_UNIT_MS = 100
_NO_CUPS_CUPS = 3


def set_points_of(machine: Machine) -> dict[str, int]:
    """Return the initial values of the set-points that depend on the machine.

    `slide_least` is three quarters of the travel time from the first row's switch to the feed switch.
    """
    slide = machine.slide
    way_m = machine.picks_m[0] - 2 * (slide.switch_band_m + slide.switch_hysteresis_m)
    return {"slide_least": max(10, round(0.75 * way_m / SLIDE_M_S * 100))}


def cup_set_points(machine: Machine, frequency_per_min: float) -> dict[str, int]:
    """Return the set-points that a commissioning engineer would enter for a planting frequency.

    The release delay makes the plugs land in the middle of the cups; it is zero if any delay would be too long.
    The machine is Suspended if no cup passes for three cup intervals. Both are limited to the range of their set-point.

    Args:
        machine: Parameters of the machine.
        frequency_per_min: Cups per minute per row, more than 0.
    """
    lead_ms = 60_000 / frequency_per_min * machine.cups.sensor_lead_m / machine.cups.pitch_m
    no_cups_ms = _NO_CUPS_CUPS * 60_000 / frequency_per_min
    wanted = {
        "release_delay": round((lead_ms - landing_ms(machine)) / DELAY_UNIT_MS),
        "no_cups": math.ceil(no_cups_ms / _NO_CUPS_UNIT_MS),
    }
    set_points = SetPoints()
    limits = {name: set_points.limits[getattr(set_points, name)] for name in wanted}
    return {name: min(max(value, limits[name][0]), limits[name][1]) for name, value in wanted.items()}


def landing_ms(machine: Machine) -> float:
    """Return the time from the cup edge to the landing of the plug, excluding the release delay, ms."""
    return READING_MS + OPENING_MS + 1000 * machine.handling.fall_s(0.0)
