"""Many trials on the twin, spread over processes; what comes out does not depend on how many there are."""

from __future__ import annotations

import shlex
import signal
from collections.abc import Callable, Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import joblib
import numpy as np
from joblib.externals.loky.process_executor import TerminatedWorkerError

from controller.io_map import IoMap
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Setting
from plant_sim.bench.trial import run_trial
from plant_sim.parameters import Machine

SEEDLINGS = 144
"""Seedlings of the paper's trial, two trays."""
MOST_SEEDLINGS = 72_000
"""A thousand trays, the most that the magazine holds."""
MOST_TRIALS = 100_000
_MOST_REASONS = 5

Progress = Callable[[int, int], None]
"""Is told how many trials are done, and of how many."""
Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class RunOptions:
    """How a study is to be run.

    Attributes:
        trials: Trials at each setting.
        seed: Seed of the study; see `trial_seed`.
        workers: Processes side by side; 1 = this one, None = one a core.
        machine: The machine that the study's settings change.
        io_map: Its wires.
        seedlings: Seedlings of a trial.
        progress: Is told of every trial that is done.
        machine_file: File of the machine; None = that of the repository.
        io_map_file: File of the wires; None = that of the repository.
    """

    trials: int
    seed: int
    workers: int | None
    machine: Machine
    io_map: IoMap
    seedlings: int = SEEDLINGS
    progress: Progress | None = None
    machine_file: Path | None = None
    io_map_file: Path | None = None

    def run(self, settings: Sequence[Setting]) -> list[list[TrialReport]]:
        """Run the trials at each of some settings.

        Args:
            settings: The settings; all of them are checked before anything runs.

        Returns:
            The reports, by setting and trial; the same for any number of workers, but for `wall_s`.

        Raises:
            StudyError: a setting or a number is impossible, or a process was killed.
        """
        _check_numbers(len(settings), self.trials, self.seedlings)
        made = [(setting.machine(self.machine), setting.set_points()) for setting in settings]
        jobs = [
            partial(
                run_trial,
                seed=trial_seed(self.seed, index, trial),
                seedlings=self.seedlings,
                parameters=parameters,
                set_points=set_points,
                io_map=self.io_map,
            )
            for index, (parameters, set_points) in enumerate(made)
            for trial in range(self.trials)
        ]
        reports = spread(jobs, self.workers, self.progress)
        return [reports[first : first + self.trials] for first in range(0, len(jobs), self.trials)]

    def command(self, study: str, file: Path | None = None, **own: object) -> str:
        """Return the command that makes a study again, with every option that decides what comes out.

        Args:
            study: Its name.
            file: Its file, if it has one.
            own: Options of its own, by name.
        """
        return command_line(
            study,
            file,
            trials=self.trials,
            seed=self.seed,
            seedlings=self.seedlings,
            **own,
            machine=self.machine_file,
            io_map=self.io_map_file,
        )


def command_line(study: str, file: Path | None = None, **options: object) -> str:
    """Return a command line of a study.

    Args:
        study: Its name.
        file: Its file, if it has one.
        options: Its options by name; None is left out.

    >>> command_line("throughput", seed=1, io_map="my wires.yaml", spacing=None)
    "python -m plant_sim study throughput --seed 1 --io-map 'my wires.yaml'"
    """
    words = ["python", "-m", "plant_sim", "study", study, *([] if file is None else [str(file)])]
    for name, value in options.items():
        if value is not None:
            words += [f"--{name.replace('_', '-')}", str(value)]
    return shlex.join(words)


def trial_record(report: TrialReport) -> dict[str, object]:
    """Return what it takes to run a trial again, and what became of its seedlings, for programs."""
    names = ("seed", "completed", "reason", "seedlings", "in_cups", "P", "D", "T", "missed_cups")
    return {name: getattr(report, name) for name in names}


def incomplete_trials(reports: Sequence[Sequence[TrialReport]], counted: str) -> list[str]:
    """Say which trials did not complete: one paragraph, or none if all did.

    Args:
        reports: The trials by run.
        counted: How they are counted, as `they count as they ended`.
    """
    broken = [(run, trial.reason) for run, trials in enumerate(reports, 1) for trial in trials if not trial.completed]
    if not broken:
        return []
    reasons = "; ".join(f"run {run}: {reason}" for run, reason in broken[:_MOST_REASONS])
    more = "; and others" if len(broken) > _MOST_REASONS else ""
    total = sum(map(len, reports))
    return [f"{len(broken)} of {total} trials did not complete; {counted}. {reasons}{more}."]


class Whole:
    """Progress of work that is done in several goes, told as that of one whole."""

    def __init__(self, progress: Progress, planned: int) -> None:
        """Plan the work.

        Args:
            progress: Is told of the whole.
            planned: Trials of all goes, as far as it is known beforehand; later goes add what they need.
        """
        self._progress = progress
        self._planned = planned
        self._begun = 0
        self._done = 0

    def __call__(self, done: int, total: int) -> None:
        """Take note that a trial of a go is done."""
        if done == 1:
            self._begun += total
        self._done += 1
        self._progress(self._done, max(self._planned, self._begun))


def spread(
    jobs: Sequence[Callable[[], Result]], workers: int | None = None, progress: Progress | None = None
) -> list[Result]:
    """Do jobs in processes side by side.

    Args:
        jobs: The jobs; what they are made of must go into another process.
        workers: How many processes; 1 = this one, None = one a core.
        progress: Is told of every job that is done.

    Returns:
        What they gave, in their order.

    Raises:
        StudyError: there is no such number of processes, or one was killed.
    """
    if workers is not None and workers < 1:
        raise StudyError(f"--workers {workers}: give 1 or more, or leave it out for one a core")
    found: list[Result] = []
    try:
        with closing(_results(jobs, workers)) as results:
            for result in results:
                found.append(result)
                if progress is not None:
                    progress(len(found), len(jobs))
    except TerminatedWorkerError:
        raise StudyError("--workers: a process was killed, perhaps for want of memory; give a smaller number") from None
    return found


def trial_seed(seed: int, setting: int, trial: int) -> int:
    """Return the seed of a trial: of the study's seed, its setting and its number alone.

    Args:
        seed: Seed of the study, 0 or more.
        setting: Which setting of the study, from 0.
        trial: Which trial at that setting, from 0.

    Returns:
        53 bits, so that programs which read JSON numbers as floats do not round it.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(setting, trial))
    return int(sequence.generate_state(1, np.uint64)[0]) >> 11


def _check_numbers(settings: int, trials: int, seedlings: int) -> None:
    if settings < 1:
        raise StudyError("settings: the study has none; give at least one")
    if trials < 1:
        raise StudyError(f"--trials {trials}: give 1 or more")
    if not 1 <= seedlings <= MOST_SEEDLINGS:
        raise StudyError(f"--seedlings {seedlings}: give 1 to {MOST_SEEDLINGS}")
    if settings * trials > MOST_TRIALS:
        raise StudyError(f"--trials {trials}: {settings} settings make {settings * trials} trials, more than "
                         f"{MOST_TRIALS}; give fewer trials or fewer levels")  # fmt: skip


def _results(jobs: Sequence[Callable[[], Result]], workers: int | None) -> Generator[Result, None, None]:
    """The results in the order of the jobs, each as soon as it and those before it are there."""
    here = workers == 1 or len(jobs) <= 1
    pool = {} if here else {"backend": "loky", "initializer": _leave_interrupts_to_the_parent}
    processes = -1 if workers is None else min(workers, len(jobs))
    parallel = joblib.Parallel(n_jobs=1 if here else processes, return_as="generator", **pool)
    results: Generator[Result, None, None] = parallel(joblib.delayed(job)() for job in jobs)
    return results


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
