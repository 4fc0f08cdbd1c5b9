"""Machine as commissioned: default I/O map, parameters and program, and set-points that its dimensions require."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import cache, lru_cache
from typing import Final

import yaml

from controller.common.errors import InputError
from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import Transplanter, build
from controller.program.requirements.travel_times import MachineData, TravelTimes, misfits
from controller.program.set_points import SetPoints
from plant_sim.devices.lift import LiftSpec
from plant_sim.devices.slide import SlideSpec
from plant_sim.devices.spreader import SpreaderSpec
from plant_sim.machine.parameters import Machine, load_machine

SLIDE_M_S: Final = 0.15
"""Slide speed to which the throttles are adjusted, m/s."""
SLIDE_START_MS: Final = 720
"""Longest delay of the slide by valve and start, ms: the air ahead of the piston must first exhaust (measured: 707)."""
SLIDE_LEAD_MS: Final = 60
"""Time by which the slide is sooner from switch to switch than at its speed, ms (measured: 57)."""
LIFT_M_S: Final = 0.2
"""Lift speed to which the throttles are adjusted, m/s."""
LIFT_START_MS: Final = 350
"""As `SLIDE_START_MS`, for the lift (measured: 330)."""
LIFT_SHORTEST_SHARE: Final = 0.43
"""Shortest time of the lift between its switches, relative to that of the whole stroke at its speed; it occurs if a jam
has vented the chamber ahead of the piston: 0.32 s instead of 0.75 s (`places.LIFT_LEAST_MS`)."""
BELT_M_S: Final = 0.2
"""Speed of the belt, m/s, which follows from spreader.emf_v_s_m in machine.yaml."""
BELT_START_MS: Final = 30
"""As `SLIDE_START_MS`, for the belt (measured: 15)."""


class MisfitError(InputError):
    """Raised for constants that do not fit the machine; the message is one line with the remedy."""


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
    """Return the machine constants that depend on the dimensions of the machine.

    `slide_least` is three quarters of the travel time from the first row's switch to the feed switch.
    """
    least = 0.75 * _ms(machine.picks_m[0] - _bands_m(machine.slide), SLIDE_M_S) / 10
    return {"slide_least": max(10, round(least)), "arms_may_meet": int(machine.layout.arms_may_meet_in_plant)}


def travel_times_of(machine: Machine) -> TravelTimes:
    """Return the travel times of a machine without faults, from its dimensions and the speeds of the delivered one.

    Other throttles, drives or pressures change these times; they are not considered.
    """
    slide, lift, belt = machine.slide, machine.lift, machine.spreader
    first_m, row_m = machine.picks_m[0], machine.picks_m[1] - machine.picks_m[0]
    return TravelTimes(
        lift_ms=_ms(lift.stroke_m, LIFT_M_S) + LIFT_START_MS,
        lift_shortest_ms=round(LIFT_SHORTEST_SHARE * _ms(lift.stroke_m, LIFT_M_S)),
        belt_ms=_ms(belt.travel_m, BELT_M_S) + BELT_START_MS,
        belt_shortest_ms=_ms(belt.travel_m - _bands_m(belt), BELT_M_S),
        row_1_ms=_ms(first_m, SLIDE_M_S) + SLIDE_START_MS,
        row_1_shortest_ms=_ms(first_m - _bands_m(slide), SLIDE_M_S) - SLIDE_LEAD_MS,
        row_ms=_ms(row_m, SLIDE_M_S),
        row_shortest_ms=_ms(row_m - _bands_m(slide), SLIDE_M_S) - SLIDE_LEAD_MS,
    )


def constants_file(machine: Machine) -> str:
    """Return the text of the constants file of a machine (``controller run --constants``)."""
    return yaml.safe_dump(set_points_of(machine) | asdict(travel_times_of(machine)), sort_keys=False)


def check_fit(program: Transplanter, machine: Machine, set_points: Mapping[str, int]) -> None:
    """Check that a program with set-points fits a machine.

    Args:
        program: Program of the machine.
        machine: Parameters of the machine.
        set_points: Values of set-points, by name; the others have their defaults.

    Raises:
        MisfitError: A time does not fit the machine, or the arms may meet although there is no room.
    """
    if set_points.get("arms_may_meet") and not machine.layout.arms_may_meet_in_plant:
        raise MisfitError("arms_may_meet: 1, but layout.arms_may_meet_in_plant of the machine is false; change one")
    sp = program.tags.sp
    values = {getattr(sp, name): value for name, value in set_points.items()}
    lines = misfits(program.program, program.tags, MachineData(travel_times_of(machine), values))
    if lines:
        raise MisfitError(f"{lines[0]}; correct the set-points or the parameters of the machine")


def needs_confirmation(machine: Machine) -> bool:
    """Return True if a constant of the machine differs from its default, so that a start must be confirmed with X25."""
    set_points, values = SetPoints(), set_points_of(machine)
    given = {getattr(set_points, name): value for name, value in values.items()}
    defaults = dict(set_points.defaults)
    return bool(set_points.changed(lambda word: given.get(word, defaults[word])))


def _ms(way_m: float, speed_m_s: float) -> int:
    return round(1_000 * way_m / speed_m_s)


def _bands_m(device: SlideSpec | LiftSpec | SpreaderSpec) -> float:
    """Return the part of the way between two places on which one of their switches is on, m."""
    return 2 * (device.switch_band_m + device.switch_hysteresis_m)
