"""The study of throughput: where the arms stop keeping up, which motion is the bottleneck, how fast to drive."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from statistics import fmean
from typing import Final

from matplotlib.figure import Figure

from controller.program.tags import ROWS, SIDES, Side
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study.bottleneck import Bottleneck, first_late
from plant_sim.bench.study.chart import gantt_chart
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.factors import Setting
from plant_sim.bench.study.own import estimate
from plant_sim.bench.study.pace import (
    SLOWEST_PER_MIN,
    TRAYS,
    Paces,
    highest,
    landing_offset_mm,
    round_needed_s,
    setting_at,
)
from plant_sim.bench.study.parts import Cell, Heading, Part, Picture, Table
from plant_sim.bench.study.report import Study, drawing
from plant_sim.bench.study.runner import SEEDLINGS, RunOptions
from plant_sim.scope.style import COLOURS, SERIES

FREQUENCIES_PER_MIN: Final = tuple(range(20, 91, 10))
SPACING_M: Final = 0.40
"""Distance of the plants in a row, m; assumed, the papers do not tell it."""
MARGIN: Final = 0.10
"""Part of the highest speed that the advice keeps back."""


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
    """Up to which planting frequency the arms keep up, 1/min; None where not even the lowest one is kept up with.

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
class _Found:
    """Everything the study has found out."""

    spacing_m: float
    points: list[Point]
    paces: Paces
    limits: Limits
    advice: Advice | None


def throughput_study(
    options: RunOptions, *, frequencies_per_min: Sequence[int] = FREQUENCIES_PER_MIN, spacing_m: float = SPACING_M
) -> Study:
    """Run the twin over planting frequencies and tell how fast the machine can be driven.

    Args:
        options: How the trials are run, and the machine.
        frequencies_per_min: Planting frequencies to begin with; limits are then sought to 1/min.
        spacing_m: Distance of the plants in a row, m.

    Raises:
        StudyError: a frequency or the distance is impossible.
    """
    frequencies = sorted(set(frequencies_per_min))
    if not frequencies:
        raise StudyError("frequencies: there is none; give at least one planting frequency")
    if not 0.05 <= spacing_m <= 2.0:
        raise StudyError(f"spacing_m: {spacing_m:g} m between plants; give 0.05 to 2 m")
    points = _points(options, frequencies)
    paces = Paces(options)
    paces.observe(frequencies)
    limits = _limits(paces, frequencies)
    found = _Found(spacing_m, points, paces, limits, _advice(options, limits))
    bottlenecks = [each for each in (first_late(paces.found, changes_tray=change) for change in (False, True)) if each]
    return Study(
        name="throughput",
        title="Throughput: where the arms stop keeping up with the cups",
        command=f"python -m plant_sim study throughput --trials {options.trials} --seed {options.seed}",
        parts=tuple(
            chain(
                _advice_parts(found),
                _limit_parts(limits),
                _bottleneck_parts(bottlenecks),
                _trial_parts(options, found),
                _setting_parts(options, points),
            )
        ),
        record=_record(found, bottlenecks),
    )


def ground_speed_km_h(frequency_per_min: float, spacing_m: float) -> float:
    """Return the speed at which plants come to stand a distance apart, km/h."""
    return frequency_per_min * spacing_m * 60 / 1000


def _points(options: RunOptions, frequencies_per_min: Sequence[int]) -> list[Point]:
    settings = [setting_at(options.machine, frequency) for frequency in frequencies_per_min]
    trials = options.run(settings, seedlings=SEEDLINGS)
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


def _advice(options: RunOptions, limits: Limits) -> Advice | None:
    """Return the advice that trials bear out: where one still has a gap, the next lower frequency is tried."""
    for frequency in range(limits.without_gap or 0, SLOWEST_PER_MIN, -1):
        slower = math.floor(frequency * (1 - MARGIN))
        if slower < SLOWEST_PER_MIN:
            break
        found = Advice(*_points(options, [frequency, slower]))
        if not any(trial.missed_cups or trial.reason for trial in (*found.highest.trials, *found.with_margin.trials)):
            return found
    return None


def _advice_parts(found: _Found) -> list[Part]:
    advice, limits, spacing_m = found.advice, found.limits, found.spacing_m
    parts: list[Part] = [Heading("How fast to drive")]
    if advice is None:
        return [*parts, "There is a gap in a row at every planting frequency tried: no speed can be advised."]
    top, safe = advice.highest, advice.with_margin
    beyond = " (nothing faster was tried)" if top.frequency_per_min == limits.searched_to else ""
    text = (
        f"With {100 * spacing_m:g} cm between plants{' (assumed)' if spacing_m == SPACING_M else ''}, drive up to "
        f"{ground_speed_km_h(top.frequency_per_min, spacing_m):.2f} km/h: {top.frequency_per_min} plants a minute and "
        f"row{beyond}, without a gap in {len(top.trials)} trials of {SEEDLINGS}. With {100 * MARGIN:g} % margin: "
        f"{ground_speed_km_h(safe.frequency_per_min, spacing_m):.2f} km/h, {safe.frequency_per_min} a minute; every "
        f"row then waits at least {_least_wait_s(safe):.1f} s for its cups."
    )
    if limits.settled is not None and limits.settled > top.frequency_per_min:
        text += (
            f" Up to {ground_speed_km_h(limits.settled, spacing_m):.2f} km/h, {limits.settled} a minute, gaps come "
            "only at the beginning, until the arms have found their time against each other."
        )
    return [*parts, text]


def _least_wait_s(point: Point) -> float:
    return min(point.waiting_s(side, row) for side in SIDES for row in ROWS)


def _limit_parts(limits: Limits) -> list[Part]:
    rows: list[tuple[Cell, ...]] = [
        ("no cup is missed", limits.without_gap, _round_s(limits.without_gap)),
        ("none from the third tray on", limits.settled, _round_s(limits.settled)),
    ]
    rows += [
        (f"both arms are there before their cups with row {row}", limit, _round_s(limit))
        for row, limit in limits.by_row.items()
    ]
    return [
        Heading("Up to where the arms keep up"),
        f"Found on runs of {TRAYS} trays, to 1/min, up to {limits.searched_to}/min. A round is the time in which "
        "twelve cups pass; an arm that comes over its cups after the twelfth leaves a gap.",
        Table("limits", "Highest planting frequency at which it holds", ("holds", "frequency, 1/min", "round, s"),
              tuple(rows)),
    ]  # fmt: skip


def _round_s(frequency_per_min: int | None) -> float | None:
    return None if frequency_per_min is None else round_needed_s(frequency_per_min)


def _bottleneck_parts(bottlenecks: Sequence[Bottleneck]) -> list[Part]:
    parts: list[Part] = [Heading("The bottleneck")]
    if not bottlenecks:
        return [*parts, "No arm is late at any frequency tried: the carousel, and so the tractor, sets the pace."]
    parts.append(
        "The critical path goes back from a throw to the one before: what moves or dwells is on it, and what waits "
        "hands over to what it waited for. Shown is the latest round at the lowest frequency at which one is late."
    )
    for each in bottlenecks:
        with drawing():
            chart = gantt_chart(each.timeline, each.round)
        parts += [each.text(), each.table(), Picture(f"round-{each.name}", f"The same round, {each.title}", chart)]
    return parts


def _trial_parts(options: RunOptions, found: _Found) -> list[Part]:
    points, paces, spacing_m = found.points, found.paces, found.spacing_m
    rows: list[tuple[Cell, ...]] = []
    for point in points:
        success = estimate("S", point.trials)
        rows.append((
            point.frequency_per_min, ground_speed_km_h(point.frequency_per_min, spacing_m), success.mean, success.low,
            success.high, point.mean("missed_cups"), paces(point.frequency_per_min).settled_missed_cups,
            point.mean("cycle_time_s"), point.air_l_min, point.air_l_per_seedling,
            sum(trial.completed for trial in point.trials),
        ))  # fmt: skip
    heading = ("frequency, 1/min", "ground speed, km/h", "S, %", "from", "to", "missed cups a trial",
               "missed a settled tray", "cycle, s", "air, L/min", "air, L a seedling", "completed")  # fmt: skip
    return [
        Heading("Trials"),
        f"At each frequency {options.trials} trials of {SEEDLINGS} seedlings, two trays; S with its exact 95 % "
        f"interval; a settled tray is one from the third on of runs of {TRAYS}.",
        Table("trials", "What the trials gave", heading, tuple(rows)),
        *_cause_parts(points),
        _waiting_table(points),
        Picture("curves", "Success, gaps and air over the planting frequency", _curves(points, paces)),
    ]


def _cause_parts(points: Sequence[Point]) -> list[Part]:
    causes = sorted({cause for point in points for trial in point.trials for cause in trial.missed_cups_by_cause})
    if not causes:
        return ["No cup was missed in any trial."]
    rows = tuple((point.frequency_per_min, *map(point.missed_by_cause, causes)) for point in points)
    return [Table("gaps", "Missed cups a trial, by what kept the arm", ("frequency, 1/min", *causes), rows)]


def _waiting_table(points: Sequence[Point]) -> Table:
    rows = [(side, row) for side in SIDES for row in ROWS]
    return Table(
        "waiting",
        "How long an arm waits for cups, s, mean",
        ("frequency, 1/min", *(f"{side} row {row}" for side, row in rows)),
        tuple((point.frequency_per_min, *(point.waiting_s(*each) for each in rows)) for point in points),
    )


def _setting_parts(options: RunOptions, points: Sequence[Point]) -> list[Part]:
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            point.frequency_per_min,
            10 * int(point.setting.values["program.release_delay"]),
            landing_offset_mm(options.machine, point.setting),
            point.setting.values["program.no_cups"] / 10,
        )
        for point in points
    )
    return [
        Heading("What is set for each frequency"),
        "The release delay lets the plugs land in the middle of their cups, where the cup sensor sits far enough "
        f"ahead for that; a plug may land {1000 * options.machine.cups.catch_m:g} mm off. Without a cup for three cup "
        "times the machine is Suspended.",
        Table("settings", "Set-points", ("frequency, 1/min", "release delay, ms", "landing, mm past the middle",
              "no cups, s"), rows, digits=1),
    ]  # fmt: skip


def _curves(points: Sequence[Point], paces: Paces) -> Figure:
    frequencies = [point.frequency_per_min for point in points]
    with drawing():
        figure = Figure(figsize=(11.0, 3.2), layout="constrained")
        success, gaps, air = figure.subplots(1, 3)
        found = [estimate("S", point.trials) for point in points]
        means = [each.mean or 0.0 for each in found]
        errors = [[mean - (each.low or mean) for mean, each in zip(means, found, strict=True)],
                  [(each.high or mean) - mean for mean, each in zip(means, found, strict=True)]]  # fmt: skip
        success.errorbar(frequencies, means, errors, fmt="o-", color=SERIES[0], capsize=2, markersize=3)
        success.set_ylabel("S, 95 % interval (%)")
        missed = [point.mean("missed_cups") for point in points]
        settled = [paces(each).settled_missed_cups for each in frequencies]
        gaps.plot(frequencies, missed, "o-", color=COLOURS["alarms"], markersize=3, label="a trial of two trays")
        gaps.plot(frequencies, settled, "s--", color=COLOURS["faults"], markersize=3, label="a settled tray")
        gaps.set_ylabel("missed cups")
        gaps.legend()
        air.plot(frequencies, [each.air_l_min for each in points], "o-", color=SERIES[5], markersize=3)
        air.set_ylabel("air (L/min ANR)")
        for axes in (success, gaps, air):
            axes.set_xlabel("planting frequency (1/min and row)")
            axes.grid()
    return figure


def _record(found: _Found, bottlenecks: Sequence[Bottleneck]) -> dict[str, object]:
    limits, advice, spacing_m = found.limits, found.advice, found.spacing_m
    return {
        "spacing_m": spacing_m,
        "points": [_point_record(point, found.paces) for point in found.points],
        "limits_per_min": {
            "without_gap": limits.without_gap,
            "settled": limits.settled,
            "searched_to": limits.searched_to,
            **{f"row {row}": limit for row, limit in limits.by_row.items()},
        },
        "advice": None if advice is None else {
            name: {"frequency_per_min": point.frequency_per_min,
                   "ground_speed_km_h": ground_speed_km_h(point.frequency_per_min, spacing_m),
                   "least_waiting_s": _least_wait_s(point)}
            for name, point in (("highest", advice.highest), ("with_margin", advice.with_margin))
        },
        "bottlenecks": {each.name: each.record() for each in bottlenecks},
    }  # fmt: skip


def _point_record(point: Point, paces: Paces) -> dict[str, object]:
    success = estimate("S", point.trials)
    return {
        "frequency_per_min": point.frequency_per_min,
        "set": dict(point.setting.values),
        "S": success.mean,
        "S_low": success.low,
        "S_high": success.high,
        "missed_cups": point.mean("missed_cups"),
        "missed_cups_a_settled_tray": paces(point.frequency_per_min).settled_missed_cups,
        "cycle_time_s": point.mean("cycle_time_s"),
        "air_l_min": point.air_l_min,
        "air_l_per_seedling": point.air_l_per_seedling,
        "waiting_s": {f"{side} row {row}": point.waiting_s(side, row) for side in SIDES for row in ROWS},
        "least_margin_s": {f"row {row}": paces(point.frequency_per_min).least_margin_s(row) for row in ROWS},
        "reasons": [trial.reason for trial in point.trials if trial.reason],
    }
