"""Driving speed: trials at every planting frequency of the program, limits and recommendation."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import fmean
from typing import Final

from controller.program.set_points import SLOWEST_PER_MIN
from controller.program.tags import ROWS, SIDES, Side
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import OverallProgress, RunOptions
from plant_sim.study.throughput.gains import MotionGain, has_gap, motion_gains, planned_runs
from plant_sim.study.throughput.pace import CyclePace, CyclePaces, setting_at
from plant_sim.study.throughput.scan import SERVED_PER_MIN, ConditionScan
from plant_sim.twin.report import TrialReport

FREQUENCIES_PER_MIN: Final = tuple(range(20, 91, 10))
SPACING_M: Final = 0.40
"""Plant spacing in a row, m; assumed, because the papers do not state it."""
MARGIN: Final = 0.10
"""Margin of the recommendation, as a fraction of the highest speed."""
LEAST_TRIALS: Final = 5
"""Minimum number of trials at each frequency, because the start position of the cups decides about the first gaps."""


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
    def is_free_of_gaps(self) -> bool:
        """True if every trial completed without a missed cup."""
        return self.gaps == 0

    @property
    def gaps(self) -> int:
        """Number of trials that had a gap or did not complete."""
        return self.free.count(False)

    @property
    def free(self) -> tuple[bool, ...]:
        """For each trial whether it completed without a missed cup."""
        return tuple(not has_gap(trial) for trial in self.trials)

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

    @property
    def least_wait_s(self) -> float:
        """Shortest mean wait for cups among all combinations of arm and row, s."""
        return min(self.waiting_s(side, row) for side in SIDES for row in ROWS)

    def missed_by_cause(self, cause: str) -> float:
        """Return the mean number of cups missed per trial due to a cause."""
        return fmean(trial.missed_cups_by_cause.get(cause, 0) for trial in self.trials)


def _air_l_min(trial: TrialReport) -> float:
    return math.nan if trial.air_l_min is None else trial.air_l_min


@dataclass(frozen=True)
class FrequencyLimits:
    """Conditions over the planting frequencies that the program serves.

    Attributes:
        without_gap: No cup is missed in any trial.
        settled: No cup is missed from the third tray on of the observed runs.
        by_row: For each row of the tray, both arms are over their cups before the twelfth cup in the observed runs.
    """

    without_gap: ConditionScan
    settled: ConditionScan
    by_row: Mapping[int, ConditionScan]

    @property
    def conditions(self) -> tuple[ConditionScan, ...]:
        """All conditions."""
        return (self.without_gap, self.settled, *self.by_row.values())


@dataclass(frozen=True)
class Advice:
    """Recommended driving speed.

    Attributes:
        highest: Result at the highest frequency up to which no trial has a gap.
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
        frequencies_per_min: Frequencies of the tables, 1/min; the limits and the recommendation do not depend on them.
        results: Results by frequency, at every frequency that the program serves.
        paces: Observed paces by frequency, at every frequency that the program serves.
        limits: Conditions over the frequencies.
        gains: Effect of the time of each motion on the limit; empty if there is no limit.
    """

    spacing_m: float
    is_assumed: bool
    frequencies_per_min: tuple[int, ...]
    results: Mapping[int, FrequencyResult]
    paces: Mapping[int, CyclePace]
    limits: FrequencyLimits
    gains: Sequence[MotionGain]

    @property
    def points(self) -> list[FrequencyResult]:
        """Results at the frequencies of the tables."""
        return [self.results[each] for each in self.frequencies_per_min]

    @cached_property
    def advice(self) -> Advice | None:
        """Recommendation; None if the limit less the margin is below the frequencies that the program serves."""
        limit = self.limits.without_gap.limit
        slower = math.floor((limit or 0) * (1 - MARGIN))
        if limit is None or slower < SLOWEST_PER_MIN:
            return None
        return Advice(self.results[limit], self.results[slower])


def drive(options: RunOptions, frequencies_per_min: Sequence[int], spacing_m: float | None) -> ThroughputResult:
    """Run the twin at every planting frequency that the program serves.

    Args:
        options: Run options, with the machine; at least `LEAST_TRIALS` trials are run at each frequency.
        frequencies_per_min: Frequencies of the tables; they affect neither the limits nor the recommendation.
        spacing_m: Plant spacing in a row, m; None = `SPACING_M`.

    Raises:
        StudyError: A frequency or the spacing is invalid.
    """
    frequencies, plants_m = tuple(sorted(set(frequencies_per_min))), SPACING_M if spacing_m is None else spacing_m
    if not frequencies:
        raise StudyError("--frequencies: is empty; specify at least one planting frequency")
    if not 0.05 <= plants_m <= 2.0:
        raise StudyError(f"--spacing: {plants_m:g} m between plants; must be 5 cm to 2 m")
    for frequency in frequencies:
        setting_at(frequency)
    options = _with_overall_progress(dataclasses.replace(options, trials=max(options.trials, LEAST_TRIALS)))
    results = _results(options)
    cache = CyclePaces(options)
    cache.observe(SERVED_PER_MIN)
    limits = limits_of(results, cache.observed)
    limit = limits.without_gap.limit
    free = {each: result.free for each, result in results.items()}
    gains = [] if limit is None else motion_gains(options, cache(limit), free)
    return ThroughputResult(plants_m, spacing_m is None, frequencies, results, cache.observed, limits, gains)


def ground_speed_km_h(frequency_per_min: float, spacing_m: float) -> float:
    """Return the ground speed for a plant spacing, km/h."""
    return frequency_per_min * spacing_m * 60 / 1000


def limits_of(results: Mapping[int, FrequencyResult], paces: Mapping[int, CyclePace]) -> FrequencyLimits:
    """Return the conditions over the planting frequencies."""

    def keeps_up(pace: CyclePace, row: int) -> bool:
        return pace.completes and pace.least_margin_s(row) >= 0

    return FrequencyLimits(
        without_gap=ConditionScan(
            "no missed cup in any trial", {each: result.is_free_of_gaps for each, result in results.items()}
        ),
        settled=ConditionScan(
            "no missed cup from the third tray on",
            {each: pace.completes and not pace.settled_missed_cups for each, pace in paces.items()},
        ),
        by_row={
            row: ConditionScan(
                f"both arms over their cups in time with row {row}",
                {each: keeps_up(pace, row) for each, pace in paces.items()},
            )
            for row in ROWS
        },
    )


def _with_overall_progress(options: RunOptions) -> RunOptions:
    """Return options whose progress covers all trials and observed runs."""
    if options.progress is None:
        return options
    scanned = len(SERVED_PER_MIN) * (options.trials + 1)
    planned = scanned + planned_runs(options.trials)
    return dataclasses.replace(options, progress=OverallProgress(options.progress, planned))


def _results(options: RunOptions) -> dict[int, FrequencyResult]:
    """Return the results at every frequency; the seeds of its trials depend on the frequency alone."""
    settings = {frequency: setting_at(frequency) for frequency in SERVED_PER_MIN}
    trials = options.run_indexed(list(settings.items()))
    return {
        frequency: FrequencyResult(frequency, setting, tuple(reports))
        for (frequency, setting), reports in zip(settings.items(), trials, strict=True)
    }
