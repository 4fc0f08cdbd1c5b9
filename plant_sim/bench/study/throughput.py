"""The study of throughput: where the arms stop keeping up, which motion is the bottleneck, how fast to drive."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from controller.program.tags import ROWS, SIDES
from plant_sim.bench.report import binomial_interval
from plant_sim.bench.study.bottleneck import Bottleneck, first_late
from plant_sim.bench.study.chart import gantt_chart
from plant_sim.bench.study.driving import FREQUENCIES_PER_MIN, MARGIN, Found, Limits, Point, drive, ground_speed_km_h
from plant_sim.bench.study.own import ROWS_FAIL_TOGETHER, estimate
from plant_sim.bench.study.pace import SLOWEST_PER_MIN, TRAYS, Paces, landing_offset_mm, observed_runs, round_needed_s
from plant_sim.bench.study.parts import Cell, Heading, Part, Picture, Table, counted
from plant_sim.bench.study.report import Study, drawing
from plant_sim.bench.study.runner import RunOptions, trial_record
from plant_sim.scope.style import COLOURS, SERIES


def throughput_study(
    options: RunOptions, *, frequencies_per_min: Sequence[int] = FREQUENCIES_PER_MIN, spacing_m: float | None = None
) -> Study:
    """Run the twin over planting frequencies and tell how fast the machine can be driven.

    Args:
        options: How the trials are run, and the machine.
        frequencies_per_min: Planting frequencies to begin with; limits are then sought to 1/min.
        spacing_m: Distance of the plants in a row, m; None = 0.40, and the report says that it is assumed.

    Raises:
        StudyError: a frequency or the distance is impossible.
    """
    found = drive(options, frequencies_per_min, spacing_m)
    changes = (False, True)
    bottlenecks = [each for each in (first_late(found.paces.found, changes_tray=change) for change in changes) if each]
    return Study(
        name="throughput",
        title="Throughput: where the arms stop keeping up with the cups",
        command=options.command(
            "throughput", frequencies=",".join(map(str, sorted(set(frequencies_per_min)))), spacing=spacing_m
        ),
        parts=tuple(
            chain(
                _advice_parts(found),
                _limit_parts(found.limits, observed_runs(options.trials)),
                _bottleneck_parts(bottlenecks),
                _trial_parts(options, found),
                _setting_parts(options, found.points),
            )
        ),
        record=_record(found, bottlenecks),
    )


def _advice_parts(found: Found) -> list[Part]:
    advice, limits, spacing_m = found.advice, found.limits, found.spacing_m
    parts: list[Part] = [Heading("How fast to drive")]
    if advice is None:
        return [
            *parts,
            f"No speed can be advised: down to {SLOWEST_PER_MIN}/min, the slowest of this study, none is without a "
            f"gap and leaves a margin of {100 * MARGIN:g} %.",
            *_tried_parts(found),
        ]
    top, safe = advice.highest, advice.with_margin
    beyond = " (nothing faster was tried)" if top.frequency_per_min == limits.searched_to else ""
    text = (
        f"With {100 * spacing_m:g} cm between plants{' (assumed)' if found.is_assumed else ''}, drive up to "
        f"{ground_speed_km_h(top.frequency_per_min, spacing_m):.2f} km/h: {top.frequency_per_min} plants a minute and "
        f"row{beyond}, without a gap in {counted(len(top.trials), 'trial')} of {top.trials[0].seedlings}. "
        f"With {100 * MARGIN:g} % margin: "
        f"{ground_speed_km_h(safe.frequency_per_min, spacing_m):.2f} km/h, {safe.frequency_per_min} a minute; each "
        f"arm then waits {_least_wait_s(safe):.1f} s or more for its cups, on average."
    )
    if limits.settled is not None and limits.settled > top.frequency_per_min:
        text += (
            f" Up to {ground_speed_km_h(limits.settled, spacing_m):.2f} km/h, {limits.settled} a minute, gaps come "
            "only at the beginning of the observed runs, until the arms have found their time against each other."
        )
    trials = len(top.trials)
    _, most = binomial_interval(0, trials)
    text += (
        f" The trials differ in where the cups stand at the start, which decides over the first gaps. A gap in none "
        f"of {trials} trials does not rule out one: it may still come in up to {100 * most:.0f} % of the starts "
        "(95 %, exact binomial), and another seed may move the limit by a few plants a minute; more --trials make it "
        "surer."
    )
    return [*parts, text, *_tried_parts(found)]


def _tried_parts(found: Found) -> list[Part]:
    """The trials in which the advice was sought."""
    points = [*found.tried, *([] if found.advice is None else [found.advice.with_margin])]
    if not points:
        return []
    rows = tuple((each.frequency_per_min, len(each.trials), each.gaps) for each in points)
    return [Table("advice", "Trials that the advice rests on, from the limit of the observed runs down",
                  ("frequency, 1/min", "trials", "with a gap, or not completed"), rows)]  # fmt: skip


def _least_wait_s(point: Point) -> float:
    """Return the mean wait for cups with the row that waits least, s."""
    return min(point.waiting_s(side, row) for side in SIDES for row in ROWS)


def _limit_parts(limits: Limits, runs: int) -> list[Part]:
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
        f"Found on {counted(runs, 'run')} of {TRAYS} trays, to 1/min, up to {limits.searched_to}/min; - where it does "
        f"not even hold at {SLOWEST_PER_MIN}/min. A round is the time in which twelve cups pass; an arm that comes "
        "over its cups after the twelfth leaves a gap.",
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


def _trial_parts(options: RunOptions, found: Found) -> list[Part]:
    points, paces, spacing_m = found.points, found.paces, found.spacing_m
    rows: list[tuple[Cell, ...]] = []
    for point in points:
        success = estimate("S", point.trials)
        rows.append((
            point.frequency_per_min, ground_speed_km_h(point.frequency_per_min, spacing_m), success.mean, success.low,
            success.high, success.sd, point.mean("missed_cups"), paces(point.frequency_per_min).settled_missed_cups,
            point.mean("cycle_time_s"), point.air_l_min, point.air_l_per_seedling,
            sum(trial.completed for trial in point.trials),
        ))  # fmt: skip
    heading = ("frequency, 1/min", "ground speed, km/h", "S, %", "from", "to", "SD between trials",
               "missed cups a trial", "missed a settled tray", "cycle, s", "air, L/min", "air, L a seedling",
               "trials completed")  # fmt: skip
    return [
        Heading("Trials"),
        f"At each frequency {counted(options.trials, 'trial')} of {options.seedlings} seedlings; S with its exact 95 % "
        f"interval; a settled tray is one from the third on of runs of {TRAYS}. {ROWS_FAIL_TOGETHER}",
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
        means, lows, highs = _success(points)
        success.errorbar(
            frequencies, means, [means - lows, highs - means], fmt="o-", color=SERIES[0], capsize=2, markersize=3
        )
        success.set_ylabel("S and its 95 % interval, %")
        missed = [point.mean("missed_cups") for point in points]
        settled = [paces(each).settled_missed_cups for each in frequencies]
        gaps.plot(frequencies, missed, "o-", color=COLOURS["alarms"], markersize=3, label="a trial of two trays")
        gaps.plot(frequencies, settled, "s--", color=COLOURS["faults"], markersize=3, label="a settled tray")
        gaps.set_ylabel("missed cups, mean")
        gaps.legend()
        air.plot(frequencies, [each.air_l_min for each in points], "o-", color=SERIES[5], markersize=3)
        air.set_ylabel("air, L/min ANR")
        for axes in (success, gaps, air):
            axes.set_xlabel("planting frequency, 1/min and row")
            axes.grid()
    return figure


def _success(points: Sequence[Point]) -> NDArray[np.float64]:
    """S of every point and the ends of its 95 % interval, %, three rows."""
    found = (estimate("S", point.trials) for point in points)
    return np.array([(each.mean, each.low, each.high) for each in found], dtype=np.float64).T


def _record(found: Found, bottlenecks: Sequence[Bottleneck]) -> dict[str, object]:
    limits, advice, spacing_m = found.limits, found.advice, found.spacing_m
    return {
        "spacing_m": spacing_m,
        "points": [_point_record(point, found.paces) for point in found.points],
        "observed": [
            {"set": dict(run.setting.values), "trays": TRAYS, "seed": run.seed, "reason": run.reason}
            for pace in found.paces.found.values()
            for run in pace.runs
        ],
        "tried": [_tried_record(point) for point in found.tried],
        "limits_per_min": {
            "without_gap": limits.without_gap,
            "settled": limits.settled,
            "searched_to": limits.searched_to,
            **{f"row {row}": limit for row, limit in limits.by_row.items()},
        },
        "advice": None if advice is None else {
            name: {"ground_speed_km_h": ground_speed_km_h(point.frequency_per_min, spacing_m),
                   "least_waiting_s": _least_wait_s(point), **_tried_record(point)}
            for name, point in (("highest", advice.highest), ("with_margin", advice.with_margin))
        },
        "bottlenecks": {each.name: each.record() for each in bottlenecks},
    }  # fmt: skip


def _tried_record(point: Point) -> dict[str, object]:
    return {
        "frequency_per_min": point.frequency_per_min,
        "set": dict(point.setting.values),
        "gaps": point.gaps,
        "trials": [trial_record(trial) for trial in point.trials],
    }


def _point_record(point: Point, paces: Paces) -> dict[str, object]:
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
