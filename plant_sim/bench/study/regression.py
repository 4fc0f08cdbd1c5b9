"""Polynomial regression on coded factors, with its analysis of variance.

Terms are named as the papers do: ``1`` the constant, ``X1``, ``X1 X2``, ``X1^2``.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import statsmodels.api as sm
from numpy.typing import NDArray
from scipy import stats

from plant_sim.bench.study.errors import StudyError

Order = Literal["linear", "interactions", "quadratic"]
CONSTANT = "1"

_PART = re.compile(r"X([1-9]\d*)(\^2)?")
_SAME_POINT_DECIMALS = 9
_ROUNDING = 1e-20  # share of the squares of the response: what is left below it is arithmetic, not scatter


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient of a fit.

    Attributes:
        value: Its estimate, in units of the response.
        standard_error: Its standard error.
        t: Value over standard error; None where the fit leaves no error.
        p: Two-sided P that chance alone gives such a t; None where there is no t.
    """

    value: float
    standard_error: float
    t: float | None
    p: float | None


@dataclass(frozen=True, slots=True)
class AnovaRow:
    """A line of an analysis of variance.

    Attributes:
        source: ``model``, a term, ``residual``, ``lack of fit``, ``pure error`` or ``total``.
        sum_of_squares: Sum of squares; of a term partial (type III).
        degrees: Degrees of freedom.
        mean_square: Mean square; None for the total.
        f: F: over the residual's mean square, for lack of fit over the pure error's; None where there is none.
        p: P of F; None where there is none.
    """

    source: str
    sum_of_squares: float
    degrees: int
    mean_square: float | None = None
    f: float | None = None
    p: float | None = None


@dataclass(frozen=True)
class Polynomial:
    """A polynomial of the coded factors, such as a printed equation.

    Attributes:
        coefficients: By term; ``1`` is the constant.
    """

    coefficients: Mapping[str, float]

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return its value at coded points, one row each, or at one (then an array of one)."""
        points = np.atleast_2d(np.asarray(coded, dtype=np.float64))
        value: NDArray[np.float64] = model_matrix(points, list(self.coefficients)) @ list(self.coefficients.values())
        return value


@dataclass(frozen=True)
class Fit:
    """A fitted polynomial.

    Attributes:
        coded: The runs, coded.
        response: What they gave.
        coefficients: By term; ``1`` is the constant.
        anova: Analysis of variance: model, every term, residual, lack of fit and pure error where points are
            repeated, total.
        r2: Share of the variation that the model explains, 0 to 1.
        adjusted_r2: The same, adjusted for the number of terms.
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
        """The coefficients alone, by term."""
        return {term: coefficient.value for term, coefficient in self.coefficients.items()}

    def row(self, source: str) -> AnovaRow:
        """Return a line of the analysis of variance.

        Raises:
            StudyError: it has none of this name, such as a lack of fit where no point is repeated.
        """
        for row in self.anova:
            if row.source == source:
                return row
        has = ", ".join(row.source for row in self.anova)
        raise StudyError(f"analysis of variance: has no line {source!r}; it has {has}")

    def predict(self, coded: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the fitted response at coded points, one row each, or at one (then an array of one)."""
        return Polynomial(self.values).predict(coded)

    def drawn(self, number: int, *, seed: int) -> NDArray[np.float64]:
        """Return coefficients as they may be, drawn about the estimates from Student's t with their covariance.

        Args:
            number: How many.
            seed: Seed of the draws.

        Returns:
            One row a draw, the terms in their order.
        """
        covariance, degrees = self._results.cov_params(), self._results.df_resid
        drawn = stats.multivariate_t(self._results.params, covariance, df=degrees, allow_singular=True, seed=seed)
        return np.asarray(drawn.rvs(size=number), dtype=np.float64)

    def prediction_interval(
        self, coded: NDArray[np.float64], confidence: float = 0.95
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return between what a further single run at coded points is expected.

        Args:
            coded: Points, one row each, or one.
            confidence: Probability that the run lies between them, above 0 and below 1.

        Returns:
            Lower and upper ends.

        Raises:
            StudyError: the confidence is no such probability.
        """
        if not 0 < confidence < 1:
            raise StudyError(f"confidence {confidence:g}: is no probability between 0 and 1; give one such as 0.95")
        matrix = model_matrix(np.atleast_2d(coded), list(self.coefficients))
        ends = self._results.get_prediction(matrix).conf_int(obs=True, alpha=1 - confidence)
        return ends[:, 0], ends[:, 1]


def terms(k: int, order: Order) -> tuple[str, ...]:
    """Return the names of the terms of a polynomial without its constant.

    Args:
        k: Number of factors.
        order: ``linear``; ``interactions`` adds the products of two; ``quadratic`` adds the squares too.

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


def model_matrix(coded: NDArray[np.float64], names: Sequence[str]) -> NDArray[np.float64]:
    """Return the columns of terms at coded points.

    Args:
        coded: Points, one row each.
        names: Terms, the constant among them if wanted.

    Raises:
        StudyError: a term is none, or names a factor the points do not have.
    """
    return np.column_stack([_column(coded, name) for name in names])


def _column(coded: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    column = np.ones(len(coded))
    if name == CONSTANT:
        return column
    for part in name.split(" "):
        match = _PART.fullmatch(part)
        if match is None or int(match[1]) > coded.shape[1]:
            has = f"the design has X1 to X{coded.shape[1]}"
            raise StudyError(f"term {name!r}: {has}; write a term like X1, 'X1 X2' or X1^2")
        column = column * coded[:, int(match[1]) - 1] ** (2 if match[2] else 1)
    return column


def fit(coded: NDArray[np.float64], response: NDArray[np.float64], terms: Sequence[str]) -> Fit:
    """Fit a polynomial by least squares.

    Args:
        coded: The runs, one row each, coded.
        response: What each gave.
        terms: Names of the terms besides the constant, at least one.

    Raises:
        StudyError: there are no runs, no terms or not more runs than coefficients; a number is not finite; the
            response is the same in every run; or the design cannot tell terms apart.
    """
    coded, response = np.asarray(coded, dtype=np.float64), np.asarray(response, dtype=np.float64)
    names = [CONSTANT, *terms]
    _check_runs(coded, response, names)
    matrix = model_matrix(coded, names)
    _check_separable(matrix, names)
    results = sm.OLS(response, matrix).fit()
    residual = _scatter(float(results.ssr), results)
    coefficients = _coefficients(names, results, has_error=residual > 0)
    anova = _anova(coded, names, results, residual)
    return Fit(coded, response, coefficients, anova, float(results.rsquared), float(results.rsquared_adj), results)


def _check_runs(coded: NDArray[np.float64], response: NDArray[np.float64], names: Sequence[str]) -> None:
    """Refuse runs nothing can be fitted to."""
    if coded.ndim != 2 or len(coded) == 0:
        raise StudyError("regression: the design has no runs; give one row a run")
    if len(names) < 2:
        raise StudyError("regression: no terms; give at least one, such as X1")
    if response.shape != (len(coded),):
        raise StudyError(f"regression: {len(coded)} runs but {response.size} responses; give one a run")
    broken = np.flatnonzero(~(np.isfinite(response) & np.isfinite(coded).all(axis=1)))
    if len(broken):
        raise StudyError(f"regression: run {broken[0] + 1} holds no finite number; complete or leave out the run")
    if len(coded) <= len(names):
        counts = f"{len(coded)} runs for {len(names)} coefficients leave nothing to judge the error by"
        raise StudyError(f"regression: {counts}; add runs or leave out terms")
    if np.ptp(response) == 0:
        raise StudyError(f"regression: the response is {response[0]:g} in every run; there is nothing to explain")


def _check_separable(matrix: NDArray[np.float64], names: Sequence[str]) -> None:
    """Refuse columns that depend on each other: a vector that the matrix takes to zero names them."""
    rank = int(np.linalg.matrix_rank(matrix))
    if rank == len(names):
        return
    _, _, directions = np.linalg.svd(matrix, full_matrices=False)  # at least as many runs as terms
    entangled = np.any(np.abs(directions[rank:]) > 1e-9, axis=0)
    listed = ", ".join(name for name, is_one in zip(names, entangled, strict=True) if is_one)
    raise StudyError(f"regression: the design cannot tell these terms apart: {listed}; add levels or leave out terms")


def _scatter(sum_of_squares: float, results: Any) -> float:
    """Return a sum of squares, or 0 if it is no more than arithmetic leaves."""
    return sum_of_squares if sum_of_squares > _ROUNDING * results.uncentered_tss else 0.0


def _coefficients(names: Sequence[str], results: Any, *, has_error: bool) -> dict[str, Coefficient]:
    values = [float(value) for value in results.params]
    if not has_error:
        return {name: Coefficient(value, 0.0, None, None) for name, value in zip(names, values, strict=True)}
    errors = zip(*(map(float, column) for column in (results.bse, results.tvalues, results.pvalues)), strict=True)
    return {name: Coefficient(value, *row) for name, value, row in zip(names, values, errors, strict=True)}


def _anova(coded: NDArray[np.float64], names: Sequence[str], results: Any, residual: float) -> tuple[AnovaRow, ...]:
    """Return the lines of the analysis of variance."""
    model_df, residual_df = round(results.df_model), round(results.df_resid)
    error = residual / residual_df
    rows = [_tested("model", float(results.ess), model_df, error, residual_df)]
    # partial, of one degree of freedom: what the residual gains when only this term is left out
    gains = results.params**2 / np.diag(results.normalized_cov_params)
    rows += [
        _tested(name, float(gain), 1, error, residual_df)
        for name, gain in zip(names, gains, strict=True)
        if name != CONSTANT
    ]
    rows.append(AnovaRow("residual", residual, residual_df, error))
    rows += _lack_of_fit(coded, results, residual)
    return (*rows, AnovaRow("total", float(results.centered_tss), model_df + residual_df))


def _lack_of_fit(coded: NDArray[np.float64], results: Any, residual: float) -> list[AnovaRow]:
    """Split the residual into lack of fit and pure error; nothing where no point is repeated.

    The pure error is the scatter of the runs about the mean of their own point.
    """
    points = np.round(coded, _SAME_POINT_DECIMALS)
    _, groups, counts = np.unique(points, axis=0, return_inverse=True, return_counts=True)
    if len(counts) == len(coded):
        return []
    response = results.model.endog
    means = np.bincount(groups, weights=response) / counts
    pure = _scatter(float(np.sum((response - means[groups]) ** 2)), results)
    pure_df = len(coded) - len(counts)
    pure_row = AnovaRow("pure error", pure, pure_df, pure / pure_df)
    lack_df = round(results.df_resid) - pure_df
    if lack_df == 0:
        return [pure_row]
    lack = _scatter(residual - pure, results)
    return [_tested("lack of fit", lack, lack_df, pure / pure_df, pure_df), pure_row]


def _tested(source: str, sum_of_squares: float, degrees: int, error: float, error_df: int) -> AnovaRow:
    """Return a line with its F against a mean square of error; without F where that is 0."""
    mean_square = sum_of_squares / degrees
    if error <= 0 or not math.isfinite(mean_square / error):
        return AnovaRow(source, sum_of_squares, degrees, mean_square)
    f = mean_square / error
    return AnovaRow(source, sum_of_squares, degrees, mean_square, f, float(stats.f.sf(f, degrees, error_df)))
