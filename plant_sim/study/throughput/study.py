"""Throughput study: frequencies at which the arms keep up, bottleneck and recommended driving speed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from statistics import fmean

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Heading, Part, Picture, Table, counted
from controller.program.tags import ROWS, SIDES
from plant_sim.common.figure_style import COLOURS, SERIES, drawing
from plant_sim.study.estimates import ROWS_FAIL_TOGETHER, estimate
from plant_sim.study.report.study import Study
from plant_sim.study.runner import RunOptions, trial_record
from plant_sim.study.throughput.bottleneck import Bottleneck, first_late
from plant_sim.study.throughput.chart import gantt_chart
from plant_sim.study.throughput.driving import (
    FREQUENCIES_PER_MIN,
    MARGIN,
    FrequencyLimits,
    FrequencyResult,
    ThroughputResult,
    drive,
    ground_speed_km_h,
)
from plant_sim.study.throughput.pace import (
    SLOWEST_PER_MIN,
    TRAYS,
    CyclePaces,
    observed_runs,
    round_needed_s,
)
from plant_sim.twin.report import binomial_interval


def throughput_study(
    options: RunOptions, *, frequencies_per_min: Sequence[int] = FREQUENCIES_PER_MIN, spacing_m: float | None = None
) -> Study:
    """Run the twin at several planting frequencies and report the recommended driving speed.

    Args:
        options: Run options, with the machine.
        frequencies_per_min: Initial planting frequencies; the limits are then determined to the nearest 1/min.
        spacing_m: Plant spacing in a row, m; None = 0.40, marked as assumed in the report.

    Raises:
        StudyError: A frequency or the spacing is invalid.
    """
    result = drive(options, frequencies_per_min, spacing_m)
    changes = (False, True)
    late = (first_late(result.paces.observed, changes_tray=change) for change in changes)
    bottlenecks = [each for each in late if each]
    return Study(
        name="throughput",
        title="Throughput: limits at which the arms keep up with the cups",
        command=options.command(
            "throughput", frequencies=",".join(map(str, sorted(set(frequencies_per_min)))), spacing=spacing_m
        ),
        parts=tuple(
            chain(
                _advice_parts(result),
                _limit_parts(result.limits, observed_runs(options.trials)),
                _bottleneck_parts(bottlenecks),
                _trial_parts(options, result),
                _setting_parts(options, result),
            )
        ),
        record=_record(result, bottlenecks),
    )


def _advice_parts(result: ThroughputResult) -> list[Part]:
    advice, limits, spacing_m = result.advice, result.limits, result.spacing_m
    parts: list[Part] = [Heading("Recommended speed")]
    if advice is None:
        return [
            *parts,
            f"No speed can be recommended: no frequency down to {SLOWEST_PER_MIN}/min, the lowest of this study, is "
            f"free of gaps with a margin of {100 * MARGIN:g} %.",
            *_tried_parts(result),
        ]
    top, safe = advice.highest, advice.with_margin
    beyond = " (the highest frequency tested)" if top.frequency_per_min == limits.searched_to else ""
    text = (
        f"With {100 * spacing_m:g} cm between plants{' (assumed)' if result.is_assumed else ''}, drive up to "
        f"{ground_speed_km_h(top.frequency_per_min, spacing_m):.2f} km/h: {top.frequency_per_min} plants per minute "
        f"per row{beyond}, without a gap in {counted(len(top.trials), 'trial')} of {top.trials[0].seedlings} "
        f"seedlings. With a margin of {100 * MARGIN:g} %: "
        f"{ground_speed_km_h(safe.frequency_per_min, spacing_m):.2f} km/h, {safe.frequency_per_min} per minute; each "
        f"arm then waits at least {_least_wait_s(safe):.1f} s for its cups, on average."
    )
    if limits.settled is not None and limits.settled > top.frequency_per_min:
        text += (
            f" Up to {ground_speed_km_h(limits.settled, spacing_m):.2f} km/h, {limits.settled} per minute, gaps occur "
            "only at the start of the observed runs, until the timing between the arms has settled."
        )
    trials = len(top.trials)
    _, most = binomial_interval(0, trials)
    text += (
        f" The trials differ in the start position of the cups, which determines the first gaps. {trials} trials "
        f"without a gap do not exclude gaps: they may still occur in up to {100 * most:.0f} % of the starts (95 %, "
        "exact binomial), and another seed may shift the limit by a few plants per minute; a larger --trials "
        "reduces the uncertainty."
    )
    return [*parts, text, *_tried_parts(result)]


def _tried_parts(result: ThroughputResult) -> list[Part]:
    """Return the report parts with the trials made for the recommendation."""
    points = [*result.tried, *([] if result.advice is None else [result.advice.with_margin])]
    if not points:
        return []
    rows = tuple((each.frequency_per_min, len(each.trials), each.gaps) for each in points)
    return [
        Table(
            "advice",
            "Trials for the recommendation, downward from the limit of the observed runs",
            ("frequency, 1/min", "trials", "with a gap, or not completed"),
            rows,
        )
    ]


def _least_wait_s(point: FrequencyResult) -> float:
    """Return the shortest mean wait for cups among all combinations of arm and row, s."""
    return min(point.waiting_s(side, row) for side in SIDES for row in ROWS)


def _limit_parts(limits: FrequencyLimits, runs: int) -> list[Part]:
    rows: list[tuple[Cell, ...]] = [
        ("no missed cup", limits.without_gap, _round_s(limits.without_gap)),
        ("no missed cup from the third tray on", limits.settled, _round_s(limits.settled)),
    ]
    rows += [
        (f"both arms over their cups in time with row {row}", limit, _round_s(limit))
        for row, limit in limits.by_row.items()
    ]
    return [
        Heading("Limits of the arms"),
        f"Determined with {counted(runs, 'run')} of {TRAYS} trays, with a resolution of 1/min, up to "
        f"{limits.searched_to}/min; '-' means that the condition is not met at {SLOWEST_PER_MIN}/min. A round is the "
        "time for twelve cups to pass; an arm that arrives after the twelfth cup leaves a gap.",
        Table(
            "limits",
            "Highest planting frequency for each condition",
            ("condition", "frequency, 1/min", "round, s"),
            tuple(rows),
        ),
    ]


def _round_s(frequency_per_min: int | None) -> float | None:
    return None if frequency_per_min is None else round_needed_s(frequency_per_min)


def _bottleneck_parts(bottlenecks: Sequence[Bottleneck]) -> list[Part]:
    parts: list[Part] = [Heading("Bottleneck")]
    if not bottlenecks:
        return [*parts, "No arm is late at any tested frequency: the carousel, and thus the tractor, sets the pace."]
    parts.append(
        "The critical path runs from a throw back to the previous one: it contains motions and dwells, and a wait is "
        "replaced by its cause. The round with the largest delay at the lowest frequency with a late round is shown."
    )
    for each in bottlenecks:
        with drawing():
            chart = gantt_chart(each.timeline, each.round)
        parts += [each.text(), each.table(), Picture(f"round-{each.name}", f"The same round, {each.title}", chart)]
    return parts


def _trial_parts(options: RunOptions, result: ThroughputResult) -> list[Part]:
    points, paces, spacing_m = result.points, result.paces, result.spacing_m
    rows: list[tuple[Cell, ...]] = []
    for point in points:
        success = estimate("S", point.trials)
        rows.append(
            (
                point.frequency_per_min,
                ground_speed_km_h(point.frequency_per_min, spacing_m),
                success.mean,
                success.low,
                success.high,
                success.sd,
                point.mean("missed_cups"),
                paces(point.frequency_per_min).settled_missed_cups,
                point.mean("cycle_time_s"),
                point.air_l_min,
                point.air_l_per_seedling,
                sum(trial.completed for trial in point.trials),
            )
        )
    heading = (
        "frequency, 1/min",
        "ground speed, km/h",
        "S, %",
        "from",
        "to",
        "SD between trials",
        "missed cups per trial",
        "missed cups per settled tray",
        "cycle, s",
        "air, L/min",
        "air, L per seedling",
        "trials completed",
    )
    return [
        Heading("Trials"),
        f"At each frequency {counted(options.trials, 'trial')} of {options.seedlings} seedlings; S with its exact 95 % "
        f"interval; settled trays are those from the third tray of runs with {TRAYS} trays. {ROWS_FAIL_TOGETHER}",
        Table("trials", "Results of the trials", heading, tuple(rows)),
        *_cause_parts(points),
        _waiting_table(points),
        Picture("curves", "Success, gaps and air against the planting frequency", _curves(points, paces)),
    ]


def _cause_parts(points: Sequence[FrequencyResult]) -> list[Part]:
    causes = sorted({cause for point in points for trial in point.trials for cause in trial.missed_cups_by_cause})
    if not causes:
        return ["No cup was missed in any trial."]
    rows = tuple((point.frequency_per_min, *map(point.missed_by_cause, causes)) for point in points)
    return [Table("gaps", "Missed cups per trial, by cause", ("frequency, 1/min", *causes), rows)]


def _waiting_table(points: Sequence[FrequencyResult]) -> Table:
    rows = [(side, row) for side in SIDES for row in ROWS]
    return Table(
        "waiting",
        "Mean wait of an arm for cups, s",
        ("frequency, 1/min", *(f"{side} row {row}" for side, row in rows)),
        tuple((point.frequency_per_min, *(point.waiting_s(*each) for each in rows)) for point in points),
    )


def _setting_parts(options: RunOptions, result: ThroughputResult) -> list[Part]:
    rows: list[tuple[Cell, ...]] = []
    for point in result.points:
        landings_mm = result.paces(point.frequency_per_min).landings_mm
        mean, largest = (fmean(landings_mm), max(landings_mm, key=abs)) if landings_mm else (None, None)
        rows.append((point.frequency_per_min, point.setting.values["program.no_cups"] / 10, mean, largest))
    return [
        Heading("Settings for each frequency"),
        "If no cup passes for three cup intervals, the machine is Suspended. The program adapts the release to the "
        f"speed of the chain; a plug may land up to {1000 * options.machine.cups.catch_m:g} mm off the middle of its "
        "cup. The landings are those of the observed runs.",
        Table(
            "settings",
            "Set-point and landings",
            ("frequency, 1/min", "no cups, s", "mean landing, mm past the middle", "largest, mm"),
            tuple(rows),
            digits=1,
        ),
    ]


def _curves(points: Sequence[FrequencyResult], paces: CyclePaces) -> Figure:
    frequencies = [point.frequency_per_min for point in points]
    with drawing():
        figure = Figure(figsize=(11.0, 3.2), layout="constrained")
        success, gaps, air = figure.subplots(1, 3)
        means, lows, highs = _success(points)
        success.errorbar(
            frequencies, means, [means - lows, highs - means], fmt="o-", color=SERIES[0], capsize=2, markersize=3
        )
        success.set_ylabel("S and its 95 % interval, %")
        missed = [point.mean("missed_cups") for point in points]
        settled = [paces(each).settled_missed_cups for each in frequencies]
        gaps.plot(frequencies, missed, "o-", color=COLOURS["alarms"], markersize=3, label="trial of two trays")
        gaps.plot(frequencies, settled, "s--", color=COLOURS["faults"], markersize=3, label="settled tray")
        gaps.set_ylabel("missed cups, mean")
        gaps.legend()
        air.plot(frequencies, [each.air_l_min for each in points], "o-", color=SERIES[5], markersize=3)
        air.set_ylabel("air, L/min ANR")
        for axes in (success, gaps, air):
            axes.set_xlabel("planting frequency, 1/min per row")
            axes.grid()
    return figure


def _success(points: Sequence[FrequencyResult]) -> NDArray[np.float64]:
    """Return S for every point and the lower and upper ends of its 95 % interval, %, in three rows."""
    estimates = (estimate("S", point.trials) for point in points)
    return np.array([(each.mean, each.low, each.high) for each in estimates], dtype=np.float64).T


def _record(result: ThroughputResult, bottlenecks: Sequence[Bottleneck]) -> dict[str, object]:
    limits, advice, spacing_m = result.limits, result.advice, result.spacing_m
    return {
        "spacing_m": spacing_m,
        "points": [_point_record(point, result.paces) for point in result.points],
        "observed": [
            {"set": dict(run.setting.values), "trays": TRAYS, "seed": run.seed, "reason": run.reason}
            for pace in result.paces.observed.values()
            for run in pace.runs
        ],
        "tried": [_tried_record(point) for point in result.tried],
        "limits_per_min": {
            "without_gap": limits.without_gap,
            "settled": limits.settled,
            "searched_to": limits.searched_to,
            **{f"row {row}": limit for row, limit in limits.by_row.items()},
        },
        "advice": None
        if advice is None
        else {
            name: {
                "ground_speed_km_h": ground_speed_km_h(point.frequency_per_min, spacing_m),
                "least_waiting_s": _least_wait_s(point),
                **_tried_record(point),
            }
            for name, point in (("highest", advice.highest), ("with_margin", advice.with_margin))
        },
        "bottlenecks": {each.name: each.record() for each in bottlenecks},
    }


def _tried_record(point: FrequencyResult) -> dict[str, object]:
    return {
        "frequency_per_min": point.frequency_per_min,
        "set": dict(point.setting.values),
        "gaps": point.gaps,
        "trials": [trial_record(trial) for trial in point.trials],
    }


def _point_record(point: FrequencyResult, paces: CyclePaces) -> dict[str, object]:
    success = estimate("S", point.trials)
    return {
        "frequency_per_min": point.frequency_per_min,
        "set": dict(point.setting.values),
        "S": success.mean,
        "S_low": success.low,
        "S_high": success.high,
        "S_sd": success.sd,
        "missed_cups": point.mean("missed_cups"),
        "missed_cups_a_settled_tray": paces(point.frequency_per_min).settled_missed_cups,
        "cycle_time_s": point.mean("cycle_time_s"),
        "air_l_min": point.air_l_min,
        "air_l_per_seedling": point.air_l_per_seedling,
        "waiting_s": {f"{side} row {row}": point.waiting_s(side, row) for side in SIDES for row in ROWS},
        "least_margin_s": {f"row {row}": paces(point.frequency_per_min).least_margin_s(row) for row in ROWS},
        "trials": [trial_record(trial) for trial in point.trials],
    }
