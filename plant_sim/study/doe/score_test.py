"""F test of terms of a fit to counts, with the weights of the model without them, for many tables at once.

Weights come from fitted shares. If the tested terms take part in the fit, trials that are low by chance get large
weights from their own deviation, and a term that does not exist is found too often with the identity link. Under the
hypothesis the weights are those of the model without the terms: the principle of Rao's score test. Response and weights
of the last step of its iteration then make an ordinary linear model, in which the decrease of the residual by the terms
is compared with the pure error.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import qr

from plant_sim.study.doe.irls import Array, Link, irls, split_residual
from plant_sim.study.doe.regression import point_numbers

_INDEPENDENT = 1e-9
"""Diagonal of the triangular factor, relative to the largest, above which a column is independent of the others."""


def nested_f(without: Array, matrix: Array, pure: Array, shares: Array, totals: Array, *, link: Link) -> Array:
    """Return F of a model against a simpler one that is part of it, relative to the pure error.

    Args:
        without: Model matrix of the hypothesis, the simpler model, one row per trial.
        matrix: Model matrix; that of the pure error for the lack of fit.
        pure: Matrix of the pure error (`pure_matrix`).
        shares: Observed shares, 0 to 1, trials in the last dimension; leading dimensions are separate tables.
        totals: Seedlings of each trial.
        link: Link function.
    """
    _, response, weights, _ = irls(without, shares, totals, link)
    trials = np.arange(len(totals))
    before, after, error = (split_residual(each, response, weights, trials)[0] for each in (without, matrix, pure))
    terms, degrees = matrix.shape[1] - without.shape[1], len(totals) - pure.shape[1]
    return np.asarray((before - after) / terms / (error / degrees))


def pure_matrix(coded: Array, additive: int = 0) -> Array:
    """Return the model matrix of the pure error: one mean for each point, and blocks, as independent columns.

    Args:
        coded: Coded trials.
        additive: Number of factors at the end, such as blocks, that do not interact with the others.
    """
    kept = coded.shape[1] - additive
    groups = point_numbers(coded[:, :kept])
    matrix = np.hstack([np.eye(int(groups.max()) + 1)[groups], coded[:, kept:]])
    _, triangle, order = qr(matrix, mode="economic", pivoting=True)
    size = np.abs(np.diag(triangle))
    return matrix[:, np.sort(order[: np.count_nonzero(size > _INDEPENDENT * size[0])])]
