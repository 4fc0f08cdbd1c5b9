"""Weighted regression of counted seedlings: binomial variance function, error from repeated runs, F tests.

The unit is the trial. Seedlings of a tray fail together more often than chance would have it, so the variance of a
share is not ``p (1 - p) / n`` but a multiple of it, the dispersion. The dispersion is the mean square of the pure
error: the scatter of repeated runs around the mean of their point. F tests and intervals use that mean square with its
degrees of freedom, whatever its value.

The last step of the iteration is a weighted least squares fit of statsmodels, from which everything else is computed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats
from statsmodels.regression.linear_model import WLS

from plant_sim.common.polynomial import CONSTANT, model_matrix
from plant_sim.study.doe.dispersion import Dispersion
from plant_sim.study.doe.irls import MOST_STEPS, Array, Link, irls, share_bounds, split_residual
from plant_sim.study.doe.regression import (
    AnovaRow,
    Coefficient,
    Fit,
    check_runs,
    check_separable,
    find_row,
    joint_row,
    point_numbers,
    pure_error,
    tested_row,
)
from plant_sim.study.doe.score_test import nested_f, pure_matrix
from plant_sim.study.errors import StudyError

_PERCENT: Final = 100.0
_LARGEST_LEVERAGE = 1 - 1e-9
"""Leverage above which a run determines a coefficient alone, so that it cannot be predicted from the others."""
_ROUNDING = 1e-20
"""Fraction of the total below which a sum of squares is rounding error."""


@dataclass(frozen=True)
class WeightedFit:
    """Polynomial fitted to counts, weighted by the binomial variance function.

    Attributes:
        coded: Coded trials.
        counts: Counted seedlings of each trial.
        totals: Seedlings of each trial.
        link: ``identity``: the share is the polynomial; ``logit``: its logit is.
        coefficients: Coefficients by term; in percentage points with the identity link, in logits otherwise. Without a
            known dispersion t and P are None, and the standard errors are binomial.
        anova: Analysis of variance as of `Fit`, in weighted sums of squares (Pearson χ²). F and P are relative to the
            pure error; None if it is unknown.
        dispersion: Dispersion between repeated trials.
        r2: Weighted coefficient of determination, 0 to 1.
        adjusted_r2: The same, adjusted for the number of terms.
    """

    coded: Array
    counts: Array
    totals: Array
    link: Link
    coefficients: Mapping[str, Coefficient]
    anova: tuple[AnovaRow, ...]
    dispersion: Dispersion
    r2: float
    adjusted_r2: float
    _results: Any = field(repr=False)
    _additive: int = field(repr=False)

    @property
    def response(self) -> Array:
        """Share of each trial, %."""
        return _PERCENT * self.counts / self.totals

    @property
    def values(self) -> dict[str, float]:
        """Coefficient values by term."""
        return {term: coefficient.value for term, coefficient in self.coefficients.items()}

    @property
    def is_lower_bound(self) -> bool:
        """True if the intervals are only lower bounds of the true ones: no repeated runs give the dispersion."""
        return not self.dispersion.is_known

    @property
    def at_bound(self) -> int:
        """Number of trials whose fitted share is so close to 0 or 100 % that its variance is only assumed."""
        low, high = share_bounds(self.totals, self.link)
        fitted = self.predict(self.coded) / _PERCENT
        return int(np.count_nonzero((fitted < low) | (fitted > high)))

    @property
    def interval_name(self) -> str:
        """Name of the 95 % intervals for a report."""
        return "lower bound of the 95 % interval" if self.is_lower_bound else "95 % interval"

    def row(self, source: str) -> AnovaRow:
        """Return a row of the analysis of variance.

        Raises:
            StudyError: There is no such row.
        """
        return find_row(self.anova, source)

    def joint_row(self, source: str, terms: Sequence[str]) -> AnovaRow:
        """Return the row of several terms together, tested with the weights of the model without them (`nested_f`).

        The sum of squares is relative to the pure error of this fit, so that F is the ratio of the mean squares.
        """
        error, degrees, names = self.dispersion.estimate or 0.0, self.dispersion.degrees, list(self.coefficients)
        if self.is_lower_bound:
            return joint_row(source, terms, names, self._results, error=error, error_df=degrees)
        matrix, pure = self._matrix(self.coded), pure_matrix(self.coded, self._additive)
        without = np.delete(matrix, [names.index(term) for term in terms], axis=1)
        f = float(nested_f(without, matrix, pure, self.counts / self.totals, self.totals, link=self.link))
        return tested_row(source, f * len(terms) * error, len(terms), error, degrees)

    def p_value(self, source: str) -> float:
        """Return the P value of a row of the analysis of variance.

        Raises:
            StudyError: There is no such row, or there are no degrees of freedom for the error.
        """
        p = self.row(source).p
        if p is None:
            raise StudyError(
                f"P value of {source}: no repeated trials that differ, so there is no error to test against; "
                "repeat trials at one point at least"
            )
        return p

    def lack_of_fit_with_least_dispersion(self) -> tuple[float, float] | None:
        """Return F and P of the lack of fit with a dispersion of at least 1; None if there is no such test."""
        row = next((row for row in self.anova if row.source == "lack of fit"), None)
        if row is None or row.mean_square is None or self.is_lower_bound:
            return None
        f = row.mean_square / self.dispersion.value
        return f, float(stats.f.sf(f, row.degrees, self.dispersion.degrees))

    def predict(self, coded: Array) -> Array:
        """Return the fitted share at coded points, %; a single point gives an array with one element."""
        return self._share(self._matrix(coded) @ self._results.params)

    def mean_interval(self, coded: Array, confidence: float = 0.95) -> tuple[Array, Array]:
        """Return the confidence interval of the share at coded points, %: a lower bound if `is_lower_bound`.

        Args:
            coded: Points, one per row, or a single point.
            confidence: Confidence, above 0 and below 1.
        """
        matrix = self._matrix(coded)
        eta, half = matrix @ self._results.params, self._quantile(confidence) * np.sqrt(self._variance(matrix))
        return self._share(eta - half), self._share(eta + half)

    def prediction_interval(
        self, coded: Array, confidence: float = 0.95, *, seedlings: float | None = None
    ) -> tuple[Array, Array]:
        """Return the prediction interval of the share in one further trial, %, limited to 0 to 100.

        Args:
            coded: Points, one per row, or a single point.
            confidence: Probability that the share is in the interval, above 0 and below 1.
            seedlings: Seedlings of the further trial; None for the mean of the trials of the fit.
        """
        matrix = self._matrix(coded)
        each = float(self.totals.mean()) if seedlings is None else seedlings
        share = np.clip(self.predict(coded) / _PERCENT, *share_bounds(np.array(each), self.link))
        slope = 1.0 if self.link == "identity" else (share * (1 - share)) ** 2
        scale = 1.0 if self.link == "identity" else _PERCENT**2
        trial = _PERCENT**2 * self._scale * share * (1 - share) / each
        half = self._quantile(confidence) * np.sqrt(scale * slope * self._variance(matrix) + trial)
        middle = self.predict(coded)
        return np.clip(middle - half, 0, _PERCENT), np.clip(middle + half, 0, _PERCENT)

    def coefficient_interval(self, term: str, confidence: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of a coefficient: a lower bound if `is_lower_bound`."""
        each = self.coefficients[term]
        half = self._quantile(confidence) * each.standard_error
        return each.value - half, each.value + half

    def drawn(self, number: int, *, seed: int) -> Array:
        """Return coefficients drawn from Student's t (normal without a known dispersion), one draw per row.

        Args:
            number: Number of draws.
            seed: Seed of the draws.
        """
        spread = self._scale * self._results.normalized_cov_params
        distribution = stats.multivariate_t(
            self._results.params, spread, df=self._degrees, allow_singular=True, seed=seed
        )
        return np.asarray(distribution.rvs(size=number), dtype=np.float64)

    @property
    def studentized(self) -> Array:
        """Residual of each trial divided by its standard deviation, internally studentized."""
        white, leverage = self._results.wresid, self._leverage
        return np.asarray(white / np.sqrt(self._scale * np.maximum(1 - leverage, 1e-12)), dtype=np.float64)

    @property
    def adequate_precision(self) -> float:
        """Range of the fitted linear predictor divided by its mean standard error; above 4 the model can be used."""
        matrix = self._results.model.exog
        return float(np.ptp(matrix @ self._results.params) / math.sqrt(self._variance(matrix).mean()))

    @property
    def predicted_r2(self) -> float | None:
        """Coefficient of determination of trials predicted without them (PRESS); None if one cannot be left out."""
        return self._predicted_r2(np.arange(len(self.coded)))

    @property
    def predicted_r2_by_point(self) -> float | None:
        """The same with all trials of a point left out together; None if a point cannot be left out."""
        return self._predicted_r2(point_numbers(self.coded))

    def _predicted_r2(self, groups: NDArray[np.intp]) -> float | None:
        white, residual = self._results.model.wexog, self._results.wresid
        hat = white @ self._results.normalized_cov_params @ white.T
        press = 0.0
        for group in range(int(groups.max()) + 1):
            members = np.flatnonzero(groups == group)
            own = hat[np.ix_(members, members)]
            if float(np.linalg.eigvalsh(own)[-1]) > _LARGEST_LEVERAGE:
                return None
            press += float(np.sum(np.linalg.solve(np.eye(len(members)) - own, residual[members]) ** 2))
        return 1 - press / float(self._results.centered_tss)

    @property
    def misfit(self) -> tuple[float, float]:
        """Root mean square of the means of the points minus the fit, and its value by the error alone, points of %."""
        groups = point_numbers(self.coded)
        total = np.asarray(np.bincount(groups, self.totals), dtype=np.float64)
        leverage = np.bincount(groups, self._leverage)
        means = _PERCENT * np.bincount(groups, self.counts) / total
        _, first = np.unique(groups, return_index=True)
        fitted = self.predict(self.coded[first])
        share = np.clip(fitted / _PERCENT, *share_bounds(total, self.link))
        error = self._scale * _PERCENT**2 * share * (1 - share) / total * np.maximum(1 - leverage, 0)
        return float(np.sqrt(np.mean((means - fitted) ** 2))), float(np.sqrt(error.mean()))

    @property
    def _leverage(self) -> Array:
        white = self._results.model.wexog
        return np.asarray(np.einsum("ij,jk,ik->i", white, self._results.normalized_cov_params, white))

    @property
    def _scale(self) -> float:
        """Multiple of the binomial variance in the standard errors."""
        estimate = self.dispersion.estimate
        return 1.0 if self.is_lower_bound or estimate is None else estimate

    @property
    def _degrees(self) -> float:
        return math.inf if self.is_lower_bound else self.dispersion.degrees

    def _quantile(self, confidence: float) -> float:
        if not 0 < confidence < 1:
            raise StudyError(f"confidence {confidence:g}: must be between 0 and 1, for example 0.95")
        return float(stats.t.ppf((1 + confidence) / 2, self._degrees))

    def _matrix(self, coded: Array) -> Array:
        return model_matrix(np.atleast_2d(np.asarray(coded, dtype=np.float64)), list(self.coefficients))

    def _variance(self, matrix: Array) -> Array:
        """Return the variance of the linear predictor in rows of a model matrix."""
        covariance = self._scale * self._results.normalized_cov_params
        return np.asarray(np.einsum("ij,jk,ik->i", matrix, covariance, matrix))

    def _share(self, eta: Array) -> Array:
        return np.asarray(eta if self.link == "identity" else _PERCENT * special.expit(eta), dtype=np.float64)


Model = Fit | WeightedFit
"""Fitted polynomial of measured values or of counts."""


def weighted_fit(
    coded: Array,
    counts: Array,
    totals: Array,
    terms: Sequence[str],
    link: Link = "identity",
    *,
    additive: int = 0,
) -> WeightedFit:
    """Fit a polynomial to the counts of trials.

    Args:
        coded: Coded trials, one per row; repeated rows are repeated trials and give the pure error.
        counts: Counted seedlings of each trial; a printed share times its total need not be a whole number.
        totals: Seedlings of each trial.
        terms: Names of the terms, excluding the constant; at least one.
        link: ``identity`` if the share itself is the polynomial, as in the papers; ``logit`` for its logit.
        additive: Number of factors at the end, such as blocks, that do not interact with the others; trials that
            differ in them only are repeated trials.

    Raises:
        StudyError: The trials do not allow the fit; a count is not between 0 and its total; the iteration diverges.
    """
    coded = np.asarray(coded, dtype=np.float64)
    counts, totals = np.asarray(counts, dtype=np.float64), np.asarray(totals, dtype=np.float64)
    _check_counts(counts, totals)
    names = [CONSTANT, *terms]
    check_runs(coded, counts / totals, names)
    matrix = model_matrix(coded, names)
    check_separable(matrix, names)
    _, response, weights, has_converged = irls(matrix, counts / totals, totals, link)
    if not has_converged.all():
        raise StudyError(
            f"weighted fit: no convergence after {MOST_STEPS} steps with the {link} link; remove terms or use the "
            f"{'logit' if link == 'identity' else 'identity'} link"
        )
    scale = _PERCENT if link == "identity" else 1.0
    results = WLS(scale * response, matrix, weights=weights / scale**2).fit()
    groups = point_numbers(coded)
    residual, pure = (
        float(each) if each > _ROUNDING * results.uncentered_tss else 0.0
        for each in split_residual(matrix, response, weights, groups)
    )
    pure_df = len(coded) - int(groups.max()) - 1
    if additive:
        pure, pure_df = pure_error(coded, response, weights, additive)
    dispersion = Dispersion(pure / pure_df if pure_df else None, pure_df)
    return WeightedFit(
        coded=coded,
        counts=counts,
        totals=totals,
        link=link,
        coefficients=_coefficients(names, results, dispersion),
        anova=_anova(names, results, residual, dispersion),
        dispersion=dispersion,
        r2=float(results.rsquared),
        adjusted_r2=float(results.rsquared_adj),
        _results=results,
        _additive=additive,
    )


def _check_counts(counts: Array, totals: Array) -> None:
    """Check that every count is a part of its total."""
    if counts.shape != totals.shape or counts.ndim != 1:
        raise StudyError(f"weighted fit: {counts.size} counts but {totals.size} totals; specify one pair per trial")
    wrong = np.flatnonzero(~(np.isfinite(totals) & (totals >= 1) & (counts >= 0) & (counts <= totals)))
    if len(wrong):
        number = int(wrong[0])
        raise StudyError(
            f"weighted fit: trial {number + 1} counts {counts[number]:g} of {totals[number]:g} seedlings; a count "
            "must be 0 to its total, and a total at least 1"
        )


def _coefficients(names: Sequence[str], results: Any, dispersion: Dispersion) -> dict[str, Coefficient]:
    scale = dispersion.estimate if dispersion.is_known and dispersion.estimate is not None else 1.0
    errors = np.sqrt(scale * np.diag(results.normalized_cov_params))
    found = {}
    for name, value, error in zip(names, results.params, errors, strict=True):
        t = float(value / error) if dispersion.is_known else None
        p = None if t is None else float(2 * stats.t.sf(abs(t), dispersion.degrees))
        found[name] = Coefficient(float(value), float(error), t, p)
    return found


def _anova(names: Sequence[str], results: Any, residual: float, dispersion: Dispersion) -> tuple[AnovaRow, ...]:
    """Return the rows of the analysis of variance; every F is relative to the pure error."""
    error, pure_df = dispersion.estimate or 0.0, dispersion.degrees
    model_df, residual_df = round(results.df_model), round(results.df_resid)
    rows = [tested_row("model", float(results.ess), model_df, error, pure_df)]
    # partial, one degree of freedom: increase of the residual if only this term is removed
    increases = results.params**2 / np.diag(results.normalized_cov_params)
    rows += [
        tested_row(name, float(increase), 1, error, pure_df)
        for name, increase in zip(names, increases, strict=True)
        if name != CONSTANT
    ]
    rows.append(AnovaRow("residual", residual, residual_df, residual / residual_df))
    if pure_df:
        pure = error * pure_df
        if lack_df := residual_df - pure_df:
            rows.append(tested_row("lack of fit", max(0.0, residual - pure), lack_df, error, pure_df))
        rows.append(AnovaRow("pure error", pure, pure_df, error))
    return (*rows, AnovaRow("total", float(results.centered_tss), model_df + residual_df))
