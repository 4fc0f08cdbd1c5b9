"""Report parts of a weighted fit of counts: error, effects with intervals, quality of the model, residuals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from controller.common.document.parts import Cell, Part, Picture, Table
from plant_sim.common.figure_style import COLOURS, QUIET, drawing
from plant_sim.study.doe.weighted import Model, WeightedFit
from plant_sim.study.report.fit_parts import anova_table, p_text

_PRECISION: Final = 4
"""Adequate precision above which a model distinguishes its settings."""


def weighted_parts(name: str, fit: WeightedFit, *, response: str, is_simulated: bool) -> list[Part]:
    """Return the analysis of counts: its error, the coefficients, the quality of the model and the residuals.

    Args:
        name: Prefix of the file stems.
        fit: Weighted fit.
        response: Name and unit of the response.
        is_simulated: True for trials of the twin: effects with their Monte Carlo error, and no P value.
    """
    parts: list[Part] = [error_text(fit, is_simulated=is_simulated)]
    if not is_simulated:
        caption = f"Analysis of variance of {response}, weighted; every F is relative to the pure error"
        parts.append(anova_table(f"{name}-weighted-anova", caption, {"weighted": fit.anova}))
    return [
        *parts,
        _quality_table(name, fit, response),
        Picture(
            f"{name}-residuals",
            f"{response}: studentized residuals of the weighted fit against the fitted values, and against the "
            "quantiles of a normal distribution.",
            _residuals(fit, response),
        ),
    ]


def error_text(fit: WeightedFit, *, is_simulated: bool) -> str:
    """Return the unit, the weights and the error of the fit as a paragraph.

    Args:
        fit: Weighted fit.
        is_simulated: True for trials of the twin.
    """
    dispersion, interval = fit.dispersion, fit.dispersion.interval()
    text = (
        f"The unit is the trial: {len(fit.coded)} trials, weighted by the binomial variance function, {fit.link} link."
    )
    if dispersion.estimate is None or interval is None:
        return (
            f"{text} No repeated trials differ, so the variance between trials is unknown. The binomial variance is "
            "used in its place, every interval is only a lower bound, and no P value is given."
        )
    text += (
        f" Repeated trials scatter {dispersion.estimate:.2f} times the binomial variance (95 % interval "
        f"{interval[0]:.2f} to {interval[1]:.2f}, {dispersion.degrees} degrees of freedom). The standard errors "
        "contain this factor, whatever its value"
    )
    if is_simulated:
        found, by_error = fit.misfit
        return (
            f"{text}; they are Monte Carlo errors, which more trials reduce, so no P value is given. The means of the "
            f"points differ from the fit by {found:.2f} percentage points (root mean square); Monte Carlo error alone "
            f"would give {by_error:.2f}."
        )
    return f"{text}, and the F tests have its degrees of freedom.{_below_1(fit, interval)}"


def _below_1(fit: WeightedFit, interval: tuple[float, float]) -> str:
    """Return the consequences of an estimate below 1; empty if it is not below 1."""
    estimate, lack = fit.dispersion.estimate, fit.lack_of_fit_with_least_dispersion()
    if estimate is None or estimate >= 1:
        return ""
    why = (
        "so the repeated runs scatter less than counts of that many independent seedlings can: doubt the counts or "
        "their total"
        if interval[1] < 1
        else "which can be chance"
    )
    text = (
        f" The estimate is below 1, {why}. With a dispersion of 1 the standard errors are {estimate**-0.5:.2f} times "
    )
    text += "as large"
    return f"{text}." if lack is None else f"{text}, and the lack of fit has F {lack[0]:.2f}, P {p_text(lack[1])}."


def effects_table(
    name: str, caption: str, columns: Mapping[str, Mapping[str, float]], fit: Model, *, is_simulated: bool
) -> Table:
    """Return a table of coefficients with the error and the 95 % interval of a fit.

    Args:
        name: File stem of the table.
        caption: Caption.
        columns: Coefficients by term, for each column heading.
        fit: Fit whose errors and intervals are added.
        is_simulated: True for trials of the twin: the error is called Monte Carlo error, and there is no P value.
    """
    listed = list(dict.fromkeys(term for column in columns.values() for term in column))
    rows: list[tuple[Cell, ...]] = []
    for term in listed:
        cells: list[Cell] = [column.get(term) for column in columns.values()]
        if term in fit.coefficients:
            each = fit.coefficients[term]
            cells += [each.standard_error, *fit.coefficient_interval(term)]
            cells += [] if is_simulated else [p_text(each.p)]
        else:
            cells += [None] * (3 if is_simulated else 4)
        rows.append(("constant" if term == "1" else term, *cells))
    error = "Monte Carlo error" if is_simulated else "standard error"
    p = () if is_simulated else ("P",)
    return Table(name, caption, ("term", *columns, error, f"{fit.interval_name}: from", "to", *p), tuple(rows), 3)


def _quality_table(name: str, fit: WeightedFit, response: str) -> Table:
    caption = f"Quality of the weighted fit of {response}"
    if fit.predicted_r2_by_point is None:
        caption += "; -: a trial or a point alone determines a coefficient, as the centre of a rotatable design does"
    elif fit.predicted_r2_by_point < 0:
        caption += (
            "; a predicted R² below 0: the points left out are predicted worse than by the mean, as the centre of a "
            "rotatable design is, which its other points do not determine"
        )
    rows = (
        ("R²", fit.r2),
        ("adjusted R²", fit.adjusted_r2),
        ("predicted R² (PRESS), each trial left out", fit.predicted_r2),
        ("predicted R² (PRESS), each point left out with its repeated trials", fit.predicted_r2_by_point),
        (f"adequate precision (should exceed {_PRECISION})", fit.adequate_precision),
    )
    return Table(f"{name}-quality", caption, ("figure", "value"), rows, 3)


def _residuals(fit: WeightedFit, response: str) -> Figure:
    residuals = fit.studentized
    ordered = np.sort(residuals)
    normal = stats.norm.ppf((np.arange(len(ordered)) + 0.5) / len(ordered))
    with drawing():
        figure = Figure(figsize=(6.6, 3.0), layout="constrained")
        against, quantiles = figure.subplots(1, 2)
        against.axhline(0, color=QUIET, linewidth=0.8)
        against.plot(fit.predict(fit.coded), residuals, "o", color=COLOURS["left"], markersize=3, markeredgewidth=0)
        against.set(xlabel=f"fitted {response}", ylabel="studentized residual")
        quantiles.axline((0, 0), slope=1, color=QUIET, linewidth=0.8)
        quantiles.plot(normal, ordered, "o", color=COLOURS["left"], markersize=3, markeredgewidth=0)
        quantiles.set(xlabel="normal quantile", ylabel="studentized residual")
    return figure
