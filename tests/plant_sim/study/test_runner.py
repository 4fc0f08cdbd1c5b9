"""Runner of study trials: reproducibility, worker processes, and validation before the first trial."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import psutil
import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.common.capacity import MOST_SEEDLINGS
from plant_sim.machine.parameters import load_machine
from plant_sim.study import fleet
from plant_sim.study.engines import ProcessEngine, WorkerLostError, spread
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import (
    MOST_TRIALS,
    OverallProgress,
    RunOptions,
    incomplete_trials,
    trial_seed,
)
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial
from tests.real_time import COMMAND_S

SEEDLINGS = 12
SETTINGS = [FactorSetting({}), FactorSetting({"crop.claw_pressure_mpa": 0.7, "program.descend_at_count": 6})]


def options(**changes: object) -> RunOptions:
    """Return run options for a test."""
    given = RunOptions(
        trials=1, seed=3, workers=1, machine=load_machine(), io_map=load_io_map(DEFAULT_IO_MAP), seedlings=SEEDLINGS
    )
    return replace(given, **changes)  # type: ignore[arg-type]


def untimed(reports: Sequence[Sequence[TrialReport]]) -> list[list[TrialReport]]:
    """Return reports without their run time."""
    return [[replace(report, wall_s=0.0) for report in trials] for trials in reports]


def nothing_runs(**_: object) -> TrialReport:
    """Stand in for a trial and fail."""
    raise AssertionError("a trial ran")


def test_results_do_not_depend_on_workers_and_progress_counts_every_trial() -> None:
    """One and two processes return the same reports in the order of settings and seeds."""
    reported: list[tuple[int, int]] = []
    alone = options(trials=2, progress=lambda done, total: reported.append((done, total))).run(SETTINGS)
    assert reported == [(1, 4), (2, 4), (3, 4), (4, 4)]
    both = options(trials=2, workers=2).run(SETTINGS)
    assert untimed(both) == untimed(alone)

    assert [len(trials) for trials in alone] == [2, 2]
    assert all(report.seedlings == SEEDLINGS for trials in alone for report in trials)
    seeds = [[report.seed for report in trials] for trials in alone]
    assert seeds == [[trial_seed(3, setting, trial) for trial in range(2)] for setting in range(2)]
    direct = run_trial(
        seed=trial_seed(3, 1, 0),
        seedlings=SEEDLINGS,
        set_points={"descend_at_count": 6},
        parameters=load_machine().with_values({"crop.claw_pressure_mpa": 0.7}),
    )
    assert replace(direct, wall_s=0.0) == untimed(alone)[1][0]


def test_the_trials_of_a_setting_do_not_depend_on_later_settings() -> None:
    """A shortened study returns the first results of the complete one."""
    assert untimed(options().run(SETTINGS[:1])) == untimed(options().run(SETTINGS))[:1]


def test_the_command_contains_every_option_that_affects_the_result() -> None:
    """Defaults are included; the number of workers is not, because it does not affect the result."""
    given = RunOptions(trials=5, seed=1, workers=2, machine=load_machine(), io_map=load_io_map(DEFAULT_IO_MAP))
    assert given.command("pepper-rsm") == "python -m plant_sim study pepper-rsm --trials 5 --seed 1 --seedlings 144"
    other = replace(given, machine_file=Path("my machine.yaml"), io_map_file=Path("wires.yaml"))
    assert shlex.split(other.command("own", Path("my own.yaml"), spacing=None, frequencies="20,30"))[4:] == [
        "own",
        "my own.yaml",
        "--trials",
        "5",
        "--seed",
        "1",
        "--seedlings",
        "144",
        "--frequencies",
        "20,30",
        "--machine",
        "my machine.yaml",
        "--io-map",
        "wires.yaml",
    ]


def test_incomplete_trials_are_counted_and_the_first_are_listed() -> None:
    whole = run_trial(seed=1, seedlings=1)
    broken = replace(whole, reason="jammed")
    assert incomplete_trials([[whole], [whole]], "they do not count") == []
    assert incomplete_trials([[whole, broken], [whole, whole], [broken, whole]], "they do not count") == [
        "2 of 6 trials did not complete; they do not count. run 1: jammed; run 3: jammed."
    ]
    (many,) = incomplete_trials([[broken] * 9], "they do not count")
    assert many.startswith("9 of 9 trials")
    assert many.count("jammed") == 5
    assert many.endswith("; and others.")


def test_workers_run_in_separate_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """One worker runs in the calling process; two workers run in other processes."""
    monkeypatch.setattr(fleet, "run_trial", process_id)
    here: list[list[object]] = list(map(list, options().run(SETTINGS)))
    assert here == [[os.getpid()], [os.getpid()]]
    there: list[list[object]] = list(map(list, options(trials=2, workers=2).run(SETTINGS)))
    assert all(process != os.getpid() for trials in there for process in trials)


def process_id(**_: object) -> int:
    """Stand in for a trial and return the process id."""
    return os.getpid()


def test_prepared_processes_run_the_jobs() -> None:
    """The processes exist at the end of the context and are not replaced."""
    with ProcessEngine(2).prepared(os.getpid):
        pass
    prepared = {process.pid for process in psutil.Process().children()}
    assert {*ProcessEngine(2).results([os.getpid] * 4, ordered=False)} <= prepared


INTERRUPTS_BLOCKED = """
import signal
from functools import partial
from plant_sim.study.engines import ProcessEngine
jobs = [partial(signal.pthread_sigmask, signal.SIG_BLOCK, ())] * 4
print([signal.SIGINT in blocked for blocked in ProcessEngine(2).results(jobs, ordered=False)])
"""


def test_every_process_is_started_with_interrupts_blocked() -> None:
    """In a process that has not started others before, as at a command: the first one must not change the mask."""
    command = [sys.executable, "-c", INTERRUPTS_BLOCKED]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=COMMAND_S)
    assert done.stdout == "[True, True, True, True]\n"


@pytest.mark.nightly
def test_a_process_killed_while_it_is_prepared_is_reported() -> None:
    with (
        pytest.raises(WorkerLostError, match="--workers: a process was killed"),
        ProcessEngine(2).prepared(partial(os._exit, 1)),
    ):
        pass


def test_seeds_differ_and_depend_only_on_their_numbers() -> None:
    seeds = {trial_seed(seed, setting, trial) for seed in range(4) for setting in range(30) for trial in range(30)}
    assert len(seeds) == 4 * 30 * 30
    assert all(0 <= seed < 2**53 for seed in seeds)
    assert trial_seed(1, 2, 3) == trial_seed(1, 2, 3)
    assert trial_seed(1, 2, 3) != trial_seed(1, 3, 2)


@pytest.mark.parametrize(
    ("settings", "trials", "workers", "complaint"),
    [
        ([], 1, 1, "settings: none"),
        ([FactorSetting({})], 0, 1, "--trials 0: must be 1 or more"),
        ([FactorSetting({})], MOST_TRIALS + 1, 1, "reduce the trials or the levels"),
        ([FactorSetting({})], 1, 0, "--workers 0: must be 1 or more"),
        (
            [FactorSetting({}), FactorSetting({"crop.foam_thickness_mm": 99.0})],
            1,
            1,
            "crop.foam_thickness_mm: must be",
        ),
        (
            [FactorSetting({}), FactorSetting({"program.clamp": 1.0})],
            1,
            1,
            "program.clamp: must be 100 to 2000 ms in steps of 10 ms",
        ),
    ],
)
def test_invalid_options_are_rejected_before_the_first_trial(
    monkeypatch: pytest.MonkeyPatch, settings: list[FactorSetting], trials: int, workers: int, complaint: str
) -> None:
    monkeypatch.setattr(fleet, "run_trial", nothing_runs)
    with pytest.raises(StudyError, match=complaint):
        options(trials=trials, workers=workers).run(settings)


@pytest.mark.parametrize("seedlings", [0, MOST_SEEDLINGS + 1])
def test_an_invalid_number_of_seedlings_is_rejected(monkeypatch: pytest.MonkeyPatch, seedlings: int) -> None:
    monkeypatch.setattr(fleet, "run_trial", nothing_runs)
    with pytest.raises(StudyError, match=f"^--seedlings {seedlings}: must be 1 to 72000$"):
        options(seedlings=seedlings).run(SETTINGS)


def test_jobs_are_distributed_in_order_with_an_unpicklable_progress() -> None:
    """A progress function that cannot be sent to another process, such as that of a terminal bar, reports every job."""
    lock, reported = threading.Lock(), []

    def see(done: int, total: int) -> None:
        with lock:
            reported.append((done, total))

    assert spread([partial(divmod, number, 3) for number in range(7)], 2, see) == [
        divmod(number, 3) for number in range(7)
    ]
    assert reported == [(done, 7) for done in range(1, 8)]
    assert spread([], 2, see) == []


def test_overall_progress_covers_several_batches() -> None:
    """If 7 jobs are planned, batches of 3 and 4 do not change the total; 2 unplanned jobs increase it."""
    reported: list[tuple[int, int]] = []
    overall = OverallProgress(lambda done, total: reported.append((done, total)), 7)
    for go in (3, 4, 2):
        for done in range(1, go + 1):
            overall(done, go)
    assert reported == [*((done, 7) for done in range(1, 8)), (8, 9), (9, 9)]


def dies(**_: object) -> TrialReport:
    """Stand in for a trial and kill the process."""
    os._exit(1)


@pytest.mark.nightly
def test_a_killed_process_is_reported_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "run_trial", dies)
    with pytest.raises(StudyError, match=r"^--workers: a process was killed, .*; use a smaller number$"):
        options(workers=2).run(SETTINGS)
