"""Expectations of a scenario."""

from __future__ import annotations

from collections.abc import Callable

from controller.common.yaml_section import Section, one_of
from controller.program.machine import Transplanter
from controller.program.states import State
from plant_sim.common.units import parse_bounds
from plant_sim.crop.incident import Incident
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.machine.plant import Plant
from plant_sim.scenario.run import Check, ScenarioRun

_KEYS = ("state", "alarms", "incidents", "counts", "cycles", "missed_cups", "time", "measures")
_PLACES = SeedlingCounts.__slots__


Gauge = Callable[[Plant], float]
"""Function that measures a value of the plant at the end of a scenario."""


def _gauges(side: str) -> dict[str, tuple[str, Gauge]]:
    """Return the unit and the gauge of each measurement on an arm."""
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
"""Unit and gauge of every measurement."""


def read_checks(file: Section, program: Transplanter) -> tuple[Check, ...]:
    """Read the expectations; if there is no entry for incidents, none are expected.

    Args:
        file: Scenario file.
        program: Program that the scenario runs.

    Raises:
        ScenarioError: An expectation is invalid.
    """
    section = file.section("expect", _KEYS)
    if section is None:
        raise file.error("expect", "is missing; add the expected results, for example expect: {alarms: []}")
    checks = [_incidents(section)]
    if "state" in section:
        name = section.read("state", one_of("state", State.__members__))
        checks.append(Check(section.where("state"), "state", name, lambda run: run.twin.state.name, name.__eq__))
    if "alarms" in section:
        checks += _alarms(section, program)
    numbers: dict[str, tuple[str, Callable[[ScenarioRun], float]]] = {
        "cycles": ("-", lambda run: len(run.twin.cycles())),
        "missed_cups": ("-", lambda run: sum(run.twin.plant.missed_cups.values())),
        "time": ("ms", lambda run: run.twin.now_ms),
    }
    checks += [_bounded(section, name, unit, read) for name, (unit, read) in numbers.items() if name in section]
    checks += _counts(section) + _measured(section)
    if len(checks) == 1 and "incidents" not in section:
        raise section.error(None, f"contains no expectation; add one or more of {', '.join(_KEYS)}")
    return tuple(checks)


def _incidents(section: Section) -> Check:
    wanted = _names(section, "incidents", "incident", [kind.value for kind in Incident])
    return Check(
        section.where("incidents"),
        "incidents",
        ", ".join(wanted) or "none",
        lambda run: run.incidents,
        lambda incidents: set(incidents) == set(wanted),
    )


def _names(section: Section, key: str, what: str, known: list[str]) -> list[str]:
    """Return the names in a list after checking that each is known."""
    read = one_of(what, known)
    return [section.checked(key, read, word) for word in section.words(key)]


def _alarms(section: Section, program: Transplanter) -> list[Check]:
    """Return the checks of the raised alarms, regardless of their order, and of their times."""
    read = one_of("alarm", [f"{alarm.side}: {alarm.key}" if alarm.side else alarm.key for alarm in program.alarms])
    wanted: list[str] = []
    times: list[Check] = []
    for entry in section.entries("alarms", ("alarm", "time")):
        if isinstance(entry, Section):
            wanted.append(entry.read("alarm", read))
            times.append(_alarm_time(entry, wanted[-1]))
        else:
            wanted.append(section.checked("alarms", read, entry))
    raised = Check(
        section.where("alarms"),
        "alarms",
        ", ".join(wanted) or "none",
        lambda run: list(run.alarms),
        lambda alarms: sorted(alarms) == sorted(wanted),
    )
    return [raised, *times]


def _alarm_time(entry: Section, key: str) -> Check:
    """Return the check of the time of an alarm."""
    bounds = entry.read("time", lambda text: parse_bounds(text, "ms"))
    return Check(
        entry.where("time"),
        f"time of {key}, ms",
        bounds.text,
        lambda run: run.alarms.get(key),
        lambda at_ms: at_ms is not None and bounds.hold(at_ms),
    )


def _counts(section: Section) -> list[Check]:
    """Return the checks of the seedling counts."""
    counts = section.section("counts", _PLACES)
    return [] if counts is None else [_count(counts, name) for name in counts]


def _count(counts: Section, name: str) -> Check:
    return _bounded(counts, name, "-", lambda run: float(getattr(run.twin.plant.counts(), name)))


def _measured(section: Section) -> list[Check]:
    """Return the checks of the measurements."""
    measures = section.section("measures", GAUGES)
    return [] if measures is None else [_measure(measures, name) for name in measures]


def _measure(measures: Section, name: str) -> Check:
    unit, gauge = GAUGES[name]
    return _bounded(measures, name, unit, lambda run: gauge(run.twin.plant))


def _bounded(section: Section, name: str, unit: str, read: Callable[[ScenarioRun], float]) -> Check:
    """Return the check that a number is within bounds."""
    bounds = section.read(name, lambda text: parse_bounds(text, unit))
    label = name if unit == "-" else f"{name}, {unit}"
    return Check(section.where(name), label, bounds.text, read, bounds.hold)
