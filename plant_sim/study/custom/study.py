"""Custom study: trials, means with intervals, regression, main effects and contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.study.custom.figures import main_effects
from plant_sim.study.custom.file import CustomStudy
from plant_sim.study.doe.irls import Link
from plant_sim.study.doe.regression import fit, terms
from plant_sim.study.doe.weighted import Model, WeightedFit, weighted_fit
from plant_sim.study.errors import StudyError
from plant_sim.study.estimates import BY_SCATTER, SHARE_OF, Estimate, IntervalBasis, estimate, numbers
from plant_sim.study.factors import ratings_exceeded
from plant_sim.study.report.fit_parts import (
    SHARE_LIMITS,
    doubts,
    explains,
    fit_record,
    no_share_text,
)
from plant_sim.study.report.origin import changed_keys, origin_parts
from plant_sim.study.report.study import Study
from plant_sim.study.report.surface import contours
from plant_sim.study.report.weighted_parts import effects_table, weighted_parts
from plant_sim.study.runner import RunOptions, incomplete_trials, trial_record
from plant_sim.twin.repeats import SHARES
from plant_sim.twin.report import TrialReport

_UNITS = (
    {"cycle_time_s": "s", "simulated_s": "s", "air_l_min": "L/min", "missed_cups": "cups per trial"}
    | dict.fromkeys(SHARES, "%")
    | dict.fromkeys(SHARES.values(), "seedlings per trial")
)


def custom_study(custom: CustomStudy, options: RunOptions) -> Study:
    """Run a custom study.

    Args:
        custom: The study; its trials, seed and seedlings override those in `options`.
        options: Run options.

    Raises:
        StudyError: The study cannot be run.
    """
    options = dataclasses.replace(options, trials=custom.replicates, seed=custom.seed, seedlings=custom.seedlings)
    reports = options.run(custom.settings)
    basis = IntervalBasis.of(reports) if any(name in SHARE_OF for name in custom.responses) else None
    is_binomial = basis is None or basis.is_binomial
    estimates = {
        name: [estimate(name, trials, is_binomial=is_binomial) for trials in reports] for name in custom.responses
    }
    fits = {name: _fitted(custom, name, reports) for name in custom.responses}
    models = {name: each for name, each in fits.items() if isinstance(each, Model)}
    parts: list[Part] = [
        *origin_parts(options.machine, options.machine_file),
        *_about(custom, options),
        *_cautions(custom, options, reports),
        *([] if basis is None else [basis.text(BY_SCATTER)]),
        *(doubt for name, model in models.items() for doubt in doubts(name, model, is_simulated=True)),
        Heading("Runs"),
        _runs(custom, estimates),
    ]
    record: dict[str, object] = {
        "title": custom.title,
        "design": custom.design,
        "changed_parameters": changed_keys(options.machine),
        "seed": options.seed,
        "trials_per_run": options.trials,
        "seedlings": custom.seedlings,
        "intervals": None if basis is None else basis.record(),
        "runs": _run_records(custom, estimates, reports),
    }
    for name, model in fits.items():
        parts += _response_parts(custom, name, estimates[name], model, basis)
    if custom.model != "none":
        record["models"] = {name: fit_record(model) for name, model in models.items()}
    return Study(custom.name, custom.title, options.command("own", custom.path), tuple(parts), record)


def _about(custom: CustomStudy, options: RunOptions) -> list[Part]:
    """Return the description of the experiment."""
    parts: list[Part] = [
        f"Design {custom.design}: {len(custom.points)} runs. Trials per run: {options.trials}, "
        f"of {custom.seedlings} seedlings, on the twin (program and simulated machine in lock step), "
        f"seed {options.seed}.",
        Table(
            "factors",
            "Factors with their coded levels -1 and 1",
            ("term", "factor", "unit", "-1", "1"),
            tuple(
                (f"X{number}", each.name, each.unit, _level(each.natural(-1)), _level(each.natural(1)))
                for number, each in enumerate(custom.factors, 1)
            ),
        ),
    ]
    parts += [
        f"Tied: {each.parameter.name} changes with {custom.parameters[each.factor].name}, from {each.low:.6g} to "
        f"{each.high:.6g}{'' if each.parameter.unit == '-' else f' {each.parameter.unit}'}. Effects of the factor are "
        "effects of both."
        for each in custom.ties
    ]
    if custom.fixed:
        fixed = ", ".join(
            f"{each.name} = {value:.6g}" + ("" if each.unit == "-" else f" {each.unit}")
            for each, value in custom.fixed.items()
        )
        parts.append(f"Fixed in every run: {fixed}. All other values are those of the machine and the program.")
    return parts


def _cautions(custom: CustomStudy, options: RunOptions, reports: Sequence[Sequence[TrialReport]]) -> list[Part]:
    """Return the caveats about the results."""
    parts: list[Part] = [
        f"Outside the manufacturer's rating: {line}." for line in ratings_exceeded(custom.settings, options.machine)
    ]
    beyond = [str(run) for run, trials in enumerate(reports, 1) if any(trial.extrapolates for trial in trials)]
    if beyond:
        runs = f"{'run' if len(beyond) == 1 else 'runs'} {', '.join(beyond)}"
        parts.append(
            f"Outside the range tested in the pepper paper; the behaviour of seedlings is extrapolated: {runs}."
        )
    parts += incomplete_trials(reports, "they are included with their final counts")
    return parts


def _runs(custom: CustomStudy, estimates: Mapping[str, Sequence[Estimate]]) -> Table:
    rows = (
        (run + 1, *map(_level, point), *(each[run].mean for each in estimates.values()))
        for run, point in enumerate(custom.points)
    )
    heading = ("run", *(each.label for each in custom.parameters), *map(_label, estimates))
    return Table("runs", "Levels and mean responses of the runs", heading, tuple(rows))


def _intervals(name: str, estimates: Sequence[Estimate], basis: IntervalBasis | None) -> Table:
    rows = tuple((run, each.mean, each.low, each.high, each.sd) for run, each in enumerate(estimates, 1))
    is_binomial = name in SHARE_OF and basis is not None and basis.is_binomial
    kind = "exact binomial, trials pooled" if is_binomial else "Student's t"
    caption = f"{_label(name)}: mean of each run and its 95 % confidence interval ({kind})"
    return Table(f"{_stem(name)}-intervals", caption, ("run", "mean", "low", "high", "SD between trials"), rows)


def _fitted(custom: CustomStudy, name: str, reports: Sequence[Sequence[TrialReport]]) -> Model | str | None:
    """Return the model of a response, or the reason why there is none; None if no model is requested."""
    if custom.model == "none":
        return None
    values = [numbers(name, trials) for trials in reports]
    response = np.concatenate(values)
    if len(response) < sum(map(len, reports)):
        return f"Not every trial has a value for {name}, so no model is fitted."
    if np.ptp(response) == 0:
        return f"{name} is {response[0]:g} in every trial: no model is fitted."
    coded = np.repeat(custom.coded, [len(each) for each in values], axis=0)
    names = terms(len(custom.parameters), custom.model)
    if name not in SHARES:
        return fit(coded, response, names)
    each_trial = [trial for trials in reports for trial in trials]
    counts = np.array([getattr(trial, SHARES[name]) for trial in each_trial])
    link: Link = "identity" if name == "S" else "logit"  # losses are small: the logit keeps them above 0
    try:
        return weighted_fit(coded, counts, np.array([trial.seedlings for trial in each_trial]), names, link)
    except StudyError as error:
        return f"No model is fitted: {error}."


def _response_parts(
    custom: CustomStudy,
    name: str,
    estimates: Sequence[Estimate],
    model: Model | str | None,
    basis: IntervalBasis | None,
) -> list[Part]:
    """Return the report parts for one response."""
    parts: list[Part] = [Heading(_label(name)), _intervals(name, estimates, basis)]
    if isinstance(model, Model):
        parts += _model_parts(custom, name, model)
    elif model is not None:
        parts.append(model)
    drawn = model if isinstance(model, Model) and explains(model) else None
    parts.append(
        Picture(
            f"{_stem(name)}-main-effects",
            f"Main effects on {_label(name)}: {_line(custom, drawn)}",
            main_effects(custom, estimates, _label(name), drawn),
        )
    )
    return parts


def _line(custom: CustomStudy, model: Model | None) -> str:
    """Return the caption for the line in the main-effects plots."""
    if custom.design == "factorial":
        return "points are runs, bars their 95 % intervals; the line joins the means at the levels"
    if model is not None:
        return "points are runs, bars their 95 % intervals; the line is the model with the other factors at coded 0"
    return "points are runs, bars their 95 % intervals"


def _model_parts(custom: CustomStudy, name: str, model: Model) -> list[Part]:
    stem, label = _stem(name), _label(name)
    parts: list[Part] = []
    if isinstance(model, WeightedFit):
        unit = "" if model.link == "identity" else "; coefficients in logits"
        caption = f"Weighted fit of the individual trials, coded factors: {label}{unit}"
        parts += [
            effects_table(f"{stem}-coefficients", caption, {"estimate": model.values}, model, is_simulated=True),
            *weighted_parts(stem, model, response=label, is_simulated=True),
        ]
    else:
        caption = f"Least squares on the individual trials, coded factors: {label}"
        parts.append(
            effects_table(f"{stem}-coefficients", caption, {"estimate": model.values}, model, is_simulated=True)
        )
        parts.append(f"R² = {model.r2:.4f}, adjusted {model.adjusted_r2:.4f}.")
    if custom.model == "quadratic" and len(custom.parameters) > 1 and explains(model):
        middle, edge = [0.0] * len(custom.parameters), [1.0] * len(custom.parameters)
        is_share = name in SHARES
        if is_share:
            parts += no_share_text(model, custom.factors, held=middle, reach=edge)
        figure = contours(
            model, custom.factors, response=label, held=middle, reach=edge, limits=SHARE_LIMITS if is_share else None
        )
        parts.append(Picture(f"{stem}-contours", f"Fitted {label}; factors not shown are at coded 0", figure))
    return parts


def _run_records(
    custom: CustomStudy, estimates: Mapping[str, Sequence[Estimate]], reports: Sequence[Sequence[TrialReport]]
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
        for run, (setting, coded) in enumerate(zip(custom.settings, custom.coded, strict=True))
    ]


def _label(response: str) -> str:
    """Return the name of a response with its unit."""
    return f"{response}, {_UNITS[response]}" if response in _UNITS else response


def _stem(response: str) -> str:
    """Return the name of a response as a prefix for file names."""
    return response.lower().replace("_", "-")


def _level(value: float) -> Cell:
    """Return a level for a table: an integer without decimals, a long number with six significant digits."""
    value = float(f"{value:.12g}")  # removes the rounding errors of coding and decoding
    if value.is_integer() and abs(value) < 1e9:
        return int(value)
    return value if round(value, 2) == value else f"{value:.6g}"
