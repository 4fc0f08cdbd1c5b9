"""Trial of the paper in lock step: home, start, transplant every tray, report."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from controller.common.modbus.io_map import IoMap
from controller.events.kinds import as_record
from controller.program.states import State
from controller.program.texts.operator import STATES, Language
from plant_sim.crop.seedling import TRAY_CELLS
from plant_sim.faults import Fault
from plant_sim.machine.parameters import Machine
from plant_sim.twin.lock_step import NotReachedError, Twin
from plant_sim.twin.progress import ProgressState, ProgressView
from plant_sim.twin.recording import recorded
from plant_sim.twin.report import TrialReport, make_report

HOMING_LIMIT_MS = 60_000
PROGRESS_MS = 1_000
ROWS_A_TRAY = 6
TRAY_LIMIT_MS = 600_000
"""Time limit per tray, ms; at 20 plants per minute per row a tray takes 108 s."""


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
    prepare: Callable[[Twin], None] | None = None,
) -> TrialReport:
    """Transplant complete trays in simulated time.

    Args:
        seed: Seed of the plant; the same seed gives the same report, except for `wall_s`.
        trays: Trays in the magazine, 72 seedlings each.
        seedlings: Number of seedlings, used instead of `trays`; the last tray may have empty cells.
        io_map: I/O map; None = the default map.
        parameters: Machine parameters; None = the defaults.
        set_points: Initial values of set-points, by name of `SetPoints`.
        faults: Faults of the plant.
        record: Path of a recording of the run; None = no recording.
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
    if seedlings is not None and seedlings < trays * TRAY_CELLS:
        twin.plant.seedlings.leave_out(trays - 1, trays * TRAY_CELLS - seedlings)
    if prepare is not None:
        prepare(twin)
    reason = ""
    try:
        with recorded(twin, record, seed=seed):
            twin.home(within_ms=HOMING_LIMIT_MS)
            twin.start()
            twin.run_until_state(State.COMPLETE, within_ms=TRAY_LIMIT_MS * trays)
    except NotReachedError as error:
        reason = str(error)
    return make_report(
        seed=seed,
        counts=twin.plant.counts(),
        events=[as_record(event) for event in twin.events],
        reason=reason,
        simulated_s=twin.now_ms / 1000,
        wall_s=round(time.perf_counter() - start_s, 3),
        extrapolates=twin.plant.extrapolates,
        air_l_min=60 * twin.plant.air_l / (twin.now_ms / 1000),
    )


def show_progress(view: ProgressView, trays: int, language: Language) -> Callable[[Twin], None]:
    """Return a function that makes a twin show the progress of its trial once per simulated second."""

    def show(twin: Twin) -> None:
        counts = twin.plant.counts()
        view.show(
            ProgressState(
                elapsed_s=twin.now_ms / 1000,
                state=getattr(STATES[twin.state], language),
                tray=f"{twin.plc.read(twin.machine.tags.machine.trays_done)}/{trays}",
                rows=f"{len(twin.cycles())}/{ROWS_A_TRAY * trays}",
                in_cups=counts.in_cups,
                lost=counts.P + counts.D + counts.T,
                seedlings=counts.total,
                alarm="; ".join(twin.alarms()),
            )
        )

    return lambda twin: twin.every(PROGRESS_MS, show)
