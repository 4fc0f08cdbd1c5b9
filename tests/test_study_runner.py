"""Trials of a study: the same whoever runs them, and nothing runs before all of it is known to be possible."""

from __future__ import annotations

import os
import shlex
import threading
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study import runner
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Setting
from plant_sim.bench.study.runner import (
    MOST_SEEDLINGS,
    MOST_TRIALS,
    RunOptions,
    Whole,
    incomplete_trials,
    spread,
    trial_seed,
)
from plant_sim.bench.trial import run_trial
from plant_sim.parameters import load_machine

SEEDLINGS = 12
SETTINGS = [Setting({}), Setting({"crop.claw_pressure_mpa": 0.7, "program.descend_at_count": 6})]


def options(**changes: object) -> RunOptions:
    """How to run a study in a test."""
    given = RunOptions(trials=1, seed=3, workers=1, machine=load_machine(), io_map=load_io_map(DEFAULT_IO_MAP),
                       seedlings=SEEDLINGS)  # fmt: skip
    return replace(given, **changes)  # type: ignore[arg-type]


def untimed(reports: Sequence[Sequence[TrialReport]]) -> list[list[TrialReport]]:
    """Reports without the time that they took."""
    return [[replace(report, wall_s=0.0) for report in trials] for trials in reports]


def nothing_runs(**_: object) -> TrialReport:
    """Stands where a trial would run."""
    raise AssertionError("a trial ran")


def test_workers_change_nothing_and_every_trial_is_told() -> None:
    """One process and two give the same reports in the same order; each is the trial of its setting and seed."""
    told: list[tuple[int, int]] = []
    alone = options(trials=2, progress=lambda done, total: told.append((done, total))).run(SETTINGS)
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    both = options(trials=2, workers=2).run(SETTINGS)
    assert untimed(both) == untimed(alone)

    assert [len(trials) for trials in alone] == [2, 2]
    assert all(report.seedlings == SEEDLINGS for trials in alone for report in trials)
    seeds = [[report.seed for report in trials] for trials in alone]
    assert seeds == [[trial_seed(3, setting, trial) for trial in range(2)] for setting in range(2)]
    direct = run_trial(seed=trial_seed(3, 1, 0), seedlings=SEEDLINGS, set_points={"descend_at_count": 6},
                       parameters=load_machine().with_values({"crop.claw_pressure_mpa": 0.7}))  # fmt: skip
    assert replace(direct, wall_s=0.0) == untimed(alone)[1][0]


def test_a_setting_gives_the_same_whatever_comes_after_it() -> None:
    """A study that is cut short gives the beginning of the whole one."""
    assert untimed(options().run(SETTINGS[:1])) == untimed(options().run(SETTINGS))[:1]


def test_the_command_names_every_option_that_decides_the_result() -> None:
    """Defaults, too; the number of workers decides nothing."""
    given = RunOptions(trials=5, seed=1, workers=2, machine=load_machine(), io_map=load_io_map(DEFAULT_IO_MAP))
    assert given.command("pepper-rsm") == "python -m plant_sim study pepper-rsm --trials 5 --seed 1 --seedlings 144"
    other = replace(given, machine_file=Path("my machine.yaml"), io_map_file=Path("wires.yaml"))
    assert shlex.split(other.command("own", Path("my own.yaml"), spacing=None, frequencies="20,30"))[4:] == [
        "own", "my own.yaml", "--trials", "5", "--seed", "1", "--seedlings", "144", "--frequencies", "20,30",
        "--machine", "my machine.yaml", "--io-map", "wires.yaml",
    ]  # fmt: skip


def test_trials_that_did_not_complete_are_counted_and_the_first_are_told() -> None:
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


def test_workers_run_in_processes_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """With one worker a trial runs here, with two elsewhere."""
    monkeypatch.setattr(runner, "run_trial", own_process)
    here: list[list[object]] = list(map(list, options().run(SETTINGS)))
    assert here == [[os.getpid()], [os.getpid()]]
    there: list[list[object]] = list(map(list, options(trials=2, workers=2).run(SETTINGS)))
    assert all(process != os.getpid() for trials in there for process in trials)


def own_process(**_: object) -> int:
    """Stands where a trial would run, and tells where."""
    return os.getpid()


def test_seeds_differ_and_depend_on_nothing_but_their_numbers() -> None:
    seeds = {trial_seed(seed, setting, trial) for seed in range(4) for setting in range(30) for trial in range(30)}
    assert len(seeds) == 4 * 30 * 30
    assert all(0 <= seed < 2**53 for seed in seeds)
    assert trial_seed(1, 2, 3) == trial_seed(1, 2, 3)
    assert trial_seed(1, 2, 3) != trial_seed(1, 3, 2)


@pytest.mark.parametrize(
    ("settings", "trials", "workers", "complaint"),
    [
        ([], 1, 1, "settings: the study has none"),
        ([Setting({})], 0, 1, "--trials 0: give 1 or more"),
        ([Setting({})], MOST_TRIALS + 1, 1, "give fewer trials or fewer levels"),
        ([Setting({})], 1, 0, "--workers 0: give 1 or more"),
        ([Setting({}), Setting({"crop.foam_thickness_mm": 99.0})], 1, 1, "crop.foam_thickness_mm: must lie within"),
        (
            [Setting({}), Setting({"program.clamp": 1.0})],
            1,
            1,
            "program.clamp: must be 100 to 2000 ms in steps of 10 ms",
        ),
    ],
)
def test_what_is_impossible_is_refused_before_anything_runs(
    monkeypatch: pytest.MonkeyPatch, settings: list[Setting], trials: int, workers: int, complaint: str
) -> None:
    monkeypatch.setattr(runner, "run_trial", nothing_runs)
    with pytest.raises(StudyError, match=complaint):
        options(trials=trials, workers=workers).run(settings)


@pytest.mark.parametrize("seedlings", [0, MOST_SEEDLINGS + 1])
def test_a_trial_of_none_or_of_more_than_the_magazine_holds_is_refused(
    monkeypatch: pytest.MonkeyPatch, seedlings: int
) -> None:
    monkeypatch.setattr(runner, "run_trial", nothing_runs)
    with pytest.raises(StudyError, match=f"^--seedlings {seedlings}: give 1 to 72000$"):
        options(seedlings=seedlings).run(SETTINGS)


def test_any_jobs_are_spread_in_their_order_whatever_watches_them() -> None:
    """Given a progress that no other process could be given, as that of a bar on a terminal."""
    lock, told = threading.Lock(), []

    def see(done: int, total: int) -> None:
        with lock:
            told.append((done, total))

    assert spread([partial(divmod, number, 3) for number in range(7)], 2, see) == [
        divmod(number, 3) for number in range(7)
    ]
    assert told == [(done, 7) for done in range(1, 8)]
    assert spread([], 2, see) == []


def test_work_in_several_goes_is_told_as_one_whole() -> None:
    """Given 7 planned in goes of 3 and 4, and 2 more that nobody foresaw, the total grows only with these."""
    told: list[tuple[int, int]] = []
    whole = Whole(lambda done, total: told.append((done, total)), 7)
    for go in (3, 4, 2):
        for done in range(1, go + 1):
            whole(done, go)
    assert told == [*((done, 7) for done in range(1, 8)), (8, 9), (9, 9)]


def dies(**_: object) -> TrialReport:
    """Stands where a trial would run, in a process that the system kills."""
    os._exit(1)


def test_a_killed_process_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "run_trial", dies)
    with pytest.raises(StudyError, match=r"^--workers: a process was killed, .*; give a smaller number$"):
        options(workers=2).run(SETTINGS)
