"""Power of a comparison of two shares and of the tests of a design, before anything runs.

Shares are fractions, 0 to 1. A trial is one count of m seedlings whose losses are correlated by rho, which multiplies
the binomial variance of its share by the design effect 1 + (m - 1) rho.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from plant_sim.common.polynomial import CONSTANT, model_matrix
from plant_sim.study.doe.block_columns import block_columns
from plant_sim.study.doe.regression import pure_error
from plant_sim.study.doe.standard_designs import RunPlan
from plant_sim.study.errors import StudyError

SIGNIFICANCE = 0.05
"""Level of the two-sided tests."""
_MOST_TRIALS = 100_000
_ROUNDING = 1e-12
"""Fraction of a sum of squares below which it is rounding error."""


@dataclass(frozen=True, slots=True)
class ShareComparison:
    """ShareComparison of two shares.

    Attributes:
        first: First share.
        second: Second share.
        seedlings: Seedlings per trial.
        correlation: Correlation of the losses of two seedlings of one trial, 0 to 1.

    Raises:
        StudyError: A share is not between 0 and 1, or both are equal.
    """

    first: float
    second: float
    seedlings: int
    correlation: float = 0.0

    def __post_init__(self) -> None:
        """Check the shares."""
        if not (0 < self.first < 1 and 0 < self.second < 1):
            raise StudyError(f"shares {self.first:.4g} and {self.second:.4g}: must be above 0 and below 1")
        if self.first == self.second:
            raise StudyError(f"shares {self.first:.4g} and {self.second:.4g}: are equal; a difference of 0 has no test")

    @property
    def design_effect(self) -> float:
        """Ratio of the variance of a share to that of independent seedlings."""
        return design_effect(self.seedlings, self.correlation)

    def trials_by_count(self, power: float) -> int:
        """Return the trials of each side if the pooled counts are compared with a known design effect.

        Normal approximation: the limit of the test takes the variance of the mean share, the power that of the two.

        Args:
            power: Probability that the difference is detected, above 0 and below 1.

        >>> ShareComparison(0.93, 0.95, 144).trials_by_count(0.8)
        16
        """
        mean = (self.first + self.second) / 2
        under_equality = stats.norm.isf(SIGNIFICANCE / 2) * math.sqrt(2 * mean * (1 - mean))
        under_difference = stats.norm.ppf(power) * math.sqrt(2 * self._mean_variance)
        independent = float((under_equality + under_difference) / (self.first - self.second)) ** 2
        return math.ceil(independent * self.design_effect / self.seedlings)

    def trials_by_trial(self, power: float) -> int:
        """Return the trials of each side if the shares of the trials are compared with Student's t test.

        The test estimates the scatter between trials instead of assuming it, and so needs a few more trials.

        Args:
            power: Probability that the difference is detected, above 0 and below 1.

        Raises:
            StudyError: More trials are necessary than a study can have.
        """
        low, high = 1, 2
        while self.power_by_trial(high) < power:
            low, high = high, 2 * high
            if high > _MOST_TRIALS:
                raise StudyError(
                    f"shares {self.first:.4g} and {self.second:.4g}: more than {_MOST_TRIALS} trials of each side are "
                    "necessary; plan for a greater difference"
                )
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.power_by_trial(middle) >= power else (middle, high)
        return high

    def power_by_trial(self, trials: int) -> float:
        """Return the power of Student's t test between the shares of the trials.

        Args:
            trials: Trials of each side, at least 2.
        """
        degrees = 2 * trials - 2
        variance = 2 * self._mean_variance * self.design_effect / (self.seedlings * trials)
        return f_power((self.first - self.second) ** 2 / variance, 1, degrees)

    @property
    def _mean_variance(self) -> float:
        """Mean binomial variance of one seedling."""
        return (self.first * (1 - self.first) + self.second * (1 - self.second)) / 2


def design_effect(seedlings: int, correlation: float) -> float:
    """Return the ratio of the variance of the share of a trial to that of independent seedlings.

    >>> round(design_effect(144, 0.01), 2)
    2.43
    """
    return 1 + (seedlings - 1) * correlation


def share_sd(share: float, seedlings: int, correlation: float) -> float:
    """Return the standard deviation of the share of one trial.

    >>> round(share_sd(0.946, 144, 0.0), 4)
    0.0188
    """
    return math.sqrt(share * (1 - share) / seedlings * design_effect(seedlings, correlation))


def f_power(noncentrality: float, degrees: int, error_degrees: int) -> float:
    """Return the power of an F test at the level `SIGNIFICANCE`.

    Args:
        noncentrality: Sum of squares of the effect without error, divided by the variance of the error.
        degrees: Degrees of freedom of the effect.
        error_degrees: Degrees of freedom of the error.
    """
    if noncentrality == 0:
        return SIGNIFICANCE  # for which the distribution of scipy is not defined
    limit = stats.f.isf(SIGNIFICANCE, degrees, error_degrees)
    return float(stats.ncf.sf(limit, degrees, error_degrees, noncentrality))


@dataclass(frozen=True, slots=True)
class ErrorDegrees:
    """Degrees of freedom of the error of a design with its model.

    Attributes:
        residual: Degrees of freedom of the residual.
        pure: Degrees of freedom of the pure error: runs repeated at one point, less those that the blocks take.
    """

    residual: int
    pure: int


def error_degrees(plan: RunPlan, terms: Sequence[str]) -> ErrorDegrees:
    """Return the degrees of freedom of the error.

    Args:
        plan: Runs of the design and their blocks.
        terms: Terms of the model, excluding the constant.

    Raises:
        StudyError: The design cannot separate the terms, or leaves no degrees of freedom for the error.
    """
    matrix = _matrix(plan, terms)
    if np.linalg.matrix_rank(matrix) < matrix.shape[1]:
        raise StudyError("power: the design cannot separate the terms of the model; use more levels or a simpler model")
    residual = len(matrix) - matrix.shape[1]
    if residual < 1:
        raise StudyError(
            f"power: {len(matrix)} runs for {matrix.shape[1]} coefficients leave no error; add replicates or centres"
        )
    blocks = block_columns(plan.blocks.tolist())
    unit = np.ones(len(matrix))
    _, pure = pure_error(np.hstack([plan.coded, blocks]), unit, unit, blocks.shape[1])
    return ErrorDegrees(residual, pure)


def effect_powers(
    plan: RunPlan, terms: Sequence[str], *, coefficient: float, sd: float, degrees: int
) -> dict[str, float]:
    """Return the power of the test of every term of a model, each against a coefficient of the same size.

    Args:
        plan: Runs of the design and their blocks.
        terms: Terms of the model, excluding the constant, which the design separates.
        coefficient: True coefficient of the term, in units of the response.
        sd: Standard deviation of one run, in units of the response.
        degrees: Degrees of freedom of the error of the test.
    """
    matrix = _matrix(plan, terms)
    variances = np.diag(np.linalg.inv(matrix.T @ matrix))[1 : len(terms) + 1] * sd**2
    return {name: f_power(coefficient**2 / float(v), 1, degrees) for name, v in zip(terms, variances, strict=True)}


def _matrix(plan: RunPlan, terms: Sequence[str]) -> NDArray[np.float64]:
    """Return the model matrix with the columns of the blocks."""
    return np.hstack([model_matrix(plan.coded, [CONSTANT, *terms]), block_columns(plan.blocks.tolist())])


def missing_power(terms: Sequence[str], factor: int) -> str:
    """Return the lowest power of a factor that a model lacks: its square, or its cube if the model has the square.

    >>> missing_power(["X1", "X1^2"], 1), missing_power(["X1"], 1)
    ('X1^3', 'X1^2')
    """
    return f"X{factor}^{3 if f'X{factor}^2' in terms else 2}"


def lack_of_fit_power(
    plan: RunPlan,
    terms: Sequence[str],
    factor: int,
    *,
    coefficient: float,
    sd: float,
    degrees: ErrorDegrees,
) -> float | None:
    """Return the power of the test of lack of fit against the `missing_power` of a factor.

    Args:
        plan: Runs of the design and their blocks.
        terms: Terms of the model, excluding the constant.
        factor: Number of the factor, from 1.
        coefficient: True coefficient of the missing power, in units of the response.
        sd: Standard deviation of one run, in units of the response.
        degrees: Degrees of freedom of the error, with pure error and lack of fit.

    Returns:
        The power; None if the model takes up the missing power at the points of the design.
    """
    matrix = _matrix(plan, terms)
    exponent = int(missing_power(terms, factor)[-1])
    missing = coefficient * plan.coded[:, factor - 1] ** exponent
    left = missing - matrix @ np.linalg.lstsq(matrix, missing, rcond=None)[0]
    if float(left @ left) <= _ROUNDING * float(missing @ missing):
        return None
    return f_power(float(left @ left) / sd**2, degrees.residual - degrees.pure, degrees.pure)
