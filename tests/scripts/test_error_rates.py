"""Simulated error rates of the weighted fit: false alarms, power, coverage; and the simulation itself."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import optimize, stats

from plant_sim.common.polynomial import Polynomial, model_matrix
from scripts.error_rates import (
    CODED,
    CORRELATIONS,
    DEPARTURE_POINTS,
    DEPARTURE_SEEDLINGS,
    EQUATION_5,
    LACK_DF,
    NAMES,
    PURE_DF,
    SEEDLINGS,
    TRAY,
    best_of_quadratics,
    coverage,
    lack_of_fit,
    simulated,
    table,
    truth,
)

NIGHTLY_DESIGNS = 4000
FEW_DESIGNS = 1000
CELLS = list(itertools.product(SEEDLINGS, CORRELATIONS))


def band(designs: int, low: float, high: float) -> tuple[float, float]:
    """Return a range that a sample leaves once in 10,000 times if the true fraction is between two bounds."""
    return (
        float(stats.binom.ppf(1e-4, designs, low) / designs),
        float(stats.binom.ppf(1 - 1e-4, designs, high) / designs),
    )


def false_alarms(seedlings: int, correlation: float, designs: int) -> float:
    rng = np.random.default_rng((11, seedlings, round(1000 * correlation)))
    return lack_of_fit(simulated(truth(), seedlings, correlation, designs, rng), seedlings).weighted


def test_the_degrees_of_freedom_are_those_of_table_5() -> None:
    assert (LACK_DF, PURE_DF) == (5, 5)


@pytest.mark.parametrize("correlation", CORRELATIONS)
def test_the_scatter_of_a_trial_is_that_of_correlated_seedlings(correlation: float) -> None:
    """The variance is the binomial one times 1 + 71 rho; 4,000 trials know it to 2.2 % (one standard error)."""
    shares = np.full(1, 0.85)
    drawn = simulated(shares, 144, correlation, 4000, np.random.default_rng(5))[:, 0]
    assert drawn.mean() == pytest.approx(0.85, abs=0.003)
    wanted = 0.85 * 0.15 / 144 * (1 + (TRAY - 1) * correlation)
    assert drawn.var() == pytest.approx(wanted, rel=0.1)


@pytest.mark.parametrize(("seedlings", "correlation"), [(144, 0.0), (144, 0.03), (720, 0.01)])
def test_a_true_model_is_rejected_about_as_often_as_stated(seedlings: int, correlation: float) -> None:
    low, high = band(FEW_DESIGNS, 0.035, 0.07)
    assert low <= false_alarms(seedlings, correlation, FEW_DESIGNS) <= high


@pytest.mark.nightly
@pytest.mark.parametrize(("seedlings", "correlation"), CELLS)
def test_a_true_model_is_rejected_in_3_5_to_7_percent(seedlings: int, correlation: float) -> None:
    assert 0.035 <= false_alarms(seedlings, correlation, NIGHTLY_DESIGNS) <= 0.07


def test_the_binomial_test_rejects_a_true_model_if_seedlings_are_correlated() -> None:
    """The likelihood ratio is 1 + 71 rho times too large: it exceeds its limit in P(χ²(5) > 11.07 / 3.13) = 62 %."""
    found = lack_of_fit(simulated(truth(), 720, 0.03, FEW_DESIGNS, np.random.default_rng(7)), 720)
    expected = stats.chi2.sf(stats.chi2.isf(0.05, 5) / (1 + (TRAY - 1) * 0.03), 5)
    assert found.binomial == pytest.approx(expected, abs=0.06)
    assert found.floored <= found.weighted


def test_a_cubic_departure_is_found() -> None:
    """Of 3 points times X3³, at 1,440 seedlings per run and without correlation."""
    rng = np.random.default_rng(8)
    observed = simulated(truth(DEPARTURE_POINTS), DEPARTURE_SEEDLINGS, 0.0, FEW_DESIGNS, rng)
    assert lack_of_fit(observed, DEPARTURE_SEEDLINGS).weighted >= 0.80


@pytest.mark.nightly
@pytest.mark.parametrize(("seedlings", "correlation"), CELLS)
def test_intervals_contain_the_truth_in_93_to_97_percent(seedlings: int, correlation: float) -> None:
    rng = np.random.default_rng((12, seedlings, round(1000 * correlation)))
    found = coverage(simulated(truth(), seedlings, correlation, NIGHTLY_DESIGNS, rng), seedlings, rng)
    for name, share in {**found.coefficients, "optimum": found.optimum}.items():
        assert 0.93 <= share <= 0.97, name
    low, high = band(2000, 0.93, 0.97)
    for share in found.place:
        assert low <= share <= high


def test_intervals_contain_the_truth_about_as_often_as_stated() -> None:
    rng = np.random.default_rng(9)
    found = coverage(simulated(truth(), 144, 0.01, FEW_DESIGNS, rng), 144, rng, located=100)
    low, high = band(FEW_DESIGNS, 0.93, 0.97)
    for name, share in {**found.coefficients, "optimum": found.optimum}.items():
        assert low <= share <= high, name


def test_the_best_of_a_quadratic_in_the_box_is_that_of_a_search() -> None:
    """Also at an edge or a corner, and for a saddle."""
    coefficients = np.random.default_rng(3).normal(size=(5, len(NAMES))) * [1, 1, 1, 1, 1, 1, 1, 2, 2, 2]
    coefficients[0] = [EQUATION_5.coefficients[name] for name in NAMES]
    for row, found in zip(coefficients, best_of_quadratics(coefficients), strict=True):
        surface = Polynomial(dict(zip(NAMES, row.tolist(), strict=True)))
        starts = itertools.product((-1.0, 0.0, 1.0), repeat=3)
        searched = min(
            optimize.minimize(lambda x, s=surface: -float(s.predict(x)[0]), start, bounds=[(-1, 1)] * 3).fun
            for start in starts
        )
        assert float(surface.predict(found)[0]) == pytest.approx(-searched, abs=1e-5)


def test_the_cubic_departure_leaves_shares_possible_and_is_not_a_quadratic() -> None:
    shares = truth(DEPARTURE_POINTS)
    assert (shares > 0).all()
    assert (shares < 1).all()
    matrix = model_matrix(CODED, NAMES)
    off = shares - matrix @ np.linalg.lstsq(matrix, shares)[0]
    assert np.abs(off).max() > 0.01


def test_a_table_is_markdown() -> None:
    assert table(("a", "b"), [("1", "2")]) == "| a | b |\n| --- | --- |\n| 1 | 2 |"
