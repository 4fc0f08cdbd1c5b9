"""Polynomial regression on coded factors, with its analysis of variance.

Terms are named as in the papers: ``1`` for the constant, ``X1``, ``X1 X2``, ``X1^2``.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from statsmodels.regression.linear_model import OLS

from plant_sim.common.polynomial import CONSTANT, Polynomial, model_matrix
from plant_sim.study.errors import StudyError

Order = Literal["linear", "interactions", "quadratic"]

_SAME_POINT_DECIMALS = 9
_ROUNDING = 1e-20
"""Fraction of the response's sum of squares below which a residual is rounding error."""


@dataclass(frozen=True, slots=True)
class Coefficient:
    """Coefficient of a fit.

    Attributes:
        value: Estimate, in units of the response.
        standard_error: Standard error.
        t: Value divided by its standard error; None if the fit is exact.
        p: Two-sided P value of t; None if t is None.
    """

    value: float
    standard_error: float
    t: float | None
    p: float | None


@dataclass(frozen=True, slots=True)
class AnovaRow:
    """Row of an analysis of variance.

    Attributes:
        source: ``model``, a term, ``residual``, ``lack of fit``, ``pure error`` or ``total``.
        sum_of_squares: Sum of squares; partial (type III) for a term.
        degrees: Degrees of freedom.
        mean_square: Mean square; None for the total.
        f: F value: ratio of the mean square to that of the residual or, for lack of fit, of the pure error; None if
            undefined.
        p: P value of F; None if F is None.
    """

    source: str
    sum_of_squares: float
    degrees: int
    mean_square: float | None = None
    f: float | None = None
    p: float | None = None


@dataclass(frozen=True)
class Fit:
    """Fitted polynomial.

    Attributes:
        coded: Coded runs.
        response: Response of each run.
        coefficients: Coefficients by term; ``1`` is the constant.
        anova: Analysis of variance: model, every term, residual, total; lack of fit and pure error if points are
            repeated.
        r2: Coefficient of determination, 0 to 1.
        adjusted_r2: Coefficient of determination adjusted for the number of terms.
    """

    coded: NDArray[np.float64]
    response: NDArray[np.float64]
    coefficients: Mapping[str, Coefficient]
    anova: tuple[AnovaRow, ...]
    r2: float
    adjusted_r2: float
    _results: Any = field(repr=False)

    @property
    def values(self) -> dict[str, float]:
        """Coefficient values by term."""
        return {term: coefficient.value for term, coefficient in self.coefficients.items()}

    def row(self, source: str) -> AnovaRow:
        """Return a row of the analysis of variance.

        Raises:
            StudyError: There is no such row, for example lack of fit if no points are repeated.
        """
        return find_row(self.anova, source)

    def joint_row(self, source: str, terms: Sequence[str]) -> AnovaRow:
        """Return the row of several terms together: the increase of the residual if all of them are removed."""
        error = self.row("residual")
        return joint_row(
            source,
            terms,
            list(self.coefficients),
            self._results,
            error=error.mean_square or 0.0,
            error_df=error.degrees,
        )

    @property
    def interval_name(self) -> str:
        """Name of the 95 % intervals for a report."""
        return "95 % interval"

    def coefficient_interval(self, term: str, confidence: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of a coefficient, by Student's t."""
        each = self.coefficients[term]
        half = float(stats.t.ppf((1 + confidence) / 2, self._results.df_resid)) * each.standard_error
        return each.value - half, each.value + half

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fitted response at coded points, one per row; a single point gives an array with one element."""
        return Polynomial(self.values).predict(coded)

    def drawn(self, number: int, *, seed: int) -> NDArray[np.float64]:
        """Return coefficients drawn from a multivariate t distribution with the mean and covariance of the estimates.

        Args:
            number: Number of draws.
            seed: Seed of the draws.

        Returns:
            Array with one row per draw and one column per term.
        """
        covariance, degrees = self._results.cov_params(), self._results.df_resid
        distribution = stats.multivariate_t(
            self._results.params, covariance, df=degrees, allow_singular=True, seed=seed
        )
        return np.asarray(distribution.rvs(size=number), dtype=np.float64)

    def prediction_interval(
        self, coded: NDArray[np.float64], confidence: float = 0.95
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the prediction interval of a single further run at coded points.

        Args:
            coded: Points, one per row, or a single point.
            confidence: Probability that the response of the run is in the interval, above 0 and below 1.

        Returns:
            Lower and upper ends.

        Raises:
            StudyError: The confidence is not between 0 and 1.
        """
        if not 0 < confidence < 1:
            raise StudyError(f"confidence {confidence:g}: must be between 0 and 1, for example 0.95")
        matrix = model_matrix(np.atleast_2d(coded), list(self.coefficients))
        ends = self._results.get_prediction(matrix).conf_int(obs=True, alpha=1 - confidence)
        return ends[:, 0], ends[:, 1]


def terms(k: int, order: Order) -> tuple[str, ...]:
    """Return the names of the terms of a polynomial, excluding the constant.

    Args:
        k: Number of factors.
        order: ``linear``; ``interactions`` adds the products of two factors; ``quadratic`` also adds the squares.

    >>> terms(2, "quadratic")
    ('X1', 'X2', 'X1 X2', 'X1^2', 'X2^2')
    """
    factors = [f"X{number}" for number in range(1, k + 1)]
    names = list(factors)
    if order != "linear":
        names += [" ".join(pair) for pair in itertools.combinations(factors, 2)]
    if order == "quadratic":
        names += [f"{factor}^2" for factor in factors]
    return tuple(names)


def fit(coded: NDArray[np.float64], response: NDArray[np.float64], terms: Sequence[str], *, additive: int = 0) -> Fit:
    """Fit a polynomial by least squares.

    Args:
        coded: Coded runs, one per row.
        response: Response of each run.
        terms: Names of the terms, excluding the constant; at least one.
        additive: Number of factors at the end, such as blocks, that do not interact with the others; runs that differ
            in them only are repeated runs.

    Raises:
        StudyError: There are no terms, or the runs do not outnumber the coefficients; a number is not finite; the
            response is the same in every run; or the design cannot separate the terms.
    """
    coded, response = np.asarray(coded, dtype=np.float64), np.asarray(response, dtype=np.float64)
    names = [CONSTANT, *terms]
    check_runs(coded, response, names)
    matrix = model_matrix(coded, names)
    check_separable(matrix, names)
    results = OLS(response, matrix).fit()
    residual = _scatter(float(results.ssr), results)
    coefficients = _coefficients(names, results, has_error=residual > 0)
    anova = _anova(coded, names, results, residual, additive)
    return Fit(coded, response, coefficients, anova, float(results.rsquared), float(results.rsquared_adj), results)


def find_row(anova: Sequence[AnovaRow], source: str) -> AnovaRow:
    """Return a row of an analysis of variance.

    Raises:
        StudyError: There is no such row, for example lack of fit if no points are repeated.
    """
    for row in anova:
        if row.source == source:
            return row
    sources = ", ".join(row.source for row in anova)
    raise StudyError(f"analysis of variance: has no row {source!r}; it has {sources}")


def point_numbers(coded: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the number of the point of each run, from 0; repeated runs have the same number."""
    _, groups = np.unique(np.round(coded, _SAME_POINT_DECIMALS), axis=0, return_inverse=True)
    return groups


def check_runs(coded: NDArray[np.float64], response: NDArray[np.float64], names: Sequence[str]) -> None:
    """Check that a model can be fitted to the runs."""
    if coded.ndim != 2 or len(coded) == 0:
        raise StudyError("regression: the design has no runs; specify one row per run")
    if len(names) < 2:
        raise StudyError("regression: no terms; specify at least one, such as X1")
    if response.shape != (len(coded),):
        raise StudyError(f"regression: {len(coded)} runs but {response.size} responses; specify one per run")
    broken = np.flatnonzero(~(np.isfinite(response) & np.isfinite(coded).all(axis=1)))
    if len(broken):
        raise StudyError(f"regression: run {broken[0] + 1} contains a non-finite number; complete or remove the run")
    if len(coded) <= len(names):
        counts = f"{len(coded)} runs for {len(names)} coefficients leave no degrees of freedom for the error"
        raise StudyError(f"regression: {counts}; add runs or remove terms")
    if np.ptp(response) == 0:
        raise StudyError(f"regression: the response is {response[0]:g} in every run, so no model can be fitted")


def check_separable(matrix: NDArray[np.float64], names: Sequence[str]) -> None:
    """Check that the columns are independent; dependent terms are found from the null space of the matrix."""
    rank = int(np.linalg.matrix_rank(matrix))
    if rank == len(names):
        return
    _, _, directions = np.linalg.svd(matrix, full_matrices=False)  # there are at least as many runs as terms
    is_dependent = np.any(np.abs(directions[rank:]) > 1e-9, axis=0)
    dependent = ", ".join(name for name, is_one in zip(names, is_dependent, strict=True) if is_one)
    raise StudyError(f"regression: the design cannot separate these terms: {dependent}; add levels or remove terms")


def _scatter(sum_of_squares: float, results: Any) -> float:
    """Return a sum of squares, or 0 if it is only rounding error."""
    return sum_of_squares if sum_of_squares > _ROUNDING * results.uncentered_tss else 0.0


def _coefficients(names: Sequence[str], results: Any, *, has_error: bool) -> dict[str, Coefficient]:
    values = [float(value) for value in results.params]
    if not has_error:
        return {name: Coefficient(value, 0.0, None, None) for name, value in zip(names, values, strict=True)}
    errors = zip(*(map(float, column) for column in (results.bse, results.tvalues, results.pvalues)), strict=True)
    return {name: Coefficient(value, *row) for name, value, row in zip(names, values, errors, strict=True)}


def _anova(
    coded: NDArray[np.float64], names: Sequence[str], results: Any, residual: float, additive: int
) -> tuple[AnovaRow, ...]:
    """Return the rows of the analysis of variance."""
    model_df, residual_df = round(results.df_model), round(results.df_resid)
    error = residual / residual_df
    rows = [tested_row("model", float(results.ess), model_df, error, residual_df)]
    # partial, one degree of freedom: increase of the residual if only this term is removed
    increases = results.params**2 / np.diag(results.normalized_cov_params)
    rows += [
        tested_row(name, float(increase), 1, error, residual_df)
        for name, increase in zip(names, increases, strict=True)
        if name != CONSTANT
    ]
    rows.append(AnovaRow("residual", residual, residual_df, error))
    rows += _lack_of_fit(coded, results, residual, additive)
    return (*rows, AnovaRow("total", float(results.centered_tss), model_df + residual_df))


def _lack_of_fit(coded: NDArray[np.float64], results: Any, residual: float, additive: int) -> list[AnovaRow]:
    """Return the rows for lack of fit and pure error; empty if no points are repeated.

    The pure error is the scatter of the runs around the mean at their point.
    """
    response = results.model.endog
    pure, pure_df = pure_error(coded, response, np.ones(len(coded)), additive)
    if pure_df == 0:
        return []
    pure = _scatter(pure, results)
    pure_row = AnovaRow("pure error", pure, pure_df, pure / pure_df)
    lack_df = round(results.df_resid) - pure_df
    if lack_df == 0:
        return [pure_row]
    lack = _scatter(residual - pure, results)
    return [tested_row("lack of fit", lack, lack_df, pure / pure_df, pure_df), pure_row]


def tested_row(source: str, sum_of_squares: float, degrees: int, error: float, error_df: int) -> AnovaRow:
    """Return a row with F relative to the error mean square; F is None if the error is 0."""
    mean_square = sum_of_squares / degrees
    if error <= 0 or not math.isfinite(mean_square / error):
        return AnovaRow(source, sum_of_squares, degrees, mean_square)
    f = mean_square / error
    return AnovaRow(source, sum_of_squares, degrees, mean_square, f, float(stats.f.sf(f, degrees, error_df)))


def pure_error(
    coded: NDArray[np.float64], response: NDArray[np.float64], weights: NDArray[np.float64], additive: int
) -> tuple[float, int]:
    """Return the weighted sum of squares of repeated runs around the mean of their point, and its degrees of freedom.

    Args:
        coded: Coded runs.
        response: Response of each run.
        weights: Weight of each run.
        additive: Number of factors at the end that add to the mean of a point without interaction.
    """
    kept = coded.shape[1] - additive
    groups = point_numbers(coded[:, :kept])
    root = np.sqrt(weights)
    basis = root[:, np.newaxis] * np.hstack([np.eye(int(groups.max()) + 1)[groups], coded[:, kept:]])
    solution, _, rank, _ = np.linalg.lstsq(basis, root * response, rcond=None)
    return float(np.sum((root * response - basis @ solution) ** 2)), len(coded) - int(rank)


def joint_row(
    source: str, terms: Sequence[str], names: Sequence[str], results: Any, *, error: float, error_df: int
) -> AnovaRow:
    """Return the row of several terms together, with F relative to an error mean square."""
    places = [names.index(term) for term in terms]
    values, covariance = results.params[places], results.normalized_cov_params[np.ix_(places, places)]
    return tested_row(source, float(values @ np.linalg.solve(covariance, values)), len(places), error, error_df)
