"""Second table of the fault matrix: its cases, grouped by stop and moment so that each stop is simulated once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from controller.common.suggestion import suggestion
from controller.program.tags import SIDES
from plant_sim.fault_matrix.at_rest import KINDS, RestCase, RestOutcome, run_at_rest
from plant_sim.fault_matrix.rest_report import RestResult
from plant_sim.fault_matrix.run import MatrixSetup, undisturbed
from plant_sim.fault_matrix.situations import (
    TRAY_SWITCH,
    Situation,
    Spell,
    longest_spells,
    spells_between,
)
from plant_sim.fault_matrix.stops import STOPS, StopKind
from plant_sim.faults import FaultError
from plant_sim.machine.arm import ARM_SWITCHES

PERIOD_MS: Final = 1_000
"""Period of the trial that is searched for situations in one job, ms."""


class RestJob(NamedTuple):
    """Cases of one stop at one moment.

    Attributes:
        stop: Name of the kind of stop.
        at_ms: Moment of the stop, ms.
        situations: Situations of which the cases are run.
        cases: The cases.
    """

    stop: str
    at_ms: int
    situations: tuple[Situation, ...]
    cases: tuple[RestCase, ...]


@dataclass(frozen=True)
class RestSelection:
    """Part of the second table.

    Attributes:
        stops: Kinds of stop.
        faults: Kinds of fault and switches, without the side.
    """

    stops: tuple[StopKind, ...]
    faults: tuple[tuple[str, str], ...]


ALL_FAULTS: Final = tuple((kind, switch) for switch in (*ARM_SWITCHES, TRAY_SWITCH) for kind in KINDS)


def selection(stops: Iterable[str] = (), faults: Iterable[str] = ()) -> RestSelection:
    """Return a part of the table.

    Args:
        stops: Names of kinds of stop; all if empty.
        faults: Selection as KIND or KIND:SWITCH, without the side; all if empty.

    Raises:
        FaultError: A name is unknown.
    """
    named = {stop.name: stop for stop in STOPS}
    for name in stops:
        if name not in named:
            raise FaultError(f"--stop {name}: unknown kind of stop; {suggestion(name, named)}")
    chosen = [fault for text in faults for fault in _faults_of(text)] or ALL_FAULTS
    return RestSelection(tuple(named[name] for name in stops) or STOPS, tuple(dict.fromkeys(chosen)))


def _faults_of(text: str) -> list[tuple[str, str]]:
    kind, colon, switch = text.partition(":")
    if kind not in KINDS:
        raise FaultError(f"{kind}: does not occur at rest; {suggestion(kind, KINDS)}")
    switch = switch.removeprefix(f"{SIDES[0]}.").removeprefix(f"{SIDES[1]}.")
    switches = (*ARM_SWITCHES, TRAY_SWITCH)
    if colon and switch not in switches:
        raise FaultError(f"{text}: is not a position switch; {suggestion(switch, switches)}")
    return [fault for fault in ALL_FAULTS if fault[0] == kind and switch in {"", fault[1]}]


def periods(setting: MatrixSetup) -> list[tuple[int, int]]:
    """Return the periods of the undisturbed trial that are searched for situations, ms."""
    trial = undisturbed(setting)
    firsts = range(trial.begins_ms, trial.ends_ms, PERIOD_MS)
    return [(first, min(first + PERIOD_MS, trial.ends_ms)) for first in firsts]


def search(period: tuple[int, int], setting: MatrixSetup, stops: Sequence[StopKind]) -> list[Spell]:
    """Return the spells in one period; see `spells_between`."""
    return spells_between(*period, setting, stops=stops)


def jobs_of(spells: Iterable[Spell], chosen: RestSelection) -> list[RestJob]:
    """Return one job per stop and moment, for the middle of the longest spell of every situation."""
    situations: dict[tuple[str, int], list[Situation]] = {}
    for spell in longest_spells(spells):
        situations.setdefault((spell.situation.stop, spell.middle_ms), []).append(spell.situation)
    return [
        RestJob(stop, at_ms, tuple(known), _cases(stop, at_ms, known, chosen))
        for (stop, at_ms), known in situations.items()
    ]


def jobs_at(moments: Iterable[int], chosen: RestSelection) -> list[RestJob]:
    """Return the jobs of both arms at the given moments, whatever the situations are."""
    jobs = []
    for at_ms in moments:
        for stop in chosen.stops:
            known = [Situation(stop.name, side, (), ()) for side in SIDES]
            jobs.append(RestJob(stop.name, at_ms, tuple(known), _cases(stop.name, at_ms, known, chosen)))
    return jobs


def run_job(job: RestJob, setting: MatrixSetup) -> list[RestOutcome]:
    """Run the cases of a job; the first outcome is that of the stop without a fault."""
    stop = next(stop for stop in STOPS if stop.name == job.stop)
    return run_at_rest(stop, job.at_ms, job.cases, setting)


def results_of(job: RestJob, outcomes: Iterable[RestOutcome]) -> list[RestResult]:
    """Return the outcomes of a job with the situations of their arms; the stop without a fault is the first."""
    by_side = {situation.side: situation for situation in job.situations}
    first = job.situations[0]
    return [RestResult(by_side[outcome.case.side] if outcome.case.kind else first, outcome) for outcome in outcomes]


def _cases(stop: str, at_ms: int, known: Iterable[Situation], chosen: RestSelection) -> tuple[RestCase, ...]:
    return tuple(
        RestCase(stop, at_ms, situation.side, kind, switch) for situation in known for kind, switch in chosen.faults
    )
