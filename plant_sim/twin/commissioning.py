"""Machine as commissioned: default I/O map, parameters and program, and set-points that its dimensions require."""

from __future__ import annotations

from functools import cache, lru_cache

from controller.iomap.loader import DEFAULT_IO_MAP, IoMap, load_io_map
from controller.program.machine import Transplanter, build
from controller.program.set_points import SetPoints
from plant_sim.machine.parameters import Machine, load_machine

SLIDE_M_S = 0.15
"""Slide speed to which the throttles are adjusted, m/s."""


@cache
def default_io_map() -> IoMap:
    """Return the I/O map of the delivered machine."""
    return load_io_map(DEFAULT_IO_MAP)


@cache
def default_parameters() -> Machine:
    """Return the parameters of the delivered machine."""
    return load_machine()


@lru_cache(maxsize=8)
def program_of(io_map: IoMap) -> Transplanter:
    """Return the program for an I/O map; programs of the last maps are kept, because building one takes long."""
    return build(io_map)


def set_points_of(machine: Machine) -> dict[str, int]:
    """Return the initial values of the set-points that depend on the machine.

    `slide_least` is three quarters of the travel time from the first row's switch to the feed switch.
    """
    slide = machine.slide
    way_m = machine.picks_m[0] - 2 * (slide.switch_band_m + slide.switch_hysteresis_m)
    return {"slide_least": max(10, round(0.75 * way_m / SLIDE_M_S * 100))}


def needs_confirmation(machine: Machine) -> bool:
    """Return True if a constant of the machine differs from its default, so that a start must be confirmed with X25."""
    set_points = SetPoints()
    defaults = dict(set_points.defaults)
    return any(defaults[getattr(set_points, name)] != value for name, value in set_points_of(machine).items())
