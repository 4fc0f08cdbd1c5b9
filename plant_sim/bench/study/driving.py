"""How fast the machine can be driven: trials over planting frequencies, the limits between them, the advice."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from statistics import fmean
from typing import Final

from controller.program.tags import ROWS, Side
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Setting
from plant_sim.bench.study.pace import SLOWEST_PER_MIN, Paces, highest, observed_runs, setting_at
from plant_sim.bench.study.runner import RunOptions, Whole

FREQUENCIES_PER_MIN: Final = tuple(range(20, 91, 10))
SPACING_M: Final = 0.40
"""Distance of the plants in a row, m; assumed, the papers do not tell it."""
MARGIN: Final = 0.10
"""Part of the highest speed that the advice keeps back."""
CONFIRMING_TRIALS: Final = 5
"""Trials that the advice rests on, at least: where the cups stand at the start moves the limit by a few a minute."""


@dataclass(frozen=True)
class Point:
    """What trials gave at one planting frequency.

    Attributes:
        frequency_per_min: The frequency, cups a minute and row.
        setting: What was set for it.
        trials: The trials.
    """

    frequency_per_min: int
    setting: Setting
    trials: tuple[TrialReport, ...]

    def mean(self, name: str) -> float:
        """Return the mean of a number of the trials."""
        return fmean(getattr(trial, name) for trial in self.trials)

    @property
    def gaps(self) -> int:
        """How many trials had a gap or did not complete."""
        return sum(bool(trial.missed_cups or trial.reason) for trial in self.trials)

    @property
    def air_l_min(self) -> float:
        """Air that the valves let in, mean, L/min ANR; NaN where it is not known."""
        return fmean(_air_l_min(trial) for trial in self.trials)

    @property
    def air_l_per_seedling(self) -> float:
        """Air for a seedling of the tray, planted or lost, L ANR."""
        return fmean(_air_l_min(trial) * trial.simulated_s / 60 / trial.seedlings for trial in self.trials)

    def waiting_s(self, side: Side, row: int) -> float:
        """Return how long an arm with a row waited for cups, s, mean; NaN if it never threw one."""
        times = [trial.cycle_times.get(f"{side} row {row}") for trial in self.trials]
        found = [each.waiting_s for each in times if each is not None]
        return fmean(found) if found else math.nan

    def missed_by_cause(self, cause: str) -> float:
        """Return the cups missed in a trial for a cause, mean."""
        return fmean(trial.missed_cups_by_cause.get(cause, 0) for trial in self.trials)


def _air_l_min(trial: TrialReport) -> float:
    return math.nan if trial.air_l_min is None else trial.air_l_min


@dataclass(frozen=True)
class Limits:
    """Up to which planting frequency the arms keep up, 1/min; None where not even `SLOWEST_PER_MIN` is kept up with.

    Attributes:
        without_gap: No cup is missed.
        settled: None is missed from the third tray on.
        by_row: By row of the tray: either arm with it is over its cups before the twelfth.
        searched_to: Highest frequency that was tried.
    """

    without_gap: int | None
    settled: int | None
    by_row: dict[int, int | None]
    searched_to: int


@dataclass(frozen=True)
class Advice:
    """How fast to drive.

    Attributes:
        highest: The highest frequency at which no trial has a gap.
        with_margin: The same with a margin.
    """

    highest: Point
    with_margin: Point


@dataclass(frozen=True)
class Found:
    """Everything the study has found out.

    Attributes:
        spacing_m: Distance of the plants in a row, m.
        is_assumed: Whether nobody has said so.
        points: What trials gave at the frequencies to begin with.
        paces: What was observed.
        limits: Up to where the arms keep up.
        tried: Trials in which the advice was sought, from the limit down.
        advice: How fast to drive; None if no frequency leaves a margin without a gap.
    """

    spacing_m: float
    is_assumed: bool
    points: list[Point]
    paces: Paces
    limits: Limits
    tried: Sequence[Point]
    advice: Advice | None


def drive(options: RunOptions, frequencies_per_min: Sequence[int], spacing_m: float | None) -> Found:
    """Run the twin over planting frequencies.

    Args:
        options: How the trials are run, and the machine.
        frequencies_per_min: Planting frequencies to begin with; limits are then sought to 1/min.
        spacing_m: Distance of the plants in a row, m; None = `SPACING_M`, which is assumed.

    Raises:
        StudyError: a frequency or the distance is impossible.
    """
    frequencies, plants_m = sorted(set(frequencies_per_min)), SPACING_M if spacing_m is None else spacing_m
    if not frequencies:
        raise StudyError("--frequencies: there is none; give at least one planting frequency")
    if not 0.05 <= plants_m <= 2.0:
        raise StudyError(f"--spacing: {plants_m:g} m between plants; give 5 cm to 2 m")
    options = _told_as_one(options, len(frequencies))
    points = _points(options, frequencies)
    paces = Paces(options)
    paces.observe(frequencies)
    limits = _limits(paces, frequencies)
    tried, advice = _advice(options, limits)
    return Found(plants_m, spacing_m is None, points, paces, limits, tried, advice)


def ground_speed_km_h(frequency_per_min: float, spacing_m: float) -> float:
    """Return the speed at which plants come to stand a distance apart, km/h."""
    return frequency_per_min * spacing_m * 60 / 1000


def _told_as_one(options: RunOptions, frequencies: int) -> RunOptions:
    """Tell the trials and the observed runs at the frequencies to begin with as one work."""
    if options.progress is None:
        return options
    planned = frequencies * (options.trials + observed_runs(options.trials))
    return dataclasses.replace(options, progress=Whole(options.progress, planned))


def _points(options: RunOptions, frequencies_per_min: Sequence[int]) -> list[Point]:
    settings = [setting_at(options.machine, frequency) for frequency in frequencies_per_min]
    trials = options.run(settings)
    return [
        Point(frequency, setting, tuple(reports))
        for frequency, setting, reports in zip(frequencies_per_min, settings, trials, strict=True)
    ]


def _limits(paces: Paces, frequencies: Sequence[int]) -> Limits:
    def keeps_up(row: int, frequency: int) -> bool:
        return paces(frequency).completes and paces(frequency).least_margin_s(row) >= 0

    return Limits(
        without_gap=highest(frequencies, lambda each: paces(each).completes and not paces(each).missed_cups),
        settled=highest(frequencies, lambda each: paces(each).completes and not paces(each).settled_missed_cups),
        by_row={row: highest(frequencies, partial(keeps_up, row)) for row in ROWS},
        searched_to=frequencies[-1],
    )


def _advice(options: RunOptions, limits: Limits) -> tuple[list[Point], Advice | None]:
    """Return what was tried and the advice it bears out: where a trial has a gap, the next lower frequency is tried."""
    options = dataclasses.replace(options, trials=max(options.trials, CONFIRMING_TRIALS))
    tried: list[Point] = []
    for frequency in range(limits.without_gap or 0, SLOWEST_PER_MIN, -1):
        slower = math.floor(frequency * (1 - MARGIN))
        if slower < SLOWEST_PER_MIN:
            break
        tried += _points(options, [frequency])
        if tried[-1].gaps:
            continue
        (with_margin,) = _points(options, [slower])
        if not with_margin.gaps:
            return tried, Advice(tried[-1], with_margin)
    return tried, None
