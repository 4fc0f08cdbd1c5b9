"""Optimum of a table of trials: the best point of the model, its intervals, and the picture around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.common.document.parts import Cell, Heading, Part, Picture, Table
from plant_sim.study.analyse.kinds import combination_columns, combinations
from plant_sim.study.analyse.model import TrialModel
from plant_sim.study.analyse.roles import Trials
from plant_sim.study.doe.design import Factor, full_factorial, to_natural
from plant_sim.study.doe.optimum import best
from plant_sim.study.report.fit_parts import SHARE_LIMITS
from plant_sim.study.report.surface import contours

SIGNIFICANT_P = 0.05
_MOST_OPTIMUM_FACTORS = 6
_MOST_COMBINATIONS = 200
_MOST_CONTOUR_FACTORS = 5
_GRID_POINTS = 4_000
_DRAWS = 1000
_ROUNDING = 1e-6
_EDGE = "at the edge"
_ANYWHERE = "anywhere in the range"
_SURE_SHARE = 0.95
"""Share of the draws above which a level of a categorical factor is located."""
_FIRST_IDEOGRAPH = "\u2e80"
"""First character that the font of the pictures lacks."""


@dataclass(frozen=True)
class Optimum:
    """Best point of a model within the range of the trials.

    Attributes:
        coded: Coded levels of the numeric factors.
        labels: Levels of the categorical factors.
        response: Response of the model.
        low: Lower ends of the 95 % intervals of the numeric levels, coded.
        high: Upper ends.
        label_shares: Share of the draws of the coefficients in which each of the labels is best, 0 to 1.
        prediction: 95 % interval of the response of one further trial.
    """

    coded: NDArray[np.float64]
    labels: tuple[str, ...]
    response: float
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    label_shares: tuple[float, ...]
    prediction: tuple[float, float]


@dataclass(frozen=True)
class _NumericSurface:
    """Response over the numeric factors with the categorical ones held; see `Surface`."""

    model: TrialModel
    kinds: NDArray[np.float64]

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the response at coded points of the numeric factors."""
        return self.model.predict(self.points(coded))

    def points(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points in the columns of the trials."""
        points = np.atleast_2d(coded)
        return np.hstack([points, np.tile(self.kinds, (len(points), 1))])


def find_optimum(trials: Trials, model: TrialModel) -> Optimum | None:
    """Return the best point of the model; None if it is not significant or has too many factors.

    The intervals come from drawn coefficients: each draw has a best point of a grid.
    """
    k = len(trials.factors)
    tested = [each.model_p for each in model.strata]
    combined = combinations(trials.kinds)
    too_many = k > _MOST_OPTIMUM_FACTORS or len(combined) > _MOST_COMBINATIONS
    if too_many or all(p is not None and p > SIGNIFICANT_P for p in tested):
        return None
    is_high = trials.best == "high"
    surfaces = [_NumericSurface(model, combination_columns(trials.kinds, labels)) for labels in combined]
    found = [_best(each, k, is_high=is_high) for each in surfaces]
    chosen = max(range(len(found)), key=lambda number: found[number][1] if is_high else -found[number][1])
    coded, response = found[chosen]
    each = max(3, round((_GRID_POINTS / len(combined)) ** (1 / max(k, 1))))
    grid = full_factorial([np.linspace(-1, 1, each).tolist()] * k) if k else np.empty((1, 0))
    points = np.vstack([surface.points(grid) for surface in surfaces])
    drawn = model.drawn_optima(points, is_high_best=is_high, draws=_DRAWS, seed=1)
    low, high = np.quantile(drawn[:, :k], (0.025, 0.975), axis=0)
    ends = model.fit.prediction_interval(model.padded(surfaces[chosen].points(coded)))
    return Optimum(
        coded,
        combined[chosen],
        response,
        low,
        high,
        tuple(_label_share(trials, combined[chosen], drawn[:, k:])),
        (float(ends[0][0]), float(ends[1][0])),
    )


def _best(surface: _NumericSurface, factors: int, *, is_high: bool) -> tuple[NDArray[np.float64], float]:
    if factors == 0:
        point = np.empty(0)
        return point, float(surface.predict(point)[0])
    return best(surface, [-1.0] * factors, [1.0] * factors, maximise=is_high)


def _label_share(trials: Trials, labels: Sequence[str], drawn: NDArray[np.float64]) -> list[float]:
    """Return the share of drawn optima, in the columns of the categorical factors, with each of the labels."""
    shares, first = [], 0
    for kind, label in zip(trials.kinds, labels, strict=True):
        own = combination_columns([kind], [label])
        columns = drawn[:, first : first + len(own)]
        shares.append(float(np.mean((columns == own).all(axis=1))))
        first += len(own)
    return shares


def optimum_parts(trials: Trials, model: TrialModel, optimum: Optimum | None) -> list[Part]:
    """Return the report parts about the optimum."""
    if optimum is None:
        return [
            Heading("Optimum"),
            "No optimum is stated: the factors together are not significant, or there are too many of them.",
        ]
    low, high = (to_natural(trials.factors, each) for each in (optimum.low, optimum.high))
    natural = to_natural(trials.factors, optimum.coded)
    remarks = [_remark(*ends) for ends in zip(optimum.coded, optimum.low, optimum.high, strict=True)]
    rows: list[tuple[Cell, ...]] = [
        (factor.label, f"{value:.4g}", f"{a:.4g}", f"{b:.4g}", remark or None)
        for factor, value, a, b, remark in zip(trials.factors, natural, low, high, remarks, strict=True)
    ]
    rows += [
        (kind.name, label, None, None, f"best level in {100 * share:.0f} % of draws")
        for kind, label, share in zip(trials.kinds, optimum.labels, optimum.label_shares, strict=True)
    ]
    kind = model.fit.interval_name
    text = (
        f"{trials.label}: the {'highest' if trials.best == 'high' else 'lowest'} response of the model at coded "
        f"levels -1 to 1 is {optimum.response:.2f}; {kind} of one further trial there: {optimum.prediction[0]:.2f} to "
        f"{optimum.prediction[1]:.2f}. It is the best of the same trials that the model was fitted to, and so too good "
        "on average; confirm it by new trials."
    )
    columns = combination_columns(trials.kinds, optimum.labels)
    if model.is_extrapolated(np.concatenate([optimum.coded, columns])):
        text += " This point is outside the region of the trials: the model is extrapolated there."
    if any(_EDGE in remark for remark in remarks):
        text += " A level at the edge of the range says only that the range ends there."
    if any(_ANYWHERE in remark for remark in remarks):
        text += " A level whose interval is the whole range is not located by these trials."
    unsure = [kind.name for kind, share in zip(trials.kinds, optimum.label_shares, strict=True) if share < _SURE_SHARE]
    if unsure:
        text += f" The best level of {', '.join(unsure)} is not certain: another is best in part of the draws."
    heading = ("factor", "optimum", "low", "high", "remark")
    parts: list[Part] = [
        Heading("Optimum"),
        text,
        Table("optimum", f"Optimum, with the {kind} of each level", heading, tuple(rows)),
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
    held = "the others are at the optimum"
    figure = contours(
        _NumericSurface(model, combination_columns(trials.kinds, optimum.labels)),
        factors,
        response=drawn(trials.label, "response"),
        held=optimum.coded.tolist(),
        reach=[1.0] * len(factors),
        marks={"optimum": optimum.coded},
        limits=None if trials.counts is None else SHARE_LIMITS,
    )
    return Picture(
        "contours",
        f"{trials.label} over every pair of numeric factors; {held}"
        if trials.kinds
        else f"{trials.label} over every pair of factors; {held}",
        figure,
    )


def _drawn_factor(number: int, factor: Factor) -> Factor:
    """Return a factor whose name the font of the pictures has; X1, X2, ... for a Chinese name."""
    return Factor(drawn(factor.name, f"X{number}"), drawn(factor.unit, "-"), factor.centre, factor.step)


def drawn(text: str, otherwise: str) -> str:
    """Return a text for a picture, or another if the font of the pictures lacks its characters."""
    return otherwise if any(character >= _FIRST_IDEOGRAPH for character in text) else text
