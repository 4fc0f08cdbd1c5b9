"""Where a fitted response is best within bounds, and what two responses cost each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from plant_sim.bench.study.design import full_factorial
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.regression import Fit, model_matrix

_GRID_POINTS = 20_000
_ROUNDING = 1e-6  # of a response: how exactly the constrained search keeps a bound
_DRAWS = 1000
_DRAWS_SEED = 1
_MOST_STARTS = 729  # 3 to the power of 6 factors


class Surface(Protocol):
    """What can be optimised: a `Fit` or a `Polynomial`."""

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the response at coded points, one row each, or at one (then an array of one)."""


@dataclass(frozen=True)
class Front:
    """Pareto front of two responses that should both be small.

    Attributes:
        coded: Its points, coded, one row each, from the smallest a to the smallest b.
        a: First response there.
        b: Second response there.
    """

    coded: NDArray[np.float64]
    a: NDArray[np.float64]
    b: NDArray[np.float64]


def best(
    surface: Surface, low: Sequence[float], high: Sequence[float], *, maximise: bool = True
) -> tuple[NDArray[np.float64], float]:
    """Return where a response is best within a box, and how large it is there.

    A quadratic may have several local optima in a box, so the search starts from every corner, the middle of
    every edge and face, and the centre.

    Args:
        surface: The response.
        low: Lower coded bounds, one a factor.
        high: Upper coded bounds.
        maximise: Whether large is good.

    Raises:
        StudyError: the bounds are not pairs of finite numbers in order, or of more than six factors.
    """
    box = _box(low, high)
    starts = full_factorial([(a, (a + b) / 2, b) for a, b in box])
    if len(starts) > _MOST_STARTS:
        raise StudyError(f"optimum: {len(box)} factors are too many to search; hold all but six")
    sign = -1.0 if maximise else 1.0

    def cost(point: NDArray[np.float64]) -> float:
        return sign * float(surface.predict(point)[0])

    found = [optimize.minimize(cost, start, bounds=box, method="L-BFGS-B") for start in starts]
    winner = min(found, key=lambda result: float(result.fun))
    point = np.asarray(winner.x, dtype=np.float64)
    return point, float(surface.predict(point)[0])


def best_place_interval(
    fit: Fit, low: Sequence[float], high: Sequence[float], *, confidence: float = 0.95
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return between what the place of the highest response within a box lies, each factor by itself.

    By Monte Carlo: coefficients are drawn as the regression leaves them open (Student's t, their covariance), and the
    best point of a grid is sought for each draw.

    Args:
        fit: The response.
        low: Lower coded bounds, one a factor.
        high: Upper coded bounds.
        confidence: Part of the draws between the ends, above 0 and below 1.

    Returns:
        Lower and upper ends, coded; to the step of the grid.

    Raises:
        StudyError: the bounds are not pairs of finite numbers in order.
    """
    grid = _search_grid(_box(low, high))
    matrix = model_matrix(grid, list(fit.coefficients))
    places = [int((matrix @ drawn).argmax()) for drawn in fit.drawn(_DRAWS, seed=_DRAWS_SEED)]
    tail = (1 - confidence) / 2
    ends = np.quantile(grid[places], (tail, 1 - tail), axis=0)
    return ends[0], ends[1]


def pareto(a: Surface, b: Surface, low: Sequence[float], high: Sequence[float], n: int) -> Front:
    """Return the Pareto front of two responses that should both be small.

    By the constraint method: the smallest a while b stays below a bound, for bounds from b at the smallest a
    down to the smallest b. Unlike weighted sums it also finds the parts of a front that bend inward.

    Args:
        a: First response.
        b: Second response.
        low: Lower coded bounds, one a factor.
        high: Upper coded bounds.
        n: Number of points, at least 2; fewer come back where bounds give a point twice.

    Raises:
        StudyError: the bounds are not pairs of finite numbers in order, or n is below 2.
    """
    if n < 2:
        raise StudyError(f"pareto front: {n} points; give at least 2")
    box = _box(low, high)
    least_a, _ = best(a, low, high, maximise=False)
    least_b, smallest_b = best(b, low, high, maximise=False)
    grid = np.vstack([_search_grid(box), least_a, least_b])
    grid_a, grid_b = a.predict(grid), b.predict(grid)
    bounds = np.linspace(float(b.predict(least_a)[0]), smallest_b, n)
    found = []
    for bound in bounds:
        allowed = grid_b <= bound + _ROUNDING
        start = grid[allowed][np.argmin(grid_a[allowed])]
        found.append(_least_within(a, b, start, float(bound), box))
    points = _without_dominated(np.array(found), a, b)
    return Front(points, a.predict(points), b.predict(points))


def _least_within(
    a: Surface, b: Surface, start: NDArray[np.float64], bound: float, box: Sequence[tuple[float, float]]
) -> NDArray[np.float64]:
    """Return where a is smallest near a start while b stays below a bound; the start if nothing better is."""
    result = optimize.minimize(
        lambda point: float(a.predict(point)[0]),
        start,
        bounds=box,
        constraints={"type": "ineq", "fun": lambda point: bound - float(b.predict(point)[0])},
        method="SLSQP",
    )
    point = np.clip(result.x, *np.transpose(box))
    kept = float(b.predict(point)[0]) <= bound + _ROUNDING
    better = float(a.predict(point)[0]) < float(a.predict(start)[0])
    return point if kept and better else start


def _without_dominated(points: NDArray[np.float64], a: Surface, b: Surface) -> NDArray[np.float64]:
    """Return the points no other beats in one response without losing in the other, each once."""
    values = np.round(np.column_stack([a.predict(points), b.predict(points)]), 6)
    _, first = np.unique(values, axis=0, return_index=True)
    points, values = points[np.sort(first)], values[np.sort(first)]
    no_worse = (values[:, np.newaxis] <= values).all(axis=2)
    less = (values[:, np.newaxis] < values).any(axis=2)
    return points[~(no_worse & less).any(axis=0)]


def _search_grid(box: Sequence[tuple[float, float]]) -> NDArray[np.float64]:
    """Return points all over a box, one row each."""
    levels = max(3, int(_GRID_POINTS ** (1 / len(box))))
    return full_factorial([tuple(np.linspace(*ends, levels)) for ends in box])


def _box(low: Sequence[float], high: Sequence[float]) -> list[tuple[float, float]]:
    """Return the bounds as pairs."""
    if len(low) == 0 or len(low) != len(high):
        raise StudyError(f"bounds: {len(low)} lower and {len(high)} upper ones; give one pair a factor")
    for number, ends in enumerate(zip(low, high, strict=True), start=1):
        if not (np.isfinite(ends).all() and ends[0] < ends[1]):
            raise StudyError(f"bounds of X{number}: {ends[0]:g} to {ends[1]:g} is no range; give the smaller end first")
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
