"""Driving speed: trials at several planting frequencies, limits and recommendation."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from statistics import fmean
from typing import Final

from controller.program.tags import ROWS, Side
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import OverallProgress, RunOptions
from plant_sim.study.throughput.pace import SLOWEST_PER_MIN, CyclePaces, highest, observed_runs, setting_at
from plant_sim.twin.report import TrialReport

FREQUENCIES_PER_MIN: Final = tuple(range(20, 91, 10))
SPACING_M: Final = 0.40
"""Plant spacing in a row, m; assumed, because the papers do not state it."""
MARGIN: Final = 0.10
"""Margin of the recommendation, as a fraction of the highest speed."""
CONFIRMING_TRIALS: Final = 5
"""Minimum number of trials for the recommendation, because the start position of the cups shifts the limit slightly."""


@dataclass(frozen=True)
class FrequencyResult:
    """Result of the trials at one planting frequency.

    Attributes:
        frequency_per_min: The frequency, cups per minute per row.
        setting: Factor setting for the frequency.
        trials: Trial reports.
    """

    frequency_per_min: int
    setting: FactorSetting
    trials: tuple[TrialReport, ...]

    def mean(self, name: str) -> float:
        """Return the mean of a numeric field of the trials."""
        return fmean(getattr(trial, name) for trial in self.trials)

    @property
    def gaps(self) -> int:
        """Number of trials that had a gap or did not complete."""
        return sum(bool(trial.missed_cups or trial.reason) for trial in self.trials)

    @property
    def air_l_min(self) -> float:
        """Mean air consumption of the valves, L/min ANR; NaN if unknown."""
        return fmean(_air_l_min(trial) for trial in self.trials)

    @property
    def air_l_per_seedling(self) -> float:
        """Air consumption per seedling, planted or lost, L ANR."""
        return fmean(_air_l_min(trial) * trial.simulated_s / 60 / trial.seedlings for trial in self.trials)

    def waiting_s(self, side: Side, row: int) -> float:
        """Return the mean time for which an arm with a given row waited for cups, s; NaN if it never threw the row."""
        times = [trial.cycle_times.get(f"{side} row {row}") for trial in self.trials]
        waits = [each.waiting_s for each in times if each is not None]
        return fmean(waits) if waits else math.nan

    def missed_by_cause(self, cause: str) -> float:
        """Return the mean number of cups missed per trial due to a cause."""
        return fmean(trial.missed_cups_by_cause.get(cause, 0) for trial in self.trials)


def _air_l_min(trial: TrialReport) -> float:
    return math.nan if trial.air_l_min is None else trial.air_l_min


@dataclass(frozen=True)
class FrequencyLimits:
    """Highest planting frequencies at which the arms keep up, 1/min; None if below `SLOWEST_PER_MIN`.

    Attributes:
        without_gap: Highest frequency at which no cup is missed.
        settled: Highest frequency at which no cup is missed from the third tray on.
        by_row: For each row of the tray, highest frequency at which both arms are over their cups before the twelfth
            cup.
        searched_to: Highest tested frequency.
    """

    without_gap: int | None
    settled: int | None
    by_row: dict[int, int | None]
    searched_to: int


@dataclass(frozen=True)
class Advice:
    """Recommended driving speed.

    Attributes:
        highest: Result at the highest frequency without a gap in any trial.
        with_margin: Result at that frequency reduced by the margin.
    """

    highest: FrequencyResult
    with_margin: FrequencyResult


@dataclass(frozen=True)
class ThroughputResult:
    """Results of the throughput study.

    Attributes:
        spacing_m: Plant spacing in a row, m.
        is_assumed: True if the spacing is the default.
        points: Results at the initial frequencies.
        paces: Observed paces.
        limits: Highest frequencies at which the arms keep up.
        tried: Results of the search for the recommendation, in descending order from the limit.
        advice: Recommendation; None if no frequency is free of gaps both with and without the margin.
    """

    spacing_m: float
    is_assumed: bool
    points: list[FrequencyResult]
    paces: CyclePaces
    limits: FrequencyLimits
    tried: Sequence[FrequencyResult]
    advice: Advice | None


def drive(options: RunOptions, frequencies_per_min: Sequence[int], spacing_m: float | None) -> ThroughputResult:
    """Run the twin at several planting frequencies.

    Args:
        options: Run options, with the machine.
        frequencies_per_min: Initial planting frequencies; the limits are then determined to the nearest 1/min.
        spacing_m: Plant spacing in a row, m; None = `SPACING_M`.

    Raises:
        StudyError: A frequency or the spacing is invalid.
    """
    frequencies, plants_m = sorted(set(frequencies_per_min)), SPACING_M if spacing_m is None else spacing_m
    if not frequencies:
        raise StudyError("--frequencies: is empty; specify at least one planting frequency")
    if not 0.05 <= plants_m <= 2.0:
        raise StudyError(f"--spacing: {plants_m:g} m between plants; must be 5 cm to 2 m")
    options = _with_overall_progress(options, len(frequencies))
    points = _points(options, frequencies)
    paces = CyclePaces(options)
    paces.observe(frequencies)
    limits = _limits(paces, frequencies)
    tried, advice = _advice(options, limits)
    return ThroughputResult(plants_m, spacing_m is None, points, paces, limits, tried, advice)


def ground_speed_km_h(frequency_per_min: float, spacing_m: float) -> float:
    """Return the ground speed for a plant spacing, km/h."""
    return frequency_per_min * spacing_m * 60 / 1000


def _with_overall_progress(options: RunOptions, frequencies: int) -> RunOptions:
    """Return options whose progress covers the trials and the observed runs at the initial frequencies."""
    if options.progress is None:
        return options
    planned = frequencies * (options.trials + observed_runs(options.trials))
    return dataclasses.replace(options, progress=OverallProgress(options.progress, planned))


def _points(options: RunOptions, frequencies_per_min: Sequence[int]) -> list[FrequencyResult]:
    settings = [setting_at(frequency) for frequency in frequencies_per_min]
    trials = options.run(settings)
    return [
        FrequencyResult(frequency, setting, tuple(reports))
        for frequency, setting, reports in zip(frequencies_per_min, settings, trials, strict=True)
    ]


def _limits(paces: CyclePaces, frequencies: Sequence[int]) -> FrequencyLimits:
    def keeps_up(row: int, frequency: int) -> bool:
        return paces(frequency).completes and paces(frequency).least_margin_s(row) >= 0

    return FrequencyLimits(
        without_gap=highest(frequencies, lambda each: paces(each).completes and not paces(each).missed_cups),
        settled=highest(frequencies, lambda each: paces(each).completes and not paces(each).settled_missed_cups),
        by_row={row: highest(frequencies, partial(keeps_up, row)) for row in ROWS},
        searched_to=frequencies[-1],
    )


def _advice(options: RunOptions, limits: FrequencyLimits) -> tuple[list[FrequencyResult], Advice | None]:
    """Return the tested results and the recommendation; after a gap, the next lower frequency is tested."""
    options = dataclasses.replace(options, trials=max(options.trials, CONFIRMING_TRIALS))
    tried: list[FrequencyResult] = []
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
