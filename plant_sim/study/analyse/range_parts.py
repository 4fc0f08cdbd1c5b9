"""Report of the range analysis."""

from __future__ import annotations

import numpy as np

from controller.common.document.parts import Cell, Heading, Part, Table
from plant_sim.study.analyse.model import TrialModel
from plant_sim.study.analyse.ranges import is_orthogonal_array, order_of_influence, range_by_chance, ranges
from plant_sim.study.analyse.roles import Trials
from plant_sim.study.doe.design import to_natural
from plant_sim.study.doe.regression import point_numbers

_MOST_LEVELS = 9


def range_parts(trials: Trials, model: TrialModel | None) -> list[Part]:
    """Return the range analysis; empty if the trials are not an orthogonal array.

    Args:
        trials: The trials.
        model: Model whose error tells which ranges chance alone gives; None if there is none.
    """
    if not _has_ranges(trials):
        return []
    found = ranges(_natural(trials), trials.response, is_high_best=trials.best == "high")
    sd, degrees = _error(trials, model)
    most = max(len(each.levels) for each in found)
    rows: list[tuple[Cell, ...]] = []
    for number, (factor, each) in enumerate(zip(trials.factors, found, strict=True), 1):
        blank: tuple[Cell, ...] = (None,) * (most - len(each.levels))
        chance = (
            None
            if sd is None
            else range_by_chance(len(each.levels), len(trials.coded) // len(each.levels), sd=sd, degrees=degrees)
        )
        rows.append(
            (
                f"X{number}",
                factor.label,
                *each.sums,
                *blank,
                *each.means,
                *blank,
                each.value,
                chance,
                f"{each.best:.6g}",
            )
        )
    heading = (
        *("term", "factor"),
        *(f"{letter}{level}" for letter in "Kk" for level in range(1, most + 1)),
        *("R", "R by chance", "best level"),
    )
    order = " > ".join(f"X{number}" for number in order_of_influence(found))
    combination = ", ".join(
        f"{factor.name} {each.best:.6g}{'' if factor.unit == '-' else f' {factor.unit}'}"
        for factor, each in zip(trials.factors, found, strict=True)
    )
    parts: list[Part] = [
        Heading("Range analysis (极差分析), descriptive"),
        f"Order of influence {order}; best level of each factor: {combination}. R has no test of its own: a factor "
        "without any effect has a range too. The combination need not be among the trials, and is the best one only "
        "if the factors do not interact.",
        Table(
            "ranges",
            f"Range analysis of {trials.label}: K sum and k mean of each level, ascending; R highest less lowest k",
            heading,
            tuple(rows),
        ),
    ]
    if sd is None:
        parts.append("R by chance is unknown: the trials leave no error.")
    else:
        parts.append(
            f"R by chance: a factor without effect stays below it in 95 % of experiments (SD of a trial {sd:.3g}, "
            f"{degrees} degrees of freedom). One factor in twenty exceeds it by chance."
        )
    if len({len(each.levels) for each in found}) > 1:
        parts.append("The factors have different numbers of levels, so their R are not comparable with each other.")
    return parts


def range_record(trials: Trials) -> dict[str, object] | None:
    """Return the record of the range analysis; None if the trials are not an orthogonal array."""
    if not _has_ranges(trials):
        return None
    found = ranges(_natural(trials), trials.response, is_high_best=trials.best == "high")
    return {
        "order": order_of_influence(found),
        "factors": [
            {"levels": each.levels, "K": each.sums, "k": each.means, "R": each.value, "best": each.best}
            for each in found
        ],
    }


def _natural(trials: Trials) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the levels in natural units without the rounding errors of coding and decoding."""
    return np.array([[float(f"{level:.9g}") for level in point] for point in to_natural(trials.factors, trials.coded)])


def _has_ranges(trials: Trials) -> bool:
    points = _natural(trials)
    few = all(len(np.unique(column)) <= _MOST_LEVELS for column in points.T)
    return few and len(trials.factors) > 1 and is_orthogonal_array(points)


def _error(trials: Trials, model: TrialModel | None) -> tuple[float | None, int]:
    """Return the SD of a trial and its degrees of freedom: of repeated trials, otherwise of the residual."""
    groups = point_numbers(trials.coded)
    counts = np.bincount(groups)
    degrees = len(groups) - len(counts)
    if degrees > 0:
        means = np.bincount(groups, weights=trials.response) / counts
        return float(np.sqrt(np.sum((trials.response - means[groups]) ** 2) / degrees)), degrees
    if model is None or trials.counts is not None:
        return None, 0
    residual = model.fit.row("residual")
    return float(np.sqrt(residual.sum_of_squares / residual.degrees)), residual.degrees
