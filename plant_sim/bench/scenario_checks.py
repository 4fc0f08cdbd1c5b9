"""What may be expected of a scenario."""

from __future__ import annotations

from collections.abc import Callable

from controller.program.machine import Transplanter
from controller.program.states import State
from plant_sim.bench.scenario import Check, Course
from plant_sim.bench.scenario_section import Section, one_of
from plant_sim.crop.incident import Incident
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.plant import Plant
from plant_sim.quantity import parse_bounds

_KEYS = ("state", "alarms", "incidents", "counts", "cycles", "missed_cups", "time", "measures")
_PLACES = SeedlingCounts.__slots__


Gauge = Callable[[Plant], float]
"""Measures something at the machine when a scenario ends."""


def _gauges(side: str) -> dict[str, tuple[str, Gauge]]:
    """Unit and gauge of what can be measured at an arm."""
    return {
        f"{side}.slide.position": ("m", lambda plant: plant.arms[side].slide.position_m),
        f"{side}.lift.rise": ("m", lambda plant: plant.arms[side].lift.rise_m),
        f"{side}.claws.angle": ("deg", lambda plant: plant.arms[side].claws.angle_deg),
        f"{side}.claws.clamp": ("N", lambda plant: plant.arms[side].claws.clamp_n),
        f"{side}.spreader.travel": ("m", lambda plant: plant.arms[side].spreader.travel_m),
    }


GAUGES: dict[str, tuple[str, Gauge]] = {
    "supply.pressure": ("Pa", lambda plant: plant.supply.pressure_pa),
    "supply.claw_pressure": ("Pa", lambda plant: plant.supply.claw_pressure_pa),
    "conveyor.lost_steps": ("-", lambda plant: plant.conveyor.lost_steps),
    **_gauges("left"),
    **_gauges("right"),
}
"""Unit and gauge of everything that can be measured."""


def read_checks(file: Section, program: Transplanter) -> tuple[Check, ...]:
    """Read what is expected; unless the file says otherwise, that includes that nothing happens that must not.

    Args:
        file: The scenario.
        program: The program it runs.

    Raises:
        ScenarioError: something in it is wrong.
    """
    section = file.section("expect", _KEYS)
    if section is None:
        raise file.error("expect", "is missing; add what must come of it, as expect: {alarms: []}")
    checks = [_incidents(section)]
    if "state" in section:
        name = section.read("state", one_of("state", State.__members__))
        checks.append(Check(section.where("state"), "state", name, lambda course: course.twin.state.name, name.__eq__))
    if "alarms" in section:
        checks += _alarms(section, program)
    numbers: dict[str, tuple[str, Callable[[Course], float]]] = {
        "cycles": ("-", lambda course: len(course.twin.cycles())),
        "missed_cups": ("-", lambda course: sum(course.twin.plant.missed_cups.values())),
        "time": ("ms", lambda course: course.twin.now_ms),
    }
    checks += [_bounded(section, name, unit, look) for name, (unit, look) in numbers.items() if name in section]
    checks += _counts(section) + _measured(section)
    if len(checks) == 1 and "incidents" not in section:
        raise section.error(None, f"expects nothing; add {', '.join(_KEYS)}")
    return tuple(checks)


def _incidents(section: Section) -> Check:
    wanted = _names(section, "incidents", "incident", [kind.value for kind in Incident])
    return Check(
        section.where("incidents"),
        "incidents",
        ", ".join(wanted) or "none",
        lambda course: course.incidents,
        lambda found: set(found) == set(wanted),
    )


def _names(section: Section, key: str, what: str, known: list[str]) -> list[str]:
    """The words of a list, each one of some names."""
    read = one_of(what, known)
    return [section.checked(key, read, word) for word in section.words(key)]


def _alarms(section: Section, program: Transplanter) -> list[Check]:
    """That exactly these alarms came on, in whatever order, and when."""
    read = one_of("alarm", [f"{alarm.side}: {alarm.key}" if alarm.side else alarm.key for alarm in program.alarms])
    wanted: list[str] = []
    times: list[Check] = []
    for entry in section.entries("alarms", ("alarm", "time")):
        if isinstance(entry, Section):
            wanted.append(entry.read("alarm", read))
            times.append(_alarm_time(entry, wanted[-1]))
        else:
            wanted.append(section.checked("alarms", read, entry))
    came = Check(
        section.where("alarms"),
        "alarms",
        ", ".join(wanted) or "none",
        lambda course: list(course.alarms),
        lambda found: sorted(found) == sorted(wanted),
    )
    return [came, *times]


def _alarm_time(entry: Section, key: str) -> Check:
    """That an alarm came on in time."""
    bounds = entry.read("time", lambda text: parse_bounds(text, "ms"))
    return Check(
        entry.where("time"),
        f"time of {key}, ms",
        bounds.text,
        lambda course: course.alarms.get(key),
        lambda found: found is not None and bounds.hold(found),
    )


def _counts(section: Section) -> list[Check]:
    """How many seedlings are where."""
    counts = section.section("counts", _PLACES)
    return [] if counts is None else [_count(counts, name) for name in counts]


def _count(counts: Section, name: str) -> Check:
    return _bounded(counts, name, "-", lambda course: float(getattr(course.twin.plant.counts(), name)))


def _measured(section: Section) -> list[Check]:
    """Where things stand."""
    measures = section.section("measures", GAUGES)
    return [] if measures is None else [_measure(measures, name) for name in measures]


def _measure(measures: Section, name: str) -> Check:
    unit, gauge = GAUGES[name]
    return _bounded(measures, name, unit, lambda course: gauge(course.twin.plant))


def _bounded(section: Section, name: str, unit: str, look: Callable[[Course], float]) -> Check:
    """That a number lies within bounds."""
    bounds = section.read(name, lambda text: parse_bounds(text, unit))
    shown = name if unit == "-" else f"{name}, {unit}"
    return Check(section.where(name), shown, bounds.text, look, bounds.hold)
