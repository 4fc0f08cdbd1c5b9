"""Scenarios: test sequences on the twin in simulated time, with faults, actions and expectations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.common.modbus.io_map import IoMap
from controller.core.devices import ANNUNCIATORS
from controller.core.expr import Bit
from controller.program.states import State
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.faults import Fault, FaultError
from plant_sim.machine.parameters import Machine
from plant_sim.twin.lock_step import NotReachedError, Twin
from plant_sim.twin.monitors import MONITORS, UnsafeError, guard, no_incident


@dataclass(frozen=True, slots=True)
class When:
    """Trigger of an action: a time, or a delay after the machine enters a state or a step.

    Attributes:
        text: Text in the scenario file.
        at_ms: Simulated time since the start, ms.
        state: PackML state.
        step: 'sequence: step'.
        after_ms: Delay after the state or step is first observed, ms.
    """

    text: str
    at_ms: int | None = None
    state: State | None = None
    step: str | None = None
    after_ms: int = 0

    def holds(self, twin: Twin) -> bool:
        """Return True if the time, state or step has been reached."""
        if self.at_ms is not None:
            return twin.now_ms >= self.at_ms
        if self.state is not None:
            return twin.state == self.state
        sequence, _, step = str(self.step).partition(": ")
        return twin.in_step(sequence, step)


@dataclass(frozen=True, slots=True)
class Action:
    """Action of a scenario; actions run in sequence.

    Attributes:
        when: Trigger, evaluated after the previous action.
        text: Description for the user.
        do: Effect on the twin.
    """

    when: When
    text: str
    do: Callable[[Twin], None]


@dataclass(frozen=True, slots=True)
class Until:
    """End of a scenario after its last action.

    Attributes:
        limit_ms: Time limit, ms.
        state: PackML state that ends the scenario; None if it ends at the limit.
    """

    limit_ms: int
    state: State | None = None


@dataclass(frozen=True, slots=True)
class Check:
    """Expected result.

    Attributes:
        where: File and line.
        name: Name of the checked value.
        wanted: Expected value as text.
        read: Function that returns the actual value.
        holds: Predicate that the actual value must satisfy.
    """

    where: str
    name: str
    wanted: str
    read: Callable[[ScenarioRun], Any]
    holds: Callable[[Any], bool]

    def complaint(self, run: ScenarioRun) -> str:
        """Return the failure in one line; empty if the check passed."""
        actual = self.read(run)
        return "" if self.holds(actual) else f"{self.where}: {self.name} is {_shown(actual)}, expected {self.wanted}"


@dataclass(frozen=True)
class Scenario:
    """Validated scenario.

    Attributes:
        path: Scenario file.
        title: Title of the scenario.
        seed: Seed of the random numbers.
        trays: Trays in the magazine.
        io_map: I/O map.
        machine: Machine parameters, including the values of the scenario.
        set_points: Initial values of set-points.
        faults: Faults set before the run.
        actions: Actions in order.
        until: End of the scenario.
        checks: Expected results.
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


class ScenarioRun:
    """Observations during the run of a scenario.

    Attributes:
        twin: Twin under test.
        alarms: Raised alarms with the time of the first occurrence, ms.
        reason: Reason for an early end; empty if the scenario completed.
    """

    def __init__(self, twin: Twin) -> None:
        """Initialise an observer of a twin."""
        self.twin = twin
        self.alarms: dict[str, int] = {}
        self.reason = ""
        twin.watch(self._record_alarms, devices=(Bit("S", number) for number in ANNUNCIATORS))

    @property
    def incidents(self) -> list[str]:
        """Kinds of incident, each listed once, in order of occurrence."""
        return list(dict.fromkeys(event.kind.value for event in self.twin.plant.events))

    def _record_alarms(self, twin: Twin) -> None:
        for key in twin.alarms():
            self.alarms.setdefault(key, twin.now_ms)


@dataclass(frozen=True, slots=True)
class ScenarioReport:
    """Report of a scenario.

    Attributes:
        title: Title of the scenario.
        failures: Failed checks, one line each.
        reason: Reason for an early end; empty if the scenario completed.
        checks: Number of checks.
        state: PackML state at the end.
        simulated_s: Machine time, s.
        faults: Faults that occurred, in command-line notation.
        alarms: Raised alarms with the time of the first occurrence, s.
        incidents: Kinds of incident that occurred.
        cycles: Rows transplanted.
        missed_cups: Cups that passed empty, total of both rows.
        counts: Location of the seedlings.
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
        """True if the scenario completed and every check passed."""
        return not self.reason and not self.failures

    def record(self) -> dict[str, object]:
        """Return the report as one JSON object."""
        fields = {name: getattr(self, name) for name in self.__slots__}
        return {"passed": self.passed, **fields, "counts": {name: getattr(self.counts, name) for name in _PLACES}}

    def text(self) -> str:
        """Return the report as text."""
        alarms = "; ".join(f"{key} at {at_s:.2f} s" for key, at_s in self.alarms.items())
        seedlings = ", ".join(f"{name} {getattr(self.counts, name)}" for name in _PLACES)
        lines = [
            f"{'passed' if self.passed else 'FAILED'}: {self.title}",
            f"{self.state} after {self.simulated_s:.2f} s, {self.cycles} cycles, missed cups {self.missed_cups}",
            f"faults {' '.join(self.faults) or 'none'}",
            f"alarms {alarms or 'none'}",
            f"incidents {', '.join(self.incidents) or 'none'}",
            f"seedlings {seedlings}",
            f"{self.checks - len(self.failures)} of {self.checks} checks passed",
        ]
        lines += [f"  {failure}" for failure in self.failures]
        if self.reason:
            lines.append(f"the scenario did not complete: {self.reason}")
        return "\n".join(lines)


_PLACES = tuple(SeedlingCounts.__slots__)


def run_scenario(scenario: Scenario, *, prepare: Callable[[Twin], object] | None = None) -> ScenarioReport:
    """Run a scenario in simulated time under the safety monitors; a violation ends the run.

    Incidents with seedlings and trays do not end the run, because a scenario can expect them.

    Args:
        scenario: The scenario.
        prepare: Function called with the twin before its first scan, for example to record it.
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
    run = ScenarioRun(guard(twin, [monitor for monitor in MONITORS if monitor is not no_incident]))
    if prepare is not None:
        prepare(twin)
    try:
        _play(scenario, twin)
    except (NotReachedError, FaultError, UnsafeError) as error:
        run.reason = str(error)
    complaints = [check.complaint(run) for check in scenario.checks]
    return ScenarioReport(
        title=scenario.title,
        failures=[complaint for complaint in complaints if complaint],
        reason=run.reason,
        checks=len(scenario.checks),
        state=twin.state.name,
        simulated_s=twin.now_ms / 1000,
        faults=[str(fault) for fault in twin.plant.faults.activated],
        alarms={key: at_ms / 1000 for key, at_ms in run.alarms.items()},
        incidents=run.incidents,
        cycles=len(twin.cycles()),
        missed_cups=sum(twin.plant.missed_cups.values()),
        counts=twin.plant.counts(),
    )


def _play(scenario: Scenario, twin: Twin) -> None:
    """Run the scans and, when triggered, the actions, until the end of the scenario.

    Raises:
        NotReachedError: The time limit has expired.
        FaultError: An action adds a fault that is already active, or ends one that is not active.
    """
    until = scenario.until
    for action in scenario.actions:
        _act(twin, action, until)
    if until.state is None:
        twin.run_for(until.limit_ms - twin.now_ms)
    elif twin.now_ms == 0 or twin.state != until.state:
        twin.run_until_state(until.state, within_ms=until.limit_ms - twin.now_ms)


def _act(twin: Twin, action: Action, until: Until) -> None:
    """Wait for the trigger of an action and run the action."""
    what = f"{action.when.text} ({action.text})"
    _wait(twin, lambda: action.when.holds(twin), until, what)
    due_ms = twin.now_ms + action.when.after_ms
    if due_ms > until.limit_ms:
        twin.run_for(until.limit_ms - twin.now_ms)
        raise NotReachedError(f"{what} not reached within {until.limit_ms} ms; {twin.situation()}")
    twin.run_for(due_ms - twin.now_ms)
    action.do(twin)


def _wait(twin: Twin, condition: Callable[[], bool], until: Until, what: str) -> None:
    """Scan until a condition holds; at time 0, run at least one scan."""
    if twin.now_ms == 0 or not condition():
        twin.run_until(condition, within_ms=until.limit_ms - twin.now_ms, what=what)


def _shown(actual: object) -> str:
    """Return an actual value as one line of text."""
    if isinstance(actual, float):
        return f"{actual:g}"
    return ", ".join(map(str, actual)) or "none" if isinstance(actual, list) else str(actual)
