"""Cases of the second table: a switch that sticks while the machine rests, and the recovery by the operator's book."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from controller.events.kinds import AlarmEvent, StateEvent
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.crop.seedling import TRAY_CELLS, SeedlingCounts
from plant_sim.fault_matrix.run import (
    RESTS,
    ROUNDS,
    TRAY_LIMIT_MS,
    MatrixSetup,
    Outcome,
    observe,
    resume,
    thrown,
    undisturbed,
)
from plant_sim.fault_matrix.situations import TRAY_SWITCH, come_to_rest, twin_at
from plant_sim.fault_matrix.stops import StopKind
from plant_sim.faults import Fault
from plant_sim.twin.lock_step import NotReachedError, Twin
from plant_sim.twin.monitors import STOP_ALARMS, collect_violations
from plant_sim.twin.progress import ROWS_A_TRAY
from plant_sim.twin.recovery import HOMING_LIMIT_MS, answer_truly, begin_homing, questions

KINDS: Final = ("stuck_on", "stuck_off")
UNAWARE_MS: Final = 500
"""Time from the fault until the operator acts, ms."""
START_LIMIT_MS: Final = 1_000
ANSWERS: Final = 2
"""Number of times that the operator homes a machine that asks, before he looks for a fault."""


class RestCase(NamedTuple):
    """Case of the second table.

    Attributes:
        stop: Name of the kind of stop.
        at_ms: Moment of the stop, ms.
        side: Arm whose situation is judged; the tray switch is judged in the situations of the left arm.
        kind: Kind of the fault; empty for the same stop without a fault.
        switch: Name of the switch without the side.
    """

    stop: str
    at_ms: int
    side: Side
    kind: str = ""
    switch: str = ""

    @property
    def target(self) -> str:
        """Full name of the switch."""
        return self.switch if self.switch == TRAY_SWITCH else f"{self.side}.{self.switch}"

    @property
    def name(self) -> str:
        """Kind and full name of the switch."""
        return f"{self.kind}:{self.target}" if self.kind else "no fault"


@dataclass
class RestOutcome:
    """Outcome of a case of the second table.

    Attributes:
        case: The case.
        counts: Final location of the seedlings.
        lost: Seedlings lost in excess of the same stop without a fault.
        signal: Key of the first alarm after the fault, or the reason for the Suspended state; empty if there is none.
        signal_after_ms: Time from the fault to this signal, ms.
        state: State of the machine when the operator looked for a fault; empty if he did not.
        trips: Monitor violations, by kind, except those after the same stop without a fault.
        rounds: Number of times that the operator repaired and homed the machine.
        passed: True if a tray passed through the machine undetected, and the operator ended the trial without it.
        reason: Reason for an incomplete trial or wrong counts; empty if there is none.
    """

    case: RestCase
    counts: SeedlingCounts
    lost: int = 0
    signal: str = ""
    signal_after_ms: int = 0
    state: str = ""
    trips: dict[str, str] = field(default_factory=dict)
    rounds: int = 0
    passed: bool = False
    reason: str = ""

    @property
    def is_harmed(self) -> bool:
        """True if a monitor tripped or a seedling was lost."""
        return bool(self.trips) or self.lost > 0


def run_at_rest(stop: StopKind, at_ms: int, cases: Sequence[RestCase], setting: MatrixSetup) -> list[RestOutcome]:
    """Run cases of one stop at one moment, and the same stop without a fault first.

    Args:
        stop: Kind of stop.
        at_ms: Moment of the stop, ms.
        cases: The cases.
        setting: Machine and trial.

    Returns:
        Outcome without a fault, then those of the cases.
    """
    twin = twin_at(at_ms, setting)
    come_to_rest(twin, stop)
    resting = twin.snapshot()
    reference = _run(twin, stop, RestCase(stop.name, at_ms, SIDES[0], switch=TRAY_SWITCH), setting)
    outcomes = [reference]
    for case in cases:
        twin.restore(resting)
        outcome = _run(twin, stop, case, setting)
        outcome.lost -= reference.lost
        outcome.trips = {kind: text for kind, text in outcome.trips.items() if kind not in reference.trips}
        outcomes.append(outcome)
    return outcomes


def _run(twin: Twin, stop: StopKind, case: RestCase, setting: MatrixSetup) -> RestOutcome:
    twin.unwatch()
    outcome = RestOutcome(case, twin.plant.counts())
    trips = collect_violations(twin)
    since, incidents = len(twin.events), len(twin.plant.events)
    struck_ms = twin.now_ms
    book = Outcome(
        Fault(case.kind or KINDS[0], case.target if case.kind else TRAY_SWITCH, twin.plant.time_ms), outcome.counts, 0
    )
    if case.kind:
        twin.plant.faults.add(book.fault)
    try:
        if not stop.is_blind:
            twin.run_for(UNAWARE_MS)
        stop.end(twin)
        _go_on(twin, stop, book)
        _work(twin, book)
    except NotReachedError as error:
        outcome.reason = str(error)
    outcome.counts, outcome.rounds, outcome.state = twin.plant.counts(), book.rounds, book.state
    _note_signal(twin, outcome, since, struck_ms)
    before = {event.kind.value for event in twin.plant.events[:incidents]}
    later = reversed(twin.plant.events[incidents:])  # the first of each kind is retained
    after = {event.kind.value: f"{event.text}, at {event.time_ms} ms" for event in later}
    outcome.trips = {kind: text for kind, text in trips.items() if kind not in before} | after
    _check_counts(twin, outcome, book, setting)
    return outcome


def _work(twin: Twin, book: Outcome) -> None:
    """Run to Complete, with recovery by the operator after every stop; a repaired machine empties one more tray."""
    while True:
        twin.run_until_state(State.COMPLETE, *RESTS, within_ms=2 * TRAY_LIMIT_MS)
        if twin.state is State.COMPLETE:
            return
        if book.rounds >= ROUNDS:
            raise NotReachedError(f"repeated stops; {twin.situation()}")
        _look_for_fault(twin, book)


def _look_for_fault(twin: Twin, book: Outcome) -> None:
    book.state = book.state or twin.state.name
    book.rounds += 1
    observe(twin, book)
    resume(twin, book)
    tags = twin.machine.tags
    done, target = twin.plc.read(tags.machine.trays_done), twin.plc.read(tags.sp.trays_target)
    twin.plc.write(tags.sp.trays_target, min(done + 1, target))


def _go_on(twin: Twin, stop: StopKind, book: Outcome) -> None:
    """Resume or home and start the machine as if nothing were wrong; if it does not obey, look for the fault."""
    if stop.resumes:
        twin.command("unhold")
        executing = twin.machine.tags.machine.state.equals(State.EXECUTE)
        if twin.runs_until(executing, for_ms=START_LIMIT_MS):
            return
    for _ in range(ANSWERS + 1):
        book.asked += answer_truly(twin)  # the buttons do not home while a question is shown
        if questions(twin):
            break
        begin_homing(twin)
        twin.run_until_state(State.IDLE, State.HELD, State.ABORTED, within_ms=HOMING_LIMIT_MS)
        if twin.state is not State.HELD or not questions(twin):
            break
        book.asked += answer_truly(twin)
    if twin.state is State.IDLE:
        twin.run_for(200)
        twin.press("start")
        if twin.runs_until(~twin.machine.tags.machine.state.equals(State.IDLE), for_ms=START_LIMIT_MS):
            return
        twin.run_for(1_000)
        twin.press("stop")
        twin.run_until_state(State.STOPPED, within_ms=START_LIMIT_MS)
    _look_for_fault(twin, book)


def _note_signal(twin: Twin, outcome: RestOutcome, since: int, struck_ms: int) -> None:
    """Record the first alarm after the fault, or the first Suspended state."""
    for event in twin.events[since:]:
        name = ""
        if isinstance(event, AlarmEvent) and event.active:
            alarm = twin.machine.alarms.of(event.number)
            name = alarm.key if alarm.key not in STOP_ALARMS and alarm.stops_work else ""
        elif isinstance(event, StateEvent) and event.state == State.SUSPENDED:
            name = "suspended"
        if name:
            outcome.signal, outcome.signal_after_ms = name, event.at_ms - struck_ms
            return


def _check_counts(twin: Twin, outcome: RestOutcome, book: Outcome, setting: MatrixSetup) -> None:
    """Record the losses, and wrong counts of trays and rows; the trays after the last one of the trial are not lost.

    A row whose release the stop interrupts is not counted if the operator then answers the question about this load.
    """
    target = twin.plc.read(twin.machine.tags.sp.trays_target)
    outcome.lost = outcome.counts.total - outcome.counts.in_cups - TRAY_CELLS * (setting.trays - target)
    outcome.passed = book.passed
    if outcome.reason:
        return
    complaints = ["a tray passed undetected"] if book.passed else []
    if (done := twin.plc.read(twin.machine.tags.machine.trays_done)) != target:
        complaints.append(f"{done} trays counted, not {target}")
    expected = undisturbed(setting).cycles - ROWS_A_TRAY * (setting.trays - target)
    uncounted = len({question for question in book.asked if question.endswith("loaded")})
    if not expected - uncounted <= (rows := thrown(twin)) <= expected:
        complaints.append(f"{rows} rows counted, not {expected}")
    outcome.reason = "; ".join(complaints)
