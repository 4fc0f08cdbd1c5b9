"""Tables and figures that compare printed models with models fitted to the same or to other data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Part, Picture, Table, counted
from plant_sim.study.doe.design import Factor, to_natural
from plant_sim.study.doe.optimum import Surface
from plant_sim.study.doe.regression import AnovaRow
from plant_sim.study.doe.weighted import Model, WeightedFit
from plant_sim.study.paper_tables import PrintedRow
from plant_sim.study.report.surface import Marks, contours, lowest_and_highest, observed_against_predicted

SHARE_LIMITS: Final = (0.0, 100.0)
"""Limits of a share of seedlings, %."""

_SMALLEST_P = 1e-4
_SIGNIFICANT_P = 0.05


def p_text(p: float | None) -> str | None:
    """Return a P value as text in the format of the papers.

    >>> p_text(0.00082), p_text(3e-7)
    ('0.0008', '<0.0001')
    """
    if p is None:
        return None
    return f"<{_SMALLEST_P:.4f}" if p < _SMALLEST_P else f"{p:.4f}"


def coefficient_table(
    name: str, caption: str, columns: Mapping[str, Mapping[str, float]], *, fit: Model | None = None, digits: int = 3
) -> Table:
    """Return a table that compares the coefficients of polynomials.

    Args:
        name: File stem of the table.
        caption: Caption.
        columns: Coefficients by term, for each column heading, such as paper, refit or twin.
        fit: Model whose standard errors and P values are added.
        digits: Decimals.
    """
    listed = list(dict.fromkeys(term for column in columns.values() for term in column))
    rows: list[tuple[Cell, ...]] = []
    for term in listed:
        cells: list[Cell] = [column.get(term) for column in columns.values()]
        if fit is not None:
            coefficient = fit.coefficients.get(term)
            cells += [None, None] if coefficient is None else [coefficient.standard_error, p_text(coefficient.p)]
        rows.append(("constant" if term == "1" else term, *cells))
    extra = () if fit is None else ("standard error", "P")
    return Table(name, caption, ("term", *columns, *extra), tuple(rows), digits)


def anova_table(
    name: str, caption: str, columns: Mapping[str, Sequence[AnovaRow | PrintedRow]], *, digits: int = 2
) -> Table:
    """Return a table that compares analyses of variance.

    Args:
        name: File stem of the table.
        caption: Caption.
        columns: Rows of each analysis, by column heading.
        digits: Decimals of the sums of squares and F values.
    """
    sources = list(dict.fromkeys(row.source for column in columns.values() for row in column))
    order = {row.source: index for rows in columns.values() for index, row in enumerate(rows)}
    sources.sort(key=lambda source: order[source])
    heading = [f"{title} {what}" for title in columns for what in ("sum of squares", "df", "F", "P")]
    rows: list[tuple[Cell, ...]] = []
    for source in sources:
        cells: list[Cell] = []
        for column in columns.values():
            match = next((row for row in column if row.source == source), None)
            cells += [None] * 4 if match is None else [match.sum_of_squares, match.degrees, match.f, _p_cell(match)]
        rows.append((source, *cells))
    return Table(name, caption, ("source", *heading), tuple(rows), digits)


def _p_cell(row: AnovaRow | PrintedRow) -> str | None:
    return (row.p or None) if isinstance(row, PrintedRow) else p_text(row.p)


def runs_table(
    name: str,
    caption: str,
    factors: Sequence[Factor],
    coded: NDArray[np.float64],
    columns: Mapping[str, NDArray[np.float64]],
    *,
    digits: int = 2,
) -> Table:
    """Return a table of runs: coded and natural settings, and a column for each response.

    Args:
        name: File stem of the table.
        caption: Caption.
        factors: The factors.
        coded: Coded runs, one per row.
        columns: Columns after the settings, by heading.
        digits: Decimals.
    """
    heading = ("run", *(f"X{index + 1}" for index in range(len(factors))), *(each.label for each in factors), *columns)
    listed = zip(coded, to_natural(factors, coded), zip(*columns.values(), strict=True), strict=True)
    rows: list[tuple[Cell, ...]] = [
        (number, *(f"{level:g}" for level in point), *(f"{value:.4g}" for value in natural), *map(float, values))
        for number, (point, natural, values) in enumerate(listed, start=1)
    ]
    return Table(name, caption, heading, tuple(rows), digits)


def coding_table(
    name: str,
    caption: str,
    factors: Sequence[Factor],
    codes: NDArray[np.float64],
    printed: NDArray[np.float64],
) -> Table:
    """Return a table that compares the printed factor levels with those calculated from the codes.

    Args:
        name: File stem of the table.
        caption: Caption.
        factors: The factors.
        codes: The printed codes.
        printed: The printed levels in natural units, one row per code.
    """
    heading = ["code"]
    for factor in factors:
        heading += [f"{factor.label}: printed", "by the coding", "code of the printed level"]
    rows: list[tuple[Cell, ...]] = []
    for code, levels in zip(codes, printed, strict=True):
        cells: list[Cell] = [f"{code:g}"]
        for factor, level in zip(factors, levels, strict=True):
            cells += [f"{level:g}", float(factor.natural(code)), float(factor.coded(level))]
        rows.append(tuple(cells))
    return Table(name, caption, tuple(heading), tuple(rows), 3)


def optimum_table(
    name: str,
    caption: str,
    factors: Sequence[Factor],
    *,
    response: str,
    points: Mapping[str, NDArray[np.float64]],
    surfaces: Mapping[str, Surface],
    digits: int = 2,
) -> Table:
    """Return a table of the responses at given settings.

    Args:
        name: File stem of the table.
        caption: Caption.
        factors: The factors.
        response: Name and unit of the response.
        points: Settings, coded, by name.
        surfaces: Response surfaces, by name.
        digits: Decimals of the response.
    """
    heading = ("setting", *(factor.label for factor in factors), *(f"{response}, {title}" for title in surfaces))
    rows: list[tuple[Cell, ...]] = []
    for title, point in points.items():
        natural = (f"{value:.4g}" for value in to_natural(factors, point))
        rows.append((title, *natural, *(float(surface.predict(point)[0]) for surface in surfaces.values())))
    return Table(name, caption, heading, tuple(rows), digits)


def fit_pictures(
    name: str,
    fit: Model,
    factors: Sequence[Factor],
    *,
    response: str,
    marks: Marks,
    held: NDArray[np.float64],
    box: float = 1.0,
    weighted: Model | None = None,
) -> tuple[Part, ...]:
    """Return contours of a fit over every pair of factors, and observed against predicted responses.

    Args:
        name: Prefix of the file stems.
        fit: The fit.
        factors: Factors of the fit.
        response: Name and unit of the response.
        marks: Points to mark, coded, by name.
        held: Coded levels of the factors not shown in a panel.
        box: Half the edge length of the search box, coded.
        weighted: Weighted fit, whose contours are beside those of a least squares fit as the papers print it.

    Returns:
        The figures, and a caveat if the predicted percentage is outside the range 0 to 100.
    """
    reach = np.abs(fit.coded).max(axis=0).tolist()

    def over_pairs(stem: str, of: Model, what: str, remark: str) -> list[Part]:
        figure = contours(
            of, factors, response=response, held=held.tolist(), reach=reach, marks=marks, box=box, limits=SHARE_LIMITS
        )
        caption = f"{response} over every pair of factors{what}. {remark}"
        return [*no_share_text(of, factors, held=held.tolist(), reach=reach), Picture(stem, caption, figure)]

    as_printed = "" if weighted is None else ", least squares as printed"
    remark = (
        "The dashed frame is the search box; beyond the runs of the design the surface is extrapolated. A hollow "
        "marker is a point at other levels of the factors not shown; its response is in the legend."
    )
    parts = over_pairs(f"{name}-contours", fit, as_printed, remark)
    if weighted is not None:
        beside = "The marked settings and the levels not shown are those of the picture as printed."
        parts += over_pairs(f"{name}-weighted-contours", weighted, ", weighted fit with the same terms", beside)
    runs = observed_against_predicted(fit.response, fit.predict(fit.coded), response=response, r2=fit.r2)
    caption = f"{response}: observed against fitted values of the runs{as_printed}."
    return (*parts, Picture(f"{name}-runs", caption, runs))


def no_share_text(
    surface: Surface, factors: Sequence[Factor], *, held: Sequence[float], reach: Sequence[float]
) -> list[str]:
    """Return a caveat if a predicted percentage is outside the range 0 to 100 anywhere in the contour panels.

    Args:
        surface: Response surface of the percentage.
        factors: Factors of the surface.
        held: Coded levels of the factors not shown in a panel.
        reach: Half-width of the panels, coded, one per factor.
    """
    lowest, highest = lowest_and_highest(surface, factors, held=held, reach=reach)
    left = [
        each
        for each, is_out in ((lowest, lowest[0] < SHARE_LIMITS[0]), (highest, highest[0] > SHARE_LIMITS[1]))
        if is_out
    ]
    if not left:
        return []
    where = " and ".join(f"{value:.1f} % at {_setting_text(factors, point)}" for value, point in left)
    return [
        f"A percentage is between 0 and 100 %, but a quadratic model is not limited: this one reaches {where}. Areas "
        "outside the range are grey."
    ]


def _setting_text(factors: Sequence[Factor], coded: NDArray[np.float64]) -> str:
    natural = to_natural(factors, coded)
    return ", ".join(
        f"{factor.name} {value:.4g}" if factor.unit == "-" else f"{factor.name} {value:.4g} {factor.unit}"
        for factor, value in zip(factors, natural, strict=True)
    )


def explains(fit: Model) -> bool:
    """Return whether a model is significant: its P value is at most 0.05 and its adjusted R² is above 0."""
    p = fit.row("model").p
    return (p is None or p <= _SIGNIFICANT_P) and fit.adjusted_r2 > 0


def doubts(name: str, fit: Model, *, is_simulated: bool = False) -> list[str]:
    """Return the caveats about a model: it is not significant, or its lack of fit is significant.

    Args:
        name: Name of the response.
        fit: Fitted model.
        is_simulated: True for trials of the twin, whose number is free: the caveats then compare with the Monte Carlo
            error and give no P value.
    """
    adjusted = f"adjusted R² {fit.adjusted_r2:.2f}"
    cautions = []
    if is_lower_bound(fit):
        cautions.append(
            f"{name}: no repeated trials that differ, so the error is unknown: there is no P value, and every interval "
            "is only a lower bound of the true one."
        )
    if isinstance(fit, WeightedFit) and fit.link == "identity" and fit.at_bound:
        cautions.append(
            f"{name}: in {counted(fit.at_bound, 'trial')} the fitted share is within 0.5 % of 0 or 100 %, or beyond; "
            "the variance is not known there, so intervals and tests are doubtful."
        )
    if not explains(fit):
        finding = (
            f"effects do not exceed the Monte Carlo error of these trials ({adjusted})"
            if is_simulated
            else f"model is not significant (P {p_text(fit.row('model').p)}, {adjusted})"
        )
        cautions.append(f"{name}: the {finding}; disregard its surface.")
    lack = next((row.p for row in fit.anova if row.source == "lack of fit"), None)
    if lack is not None and lack < _SIGNIFICANT_P:
        size = "" if is_simulated else f" (lack of fit P {p_text(lack)})"
        cautions.append(
            f"{name}: the model does not fit{size}: its residual exceeds "
            "the scatter of repeated runs, so it is too simple."
        )
    return cautions


def is_lower_bound(fit: Model) -> bool:
    """Return whether the intervals of a fit of counts lack an error from repeated trials."""
    return isinstance(fit, WeightedFit) and fit.is_lower_bound


def fit_record(fit: Model) -> dict[str, object]:
    """Return the JSON record of a fit: coefficients, analysis of variance, R²."""
    return {
        "coefficients": {
            term: {"value": each.value, "standard_error": each.standard_error, "t": each.t, "p": each.p}
            for term, each in fit.coefficients.items()
        },
        "anova": {
            row.source: {
                "sum_of_squares": row.sum_of_squares,
                "degrees": row.degrees,
                "mean_square": row.mean_square,
                "f": row.f,
                "p": row.p,
            }
            for row in fit.anova
        },
        "r2": fit.r2,
        "adjusted_r2": fit.adjusted_r2,
        **(_weighted_record(fit) if isinstance(fit, WeightedFit) else {}),
    }


def _weighted_record(fit: WeightedFit) -> dict[str, object]:
    return {
        "link": fit.link,
        "dispersion": {
            "estimate": fit.dispersion.estimate,
            "degrees": fit.dispersion.degrees,
            "interval_95": fit.dispersion.interval(),
            "value": fit.dispersion.value,
        },
        "predicted_r2": fit.predicted_r2,
        "predicted_r2_by_point": fit.predicted_r2_by_point,
        "adequate_precision": fit.adequate_precision,
        "misfit": fit.misfit,
    }
