"""Trial of the paper in lock step: home, start, transplant every tray, report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path

from controller.common.modbus.io_map import IoMap
from controller.common.stop_request import StopRequest
from controller.core.expr import any_of
from controller.events.kinds import as_record
from controller.program.states import State
from controller.program.texts.operator import Language
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.crop.seedling import TRAY_CELLS
from plant_sim.faults import Fault
from plant_sim.machine.parameters import Machine
from plant_sim.twin.ending.reported import ReportedEvents
from plant_sim.twin.ending.rule import INTERRUPTED, EndingRule, TrialEnd, default_max_ms
from plant_sim.twin.lock_step import NotReachedError, Twin
from plant_sim.twin.progress import ProgressView, progress_of
from plant_sim.twin.recording import recorded
from plant_sim.twin.report import TrialReport, make_report

PROGRESS_MS = 1_000
START_PAUSE_MS = 200


def run_trial(
    *,
    seed: int,
    trays: int = 2,
    seedlings: int | None = None,
    io_map: IoMap | None = None,
    parameters: Machine | None = None,
    set_points: Mapping[str, int] | None = None,
    faults: Iterable[Fault] = (),
    record: Path | None = None,
    provenance: Provenance | None = None,
    rule: EndingRule | None = None,
    stop: StopRequest | None = None,
    prepare: Callable[[Twin], None] | None = None,
) -> TrialReport:
    """Transplant trays in simulated time until the machine is complete, or the trial ends by its rule.

    Args:
        seed: Seed of the plant; the same seed gives the same report, except for `wall_s`.
        trays: Trays in the magazine, 72 seedlings each.
        seedlings: Number of seedlings, used instead of `trays`. The cells of the last tray that are picked last may be
            empty; the trial then ends with the cycle in which the last seedling is accounted for.
        io_map: I/O map; None = the default map.
        parameters: Machine parameters; None = the defaults.
        set_points: Initial values of set-points, by name of `SetPoints`.
        faults: Faults of the plant.
        record: Path of a recording of the run; None = no recording.
        provenance: Provenance that the recording carries.
        rule: Rule by which the trial ends; None = without an operator, and with the default time limit.
        stop: Request to stop the trial; None = none.
        prepare: Function that is called before the run, to register monitors.

    Returns:
        Report of the complete or incomplete trial.

    Raises:
        FaultError: A fault is not possible in this plant.
        RecordingError: The recording cannot be written.
    """
    start_s = time.perf_counter()
    if seedlings is not None:
        trays = -(-seedlings // TRAY_CELLS)
    twin = Twin(
        seed=seed,
        trays=trays,
        io_map=io_map,
        parameters=parameters,
        set_points={**(set_points or {}), "trays_target": trays},
        faults=faults,
    )
    in_last_tray = 0 if seedlings is None else seedlings % TRAY_CELLS
    if in_last_tray:
        twin.plant.seedlings.fill_in_pick_order(trays - 1, in_last_tray)
    trial = _Trial(twin, rule or EndingRule(default_max_ms(trays)), stop, ends_at_last=bool(in_last_tray))
    if prepare is not None:
        prepare(twin)
    with recorded(twin, record, seed=seed, provenance=provenance):
        ending = trial.run()
    now_s = twin.now_ms / 1000
    return make_report(
        seed=seed,
        counts=twin.plant.counts(),
        events=trial.reported.events,
        reason=ending.reason,
        simulated_s=now_s,
        wall_s=round(time.perf_counter() - start_s, 3),
        extrapolates=twin.plant.extrapolates,
        air_l_min=60 * twin.plant.air_l / now_s if now_s else None,
    )


class _Trial:
    """Trial of a twin with an operator who homes and starts the machine.

    Attributes:
        reported: Events so far.
    """

    def __init__(self, twin: Twin, rule: EndingRule, stop: StopRequest | None, *, ends_at_last: bool) -> None:
        self.reported = ReportedEvents()
        self._twin = twin
        self._rule = rule
        self._stop = stop
        self._ends_at_last = ends_at_last

    def run(self) -> TrialEnd:
        """Home, start and wait for the end."""
        twin = self._twin
        with suppress(NotReachedError):  # a machine that does not confirm rests with the alarm
            twin.confirm_constants()
        self._press_start()
        ending = self._until(State.IDLE)
        if ending is None:
            twin.run_for(START_PAUSE_MS)
            self._press_start()
            ending = self._until(State.COMPLETE)
        _read(self._twin, self.reported)
        return TrialEnd(None, "") if ending is None else ending

    def _press_start(self) -> None:
        self._twin.press("start")
        self.reported.acted(self._twin.now_ms)

    def _until(self, state: State) -> TrialEnd | None:
        """Run until the machine is in a state; return the end of the trial if it comes first."""
        twin, word = self._twin, self._twin.machine.tags.machine.state
        by_machine_only = self._stop is None and not self._ends_at_last
        reached = any_of(word.equals(state), word.equals(State.COMPLETE))
        while True:
            ending = self._ending()
            if ending is not None:
                return ending
            look_ms = self._rule.next_look_ms(twin.now_ms, self.reported.rest, by_machine_only=by_machine_only)
            if twin.runs_until(reached, for_ms=look_ms - twin.now_ms):
                return None

    def _ending(self) -> TrialEnd | None:
        """Return the end of the trial; None if it goes on."""
        _read(self._twin, self.reported)
        if self._stop is not None and self._stop.is_set():
            return TrialEnd(None, INTERRUPTED)
        reported = self.reported
        complete = self._ends_at_last and self._is_last_accounted()
        return self._rule.ending(self._twin.now_ms, complete=complete, rest=reported.rest, state=reported.english_state)

    def _is_last_accounted(self) -> bool:
        """Return True if every seedling is in a cup or lost, and no arm that has released a row is on its way back."""
        counts = self._twin.plant.counts()
        return not (counts.in_tray or counts.in_claw) and self.reported.are_back


def show_progress(view: ProgressView, trays: int, language: Language = "en") -> Callable[[Twin], None]:
    """Return a function that makes a twin show the progress of its trial once per simulated second."""
    reported = ReportedEvents()

    def show(twin: Twin) -> None:
        _read(twin, reported, language)
        view.show(progress_of(reported, twin.plant.counts(), elapsed_s=twin.now_ms / 1000, trays=trays))

    return lambda twin: twin.every(PROGRESS_MS, show)


def _read(twin: Twin, reported: ReportedEvents, language: Language = "en") -> None:
    """Read the events since the last call, in a language."""
    for event in twin.events[len(reported.events) :]:
        reported.apply(as_record(event, language))
