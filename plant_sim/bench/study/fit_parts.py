"""Tables and pictures of fits, side by side: what a paper prints, its refit, and a fit of other data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.bench.study.design import Factor, to_natural
from plant_sim.bench.study.optimum import Surface
from plant_sim.bench.study.paper import PrintedRow
from plant_sim.bench.study.parts import Cell, Part, Picture, Table
from plant_sim.bench.study.regression import AnovaRow, Fit
from plant_sim.bench.study.surface import Marks, contours, lowest_and_highest, observed_against_predicted

SHARE_LIMITS: Final = (0.0, 100.0)
"""Between what a share of seedlings can be, %."""

_SMALLEST_P = 1e-4
_SIGNIFICANT_P = 0.05


def p_text(p: float | None) -> str | None:
    """Return a P as the papers print it.

    >>> p_text(0.00082), p_text(3e-7)
    ('0.0008', '<0.0001')
    """
    if p is None:
        return None
    return f"<{_SMALLEST_P:.4f}" if p < _SMALLEST_P else f"{p:.4f}"


def coefficient_table(
    name: str, caption: str, columns: Mapping[str, Mapping[str, float]], *, fit: Fit | None = None, digits: int = 3
) -> Table:
    """Set the coefficients of polynomials side by side.

    Args:
        name: Stem of the table's file.
        caption: What it shows.
        columns: Coefficients by term, by the name of the column, such as paper, refit, twin.
        fit: Adds standard error and P of this one.
        digits: Decimals.
    """
    listed = list(dict.fromkeys(term for column in columns.values() for term in column))
    rows: list[tuple[Cell, ...]] = []
    for term in listed:
        cells: list[Cell] = [column.get(term) for column in columns.values()]
        if fit is not None:
            found = fit.coefficients.get(term)
            cells += [None, None] if found is None else [found.standard_error, p_text(found.p)]
        rows.append(("constant" if term == "1" else term, *cells))
    extra = () if fit is None else ("standard error", "P")
    return Table(name, caption, ("term", *columns, *extra), tuple(rows), digits)


def anova_table(
    name: str, caption: str, columns: Mapping[str, Sequence[AnovaRow | PrintedRow]], *, digits: int = 2
) -> Table:
    """Set analyses of variance side by side.

    Args:
        name: Stem of the table's file.
        caption: What it shows.
        columns: Lines of each, by the name it gets in the heading.
        digits: Decimals of sums of squares and F.
    """
    sources = list(dict.fromkeys(row.source for column in columns.values() for row in column))
    order = {row.source: place for rows in columns.values() for place, row in enumerate(rows)}
    sources.sort(key=lambda source: order[source])
    heading = [f"{title} {what}" for title in columns for what in ("sum of squares", "df", "F", "P")]
    rows: list[tuple[Cell, ...]] = []
    for source in sources:
        cells: list[Cell] = []
        for column in columns.values():
            found = next((row for row in column if row.source == source), None)
            cells += [None] * 4 if found is None else [found.sum_of_squares, found.degrees, found.f, _p_cell(found)]
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
    """List the runs of an experiment: coded and natural settings, and a column for each response.

    Args:
        name: Stem of the table's file.
        caption: What it shows.
        factors: The factors.
        coded: The runs, coded, one row each.
        columns: What to list behind the settings, by heading.
        digits: Decimals.
    """
    heading = ("run", *(f"X{place + 1}" for place in range(len(factors))), *(each.label for each in factors), *columns)
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
    """Set the printed levels of factors beside those the coding gives, and the code each printed level stands for.

    Args:
        name: Stem of the table's file.
        caption: What it shows.
        factors: The factors.
        codes: The printed codes.
        printed: The printed levels in natural units, one row a code.
    """
    heading = ["code"]
    for factor in factors:
        heading += [f"{factor.label}: printed", "by the coding", "code of the printed"]
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
    """Say what some responses are at some settings.

    Args:
        name: Stem of the table's file.
        caption: What it shows.
        factors: The factors.
        response: Name and unit of the response.
        points: Settings, coded, by name.
        surfaces: The responses, by name.
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
    fit: Fit,
    factors: Sequence[Factor],
    *,
    response: str,
    marks: Marks,
    held: NDArray[np.float64],
    box: float = 1.0,
) -> tuple[Part, ...]:
    """Draw the contours of a fit over every pair of factors, and its runs against what it says.

    Args:
        name: How the names of the pictures begin.
        fit: The fit.
        factors: Its factors.
        response: Name and unit of the response.
        marks: Points to mark, coded, by name.
        held: Coded levels of the factors that a panel does not show.
        box: Half the edge of the searched box, coded.

    Returns:
        The two pictures, and a sentence where the surface leaves what a share can be.
    """
    reach = np.abs(fit.coded).max(axis=0).tolist()
    over = contours(fit, factors, response=response, held=held.tolist(), reach=reach, marks=marks, box=box,
                    limits=SHARE_LIMITS)  # fmt: skip
    runs = observed_against_predicted(fit.response, fit.predict(fit.coded), response=response, r2=fit.r2)
    seen = (
        "The dashed frame is the searched box; beyond the runs of the design the surface is a guess. A hollow sign "
        "lies off the slice; the response there is in the legend."
    )
    return (
        *no_share_text(fit, factors, held=held.tolist(), reach=reach),
        Picture(f"{name}-contours", f"{response} over every pair of factors. {seen}", over),
        Picture(f"{name}-runs", f"{response}: every run against the fit.", runs),
    )


def no_share_text(
    surface: Surface, factors: Sequence[Factor], *, held: Sequence[float], reach: Sequence[float]
) -> list[str]:
    """Say where the surface of a share, %, leaves 0 to 100 in the panels of its contours; nothing if it does not.

    Args:
        surface: The share.
        factors: Its factors.
        held: Coded levels at which the factors stand that a panel does not show.
        reach: How far the panels reach to either side of the centre, coded, one a factor.
    """
    lowest, highest = lowest_and_highest(surface, factors, held=held, reach=reach)
    left = [each for each, is_out in ((lowest, lowest[0] < SHARE_LIMITS[0]), (highest, highest[0] > SHARE_LIMITS[1]))
            if is_out]  # fmt: skip
    if not left:
        return []
    where = " and ".join(f"{value:.1f} % at {_setting_text(factors, point)}" for value, point in left)
    return [f"A share lies between 0 and 100 %, which a quadratic does not know: this one reaches {where}. Where it "
            "leaves that range the contours are grey."]  # fmt: skip


def _setting_text(factors: Sequence[Factor], coded: NDArray[np.float64]) -> str:
    natural = to_natural(factors, coded)
    return ", ".join(
        f"{factor.name} {value:.4g}" if factor.unit == "-" else f"{factor.name} {value:.4g} {factor.unit}"
        for factor, value in zip(factors, natural, strict=True)
    )


def explains(fit: Fit) -> bool:
    """Tell whether a model explains more than chance does: P of the model up to 0.05, adjusted R² above 0."""
    p = fit.row("model").p
    return (p is None or p <= _SIGNIFICANT_P) and fit.adjusted_r2 > 0


def doubts(name: str, fit: Fit) -> list[str]:
    """Say in words what casts doubt on a model: that it explains nothing, or that it does not fit.

    Args:
        name: The response.
        fit: The model.
    """
    told = []
    if not explains(fit):
        told.append(f"{name}: the model explains nothing that chance alone would not (P {p_text(fit.row('model').p)}, "
                    f"adjusted R² {fit.adjusted_r2:.2f}); do not read its surface.")  # fmt: skip
    lack = next((row.p for row in fit.anova if row.source == "lack of fit"), None)
    if lack is not None and lack < _SIGNIFICANT_P:
        told.append(f"{name}: the model does not fit (lack of fit P {p_text(lack)}): what it leaves over is more than "
                    "the scatter of repeated runs; it is too simple.")  # fmt: skip
    return told


def fit_record(fit: Fit) -> dict[str, object]:
    """Return a fit for a program: coefficients, analysis of variance, R²."""
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
    }
