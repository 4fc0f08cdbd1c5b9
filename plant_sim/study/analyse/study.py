"""Study ``analyse``: report about a table of trials that never saw the twin."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Heading, Part, Picture, Table, counted
from plant_sim.study.analyse.model import Order, Stratum, TrialModel, fit_model, predicted_r2
from plant_sim.study.analyse.range_parts import range_parts, range_record
from plant_sim.study.analyse.roles import RoleOptions, Trials, assign
from plant_sim.study.analyse.table import TrialTable
from plant_sim.study.doe.design import Factor, full_factorial, to_natural
from plant_sim.study.doe.irls import Link
from plant_sim.study.doe.optimum import best
from plant_sim.study.doe.regression import point_numbers
from plant_sim.study.doe.weighted import Model, WeightedFit
from plant_sim.study.report.fit_parts import SHARE_LIMITS, anova_table, p_text
from plant_sim.study.report.study import Study
from plant_sim.study.report.surface import contours, observed_against_predicted
from plant_sim.study.report.weighted_parts import error_text

_SIGNIFICANT_P = 0.05
_MOST_OPTIMUM_FACTORS = 6
_MOST_CONTOUR_FACTORS = 5
_GRID_POINTS = 4_000
_DRAWS = 1000
_ROUNDING = 1e-6
_EDGE = "at the edge"
_ANYWHERE = "anywhere in the range"
_FIRST_IDEOGRAPH = "\u2e80"
"""First character that the font of the pictures lacks."""


@dataclasses.dataclass(frozen=True)
class Optimum:
    """Best point of a model within the range of the trials.

    Attributes:
        coded: Coded levels.
        response: Response of the model.
        low: Lower ends of the 95 % intervals of the levels, coded.
        high: Upper ends.
        prediction: 95 % interval of the response of one further trial.
    """

    coded: NDArray[np.float64]
    response: float
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    prediction: tuple[float, float]


def analyse_study(
    table: TrialTable, options: RoleOptions, command: str, *, order: Order | None = None, link: Link = "logit"
) -> Study:
    """Analyse a table of trials.

    Args:
        table: The table.
        options: Roles of its columns.
        command: Command that reproduces the study.
        order: Polynomial; None for the richest one that the trials identify.
        link: Link of a fit to counts.

    Raises:
        StudyError: A column does not fit its role, or the polynomial cannot be fitted.
    """
    trials = assign(table, options)
    model = fit_model(trials, order, link)
    optimum = _optimum(trials, model) if isinstance(model, TrialModel) else None
    parts: list[Part] = [
        *_cautions(trials, model),
        f"Data: {table.path.name}, {counted(len(table.lines), 'trial')}. The unit is the trial, one line of the table. "
        "Nothing here comes from the twin or from a paper.",
        trials.roles,
        _factor_table(trials),
        Heading("Trials"),
        _points(trials),
    ]
    if isinstance(model, TrialModel):
        parts += [*_model_parts(trials, model, link), *_optimum_parts(trials, model, optimum)]
    parts += range_parts(trials, None if isinstance(model, str) else model)
    return Study("analyse", f"Analysis of {table.path.name}", command, tuple(parts), _record(trials, model, optimum))


def _cautions(trials: Trials, model: TrialModel | str) -> list[str]:
    """Return what limits the conclusions, the gravest first."""
    if isinstance(model, str):
        return [f"No model is fitted and nothing is tested: {model}. The means below are descriptive."]
    cautions = []
    if trials.hard and trials.plots is None:
        names = _names(trials, trials.hard)
        cautions.append(
            f"P values of {names} are too small: trials between two changes of a factor that is hard to change share "
            "its error, and the table does not number these whole plots. Add a column that numbers them, and name it "
            "with --whole-plots."
        )
    for stratum in model.strata:
        cautions += _stratum_cautions(stratum)
    predicted = predicted_r2(model.fit)
    if predicted is not None and predicted <= 0:
        cautions.append(
            f"The model predicts a trial that it has not seen no better than the mean of the others does (predicted R² "
            f"{predicted:.2f})."
        )
    if trials.plots is not None:
        cautions.append(
            "Intervals of the optimum and of a further trial contain the error between trials, not that between whole "
            "plots; they are lower bounds."
        )
    return cautions


def _stratum_cautions(stratum: Stratum) -> list[str]:
    where = "" if stratum.name == "trials" else f", {stratum.name}"
    if isinstance(stratum.fit, str):
        return [f"No P values of {', '.join(stratum.terms)} ({stratum.name}): {stratum.fit}."]
    cautions = []
    if isinstance(stratum.fit, WeightedFit) and stratum.fit.is_lower_bound:
        cautions.append(
            f"No trials are repeated at one point{where}, or the repeated ones do not differ: the scatter "
            "between trials is unknown. Intervals are lower bounds, and there are no P values."
        )
    if isinstance(stratum.fit, WeightedFit) and stratum.fit.link == "identity" and stratum.fit.at_bound:
        cautions.append(
            f"In {counted(stratum.fit.at_bound, 'trial')} the fitted share{where} is within 0.5 % of 0 or 100 %, or "
            "beyond; the variance is not known there, so intervals and tests are doubtful. Omit --link identity."
        )
    p = stratum.model_p
    if p is not None and p > _SIGNIFICANT_P:
        cautions.append(f"The factors have no significant effect{where} (P {p_text(p)}).")
    lack = next((row.p for row in stratum.fit.anova if row.source == "lack of fit"), None)
    if lack is not None and lack < _SIGNIFICANT_P:
        cautions.append(
            f"The model does not fit{where} (lack of fit P {p_text(lack)}): its residual exceeds the scatter of "
            "repeated trials. Do not use its optimum."
        )
    return cautions


def _names(trials: Trials, numbers: Sequence[int]) -> str:
    return ", ".join(trials.factors[number - 1].name for number in numbers)


def _factor_table(trials: Trials) -> Table:
    rows = tuple(
        (
            f"X{number}",
            factor.name,
            factor.unit,
            f"{factor.natural(-1):.6g}",
            f"{factor.natural(1):.6g}",
            len(np.unique(np.round(coded, 9))),
            "hard to change" if number in trials.hard else None,
        )
        for number, (factor, coded) in enumerate(zip(trials.factors, trials.coded.T, strict=True), 1)
    )
    heading = ("term", "factor", "unit", "-1", "1", "levels", "remark")
    return Table("factors", "Factors with their coded levels -1 and 1", heading, rows)


def _points(trials: Trials) -> Table:
    """Return the table of the points with mean and scatter of their trials."""
    groups = point_numbers(trials.coded)
    rows: list[tuple[Cell, ...]] = []
    for group in dict.fromkeys(groups.tolist()):
        own = np.flatnonzero(groups == group)
        values = trials.response[own]
        if trials.counts is not None and trials.totals is not None:
            mean = float(100 * trials.counts[own].sum() / trials.totals[own].sum())
        else:
            mean = float(values.mean())
        natural = to_natural(trials.factors, trials.coded[own[0]])
        sd = float(values.std(ddof=1)) if len(own) > 1 else None
        rows.append((len(rows) + 1, *(f"{level:.6g}" for level in natural), len(own), mean, sd))
    heading = ("point", *(factor.label for factor in trials.factors), "trials", trials.label, "SD between trials")
    return Table("points", "Mean response at each point", heading, tuple(rows))


def _model_parts(trials: Trials, model: TrialModel, link: Link) -> list[Part]:
    fitted = model.fit
    how = "Least squares" if trials.counts is None else f"Weighted fit of counts, {link} link"
    unit = "logits" if trials.counts is not None and link == "logit" else trials.label
    chosen = f"{model.order} model"
    parts: list[Part] = [Heading("Model")]
    if isinstance(fitted, WeightedFit):
        parts.append(error_text(fitted, is_simulated=False))
    parts.append(_coefficients(model, f"{how}, {chosen}, coded factors: {unit}"))
    for number, stratum in enumerate(model.strata, 1):
        if not isinstance(stratum.fit, str):
            stem = "anova" if len(model.strata) == 1 else f"anova-{number}"
            error = "of the trials" if len(model.strata) == 1 else stratum.name
            caption = f"Analysis of variance of {trials.label}, error {error}; terms are partial (type III)"
            parts.append(anova_table(stem, caption, {"trials": stratum.rows()}, digits=4))
    parts.append(
        f"Judge the factors together first. The {counted(len(model.terms), 'term')} are tested one by one, without a "
        "correction for their number: of terms without any effect, one in twenty has a P value below 0.05."
    )
    parts.append(_quality_text(fitted))
    predicted = fitted.predict(fitted.coded)
    figure = observed_against_predicted(
        fitted.response, predicted, response=_drawn(trials.label, "response"), r2=fitted.r2
    )
    parts.append(Picture("trials", f"{trials.label}: observed against fitted values of the trials", figure))
    return parts


def _quality_text(fitted: Model) -> str:
    predicted = predicted_r2(fitted)
    text = f"R² = {fitted.r2:.4f}, adjusted {fitted.adjusted_r2:.4f}"
    if predicted is None:
        return f"{text}; a predicted R² does not exist, because some trial determines a coefficient alone."
    return f"{text}, predicted {predicted:.4f} (each trial from a fit without it)."


def _coefficients(model: TrialModel, caption: str) -> Table:
    """Return the coefficients; standard error and P are those of the stratum that tests the term."""
    rows: list[tuple[Cell, ...]] = [("constant", model.fit.values["1"], None, None, None, None, None)]
    for term in model.terms:
        stratum = next(each for each in model.strata if term in each.terms)
        if isinstance(stratum.fit, str):
            rows.append((term, model.fit.values[term], None, None, None, None, stratum.name))
        else:
            own = stratum.fit.coefficients[term]
            low, high = stratum.fit.coefficient_interval(term)
            rows.append((term, model.fit.values[term], own.standard_error, low, high, p_text(own.p), stratum.name))
    heading = ("term", "estimate", "standard error", f"{model.fit.interval_name}: from", "to", "P", "error")
    return Table("coefficients", caption, heading, tuple(rows), 3)


def _optimum(trials: Trials, model: TrialModel) -> Optimum | None:
    """Return the best point of the model; None if it is not significant or has too many factors."""
    k = len(trials.factors)
    tested = [each.model_p for each in model.strata]
    if k > _MOST_OPTIMUM_FACTORS or all(p is not None and p > _SIGNIFICANT_P for p in tested):
        return None
    is_high = trials.best == "high"
    point, response = best(model, [-1.0] * k, [1.0] * k, maximise=is_high)
    each = max(3, round(_GRID_POINTS ** (1 / k)))
    grid = full_factorial([np.linspace(-1, 1, each).tolist()] * k)
    low, high = model.optimum_interval(grid, is_high_best=is_high, draws=_DRAWS, seed=1)
    ends = model.fit.prediction_interval(model.padded(point))
    return Optimum(point, response, low, high, (float(ends[0][0]), float(ends[1][0])))


def _optimum_parts(trials: Trials, model: TrialModel, optimum: Optimum | None) -> list[Part]:
    if optimum is None:
        return [
            Heading("Optimum"),
            "No optimum is stated: the factors together are not significant, or there are too many of them.",
        ]
    low, high = (to_natural(trials.factors, each) for each in (optimum.low, optimum.high))
    natural = to_natural(trials.factors, optimum.coded)
    remarks = [_remark(*ends) for ends in zip(optimum.coded, optimum.low, optimum.high, strict=True)]
    rows = tuple(
        (factor.label, f"{value:.4g}", f"{a:.4g}", f"{b:.4g}", remark or None)
        for factor, value, a, b, remark in zip(trials.factors, natural, low, high, remarks, strict=True)
    )
    kind = model.fit.interval_name
    text = (
        f"{trials.label}: the {'highest' if trials.best == 'high' else 'lowest'} response of the model at coded "
        f"levels -1 to 1 is {optimum.response:.2f}; {kind} of one further trial there: {optimum.prediction[0]:.2f} to "
        f"{optimum.prediction[1]:.2f}. It is the best of the same trials that the model was fitted to, and so too good "
        "on average; confirm it by new trials."
    )
    if model.is_extrapolated(optimum.coded):
        text += " This point is outside the region of the trials: the model is extrapolated there."
    if any(_EDGE in remark for remark in remarks):
        text += " A level at the edge of the range says only that the range ends there."
    if any(_ANYWHERE in remark for remark in remarks):
        text += " A level whose interval is the whole range is not located by these trials."
    heading = ("factor", "optimum", "low", "high", "remark")
    parts: list[Part] = [
        Heading("Optimum"),
        text,
        Table("optimum", f"Optimum, with the {kind} of each level", heading, rows),
    ]
    if _is_curved(model) and 2 <= len(trials.factors) <= _MOST_CONTOUR_FACTORS:
        parts.append(_contours(trials, model, optimum))
    return parts


def _remark(coded: float, low: float, high: float) -> str:
    """Return the remark about the level of an optimum."""
    whole = _ANYWHERE if low < -1 + _ROUNDING and high > 1 - _ROUNDING else ""
    return "; ".join(filter(None, (_EDGE if abs(abs(coded) - 1) < _ROUNDING else "", whole)))


def _is_curved(model: TrialModel) -> bool:
    return any("^2" in term for term in model.terms)


def _contours(trials: Trials, model: TrialModel, optimum: Optimum) -> Picture:
    factors = [_drawn_factor(number, factor) for number, factor in enumerate(trials.factors, 1)]
    figure = contours(
        model,
        factors,
        response=_drawn(trials.label, "response"),
        held=optimum.coded.tolist(),
        reach=[1.0] * len(factors),
        marks={"optimum": optimum.coded},
        limits=None if trials.counts is None else SHARE_LIMITS,
    )
    return Picture("contours", f"{trials.label} over every pair of factors; the others are at the optimum", figure)


def _drawn_factor(number: int, factor: Factor) -> Factor:
    """Return a factor whose name the font of the pictures has; X1, X2, ... for a Chinese name."""
    return Factor(_drawn(factor.name, f"X{number}"), _drawn(factor.unit, "-"), factor.centre, factor.step)


def _drawn(text: str, otherwise: str) -> str:
    return otherwise if any(character >= _FIRST_IDEOGRAPH for character in text) else text


def _record(trials: Trials, model: TrialModel | str, optimum: Optimum | None) -> dict[str, object]:
    """Return the record with every figure."""
    record: dict[str, object] = {
        "roles": trials.roles,
        "response": trials.label,
        "best": trials.best,
        "factors": [dataclasses.asdict(factor) for factor in trials.factors],
        "trials": [
            {"line": line, "coded": coded.tolist(), "response": float(value)}
            for line, coded, value in zip(trials.table.lines, trials.coded, trials.response, strict=True)
        ],
        "ranges": range_record(trials),
    }
    if isinstance(model, str):
        return {**record, "model": None, "reason": model}
    record["model"] = {
        "order": model.order,
        "coefficients": model.polynomial.coefficients,
        "r2": model.fit.r2,
        "adjusted_r2": model.fit.adjusted_r2,
        "predicted_r2": predicted_r2(model.fit),
        "strata": {
            each.name: each.fit if isinstance(each.fit, str) else [dataclasses.asdict(row) for row in each.rows()]
            for each in model.strata
        },
    }
    if isinstance(model.fit, WeightedFit):
        spread = model.fit.dispersion
        record["dispersion"] = {
            "estimate": spread.estimate,
            "degrees": spread.degrees,
            "interval": spread.interval(),
        }
    record["optimum"] = (
        None
        if optimum is None
        else {
            "natural": to_natural(trials.factors, optimum.coded).tolist(),
            "response": optimum.response,
            "low": to_natural(trials.factors, optimum.low).tolist(),
            "high": to_natural(trials.factors, optimum.high).tolist(),
            "prediction": list(optimum.prediction),
        }
    )
    return record
