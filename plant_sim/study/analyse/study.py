"""Study ``analyse``: report about a table of trials that never saw the twin."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.common.document.parts import Cell, Heading, Part, Picture, Table, counted
from plant_sim.study.analyse.model import Order, Stratum, TrialModel, fit_model, predicted_r2, term_text
from plant_sim.study.analyse.optimum_parts import SIGNIFICANT_P, Optimum, drawn, find_optimum, optimum_parts
from plant_sim.study.analyse.range_parts import range_parts, range_record
from plant_sim.study.analyse.roles import RoleOptions, Trials, assign
from plant_sim.study.analyse.table import TrialTable
from plant_sim.study.doe.design import to_natural
from plant_sim.study.doe.irls import Link
from plant_sim.study.doe.regression import point_numbers
from plant_sim.study.doe.weighted import Model, WeightedFit
from plant_sim.study.report.fit_parts import anova_table, p_text
from plant_sim.study.report.study import Study
from plant_sim.study.report.surface import observed_against_predicted
from plant_sim.study.report.weighted_parts import error_text

_FALSE_ALARMS: Final = (
    "False alarms of these tests at nominal 5 %, in simulated tables without an effect: 4 to 6 %, for 144 to 7,200 "
    "seedlings in a trial whose trays have a correlation of 0, 0.01 and 0.03 (docs/statistics.md)."
)
"""Measured false alarms; scripts/analyse_error_rates.py measures them."""


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
    optimum = find_optimum(trials, model) if isinstance(model, TrialModel) else None
    parts: list[Part] = [
        *_cautions(trials, model),
        f"Data: {table.path.name}, {counted(len(table.lines), 'trial')}. The unit is the trial, one line of the table. "
        "Nothing here comes from the twin or from a paper.",
        *(f"The file is {note}." for note in table.notes),
        trials.roles,
        _factor_table(trials),
        Heading("Trials"),
        _points(trials),
    ]
    if isinstance(model, TrialModel):
        parts += [*_model_parts(trials, model, link), *optimum_parts(trials, model, optimum)]
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
    if p is not None and p > SIGNIFICANT_P:
        cautions.append(f"The factors have no significant effect{where} (P {p_text(p)}).")
    lack = next((row.p for row in stratum.fit.anova if row.source == "lack of fit"), None)
    if lack is not None and lack < SIGNIFICANT_P:
        cautions.append(
            f"The model does not fit{where} (lack of fit P {p_text(lack)}): its residual exceeds the scatter of "
            "repeated trials. Do not use its optimum."
        )
    return cautions


def _names(trials: Trials, numbers: Sequence[int]) -> str:
    return ", ".join(trials.names[number - 1] for number in numbers)


def _factor_table(trials: Trials) -> Table:
    rows: list[tuple[Cell, ...]] = [
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
    ]
    for number, kind in enumerate(trials.kinds, len(trials.factors) + 1):
        remark = f"categorical: {', '.join(kind.labels)}{'; hard to change' if number in trials.hard else ''}"
        rows.append((f"X{number}", kind.name, "-", None, None, len(kind.labels), remark))
    heading = ("term", "factor", "unit", "-1", "1", "levels", "remark")
    return Table("factors", "Factors with their coded levels -1 and 1", heading, tuple(rows))


def _points(trials: Trials) -> Table:
    """Return the table of the points with mean and scatter of their trials."""
    groups = point_numbers(trials.columns)
    rows: list[tuple[Cell, ...]] = []
    for group in dict.fromkeys(groups.tolist()):
        own = np.flatnonzero(groups == group)
        values = trials.response[own]
        if trials.counts is not None and trials.totals is not None:
            mean = float(100 * trials.counts[own].sum() / trials.totals[own].sum())
        else:
            mean = float(values.mean())
        natural = to_natural(trials.factors, trials.coded[own[0]])
        labels = (each.cells[own[0]] for each in trials.kinds)
        sd = float(values.std(ddof=1)) if len(own) > 1 else None
        rows.append((len(rows) + 1, *(f"{level:.6g}" for level in natural), *labels, len(own), mean, sd))
    names = (*(factor.label for factor in trials.factors), *(kind.name for kind in trials.kinds))
    heading = ("point", *names, "trials", trials.label, "SD between trials")
    return Table("points", "Mean response at each point", heading, tuple(rows))


def _model_parts(trials: Trials, model: TrialModel, link: Link) -> list[Part]:
    fitted = model.fit
    how = "Least squares" if trials.counts is None else f"Weighted fit of counts, {link} link"
    unit = "logits" if trials.counts is not None and link == "logit" else trials.label
    chosen = f"{model.order} model"
    parts: list[Part] = [Heading("Model")]
    if isinstance(fitted, WeightedFit):
        parts.append(error_text(fitted, is_simulated=False))
    parts.append(_coefficients(trials, model, f"{how}, {chosen}, coded factors: {unit}"))
    parts += _coding_parts(trials)
    for number, stratum in enumerate(model.strata, 1):
        if not isinstance(stratum.fit, str):
            stem = "anova" if len(model.strata) == 1 else f"anova-{number}"
            error = "of the trials" if len(model.strata) == 1 else stratum.name
            caption = f"Analysis of variance of {trials.label}, error {error}; terms are partial (type III)"
            parts.append(anova_table(stem, caption, {"trials": stratum.rows()}, digits=4))
    effects = sum(len(each.effects) for each in model.strata if each.model_p is not None)
    if effects:
        parts.append(
            f"Judge the factors together first. The {counted(effects, 'effect')} are tested one by one, without a "
            "correction for their number: of those that do not exist, one in twenty has a P value below 0.05."
        )
    if isinstance(fitted, WeightedFit) and not fitted.is_lower_bound:
        parts.append(_FALSE_ALARMS)
    parts.append(_quality_text(fitted))
    predicted = fitted.predict(fitted.coded)
    figure = observed_against_predicted(
        fitted.response, predicted, response=drawn(trials.label, "response"), r2=fitted.r2
    )
    parts.append(Picture("trials", f"{trials.label}: observed against fitted values of the trials", figure))
    return parts


def _quality_text(fitted: Model) -> str:
    predicted = predicted_r2(fitted)
    text = f"R² = {fitted.r2:.4f}, adjusted {fitted.adjusted_r2:.4f}"
    if predicted is None:
        return f"{text}; a predicted R² does not exist, because some trial determines a coefficient alone."
    return f"{text}, predicted {predicted:.4f} (each trial from a fit without it)."


def _coding_parts(trials: Trials) -> list[Part]:
    """Return how the categorical factors are coded; empty without any."""
    if not trials.kinds:
        return []
    first = trials.kinds[0]
    term = term_text(trials, f"X{len(trials.factors) + 1}")
    return [
        "Categorical factors are coded as deviations from the mean of their levels (sum to zero): "
        f"{term} is the effect of {first.name} {first.labels[0]} relative to that mean, and the effect of the last "
        f"level, {first.labels[-1]}, is minus the sum of the others. They have no quadratic term. Their levels are "
        "tested together in the analysis of variance; P of one level compares it with that mean."
    ]


def _coefficients(trials: Trials, model: TrialModel, caption: str) -> Table:
    """Return the coefficients; standard error and P are those of the stratum that tests the term."""
    rows: list[tuple[Cell, ...]] = [("constant", model.fit.values["1"], None, None, None, None, None)]
    for term in model.terms:
        stratum = next(each for each in model.strata if term in each.terms)
        if isinstance(stratum.fit, str):
            rows.append((term_text(trials, term), model.fit.values[term], None, None, None, None, stratum.name))
        else:
            own = stratum.fit.coefficients[term]
            low, high = stratum.fit.coefficient_interval(term)
            rows.append(
                (
                    term_text(trials, term),
                    model.fit.values[term],
                    own.standard_error,
                    low,
                    high,
                    p_text(stratum.fit.joint_row(term, (term,)).p),
                    stratum.name,
                )
            )
    heading = ("term", "estimate", "standard error", f"{model.fit.interval_name}: from", "to", "P", "error")
    return Table("coefficients", caption, heading, tuple(rows), 3)


def _record(trials: Trials, model: TrialModel | str, optimum: Optimum | None) -> dict[str, object]:
    """Return the record with every figure."""
    record: dict[str, object] = {
        "roles": trials.roles,
        "response": trials.label,
        "best": trials.best,
        "factors": [dataclasses.asdict(factor) for factor in trials.factors],
        "categorical": {each.name: each.labels for each in trials.kinds},
        "trials": [
            {
                "line": line,
                "coded": coded.tolist(),
                **({"labels": [each.cells[row] for each in trials.kinds]} if trials.kinds else {}),
                "response": float(value),
            }
            for row, (line, coded, value) in enumerate(
                zip(trials.table.lines, trials.coded, trials.response, strict=True)
            )
        ],
        "ranges": range_record(trials),
    }
    if isinstance(model, str):
        return {**record, "model": None, "reason": model}
    record["model"] = {
        "order": model.order,
        "coefficients": {term_text(trials, name): each for name, each in model.polynomial.coefficients.items()},
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
            "labels": dict(zip((each.name for each in trials.kinds), optimum.labels, strict=True)),
            "label_shares": list(optimum.label_shares),
            "response": optimum.response,
            "low": to_natural(trials.factors, optimum.low).tolist(),
            "high": to_natural(trials.factors, optimum.high).tolist(),
            "prediction": list(optimum.prediction),
        }
    )
    return record
