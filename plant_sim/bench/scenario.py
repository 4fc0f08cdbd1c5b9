"""Scenarios: a story on the twin in simulated time, with faults, actions and what must come of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.io_map import IoMap
from controller.program.states import State
from plant_sim.bench.monitors import MONITORS, UnsafeError, guard, no_incident
from plant_sim.bench.twin import NotReachedError, Twin
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.faults import Fault, FaultError
from plant_sim.parameters import Machine


@dataclass(frozen=True, slots=True)
class When:
    """When to act: at a time, or a while after the machine is in a state or a step.

    Attributes:
        text: As it was written.
        at_ms: Simulated time since the start, ms.
        state: PackML state.
        step: 'sequence: step'.
        after_ms: How long after the state or step was first seen, ms.
    """

    text: str
    at_ms: int | None = None
    state: State | None = None
    step: str | None = None
    after_ms: int = 0

    def holds(self, twin: Twin) -> bool:
        """Whether the time has come, or the machine is there."""
        if self.at_ms is not None:
            return twin.now_ms >= self.at_ms
        if self.state is not None:
            return twin.state == self.state
        sequence, _, step = str(self.step).partition(": ")
        return twin.in_step(sequence, step)


@dataclass(frozen=True, slots=True)
class Action:
    """One thing that is done; actions are done one after the other.

    Attributes:
        when: Not before this, looked at from the action before on.
        text: What is done, for a person.
        do: Does it.
    """

    when: When
    text: str
    do: Callable[[Twin], None]


@dataclass(frozen=True, slots=True)
class Until:
    """Where a scenario ends, once every action is done.

    Attributes:
        limit_ms: At this time at the latest, ms.
        state: In this state; None: at the limit.
    """

    limit_ms: int
    state: State | None = None


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that must have come of it.

    Attributes:
        where: File and line.
        name: What is looked at.
        wanted: What it must be, for a person.
        look: Returns what it is.
        holds: Whether that is right.
    """

    where: str
    name: str
    wanted: str
    look: Callable[[Course], Any]
    holds: Callable[[Any], bool]

    def complaint(self, course: Course) -> str:
        """Return what is wrong on one line; empty if nothing is."""
        found = self.look(course)
        return "" if self.holds(found) else f"{self.where}: {self.name} is {_shown(found)}, expected {self.wanted}"


@dataclass(frozen=True)
class Scenario:
    """A story, read and checked; nothing has been started.

    Attributes:
        path: The file.
        title: What it is about.
        seed: Seed of everything random.
        trays: Trays in the magazine.
        io_map: The wires.
        machine: The machine, with the values of the scenario.
        set_points: First values of set-points.
        faults: What breaks.
        actions: What is done, in order.
        until: Where it ends.
        checks: What must come of it.
    """

    path: Path
    title: str
    seed: int
    trays: int
    io_map: IoMap
    machine: Machine
    set_points: dict[str, int]
    faults: tuple[Fault, ...]
    actions: tuple[Action, ...]
    until: Until
    checks: tuple[Check, ...]


class Course:
    """What happens in a scenario.

    Attributes:
        twin: The machine.
        alarms: Alarms that came on, and when the first time, ms.
        reason: Why it broke off; empty if it came to its end.
    """

    def __init__(self, twin: Twin) -> None:
        """Watch a machine."""
        self.twin = twin
        self.alarms: dict[str, int] = {}
        self.reason = ""
        twin.watch(self._see)

    @property
    def incidents(self) -> list[str]:
        """Kinds of what must not happen and did, once each, in order."""
        return list(dict.fromkeys(event.kind.value for event in self.twin.plant.events))

    def _see(self, twin: Twin) -> None:
        for key in twin.alarms():
            self.alarms.setdefault(key, twin.now_ms)


@dataclass(frozen=True, slots=True)
class ScenarioReport:
    """What came of a scenario.

    Attributes:
        title: What it is about.
        failures: What was expected and is not so, one line each.
        reason: Why it broke off; empty if it came to its end.
        checks: How many things were checked.
        state: PackML state at the end.
        simulated_s: Machine time, s.
        faults: The faults that struck, as they may be given on a command line.
        alarms: Alarms that came on, and when the first time, s.
        incidents: Kinds of what must not happen and did.
        cycles: Rows transplanted.
        missed_cups: Cups that passed empty, both rows.
        counts: Where the seedlings are.
    """

    title: str
    failures: list[str]
    reason: str
    checks: int
    state: str
    simulated_s: float
    faults: list[str]
    alarms: dict[str, float]
    incidents: list[str]
    cycles: int
    missed_cups: int
    counts: SeedlingCounts

    @property
    def passed(self) -> bool:
        """Whether it came to its end and everything was as expected."""
        return not self.reason and not self.failures

    def record(self) -> dict[str, object]:
        """Return the report as one JSON object."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        return {"passed": self.passed, **fields, "counts": {name: getattr(self.counts, name) for name in _PLACES}}

    def text(self) -> str:
        """Return the report for a person."""
        alarms = "; ".join(f"{key} at {at_s:.2f} s" for key, at_s in self.alarms.items())
        seedlings = ", ".join(f"{name} {getattr(self.counts, name)}" for name in _PLACES)
        lines = [
            f"{'passed' if self.passed else 'FAILED'}: {self.title}",
            f"{self.state} after {self.simulated_s:.2f} s, {self.cycles} cycles, missed cups {self.missed_cups}",
            f"faults {' '.join(self.faults) or 'none'}",
            f"alarms {alarms or 'none'}",
            f"incidents {', '.join(self.incidents) or 'none'}",
            f"seedlings {seedlings}",
            f"{self.checks - len(self.failures)} of {self.checks} checks hold",
        ]
        lines += [f"  {failure}" for failure in self.failures]
        if self.reason:
            lines.append(f"it did not come to its end: {self.reason}")
        return "\n".join(lines)


_PLACES = tuple(SeedlingCounts.__slots__)


def run_scenario(scenario: Scenario, *, prepare: Callable[[Twin], object] | None = None) -> ScenarioReport:
    """Let a scenario happen, in simulated time, under the safety monitors: one that trips ends it.

    Incidents at seedlings and trays are not theirs to judge: the scenario says which of them it expects.

    Args:
        scenario: The story.
        prepare: Called with the machine before its first scan, for example to record it.
    """
    twin = Twin(
        seed=scenario.seed,
        trays=scenario.trays,
        io_map=scenario.io_map,
        parameters=scenario.machine,
        set_points=scenario.set_points,
    )
    for fault in scenario.faults:
        twin.plant.faults.add(fault)
    course = Course(guard(twin, [monitor for monitor in MONITORS if monitor is not no_incident]))
    if prepare is not None:
        prepare(twin)
    try:
        _tell(scenario, twin)
    except (NotReachedError, FaultError, UnsafeError) as error:
        course.reason = str(error)
    complaints = [check.complaint(course) for check in scenario.checks]
    return ScenarioReport(
        title=scenario.title,
        failures=[complaint for complaint in complaints if complaint],
        reason=course.reason,
        checks=len(scenario.checks),
        state=twin.state.name,
        simulated_s=twin.now_ms / 1000,
        faults=[str(fault) for fault in twin.plant.faults.struck],
        alarms={key: at_ms / 1000 for key, at_ms in course.alarms.items()},
        incidents=course.incidents,
        cycles=len(twin.cycles()),
        missed_cups=sum(twin.plant.missed_cups.values()),
        counts=twin.plant.counts(),
    )


def _tell(scenario: Scenario, twin: Twin) -> None:
    """Scan, act when it is time, and stop at the end.

    Raises:
        NotReachedError: The limit came first.
        FaultError: An action breaks what is broken already, or mends what is not.
    """
    until = scenario.until
    for action in scenario.actions:
        _act(twin, action, until)
    if until.state is None:
        twin.run_for(until.limit_ms - twin.now_ms)
    else:
        _wait(twin, lambda: twin.state == until.state, until, until.state.name)


def _act(twin: Twin, action: Action, until: Until) -> None:
    """Wait until it is time for an action, and do it."""
    what = f"{action.when.text} ({action.text})"
    _wait(twin, lambda: action.when.holds(twin), until, what)
    due_ms = twin.now_ms + action.when.after_ms
    _wait(twin, lambda: twin.now_ms >= due_ms, until, what)
    action.do(twin)


def _wait(twin: Twin, condition: Callable[[], bool], until: Until, what: str) -> None:
    """Scan until a condition holds; it may do so already, but for the first scan."""
    if twin.now_ms == 0 or not condition():
        twin.run_until(condition, within_ms=until.limit_ms - twin.now_ms, what=what)


def _shown(found: object) -> str:
    """What was found, on one line."""
    if isinstance(found, float):
        return f"{found:g}"
    return ", ".join(map(str, found)) or "none" if isinstance(found, list) else str(found)
