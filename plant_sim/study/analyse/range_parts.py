"""Report of the range analysis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
    found = ranges(_levels(trials), trials.response, is_high_best=trials.best == "high")
    sd, degrees = _error(trials, model)
    most = max(len(each.levels) for each in found)
    names = (*(factor.label for factor in trials.factors), *(kind.name for kind in trials.kinds))
    rows: list[tuple[Cell, ...]] = []
    for number, (name, each) in enumerate(zip(names, found, strict=True), 1):
        blank: tuple[Cell, ...] = (None,) * (most - len(each.levels))
        chance = (
            None
            if sd is None
            else range_by_chance(len(each.levels), len(trials.coded) // len(each.levels), sd=sd, degrees=degrees)
        )
        rows.append(
            (
                f"X{number}",
                name,
                *each.sums,
                *blank,
                *each.means,
                *blank,
                each.value,
                chance,
                _level_text(trials, number - 1, each.best),
            )
        )
    heading = (
        *("term", "factor"),
        *(f"{letter}{level}" for letter in "Kk" for level in range(1, most + 1)),
        *("R", "R by chance", "best level"),
    )
    order = " > ".join(f"X{number}" for number in order_of_influence(found))
    units = [*(factor.unit for factor in trials.factors), *("-" for _ in trials.kinds)]
    combination = ", ".join(
        f"{name} {_level_text(trials, number, each.best)}{'' if unit == '-' else f' {unit}'}"
        for number, (name, unit, each) in enumerate(zip(trials.names, units, found, strict=True))
    )
    parts: list[Part] = [
        Heading("Range analysis (极差分析), descriptive"),
        f"Order of influence {order}; best level of each factor: {combination}. R has no test of its own: a factor "
        "without any effect has a range too. The combination need not be among the trials, and is the best one only "
        "if the factors do not interact.",
        Table(
            "ranges",
            f"Range analysis of {trials.label}: K sum and k mean of each level, ascending, "
            "names in the order of the table of factors; R highest less lowest k",
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
    found = ranges(_levels(trials), trials.response, is_high_best=trials.best == "high")
    return {
        "order": order_of_influence(found),
        "factors": [
            {
                "levels": [_level(trials, number, level) for level in each.levels],
                "K": each.sums,
                "k": each.means,
                "R": each.value,
                "best": _level(trials, number, each.best),
            }
            for number, each in enumerate(found)
        ],
    }


def _levels(trials: Trials) -> NDArray[np.float64]:
    """Return the levels of all factors: natural units without the rounding errors of coding; numbers of the names."""
    natural = to_natural(trials.factors, trials.coded)
    rounded = np.array([float(f"{level:.9g}") for level in natural.ravel()]).reshape(natural.shape)
    return np.column_stack([rounded, *(each.codes for each in trials.kinds)])


def _level(trials: Trials, number: int, level: float) -> float | str:
    """Return a level of a factor, by its number from 0, for the record."""
    return level if number < len(trials.factors) else _level_text(trials, number, level)


def _level_text(trials: Trials, number: int, level: float) -> str:
    """Return a level of a factor, by its number from 0."""
    kind = number - len(trials.factors)
    return f"{level:.6g}" if kind < 0 else trials.kinds[kind].labels[int(level)]


def _has_ranges(trials: Trials) -> bool:
    points = _levels(trials)
    few = all(len(np.unique(column)) <= _MOST_LEVELS for column in points.T)
    return few and len(trials.names) > 1 and is_orthogonal_array(points)


def _error(trials: Trials, model: TrialModel | None) -> tuple[float | None, int]:
    """Return the SD of a trial and its degrees of freedom: of repeated trials, otherwise of the residual."""
    groups = point_numbers(trials.columns)
    counts = np.bincount(groups)
    degrees = len(groups) - len(counts)
    if degrees > 0:
        means = np.bincount(groups, weights=trials.response) / counts
        return float(np.sqrt(np.sum((trials.response - means[groups]) ** 2) / degrees)), degrees
    if model is None or trials.counts is not None:
        return None, 0
    residual = model.fit.row("residual")
    return float(np.sqrt(residual.sum_of_squares / residual.degrees)), residual.degrees
