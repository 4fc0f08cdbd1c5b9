"""Study ``pepper-single``: the three single-factor tests of the pepper paper, run on the twin ([P], section 3.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Heading, Part, Picture, Table, counted
from plant_sim.common.figure_style import COLOURS, QUIET, drawing
from plant_sim.common.paper_sheet import sheet
from plant_sim.crop.response import CropSpec
from plant_sim.study.estimates import IntervalBasis
from plant_sim.study.pepper.experiment import (
    LEFT_OUT,
    PooledResult,
    cautions,
    incomplete_count,
    point_of,
    run_record,
    setting_of,
)
from plant_sim.study.pepper.statements import STATEMENTS, Statement, Verdict
from plant_sim.study.report.origin import changed_keys, origin_parts
from plant_sim.study.report.study import Study
from plant_sim.study.runner import RunOptions, incomplete_trials

_AXES: Final = {"foam": "foam thickness, mm", "age": "age of the seedlings, d", "pressure": "claw pressure, MPa"}
_LINES: Final = {"F_p": COLOURS["left"], "F_d": COLOURS["right"], "F_t": COLOURS["supply"]}


def single_study(options: RunOptions) -> Study:
    """Return the study of the paper's single-factor tests.

    Raises:
        StudyError: A setting is invalid, or none of its trials completes.
    """
    levels = sheet("pepper-single-factor")
    natural = levels.points("foam_mm", "age_d", "pressure_mpa")
    settings = [setting_of(each, options.machine) for each in natural]
    reports = options.run(settings)
    tests: dict[str, list[PooledResult]] = {name: [] for name in _AXES}
    runs: dict[str, list[dict[str, object]]] = {name: [] for name in _AXES}
    for name, each, setting, trials in zip(levels.texts("factor"), natural, settings, reports, strict=True):
        point = point_of(CropSpec(*map(float, each)), trials)
        tests[name].append(point)
        runs[name].append({**run_record(point, setting, trials), "S_by_equation_5": point.by_equation_5})
    verdicts = {name: _verdicts(name, points) for name, points in tests.items()}
    completed = [[trial for trial in trials if trial.completed] for trials in reports]
    basis = IntervalBasis.of(completed)
    parts: list[Part] = [
        *origin_parts(options.machine, options.machine_file),
        f"{counted(options.trials, 'trial')} of {options.seedlings} seedlings at each level, on the twin. The paper "
        "shows the results only as figures and describes them in words.",
        *cautions(settings, options),
        *incomplete_trials(reports, LEFT_OUT),
        basis.text("They are lower bounds of the true intervals."),
        _verdict_text(verdicts),
    ]
    for index, (name, points) in enumerate(tests.items()):
        parts += [
            Heading(_AXES[name].partition(",")[0].capitalize()),
            _single_table(name, points, index),
            Picture(
                f"single-{name}",
                "Pick failures F_p, carry failures F_d, throw failures F_t and success S against "
                f"{_AXES[name]}; bars: 95 % binomial intervals.",
                _single_figure(name, points, index),
            ),
            _statements_table(name, points),
        ]
    parts.append(_what_equation_5_implies(tests["age"]))
    statements = {
        name: [{"words": each.text, "share": each.share, "verdict": verdict} for each, verdict in judged]
        for name, judged in verdicts.items()
    }
    record = {
        **runs,
        "changed_parameters": changed_keys(options.machine),
        "sentences": statements,
        "intervals": basis.record(),
        "incomplete_trials": incomplete_count(reports),
    }
    return Study(
        name="pepper-single",
        title="Pepper seedlings: single-factor tests",
        command=options.command("pepper-single"),
        parts=tuple(parts),
        record=record,
    )


def _single_table(name: str, points: Sequence[PooledResult], index: int) -> Table:
    heading = (_AXES[name], "F_p, %", "F_d, %", "F_t, %", "S, %", "S from", "to", "S by equation 5", "extrapolated")
    rows: list[tuple[Cell, ...]] = []
    for point in points:
        shares, (low, high) = point.shares, point.intervals["S"]
        rows.append(
            (
                f"{point.levels[index]:g}",
                shares["F_p"],
                shares["F_d"],
                shares["F_t"],
                shares["S"],
                low,
                high,
                point.by_equation_5,
                "yes" if point.crop.extrapolates else "no",
            )
        )
    return Table(f"single-{name}", f"Failures over {_AXES[name]}", heading, tuple(rows), 1)


def _single_figure(name: str, points: Sequence[PooledResult], index: int) -> Figure:
    levels = [point.levels[index] for point in points]
    with drawing():
        figure = Figure(figsize=(7.0, 3.2), layout="constrained")
        failures, success = figure.subplots(1, 2)
        for share, colour in _LINES.items():
            failures.errorbar(
                levels,
                [each.shares[share] for each in points],
                _bars(points, share),
                color=colour,
                marker="o",
                markersize=4,
                capsize=2,
                label=share,
            )
        failures.set(xlabel=_AXES[name], ylabel="failed seedlings, %", ylim=(0, None), xticks=levels)
        failures.legend()
        success.errorbar(
            levels,
            [each.shares["S"] for each in points],
            _bars(points, "S"),
            color=COLOURS["left"],
            marker="o",
            markersize=4,
            capsize=2,
            label="twin",
        )
        success.plot(levels, [each.by_equation_5 for each in points], "--", color=QUIET, label="equation 5")
        success.set(xlabel=_AXES[name], ylabel="success rate S, %", xticks=levels)
        success.legend()
    return figure


def _bars(points: Sequence[PooledResult], share: str) -> NDArray[np.float64]:
    """Return the distances from each percentage to the lower and upper ends of its interval, in two rows."""
    ends = [
        (each.shares[share] - each.intervals[share][0], each.intervals[share][1] - each.shares[share])
        for each in points
    ]
    bars: NDArray[np.float64] = np.maximum(np.array(ends).T, 0.0)
    return bars


def _verdicts(name: str, points: Sequence[PooledResult]) -> list[tuple[Statement, Verdict]]:
    """Return every statement of the paper about a factor, with its verdict."""
    course = tuple(point.pool for point in points)
    return [(each, each.verdict(course)) for each in STATEMENTS[name]]


def _verdict_text(verdicts: Mapping[str, Sequence[tuple[Statement, Verdict]]]) -> str:
    """Return a text that gives the number of confirmed statements and lists the others."""
    judged = [(name, *each) for name, found in verdicts.items() for each in found]
    parts = [
        f"Of the {len(judged)} statements of the paper, these trials confirm "
        f"{sum(verdict == 'yes' for *_, verdict in judged)}."
    ]
    for verdict, what in (("no", "Contradicted"), ("undecided", "Undecided")):
        those = [f"{name}, {each.text}" for name, each, outcome in judged if outcome == verdict]
        if those:
            parts.append(f"{what}: {'; '.join(those)}.")
    return " ".join(parts)


def _statements_table(name: str, points: Sequence[PooledResult]) -> Table:
    """Return a table that compares the paper's statements about a factor with the twin's results."""
    rows: list[tuple[Cell, ...]] = []
    for each, verdict in _verdicts(name, points):
        shown = ", ".join(f"{point.shares[each.share]:.1f}" for point in points)
        rows.append((each.text, each.meaning, f"{each.share} {shown}", verdict))
    caption = (
        "Statements of the paper and results of these trials; undecided: too few seedlings to decide "
        "(simultaneous 95 % confidence for all comparisons of a row)"
    )
    return Table(f"words-{name}", caption, ("paper", "criterion", "twin, %, level by level", "holds"), tuple(rows))


def _what_equation_5_implies(points: Sequence[PooledResult]) -> str:
    at = {each.crop.seedling_age_d: each for each in points}
    young, old = at[52.0], at[58.0]
    lost = young.by_equation_5 - old.by_equation_5
    picked = sum(old.shares[name] - young.shares[name] for name in ("F_p", "F_d"))
    return (
        f"From 52 to 58 d, S by equation 5 falls by {lost:.1f} percentage points, while the paper states that pick and "
        "carry failures fall. Both can be true only if throw failures rise by more than that: on the twin F_p and F_d "
        f"together change by {picked:+.1f} percentage points and F_t by {old.shares['F_t'] - young.shares['F_t']:+.1f}."
    )
