"""Power of comparisons and of the tests of a design, against simulations of the same tests."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from plant_sim.common.polynomial import model_matrix
from plant_sim.study.doe.design import central_composite, two_level
from plant_sim.study.doe.power import (
    ShareComparison,
    design_effect,
    effect_powers,
    error_degrees,
    f_power,
    lack_of_fit_power,
    share_sd,
)
from plant_sim.study.doe.regression import terms
from plant_sim.study.doe.standard_designs import RunPlan, blocked_composite, complete_blocks, orthogonal_array
from plant_sim.study.errors import StudyError

EXPERIMENTS = 5_000


def lost(share: float, trials: int, correlation: float, seed: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return counts of trials of 144 seedlings, experiments x trials, correlated as a beta-binomial distribution."""
    rng = np.random.default_rng(seed)
    if correlation == 0:
        return rng.binomial(144, share, (EXPERIMENTS, trials)).astype(float)
    total = 1 / correlation - 1
    return rng.binomial(144, rng.beta(share * total, (1 - share) * total, (EXPERIMENTS, trials))).astype(float)


def test_sixteen_trials_of_independent_seedlings_tell_93_from_95_percent() -> None:
    """By hand: (1.95996 sqrt(2 x 0.94 x 0.06) + 0.84162 sqrt(0.0651 + 0.0475))^2 / 0.02^2 = 2212; / 144 = 15.4."""
    assert 1.95996 * np.sqrt(0.1128) + 0.84162 * np.sqrt(0.1126) == pytest.approx(np.sqrt(2212.2 * 0.0004), rel=1e-4)
    assert ShareComparison(0.93, 0.95, 144).trials_by_count(0.8) == 16
    assert ShareComparison(0.95, 0.93, 144).trials_by_count(0.8) == 16
    assert ShareComparison(0.93, 0.95, 144).trials_by_trial(0.8) == 17
    assert ShareComparison(0.93, 0.95, 144, 0.01).trials_by_count(0.8) == 38  # 15.36 x 2.43 = 37.3
    assert ShareComparison(0.93, 0.95, 144, 0.03).trials_by_count(0.8) == 82  # 15.36 x 5.29 = 81.3


@pytest.mark.parametrize("correlation", [0.0, 0.03])
def test_the_planned_trials_have_the_power(correlation: float) -> None:
    """Simulated counts; both tests reject equality in the planned share of experiments, with the planned trials."""
    comparison = ShareComparison(0.93, 0.95, 144, correlation)
    trials = comparison.trials_by_count(0.8)
    first, second = (lost(1 - share, trials, correlation, seed) for seed, share in enumerate((0.93, 0.95)))
    shares = first.sum(axis=1) / 144 / trials, second.sum(axis=1) / 144 / trials
    mean = (shares[0] + shares[1]) / 2
    error = np.sqrt(2 * mean * (1 - mean) / 144 / trials * comparison.design_effect)
    power = np.mean(np.abs(shares[0] - shares[1]) > 1.95996 * error)
    exact = (comparison.first - comparison.second) ** 2 * 144 * trials / comparison.design_effect
    expected = stats.norm.sf(1.95996 * np.sqrt(0.1128 / 0.1126) - np.sqrt(exact / 0.1126))
    assert expected >= 0.8
    assert power == pytest.approx(expected, abs=0.025)  # four standard errors
    trials = comparison.trials_by_trial(0.8)
    first, second = (lost(1 - share, trials, correlation, seed) for seed, share in enumerate((0.93, 0.95)))
    power = np.mean(stats.ttest_ind(first, second, axis=1).pvalue < 0.05)
    assert power == pytest.approx(comparison.power_by_trial(trials), abs=0.025)
    assert comparison.power_by_trial(trials - 1) < 0.8 <= comparison.power_by_trial(trials)


def test_equal_shares_are_told_apart_in_a_twentieth_of_experiments() -> None:
    assert f_power(0.0, 1, 6) == pytest.approx(0.05)


def test_the_scatter_of_a_trial() -> None:
    counts = lost(0.06, 4, 0.03, seed=3)
    assert counts.std() / 144 == pytest.approx(share_sd(0.94, 144, 0.03), rel=0.02)
    assert design_effect(1, 0.5) == 1


def test_the_power_of_a_design_is_that_of_its_regression() -> None:
    """A coefficient of X1 of 1.2, SD 1: share of simulated regressions in which its P value is below 5 %."""
    plan = complete_blocks(central_composite(2, axial=1.4, centres=3), 1)
    names = terms(2, "quadratic")
    degrees = error_degrees(plan, names)
    assert (degrees.residual, degrees.pure) == (5, 2)
    expected = effect_powers(plan, names, coefficient=1.2, sd=1.0, degrees=degrees.residual)["X1"]
    half = effect_powers(plan, names, coefficient=0.6, sd=0.5, degrees=degrees.residual)
    assert half["X1"] == pytest.approx(expected)
    matrix = model_matrix(plan.coded, ["1", *names])
    response = 1.2 * plan.coded[:, :1] + np.random.default_rng(1).normal(size=(len(matrix), EXPERIMENTS))
    coefficients = np.linalg.pinv(matrix) @ response
    variance = ((response - matrix @ coefficients) ** 2).sum(axis=0) / 5 * np.linalg.inv(matrix.T @ matrix)[1, 1]
    power = np.mean(np.abs(coefficients[1]) / np.sqrt(variance) > 2.5706)  # Student's t, 5 degrees of freedom
    assert 0.3 < expected < 0.9
    assert power == pytest.approx(expected, abs=0.028)  # four standard errors


def test_the_power_of_lack_of_fit_is_that_of_its_test() -> None:
    """A cube of X1 with coefficient 2, axial level 1.525: share of simulated regressions with a P value below 5 %."""
    plan = complete_blocks(central_composite(2, axial=1.525, centres=5), 1)
    names = terms(2, "quadratic")
    degrees = error_degrees(plan, names)
    expected = lack_of_fit_power(plan, names, 1, coefficient=2.0, sd=1.0, degrees=degrees)
    assert expected is not None
    matrix = model_matrix(plan.coded, ["1", *names])
    response = 2 * plan.coded[:, :1] ** 3 + np.random.default_rng(2).normal(size=(len(matrix), EXPERIMENTS))
    residual = ((response - matrix @ (np.linalg.pinv(matrix) @ response)) ** 2).sum(axis=0)
    pure = ((response[-5:] - response[-5:].mean(axis=0)) ** 2).sum(axis=0)
    power = np.mean((residual - pure) / 3 / (pure / 4) > 6.5914)  # F, 3 and 4 degrees of freedom
    assert (degrees.residual, degrees.pure) == (7, 4)
    assert 0.3 < expected < 0.95
    assert power == pytest.approx(expected, abs=0.028)  # four standard errors


def test_a_cube_is_not_visible_at_three_levels() -> None:
    """At -1, 0 and 1 the cube of a factor equals the factor."""
    plan = complete_blocks(orthogonal_array("L9", 2), 2)
    names = (*terms(2, "quadratic"),)
    degrees = error_degrees(plan, names)
    assert lack_of_fit_power(plan, names, 1, coefficient=9.0, sd=1.0, degrees=degrees) is None


def test_blocks_take_degrees_of_freedom() -> None:
    plan = blocked_composite(3, axial=1.525, centres=9, blocks=3)
    degrees = error_degrees(plan, terms(3, "quadratic"))
    assert degrees.residual == 23 - 10 - 2
    assert degrees.pure == 23 - 15 - 2
    replicated = complete_blocks(two_level(2), 3)
    assert error_degrees(replicated, terms(2, "interactions")).pure == 12 - 4 - 2


def test_impossible_plans_are_rejected() -> None:
    for first, second in ((0.0, 0.5), (0.5, 1.0)):
        with pytest.raises(StudyError, match="above 0 and below 1"):
            ShareComparison(first, second, 144)
    with pytest.raises(StudyError, match="are equal"):
        ShareComparison(0.9, 0.9, 144)
    with pytest.raises(StudyError, match="more than 100000 trials"):
        ShareComparison(0.5, 0.500001, 1).trials_by_trial(0.8)
    with pytest.raises(StudyError, match="leave no error"):
        error_degrees(complete_blocks(two_level(2), 1), terms(2, "interactions"))
    with pytest.raises(StudyError, match="cannot separate"):
        error_degrees(complete_blocks(two_level(2), 4), terms(2, "quadratic"))
    assert isinstance(complete_blocks(two_level(2), 1), RunPlan)
