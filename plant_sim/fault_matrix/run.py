"""Case of the fault matrix: a complete trial with one fault and an operator who repairs it after a stop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.operator.buttons import STUCK_MS
from controller.program.states import State
from controller.program.tags import SIDES
from plant_sim.common.defaults import DEFAULT_MACHINE
from plant_sim.crop.seedling import CELLS_ALONG, SeedlingCounts
from plant_sim.fault_matrix.first_signal import FirstSignal, ListedAlarms, Signal
from plant_sim.fault_matrix.following import Followed, follow
from plant_sim.faults import FAULTS, Fault
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.twin.lock_step import NotReachedError, Twin, TwinSnapshot
from plant_sim.twin.monitors import collect_violations
from plant_sim.twin.recovery import clear, home_again, questions, repair

TRAY_LIMIT_MS = 300_000
"""Time limit for a tray if the machine does not stop, ms; at 45 cups/min a tray takes 50 s."""
START_MS = 5_000
"""Time between the instants from which a case can continue, ms."""
OBSERVATION_MS = STUCK_MS + 1_000
"""Observation time of a stopped machine before the repair, ms; every alarm at standstill is raised by then."""
SUSPENDED_MS = 10_000
"""Time limit for a Suspended machine to resume, ms."""
ROUNDS = 3
"""Maximum number of recovery attempts by the operator."""

_ROW_ALARMS = {f"{side}: row short" for side in SIDES}

RESTS = (State.HELD, State.ABORTED, State.STOPPED, State.SUSPENDED)
"""States in which the machine has stopped and waits for an operator."""


@dataclass
class Outcome:
    """Outcome of a case.

    Attributes:
        fault: Fault of the case.
        signal: First signal; None if there is none.
        state: Name of the PackML state at the first stop, or at the end.
        trips: Monitor violations, by kind.
        asked: Questions to the operator.
        in_doubt: Number of seedlings in the rows and trays affected by the questions.
        away: Arms that had no alarm and were not at feed when the machine was Held.
        rounds: Number of recoveries by the operator.
        told_rows: Number of later stops that only told a row lost before, with a wired yield input.
        followed: For each stop, the presses of an operator who follows the line that says what to do now, without and
            with an isolation of the machine before the repair.
        counts: Final location of the seedlings.
        lost: Seedlings lost or left behind in excess of those in an undisturbed run.
        passed: True if a tray passed through the machine undetected, and the operator ended the trial without it.
        alarms: Largest number of alarms announced within ten minutes.
        folded: Alarms that were folded under the first one before the operator acted.
        beside: Alarms that were listed beside the first one before the operator acted, instead of under it.
        reason: Reason for an incomplete trial or for wrong counts of trays or rows; empty if there is none.
    """

    fault: Fault
    counts: SeedlingCounts
    lost: int
    signal: Signal | None = None
    state: str = ""
    trips: dict[str, str] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)
    in_doubt: int = 0
    away: list[str] = field(default_factory=list)
    rounds: int = 0
    told_rows: int = 0
    followed: list[Followed] = field(default_factory=list)
    passed: bool = False
    alarms: int = 0
    folded: list[str] = field(default_factory=list)
    beside: list[str] = field(default_factory=list)
    reason: str = ""

    @property
    def recovered(self) -> bool:
        """True if the trial completed with correct counts and with no seedling left in trays or claws."""
        return not self.reason and not self.left

    @property
    def is_harmful(self) -> bool:
        """True if a monitor has tripped, whether the program could have prevented it or not."""
        return bool(self.trips)

    @property
    def is_silently_harmful(self) -> bool:
        """True if a monitor has tripped and no signal occurred in the whole trial."""
        return self.is_harmful and self.signal is None

    @property
    def left(self) -> int:
        """Seedlings left in trays or claws."""
        return self.counts.in_tray + self.counts.in_claw


@dataclass(frozen=True, slots=True)
class MatrixSetup:
    """Common settings of all cases of a matrix.

    Attributes:
        seed: Seed of the plant.
        trays: Trays of a trial, 72 seedlings each.
        io_map: I/O map file.
        machine: Machine parameter file.
        wires: Tags of optional points that are wired besides those of the map.
    """

    seed: int = 1
    trays: int = 2
    io_map: Path = DEFAULT_IO_MAP
    machine: Path = DEFAULT_MACHINE
    wires: tuple[str, ...] = ()

    def twin(self, *faults: Fault) -> Twin:
        """Return a twin with the given faults, after power-up.

        Raises:
            IoMapError: The I/O map is invalid.
            MachineError: The parameters are invalid.
        """
        twin = Twin(
            seed=self.seed,
            trays=self.trays,
            io_map=_io_map(self.io_map, self.wires),
            parameters=_machine(self.machine),
            set_points={"trays_target": self.trays},
            faults=faults,
        )
        twin.plant.seedlings.make_typical()  # so that every loss is caused by the fault
        return twin


@cache
def _io_map(path: Path, wires: tuple[str, ...]) -> IoMap:
    return load_io_map(path).with_wired(wires)


@cache
def _machine(path: Path) -> Machine:
    return load_machine(path)


class CaseStart(NamedTuple):
    """Instant of a trial without a fault, from which a case can continue.

    Attributes:
        at_ms: Time, ms.
        snapshot: State of the twin.
        entered_ms: Time of entry into the active steps, ms; see `FirstSignal`.
    """

    at_ms: int
    snapshot: TwinSnapshot
    entered_ms: Mapping[int, int]


class Undisturbed(NamedTuple):
    """Trial without a fault.

    Attributes:
        begins_ms: Time of entering Execute, ms.
        ends_ms: Time of entering Complete, ms.
        counts: Final location of the seedlings.
        cycles: Rows thrown (released over the cups).
        twin: The twin, which is reused by the cases.
        starts: Instants of the trial, from entering Execute `START_MS` apart, up to the first violation, if any.
    """

    begins_ms: int
    ends_ms: int
    counts: SeedlingCounts
    cycles: int
    twin: Twin
    starts: tuple[CaseStart, ...]


@cache
def undisturbed(setting: MatrixSetup) -> Undisturbed:
    """Run a trial without a fault."""
    twin = setting.twin()
    trips, signal = collect_violations(twin), FirstSignal(twin, from_ms=0)
    twin.home()
    twin.start()
    begins_ms = twin.now_ms
    starts = [CaseStart(begins_ms, twin.snapshot(), dict(signal.entered_ms))] if not trips else []
    complete = twin.machine.tags.machine.state.equals(State.COMPLETE)
    while not twin.runs_until(complete, for_ms=START_MS):
        if twin.now_ms - begins_ms > setting.trays * TRAY_LIMIT_MS:
            raise NotReachedError(f"the trial without a fault does not complete; {twin.situation()}")
        if not trips:
            starts.append(CaseStart(twin.now_ms, twin.snapshot(), dict(signal.entered_ms)))
    return Undisturbed(begins_ms, twin.now_ms, twin.plant.counts(), thrown(twin), twin, tuple(starts))


def thrown(twin: Twin) -> int:
    """Return the number of rows released over the cups, as counted by the program."""
    return sum(twin.plc.read(twin.machine.tags.arms[side].cycles) for side in SIDES)


def run_case(fault: Fault, setting: MatrixSetup) -> Outcome:
    """Run a trial with a fault, with recovery by the operator after every stop.

    Args:
        fault: The fault; it lasts until the repair.
        setting: Machine and trial.
    """
    reference = undisturbed(setting)
    start = _start_of(fault, reference)
    twin = _twin_at(start, fault, setting)
    outcome = Outcome(fault, twin.plant.counts(), 0, trips=collect_violations(twin))
    first_signal = FirstSignal(twin, fault.start_ms, entered_ms=start.entered_ms if start else {})
    listed = ListedAlarms(twin, fault.start_ms)
    try:
        _begin(twin, fault, start)
        _work(twin, outcome, listed, setting.trays)
    except NotReachedError as error:
        outcome.reason = str(error)
    outcome.signal = first_signal.signal
    outcome.alarms, outcome.folded, outcome.beside = listed.most, sorted(listed.folded), sorted(listed.beside)
    outcome.state = outcome.state or twin.state.name
    _account(twin, outcome, reference, setting.trays)
    return outcome


def run_unattended(fault: Fault, setting: MatrixSetup, for_ms: int) -> ListedAlarms:
    """Run a trial with a fault that nobody repairs, and to which nobody reacts; return its alarms.

    Args:
        fault: The fault.
        setting: Machine and trial.
        for_ms: Time after the start of the fault, ms.

    Raises:
        NotReachedError: The machine does not start.
    """
    start = _start_of(fault, undisturbed(setting))
    twin = _twin_at(start, fault, setting)
    listed = ListedAlarms(twin, fault.start_ms)
    _begin(twin, fault, start)
    twin.run_for(fault.start_ms + for_ms - twin.now_ms)
    return listed


def _start_of(fault: Fault, reference: Undisturbed) -> CaseStart | None:
    """Return the latest instant before a fault; None for a fault that is set before the run."""
    if FAULTS[fault.kind].permanent:
        return None
    return next((start for start in reversed(reference.starts) if start.at_ms < fault.start_ms), None)


def _twin_at(start: CaseStart | None, fault: Fault, setting: MatrixSetup) -> Twin:
    """Return a twin at an instant of the undisturbed trial, or after power-up."""
    if start is None:
        return setting.twin(fault) if FAULTS[fault.kind].permanent else setting.twin()
    twin = undisturbed(setting).twin
    twin.restore(start.snapshot)
    twin.unwatch()
    return twin


def _begin(twin: Twin, fault: Fault, start: CaseStart | None) -> None:
    """Set a fault and, after power-up, home and start the machine.

    Raises:
        NotReachedError: The machine does not start.
    """
    if not FAULTS[fault.kind].permanent:
        twin.plant.faults.add(fault)
    if start is None:
        twin.home()
        twin.start()


def _work(twin: Twin, outcome: Outcome, listed: ListedAlarms, trays: int) -> None:
    """Run to Complete, with recovery by the operator after every stop.

    Raises:
        NotReachedError: Complete is not reached.
    """
    while True:
        twin.run_until_state(State.COMPLETE, *RESTS, within_ms=trays * TRAY_LIMIT_MS)
        if twin.state is State.COMPLETE:
            return
        outcome.state = outcome.state or twin.state.name
        outcome.rounds += 1
        outcome.told_rows += outcome.rounds > 1 and {*twin.alarms()} <= _ROW_ALARMS
        if outcome.rounds > ROUNDS:
            raise NotReachedError(f"repeated stops; {twin.situation()}")
        observe(twin, outcome)
        listed.repaired()
        mend = partial(_mend, twin, outcome.fault)
        outcome.followed += [follow(twin, mend, isolated=isolated) for isolated in (False, True)]
        resume(twin, outcome)


def observe(twin: Twin, outcome: Outcome) -> None:
    """Observe a stopped machine, and note its open questions."""
    if twin.state is State.HELD:
        outcome.away += away_from_feed(twin)
    twin.run_for(OBSERVATION_MS)
    _note_questions(twin, outcome)


def resume(twin: Twin, outcome: Outcome) -> None:
    """Repair the fault, clear the stop, answer the questions, home the machine and start it.

    Raises:
        NotReachedError: The machine does not resume.
    """
    _mend(twin, outcome.fault)
    if twin.state is State.SUSPENDED:
        conveyor = twin.plant.conveyor
        if not conveyor.front_m and not conveyor.in_magazine:
            outcome.passed = True
            twin.command("complete")
            twin.run_until_state(State.COMPLETE, within_ms=TRAY_LIMIT_MS)
            return
        twin.press("start")
        suspended = twin.machine.tags.machine.state.equals(State.SUSPENDED)
        twin.run_until(~suspended, within_ms=SUSPENDED_MS, what="resuming")
        return
    if twin.state is State.ABORTED:
        clear(twin)
    _note_questions(twin, outcome)
    for question in home_again(twin):
        _note(twin, outcome, question)
    twin.start()


def _mend(twin: Twin, fault: Fault) -> None:
    if any(each.name == fault.name for each in twin.plant.faults.active):
        repair(twin, fault)


def away_from_feed(twin: Twin) -> list[str]:
    """Return the arms that have no alarm and are not at feed."""
    feed_m = twin.parameters.handling.feed_tolerance_m
    arms = twin.machine.tags.arms
    return [side for side in SIDES if not twin.plc.read(arms[side].fault) and twin.plant.arms[side].slide.x_m > feed_m]


def _note_questions(twin: Twin, outcome: Outcome) -> None:
    for question in questions(twin):
        _note(twin, outcome, question)


def _note(twin: Twin, outcome: Outcome, question: str) -> None:
    """Record a question and the number of seedlings affected."""
    if question not in outcome.asked:
        outcome.asked.append(question)
        outcome.in_doubt += twin.plant.counts().in_tray if question == "tray" else CELLS_ALONG


def _account(twin: Twin, outcome: Outcome, reference: Undisturbed, trays: int) -> None:
    """Check the counts and compare them with those of the undisturbed trial."""
    counts = outcome.counts = twin.plant.counts()
    outcome.lost = (counts.total - counts.in_cups) - (reference.counts.total - reference.counts.in_cups)
    if outcome.reason or outcome.passed:
        return
    complaints = []
    if (done := twin.plc.read(twin.machine.tags.machine.trays_done)) != trays:
        complaints.append(f"{done} trays counted, not {trays}")
    if (rows := thrown(twin)) != reference.cycles:
        complaints.append(f"{rows} rows counted, not {reference.cycles}")
    outcome.reason = "; ".join(complaints)
