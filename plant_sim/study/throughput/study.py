"""Throughput study: frequencies at which the arms keep up, bottleneck and recommended driving speed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from statistics import fmean

from controller.common.document.parts import Cell, Heading, Part, Picture, Table, counted
from controller.program.set_points import FASTEST_PER_MIN, SLOWEST_PER_MIN
from controller.program.tags import ROWS, SIDES
from plant_sim.common.figure_style import drawing
from plant_sim.common.proportion import Proportion
from plant_sim.study.estimates import BY_SCATTER, IntervalBasis, estimate
from plant_sim.study.report.origin import changed_keys, origin_parts
from plant_sim.study.report.study import Study
from plant_sim.study.runner import RunOptions
from plant_sim.study.throughput.bottleneck import Bottleneck, first_late
from plant_sim.study.throughput.chart import gantt_chart
from plant_sim.study.throughput.driving import (
    FREQUENCIES_PER_MIN,
    MARGIN,
    FrequencyResult,
    ThroughputResult,
    drive,
    ground_speed_km_h,
)
from plant_sim.study.throughput.figures import curves, scan_figure
from plant_sim.study.throughput.gains import ROUNDING_PER_MIN, MotionGain
from plant_sim.study.throughput.pace import TRAYS, round_needed_s
from plant_sim.study.throughput.record import record_of
from plant_sim.study.throughput.scan import ConditionScan


def throughput_study(
    options: RunOptions, *, frequencies_per_min: Sequence[int] = FREQUENCIES_PER_MIN, spacing_m: float | None = None
) -> Study:
    """Run the twin at every planting frequency that the program serves and report the recommended driving speed.

    Args:
        options: Run options, with the machine.
        frequencies_per_min: Frequencies of the tables; they affect neither the limits nor the recommendation.
        spacing_m: Plant spacing in a row, m; None = 0.40, marked as assumed in the report.

    Raises:
        StudyError: A frequency or the spacing is invalid.
    """
    result = drive(options, frequencies_per_min, spacing_m)
    changes = (False, True)
    late = (first_late(result.paces, changes_tray=change) for change in changes)
    bottlenecks = [each for each in late if each]
    basis = IntervalBasis.of([point.trials for point in result.points])
    return Study(
        name="throughput",
        title="Throughput: limits at which the arms keep up with the cups",
        command=options.command(
            "throughput", frequencies=",".join(map(str, sorted(set(frequencies_per_min)))), spacing=spacing_m
        ),
        parts=tuple(
            chain(
                origin_parts(options.machine, options.machine_file),
                _advice_parts(result),
                _limit_parts(result, len(next(iter(result.paces.values())).runs)),
                _bottleneck_parts(bottlenecks),
                _gain_parts(result),
                _trial_parts(options, result, basis),
                _setting_parts(options, result),
            )
        ),
        record={"changed_parameters": changed_keys(options.machine), **record_of(result, bottlenecks, basis)},
    )


def _advice_parts(result: ThroughputResult) -> list[Part]:
    advice, limits, spacing_m = result.advice, result.limits, result.spacing_m
    heading = Heading("Recommended speed")
    if advice is None:
        return [
            heading,
            f"No speed can be recommended: {_failure_text(limits.without_gap)}, and the program serves no frequency "
            f"below {SLOWEST_PER_MIN}/min, with a margin of {100 * MARGIN:g} %.",
        ]
    top, safe = advice.highest, advice.with_margin
    text = (
        f"With {100 * spacing_m:g} cm between plants{' (assumed)' if result.is_assumed else ''}, drive up to "
        f"{ground_speed_km_h(top.frequency_per_min, spacing_m):.2f} km/h: {top.frequency_per_min} plants per minute "
        f"per row. At every frequency from {SLOWEST_PER_MIN}/min to this one, {counted(len(top.trials), 'trial')} of "
        f"{top.trials[0].seedlings} seedlings had no gap; {_failure_text(limits.without_gap)}. With a margin of "
        f"{100 * MARGIN:g} %: {ground_speed_km_h(safe.frequency_per_min, spacing_m):.2f} km/h, "
        f"{safe.frequency_per_min} per minute; each arm then waits at least {safe.least_wait_s:.1f} s for its cups, "
        "on average."
    )
    settled = limits.settled.limit
    if settled is not None and settled > top.frequency_per_min:
        text += (
            f" Up to {ground_speed_km_h(settled, spacing_m):.2f} km/h, {settled} per minute, gaps occur only at the "
            "start of the observed runs, until the timing between the arms has settled."
        )
    trials = len(top.trials)
    _, most = Proportion(0, trials).interval_percent
    text += (
        f" The trials differ in the start position of the cups, which determines the first gaps. {trials} trials "
        f"without a gap do not exclude gaps: they may still occur in up to {most:.0f} % of the starts (95 %, "
        "exact binomial), and another seed may shift the limit by a few plants per minute; a larger --trials "
        "reduces the uncertainty."
    )
    return [heading, text]


def _failure_text(scan: ConditionScan) -> str:
    first = scan.first_failure
    if first is None:
        return f"{max(scan.met)}/min is the highest frequency that the program serves"
    return f"the first gap occurs at {first}/min"


def _limit_parts(result: ThroughputResult, runs: int) -> list[Part]:
    limits = result.limits
    rows: list[tuple[Cell, ...]] = [
        (each.name, each.limit, _round_s(each.limit), each.first_failure, _ranges(each.met_again))
        for each in limits.conditions
    ]
    trials = len(next(iter(result.results.values())).trials)
    return [
        Heading("Limits of the arms"),
        f"Every frequency that the program serves, {SLOWEST_PER_MIN} to {FASTEST_PER_MIN}/min in steps of 1/min, was "
        f"run: the first condition with {counted(trials, 'trial')}, the others with {counted(runs, 'run')} of {TRAYS} "
        "trays. A condition need not be monotone, because the first gaps depend on the start position of the cups and "
        "on which arm is first in the centre. Its limit is therefore the highest frequency up to which it is met "
        "without exception. A round is the time for twelve cups to pass; an arm that arrives after the twelfth cup "
        "leaves a gap.",
        Table(
            "limits",
            "Limit of each condition",
            ("condition", "met up to, 1/min", "round, s", "first failure, 1/min", "met again at, 1/min"),
            tuple(rows),
        ),
        Picture(
            "scan",
            "Trials with a gap at every planting frequency, with exact 95 % intervals; dashed: highest frequency "
            "without exception",
            scan_figure(result),
        ),
    ]


def _ranges(numbers: Sequence[int]) -> str:
    """Return ascending integers as text, with ranges for successive ones.

    >>> _ranges((52, 53, 54, 60))
    '52 to 54, 60'
    """
    groups: list[list[int]] = []
    for number in numbers:
        if groups and number == groups[-1][-1] + 1:
            groups[-1].append(number)
        else:
            groups.append([number])
    return ", ".join(str(each[0]) if len(each) == 1 else f"{each[0]} to {each[-1]}" for each in groups) or "-"


def _gain_parts(result: ThroughputResult) -> list[Part]:
    gains, limit = result.gains, result.limits.without_gap.limit
    if not gains or limit is None:
        return []
    scanned = [each for gain in gains for each in gain.scan.met]
    rows: list[tuple[Cell, ...]] = [
        (
            each.motion.name,
            each.base_s,
            100 * (each.changed_s / each.base_s - 1),
            each.motion.parameter,
            f"{each.value:.4g}",
            each.margin_s,
            _limit_text(each.scan),
            f"{each.gain_per_min:+.1f}",
            *(f"{end:+.1f}" for end in each.interval_per_min),
            "yes" if each.is_shown else "no: the interval includes 0",
        )
        for each in gains
    ]
    trials = len(gains[0].differences_per_min)
    text = (
        "The time of each motion was changed by 10 % on the twin, by its throttle, motor or set-point, until the "
        f"measured time agreed as far as the steps of a scan allow. {counted(trials, 'trial')} at each frequency that "
        f"decides about a motion, from {min(scanned)} to {max(scanned)}/min, were run again with the same seeds. The "
        "column plants per minute is the change of the number of "
        "frequencies without a gap, mean of the trials, with its 95 % interval by Student's t between them; the "
        f"standard deviation of a trial is taken as at least {ROUNDING_PER_MIN:.2f}/min, because frequencies have "
        f"steps of 1/min. The margin is the smallest one of the rounds of one run at {limit}/min, where a second is "
        f"worth {limit / round_needed_s(limit):.1f} plants per minute: it orders motions whose gain is too small to be "
        f"shown. {_shown_text(gains)}"
    )
    return [
        Heading("Next plant per minute"),
        text,
        Table(
            "gains",
            f"Limit with a changed time of one motion; unchanged machine: {limit}/min",
            (
                "motion",
                "time, s",
                "changed by, %",
                "by",
                "value",
                "margin changed by, s",
                "limit, 1/min",
                "plants per minute",
                "95 % interval: from",
                "to",
                "shown",
            ),
            tuple(rows),
        ),
    ]


def _shown_text(gains: Sequence[MotionGain]) -> str:
    """Return the motions that give plants if they are shorter, and those for which this is not shown."""
    shorter = [each for each in gains if each.changed_s < each.base_s]
    giving = sorted(
        (each for each in shorter if each.is_shown and each.gain_per_min > 0), key=lambda each: -each.gain_per_min
    )
    if not giving:
        return "No motion that is shorter by 10 % is shown to give a plant per minute; a larger --trials may."
    listed = ", ".join(f"{each.motion.name} {each.gain_per_min:+.1f}" for each in giving)
    text = f"Shorter by 10 %, these give plants per minute: {listed}."
    rest = ", ".join(each.motion.name for each in shorter if each not in giving)
    return f"{text} Not shown for: {rest}." if rest else text


def _round_s(frequency_per_min: int | None) -> float | None:
    return None if frequency_per_min is None else round_needed_s(frequency_per_min)


def _bottleneck_parts(bottlenecks: Sequence[Bottleneck]) -> list[Part]:
    parts: list[Part] = [Heading("Bottleneck")]
    if not bottlenecks:
        return [*parts, "No arm is late at any frequency: the carousel, and thus the tractor, sets the pace."]
    parts.append(
        "The critical path runs from a throw back to the previous one: it contains motions and dwells, and a wait is "
        "replaced by its cause. The round with the largest delay at the lowest frequency with a late round is shown."
    )
    for each in bottlenecks:
        with drawing():
            chart = gantt_chart(each.timeline, each.round)
        parts += [each.text(), each.table(), Picture(f"round-{each.name}", f"The same round, {each.title}", chart)]
    return parts


def _trial_parts(options: RunOptions, result: ThroughputResult, basis: IntervalBasis) -> list[Part]:
    points, paces, spacing_m = result.points, result.paces, result.spacing_m
    rows: list[tuple[Cell, ...]] = []
    for point in points:
        success = estimate("S", point.trials, is_binomial=basis.is_binomial)
        rows.append(
            (
                point.frequency_per_min,
                ground_speed_km_h(point.frequency_per_min, spacing_m),
                success.mean,
                success.low,
                success.high,
                success.sd,
                point.mean("missed_cups"),
                paces[point.frequency_per_min].settled_missed_cups,
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
        f"At each frequency {counted(len(points[0].trials), 'trial')} of {options.seedlings} seedlings; S with its "
        f"95 % interval; settled trays are those from the third tray of runs with {TRAYS} trays. "
        f"{basis.text(BY_SCATTER)}",
        Table("trials", "Results of the trials", heading, tuple(rows)),
        *_cause_parts(points),
        _waiting_table(points),
        Picture(
            "curves",
            "Success, gaps and air against the planting frequency",
            curves(points, paces, is_binomial=basis.is_binomial),
        ),
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


def _limit_text(scan: ConditionScan) -> str:
    """Return the limit of a scan, which may be below or at least the scanned frequencies."""
    if scan.limit is None:
        return f"below {min(scan.met)}"
    return str(scan.limit) if scan.first_failure is not None else f"{scan.limit} or more"


def _setting_parts(options: RunOptions, result: ThroughputResult) -> list[Part]:
    rows: list[tuple[Cell, ...]] = []
    for point in result.points:
        landings_mm = result.paces[point.frequency_per_min].landings_mm
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
