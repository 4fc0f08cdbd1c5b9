"""Optimum of a fitted response within bounds, and the Pareto front of two responses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from plant_sim.common.polynomial import model_matrix
from plant_sim.study.doe.design import full_factorial
from plant_sim.study.doe.weighted import Model
from plant_sim.study.errors import StudyError

_GRID_POINTS = 20_000
_ROUNDING = 1e-6
"""Tolerance of a bound in the constrained search, in units of the response."""
_DIFFERENCE = 1e-8
"""Step of a difference quotient, coded: about the root of the relative rounding error."""
_DRAWS = 1000
_DRAWS_SEED = 1
_MOST_STARTS = 729
"""Maximum number of start points: 3 to the power of 6 factors."""


class Surface(Protocol):
    """Response surface that can be optimised: a fit or a `Polynomial`."""

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the response at coded points, one per row; a single point gives an array with one element."""


@dataclass(frozen=True)
class Front:
    """Pareto front of two responses that are both minimised.

    Attributes:
        coded: Coded points, one per row, from the minimum of `a` to the minimum of `b`.
        a: First response at the points.
        b: Second response at the points.
    """

    coded: NDArray[np.float64]
    a: NDArray[np.float64]
    b: NDArray[np.float64]


def best(
    surface: Surface, low: Sequence[float], high: Sequence[float], *, maximise: bool = True
) -> tuple[NDArray[np.float64], float]:
    """Return the point within a box at which a response is optimal, and the response at that point.

    A quadratic can have several local optima in a box, so the search starts from every corner, the middle of
    every edge and face, and the centre.

    Args:
        surface: The response.
        low: Lower coded bounds, one per factor.
        high: Upper coded bounds.
        maximise: True to maximise, False to minimise.

    Raises:
        StudyError: The bounds are not ordered pairs of finite numbers, or there are more than six factors.
    """
    box = _box(low, high)
    starts = full_factorial([(a, (a + b) / 2, b) for a, b in box])
    if len(starts) > _MOST_STARTS:
        raise StudyError(f"optimum: {len(box)} factors; must be at most six")
    sign = -1.0 if maximise else 1.0

    upper = np.transpose(box)[1]

    def cost_and_slope(point: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        """Return the cost and its forward differences, or backward ones at the upper bound, from one prediction."""
        steps = np.where(point + _DIFFERENCE > upper, -_DIFFERENCE, _DIFFERENCE)
        cost, *moved = sign * surface.predict(np.vstack([point, point + np.diag(steps)]))
        return float(cost), (np.array(moved) - cost) / steps

    candidates = [optimize.minimize(cost_and_slope, start, jac=True, bounds=box, method="L-BFGS-B") for start in starts]
    winner = min(candidates, key=lambda result: float(result.fun))
    point = np.asarray(winner.x, dtype=np.float64)
    return point, float(surface.predict(point)[0])


def best_location_interval(
    fit: Model, low: Sequence[float], high: Sequence[float], *, confidence: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return, for each factor, a confidence interval for the location of the maximum within a box.

    The Monte Carlo method is used: coefficients are drawn from their estimated distribution (Student's t with the
    covariance of the fit), and the best point of a grid is determined for each draw.

    Args:
        fit: Fitted response.
        low: Lower coded bounds, one per factor.
        high: Upper coded bounds.
        confidence: Fraction of the draws within the interval, above 0 and below 1.

    Returns:
        Lower and upper ends, coded, to the resolution of the grid.

    Raises:
        StudyError: The bounds are not ordered pairs of finite numbers.
    """
    grid = _search_grid(_box(low, high))
    matrix = model_matrix(grid, list(fit.coefficients))
    optima = [int((matrix @ drawn).argmax()) for drawn in fit.drawn(_DRAWS, seed=_DRAWS_SEED)]
    tail = (1 - confidence) / 2
    ends = np.quantile(grid[optima], (tail, 1 - tail), axis=0)
    return ends[0], ends[1]


def pareto(a: Surface, b: Surface, low: Sequence[float], high: Sequence[float], n: int) -> Front:
    """Return the Pareto front of two responses that are both minimised.

    The constraint method is used: `a` is minimised with `b` below a bound, and the bound is lowered step by step from
    the value of `b` at the minimum of `a` to the minimum of `b`. Unlike weighted sums, this also finds the concave
    parts of a front.

    Args:
        a: First response.
        b: Second response.
        low: Lower coded bounds, one per factor.
        high: Upper coded bounds.
        n: Number of points, at least 2; duplicates are removed.

    Raises:
        StudyError: The bounds are not ordered pairs of finite numbers, or n is below 2.
    """
    if n < 2:
        raise StudyError(f"pareto front: {n} points; must be at least 2")
    box = _box(low, high)
    least_a, _ = best(a, low, high, maximise=False)
    least_b, smallest_b = best(b, low, high, maximise=False)
    grid = np.vstack([_search_grid(box), least_a, least_b])
    grid_a, grid_b = a.predict(grid), b.predict(grid)
    bounds = np.linspace(float(b.predict(least_a)[0]), smallest_b, n)
    minima = []
    for bound in bounds:
        allowed = grid_b <= bound + _ROUNDING
        start = grid[allowed][np.argmin(grid_a[allowed])]
        minima.append(_least_within(a, b, start, float(bound), box))
    points = _without_dominated(np.array(minima), a, b)
    return Front(points, a.predict(points), b.predict(points))


def _least_within(
    a: Surface, b: Surface, start: NDArray[np.float64], bound: float, box: Sequence[tuple[float, float]]
) -> NDArray[np.float64]:
    """Return the point near a start that minimises `a` with `b` below a bound; the start if no point is better."""
    result = optimize.minimize(
        lambda point: float(a.predict(point)[0]),
        start,
        bounds=box,
        constraints={"type": "ineq", "fun": lambda point: bound - float(b.predict(point)[0])},
        method="SLSQP",
    )
    point = np.clip(result.x, *np.transpose(box))
    is_allowed = float(b.predict(point)[0]) <= bound + _ROUNDING
    is_better = float(a.predict(point)[0]) < float(a.predict(start)[0])
    return point if is_allowed and is_better else start


def _without_dominated(points: NDArray[np.float64], a: Surface, b: Surface) -> NDArray[np.float64]:
    """Return the points that are not dominated by another point, without duplicates."""
    values = np.round(np.column_stack([a.predict(points), b.predict(points)]), 6)
    _, first = np.unique(values, axis=0, return_index=True)
    points, values = points[np.sort(first)], values[np.sort(first)]
    no_worse = (values[:, np.newaxis] <= values).all(axis=2)
    less = (values[:, np.newaxis] < values).any(axis=2)
    return points[~(no_worse & less).any(axis=0)]


def _search_grid(box: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """Return a grid of points in a box, one per row."""
    levels = max(3, int(_GRID_POINTS ** (1 / len(box))))
    return full_factorial([tuple(np.linspace(*ends, levels)) for ends in box])


def _box(low: Sequence[float], high: Sequence[float]) -> list[tuple[float, float]]:
    """Return the bounds as pairs."""
    if len(low) == 0 or len(low) != len(high):
        raise StudyError(f"bounds: {len(low)} lower and {len(high)} upper bounds; specify one pair per factor")
    for number, ends in enumerate(zip(low, high, strict=True), start=1):
        if not (np.isfinite(ends).all() and ends[0] < ends[1]):
            raise StudyError(
                f"bounds of X{number}: {ends[0]:g} to {ends[1]:g} is not a range; specify the lower bound first"
            )
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
