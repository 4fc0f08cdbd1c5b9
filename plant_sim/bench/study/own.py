"""A study of one's own: its trials, means with intervals, regression, main effects and contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from statsmodels.stats.weightstats import DescrStatsW

from controller.program.tags import CUPS
from plant_sim.bench.repeats import SHARES, pool
from plant_sim.bench.report import TrialReport
from plant_sim.bench.study.factors import ratings_exceeded
from plant_sim.bench.study.fit_parts import (
    SHARE_LIMITS,
    anova_table,
    coefficient_table,
    doubts,
    explains,
    fit_record,
    no_share_text,
)
from plant_sim.bench.study.own_figures import main_effects
from plant_sim.bench.study.own_file import OwnStudy
from plant_sim.bench.study.parts import Cell, Heading, Part, Picture, Table
from plant_sim.bench.study.regression import Fit, fit, terms
from plant_sim.bench.study.report import Study
from plant_sim.bench.study.runner import RunOptions, incomplete_trials, trial_record
from plant_sim.bench.study.surface import contours

_SHARE_OF = {name: name for name in SHARES} | {count: name for name, count in SHARES.items()}
"""Responses that come of counting seedlings, and the share that each stands for."""
_UNITS = (
    {"cycle_time_s": "s", "simulated_s": "s", "air_l_min": "L/min", "missed_cups": "cups a trial"}
    | dict.fromkeys(SHARES, "%")
    | dict.fromkeys(SHARES.values(), "seedlings a trial")
)

ROWS_FAIL_TOGETHER = (
    "The binomial intervals take every seedling to fail by itself. A late release or a stop loses up to "
    f"{CUPS} at once: where that happens they are too narrow, and the standard deviation between trials tells more."
)
"""What the intervals of counted seedlings do not know."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A response at one setting.

    Attributes:
        mean: Mean of its trials; None where no trial gave a number.
        low: Lower end of the 95 % confidence interval of the mean; None where it cannot be told.
        high: Upper end.
        sd: Standard deviation between trials; None for fewer than two.
    """

    mean: float | None
    low: float | None = None
    high: float | None = None
    sd: float | None = None


def estimate(response: str, trials: Sequence[TrialReport]) -> Estimate:
    """Return the mean of a response at one setting with its 95 % interval.

    Whatever counts seedlings is pooled over the trials and gets the exact binomial interval (Clopper and Pearson), as
    a share or, times the seedlings of a trial, as a number; anything else gets that of Student's t, for which it takes
    two trials that differ.

    Args:
        response: Name of a number of a trial.
        trials: All trials at the setting.
    """
    values = numbers(response, trials)
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    share = _SHARE_OF.get(response)
    if share is not None:
        together = pool(trials)
        each = 1.0 if share == response else together.seedlings / together.trials / 100
        low, high = together.intervals[share]
        return Estimate(each * together.shares[share], each * low, each * high, sd)
    if len(values) == 0:
        return Estimate(None)
    if np.ptp(values) == 0:
        return Estimate(float(values[0]), sd=sd)
    described = DescrStatsW(values)
    low, high = described.tconfint_mean(alpha=0.05)
    return Estimate(float(described.mean), float(low), float(high), sd)


def numbers(response: str, trials: Sequence[TrialReport]) -> NDArray[np.float64]:
    """Return what those trials gave that have a number for a response."""
    values = [getattr(trial, response) for trial in trials]
    return np.array([value for value in values if value is not None], dtype=np.float64)


def own_study(own: OwnStudy, options: RunOptions) -> Study:
    """Run a study of one's own.

    Args:
        own: The study as read; trials, seed and seedlings are its own.
        options: How to run it otherwise.

    Raises:
        StudyError: it cannot be run.
    """
    options = dataclasses.replace(options, trials=own.replicates, seed=own.seed, seedlings=own.seedlings)
    reports = options.run(own.settings)
    estimates = {name: [estimate(name, trials) for trials in reports] for name in own.responses}
    fits = {name: _fitted(own, name, reports) for name in own.responses}
    models = {name: each for name, each in fits.items() if isinstance(each, Fit)}
    parts: list[Part] = [
        *_about(own, options),
        *_cautions(own, options, reports),
        *(doubt for name, model in models.items() for doubt in doubts(name, model)),
        Heading("Runs"),
        _runs(own, estimates),
    ]
    record: dict[str, object] = {
        "title": own.title,
        "design": own.design,
        "seed": options.seed,
        "trials_per_run": options.trials,
        "seedlings": own.seedlings,
        "runs": _run_records(own, estimates, reports),
    }
    for name, found in fits.items():
        parts += _response_parts(own, name, estimates[name], found)
    if own.model != "none":
        record["models"] = {name: fit_record(model) for name, model in models.items()}
    return Study(own.name, own.title, options.command("own", own.path), tuple(parts), record)


def _about(own: OwnStudy, options: RunOptions) -> list[Part]:
    """What was done."""
    parts: list[Part] = [
        f"Design {own.design}: {len(own.points)} runs. Trials a run: {options.trials}, of {own.seedlings} seedlings, "
        f"on the twin (program and simulated machine in lock step), seed {options.seed}.",
        Table(
            "factors",
            "Factors, and what the coded levels -1 and 1 stand for",
            ("term", "factor", "unit", "-1", "1"),
            tuple(
                (f"X{number}", each.name, each.unit, _level(each.natural(-1)), _level(each.natural(1)))
                for number, each in enumerate(own.factors, 1)
            ),
        ),
    ]
    if own.fixed:
        fixed = ", ".join(
            f"{each.name} = {value:.6g}" + ("" if each.unit == "-" else f" {each.unit}")
            for each, value in own.fixed.items()
        )
        parts.append(f"Held in every run: {fixed}. Everything else is as machine and program have it.")
    return parts


def _cautions(own: OwnStudy, options: RunOptions, reports: Sequence[Sequence[TrialReport]]) -> list[Part]:
    """What to know before the figures are believed."""
    parts: list[Part] = [
        f"Outside the maker's rating: {line}." for line in ratings_exceeded(own.settings, options.machine)
    ]
    beyond = [str(run) for run, trials in enumerate(reports, 1) if any(trial.extrapolates for trial in trials)]
    if beyond:
        runs = f"{'run' if len(beyond) == 1 else 'runs'} {', '.join(beyond)}"
        parts.append(f"Outside the trials of the pepper paper, where it is extrapolated what happens to a seedling: "
                     f"{runs}.")  # fmt: skip
    parts += incomplete_trials(reports, "they count as they ended")
    if any(name in _SHARE_OF for name in own.responses):
        parts.append(ROWS_FAIL_TOGETHER)
    return parts


def _runs(own: OwnStudy, estimates: Mapping[str, Sequence[Estimate]]) -> Table:
    rows = (
        (run + 1, *map(_level, point), *(each[run].mean for each in estimates.values()))
        for run, point in enumerate(own.points)
    )
    heading = ("run", *(each.label for each in own.knobs), *map(_label, estimates))
    return Table("runs", "Levels and mean responses of the runs", heading, tuple(rows))


def _intervals(name: str, estimates: Sequence[Estimate]) -> Table:
    rows = tuple((run, each.mean, each.low, each.high, each.sd) for run, each in enumerate(estimates, 1))
    kind = "exact binomial, trials pooled" if name in _SHARE_OF else "Student's t"
    caption = f"{_label(name)}: mean of each run and its 95 % confidence interval ({kind})"
    return Table(f"{_stem(name)}-intervals", caption, ("run", "mean", "low", "high", "SD between trials"), rows)


def _fitted(own: OwnStudy, name: str, reports: Sequence[Sequence[TrialReport]]) -> Fit | str | None:
    """The model of a response, or why there is none; None where none is wanted."""
    if own.model == "none":
        return None
    values = [numbers(name, trials) for trials in reports]
    response = np.concatenate(values)
    if len(response) < sum(map(len, reports)):
        return f"Not every trial has a number for {name}, so no model is fitted."
    if np.ptp(response) == 0:
        return f"{name} is {response[0]:g} in every trial: there is nothing for a model to explain."
    coded = np.repeat(own.coded, [len(each) for each in values], axis=0)
    return fit(coded, response, terms(len(own.knobs), own.model))


def _response_parts(own: OwnStudy, name: str, estimates: Sequence[Estimate], found: Fit | str | None) -> list[Part]:
    """Everything about one response."""
    parts: list[Part] = [Heading(_label(name)), _intervals(name, estimates)]
    means = np.array([np.nan if each.mean is None else each.mean for each in estimates])
    if isinstance(found, Fit):
        parts += _model_parts(own, name, found)
    elif found is not None:
        parts.append(found)
    drawn = found if isinstance(found, Fit) and explains(found) else None
    parts.append(Picture(f"{_stem(name)}-main-effects", f"Main effects on {_label(name)}: {_line(own, drawn)}",
                         main_effects(own, means, _label(name), drawn)))  # fmt: skip
    return parts


def _line(own: OwnStudy, model: Fit | None) -> str:
    """What the line in the main effects is."""
    if own.design == "factorial":
        return "points are runs, the line joins the means of the levels"
    if model is not None:
        return "points are runs, the line is the model with the other factors at their coded 0"
    return "points are runs"


def _model_parts(own: OwnStudy, name: str, model: Fit) -> list[Part]:
    stem, label = _stem(name), _label(name)
    caption = f"Least squares on the single trials, coded factors: {label}"
    parts: list[Part] = [
        coefficient_table(f"{stem}-coefficients", caption, {"estimate": model.values}, fit=model, digits=4),
        anova_table(f"{stem}-anova", f"Analysis of variance of {label}; terms are partial (type III)",
                    {"twin": model.anova}, digits=4),
        f"R² = {model.r2:.4f}, adjusted {model.adjusted_r2:.4f}.",
    ]  # fmt: skip
    if own.model == "quadratic" and len(own.knobs) > 1 and explains(model):
        middle, edge = [0.0] * len(own.knobs), [1.0] * len(own.knobs)
        is_share = name in SHARES
        if is_share:
            parts += no_share_text(model, own.factors, held=middle, reach=edge)
        figure = contours(model, own.factors, response=label, held=middle, reach=edge,
                          limits=SHARE_LIMITS if is_share else None)  # fmt: skip
        parts.append(Picture(f"{stem}-contours", f"Fitted {label}; factors not shown are at their coded 0", figure))
    return parts


def _run_records(
    own: OwnStudy, estimates: Mapping[str, Sequence[Estimate]], reports: Sequence[Sequence[TrialReport]]
) -> list[dict[str, object]]:
    return [
        {
            "setting": dict(setting.values),
            "coded": coded.tolist(),
            "estimates": {name: dataclasses.asdict(each[run]) for name, each in estimates.items()},
            "trials": [
                {**trial_record(trial), **{name: getattr(trial, name) for name in estimates}} for trial in reports[run]
            ],
        }
        for run, (setting, coded) in enumerate(zip(own.settings, own.coded, strict=True))
    ]


def _label(response: str) -> str:
    """A response with its unit."""
    return f"{response}, {_UNITS[response]}" if response in _UNITS else response


def _stem(response: str) -> str:
    """A response as the beginning of a file name."""
    return response.lower().replace("_", "-")


def _level(value: float) -> Cell:
    """A level as it stands in a table: a whole number as one, a long one with six digits."""
    value = float(f"{value:.12g}")  # without what coding and decoding leave behind
    if value.is_integer() and abs(value) < 1e9:
        return int(value)
    return value if round(value, 2) == value else f"{value:.6g}"
