"""Trials on the twin, distributed over processes; the results do not depend on the number of processes."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from controller.common.modbus.io_map import IoMap
from plant_sim.common.capacity import MOST_SEEDLINGS
from plant_sim.machine.parameters import Machine
from plant_sim.study.engines import ProcessEngine, Progress
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting
from plant_sim.study.fleet import SEEDLINGS, FleetMachine, load_twin, run_fleet
from plant_sim.twin.report import TrialReport

MOST_TRIALS = 100_000
_MOST_REASONS = 5


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Run options of a study.

    Attributes:
        trials: Trials at each setting.
        seed: Seed of the study; see `trial_seed`.
        workers: Number of processes; 1 = this process, None = one per core.
        machine: Base machine to which the settings are applied.
        io_map: I/O map.
        seedlings: Seedlings per trial.
        progress: Callback after every completed trial.
        machine_file: Machine parameter file; None = the default.
        io_map_file: I/O map file; None = the default.
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

    def run(self, settings: Sequence[FactorSetting]) -> list[list[TrialReport]]:
        """Run the trials at each setting; the position of a setting determines the seeds of its trials.

        Args:
            settings: The settings, all checked before the first trial.

        Returns:
            Reports by setting and trial; identical for any number of workers, except `wall_s`.

        Raises:
            StudyError: A setting or a number is invalid, or a process was killed.
        """
        return self.run_indexed(list(enumerate(settings)))

    def run_indexed(self, settings: Sequence[tuple[int, FactorSetting]]) -> list[list[TrialReport]]:
        """Run the trials at each setting.

        Args:
            settings: The settings, each after its index, which determines the seeds of its trials.

        Returns:
            Reports by setting and trial; see `run`.

        Raises:
            StudyError: A setting or a number is invalid, or a process was killed.
        """
        _check_numbers(len(settings), self.trials, self.seedlings)
        configurations = [(index, setting.machine(self.machine), setting.set_points()) for index, setting in settings]
        fleet = [
            FleetMachine(trial_seed(self.seed, index, trial), parameters, set_points, seedlings=self.seedlings)
            for index, parameters, set_points in configurations
            for trial in range(self.trials)
        ]
        reports = run_fleet(fleet, io_map=self.io_map, workers=self.workers, progress=self.progress)
        return [reports[first : first + self.trials] for first in range(0, len(fleet), self.trials)]

    @contextmanager
    def prepared(self) -> Iterator[None]:
        """Start the processes of the trials while the body of the context, such as imports, is executed.

        Raises:
            StudyError: A number is invalid.
        """
        _check_numbers(1, self.trials, self.seedlings)
        with ProcessEngine(self.workers).prepared(partial(load_twin, self.machine, self.io_map)):
            yield

    def command(self, study: str, file: Path | None = None, **study_options: object) -> str:
        """Return the command that reproduces a study, with every option that affects the result.

        Args:
            study: Name of the study.
            file: Study file, if any.
            study_options: Options specific to the study, by name.
        """
        return command_line(
            study,
            file,
            trials=self.trials,
            seed=self.seed,
            seedlings=self.seedlings,
            **study_options,
            machine=self.machine_file,
            io_map=self.io_map_file,
        )


def command_line(study: str, file: Path | None = None, **options: object) -> str:
    """Return the command line of a study.

    Args:
        study: Name of the study.
        file: Study file, if any.
        options: Options by name; those that are None are omitted.

    >>> command_line("throughput", seed=1, io_map="my wires.yaml", spacing=None)
    "python -m plant_sim study throughput --seed 1 --io-map 'my wires.yaml'"
    """
    arguments = ["python", "-m", "plant_sim", "study", study, *([] if file is None else [str(file)])]
    for name, value in options.items():
        if value is not None:
            arguments += [f"--{name.replace('_', '-')}", str(value)]
    return shlex.join(arguments)


def trial_record(report: TrialReport) -> dict[str, object]:
    """Return a JSON record of the seedling counts of a trial and the data needed to reproduce it."""
    names = ("seed", "completed", "reason", "seedlings", "in_cups", "P", "D", "T", "missed_cups")
    return {name: getattr(report, name) for name in names}


def incomplete_trials(reports: Sequence[Sequence[TrialReport]], counted: str) -> list[str]:
    """Return a paragraph about incomplete trials; empty if all completed.

    Args:
        reports: The trial reports of each run.
        counted: Clause that states how incomplete trials are counted.
    """
    broken = [(run, trial.reason) for run, trials in enumerate(reports, 1) for trial in trials if not trial.completed]
    if not broken:
        return []
    reasons = "; ".join(f"run {run}: {reason}" for run, reason in broken[:_MOST_REASONS])
    more = "; and others" if len(broken) > _MOST_REASONS else ""
    total = sum(map(len, reports))
    return [f"{len(broken)} of {total} trials did not complete; {counted}. {reasons}{more}."]


class OverallProgress:
    """Combined progress of several batches of trials."""

    def __init__(self, progress: Progress, planned: int) -> None:
        """Initialise with the planned number of trials.

        Args:
            progress: Callback with the combined progress.
            planned: Number of trials in all batches known in advance; later batches can add more.
        """
        self._progress = progress
        self._planned = planned
        self._started = 0
        self._done = 0
        self._done_in_batch = 0

    def __call__(self, done: int, total: int) -> None:
        """Count the completed trials of a batch, which may be reported several at a time."""
        if self._done_in_batch == 0:
            self._started += total
        self._done += done - self._done_in_batch
        self._done_in_batch = 0 if done == total else done
        self._progress(self._done, max(self._planned, self._started))


def trial_seed(seed: int, setting: int, trial: int) -> int:
    """Return the seed of a trial, which depends only on the study's seed, the setting and the trial number.

    Args:
        seed: Seed of the study, 0 or more.
        setting: Index of the setting.
        trial: Index of the trial at that setting.

    Returns:
        Seed of at most 53 bits, so that programs that read JSON numbers as floats read it exactly.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(setting, trial))
    return int(sequence.generate_state(1, np.uint64)[0]) >> 11


def _check_numbers(settings: int, trials: int, seedlings: int) -> None:
    if settings < 1:
        raise StudyError("settings: none; at least one is required")
    if trials < 1:
        raise StudyError(f"--trials {trials}: must be 1 or more")
    if not 1 <= seedlings <= MOST_SEEDLINGS:
        raise StudyError(f"--seedlings {seedlings}: must be 1 to {MOST_SEEDLINGS}")
    if settings * trials > MOST_TRIALS:
        raise StudyError(
            f"--trials {trials}: {settings} settings result in {settings * trials} trials, more than "
            f"{MOST_TRIALS}; reduce the trials or the levels"
        )
