"""Iteratively reweighted least squares of shares with the binomial variance function, for many tables at once.

The iteration is our own for two reasons. A fitted share must not reach 0 or 1, where its run would take all the weight,
but the generalized linear models of statsmodels do not bound the means of the identity link. And a simulation fits
thousands of tables of one design; the functions here take them in the leading dimensions, so that the simulation runs
the code of the fit itself.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import special

Link = Literal["identity", "logit"]
Array = NDArray[np.float64]

MOST_STEPS = 2000
"""Maximum number of steps of the iteration."""
_FULL_STEPS = 500
_LEAST_SHARE = 0.005
"""Distance from 0 and 1 below which the identity link takes the variance as constant."""
_CLOSE = 1e-10
"""Change of every fitted share below which the iteration has converged."""


def irls(
    matrix: Array, shares: Array, totals: Array, link: Link = "identity"
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Fit shares by iteratively reweighted least squares; leading dimensions of the shares are separate tables.

    Where the variance is computed from a fitted share, the share is kept away from 0 and 1 (`share_bounds`).

    Args:
        matrix: Model matrix, one row per trial.
        shares: Observed shares, 0 to 1, trials in the last dimension.
        totals: Seedlings of each trial.
        link: Link function.

    Returns:
        Coefficients; response and weights of the last least squares step; whether each table has converged.
    """
    low, high = share_bounds(totals, link)
    mean = np.clip(shares, low, high)
    for step in range(MOST_STEPS):
        variance = mean * (1 - mean)
        if link == "identity":
            response, weights = shares, totals / variance
        else:
            response, weights = special.logit(mean) + (shares - mean) / variance, totals * variance
        coefficients = _solve(matrix, response, weights)
        eta = coefficients @ matrix.T
        new = np.clip(eta if link == "identity" else special.expit(eta), low, high)
        change = np.abs(new - mean).max(axis=-1)
        mean = new if step < _FULL_STEPS else (mean + new) / 2  # half steps end a cycle between two fits
        if (change < _CLOSE).all():
            break
    return coefficients, response, weights, change < math.sqrt(_CLOSE)


def share_bounds(totals: Array, link: Link) -> tuple[Array, Array]:
    """Return the bounds of the fitted shares that determine the variance.

    The bound is half a seedling. With the identity link, which can leave the range of shares, it is also at least half
    a percent: otherwise a run of many seedlings whose fitted share is 0 or 1 would outweigh all others.

    Args:
        totals: Seedlings of each trial.
        link: Link function.
    """
    low = np.minimum(0.5, 0.5 / totals)
    low = low if link == "logit" else np.maximum(low, _LEAST_SHARE)
    return low, 1 - low


def split_residual(matrix: Array, response: Array, weights: Array, groups: NDArray[np.intp]) -> tuple[Array, Array]:
    """Return the weighted residual sum of squares and the part of it within points, the pure error.

    Args:
        matrix: Model matrix, one row per trial.
        response: Response of the least squares step, trials in the last dimension.
        weights: Its weights.
        groups: Number of the point of each trial.
    """
    residual = response - _solve(matrix, response, weights) @ matrix.T
    member = np.eye(int(groups.max()) + 1)[groups]
    means = (weights * response) @ member / (weights @ member)
    within = response - means[..., groups]
    return np.sum(weights * residual**2, axis=-1), np.sum(weights * within**2, axis=-1)


def _solve(matrix: Array, response: Array, weights: Array) -> Array:
    """Return the coefficients of weighted least squares, tables in the leading dimensions."""
    weighted = weights[..., np.newaxis] * matrix
    normal = np.einsum("...ij,ik->...jk", weighted, matrix)
    right = np.einsum("...ij,...i->...j", weighted, response)
    return np.asarray(np.linalg.solve(normal, right[..., np.newaxis])[..., 0])
