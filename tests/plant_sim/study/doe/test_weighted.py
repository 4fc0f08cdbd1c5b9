"""Weighted fit of counts: agreement with statsmodels, error from repeated trials, refusals, left-out runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.typing import NDArray
from scipy import special, stats

from plant_sim.common.polynomial import Polynomial, model_matrix
from plant_sim.study.doe.design import central_composite
from plant_sim.study.doe.dispersion import Dispersion
from plant_sim.study.doe.irls import Link
from plant_sim.study.doe.regression import point_numbers, terms
from plant_sim.study.doe.weighted import WeightedFit, weighted_fit
from plant_sim.study.errors import StudyError

Array = NDArray[np.float64]

NAMES = terms(2, "quadratic")
ALL_NAMES = ["1", *NAMES]
DESIGN = central_composite(2, axial=1.4, centres=5)
TRUE = Polynomial({"1": 85.0, "X1": 4.0, "X2": -3.0, "X1 X2": 2.0, "X1^2": -3.0, "X2^2": -2.0})
TOTALS = np.array([144.0, 288.0] * 6 + [144.0])


def drawn(seed: int = 1) -> Array:
    """Return binomial counts of the design."""
    return np.random.default_rng(seed).binomial(TOTALS.astype(int), TRUE.predict(DESIGN) / 100).astype(np.float64)


def fitted(link: Link = "identity", seed: int = 1) -> WeightedFit:
    return weighted_fit(DESIGN, drawn(seed), TOTALS, NAMES, link)


@pytest.mark.parametrize("link", ["identity", "logit"])
@pytest.mark.filterwarnings("ignore:The Identity link function does not respect the domain")
def test_estimates_are_those_of_the_generalized_linear_model(link: Link) -> None:
    """No share is near 0 or 1, so bounds have no effect: coefficients, errors and χ² are those of statsmodels."""
    counts, found = drawn(), fitted(link)
    family = sm.families.Binomial({"identity": sm.families.links.Identity, "logit": sm.families.links.Logit}[link]())
    start = [0.8, *[0.0] * 5] if link == "identity" else None
    data = np.column_stack([counts, TOTALS - counts])
    model = sm.GLM(data, model_matrix(DESIGN, ALL_NAMES), family=family).fit(start_params=start, tol=1e-12, maxiter=200)
    scale = 100 if link == "identity" else 1
    assert list(found.values.values()) == pytest.approx(scale * model.params, rel=1e-6)
    assert found.row("residual").sum_of_squares == pytest.approx(model.pearson_chi2, rel=1e-6)
    assert found.dispersion.estimate is not None
    errors = [each.standard_error for each in found.coefficients.values()]
    assert errors == pytest.approx(scale * model.bse * found.dispersion.estimate**0.5, rel=1e-6)


@pytest.mark.parametrize("link", ["identity", "logit"])
def test_the_error_is_the_scatter_of_repeated_trials(link: Link) -> None:
    """The five centre runs have one fitted share; their scatter has four degrees of freedom in every F."""
    found = fitted(link)
    counts, totals = drawn()[8:], TOTALS[8:]
    share = float(found.predict(np.zeros(2))[0]) / 100
    mean = counts.sum() / totals.sum()
    pure = float(np.sum(totals * (counts / totals - mean) ** 2)) / (share * (1 - share))
    assert found.row("pure error").sum_of_squares == pytest.approx(pure)
    assert found.dispersion.estimate == pytest.approx(pure / 4)
    assert found.dispersion.degrees == 4
    lack = found.row("lack of fit")
    assert lack.degrees == 3
    assert lack.f == pytest.approx(lack.sum_of_squares / 3 / (pure / 4))
    assert found.p_value("lack of fit") == pytest.approx(stats.f.sf(lack.f, 3, 4))
    x1 = found.coefficients["X1"]
    assert found.row("X1").f == pytest.approx((x1.value / x1.standard_error) ** 2)
    assert found.p_value("X1") == pytest.approx(x1.p) == pytest.approx(2 * stats.t.sf(abs(x1.t or 0), 4))


@pytest.mark.parametrize("link", ["identity", "logit"])
@pytest.mark.filterwarnings("ignore:The Identity link function does not respect the domain")
def test_several_terms_are_tested_with_the_weights_of_the_model_without_them(link: Link) -> None:
    """The score test of statsmodels, relative to the pure error with the same weights."""
    tested = ("X1 X2", "X1^2", "X2^2")
    without = [name for name in ALL_NAMES if name not in tested]
    family = sm.families.Binomial({"identity": sm.families.links.Identity, "logit": sm.families.links.Logit}[link]())
    counts = drawn()
    model = sm.GLM(np.column_stack([counts, TOTALS - counts]), model_matrix(DESIGN, without), family=family)
    start = [0.8, 0.0, 0.0] if link == "identity" else None
    simple = model.fit(start_params=start, tol=1e-12, maxiter=200)
    chi2, _, degrees = model.score_test(simple.params, exog_extra=model_matrix(DESIGN, tested), observed=False)
    assert degrees == 3
    share, mean = float(simple.fittedvalues[-1]), counts[8:].sum() / TOTALS[8:].sum()
    pure = float(np.sum(TOTALS[8:] * (counts[8:] / TOTALS[8:] - mean) ** 2)) / (share * (1 - share))
    found = fitted(link)
    row = found.joint_row("curved", tested)
    assert row.f == pytest.approx(chi2.item() / 3 / (pure / 4), rel=1e-5)
    assert row.f == pytest.approx((row.mean_square or 0) / (found.dispersion.estimate or 0))
    assert row.p == pytest.approx(stats.f.sf(row.f, 3, 4))


def test_the_analysis_of_variance_adds_up() -> None:
    found = fitted()
    for whole, parts in (("total", ("model", "residual")), ("residual", ("lack of fit", "pure error"))):
        rows = [found.row(part) for part in parts]
        assert sum(row.sum_of_squares for row in rows) == pytest.approx(found.row(whole).sum_of_squares)
        assert sum(row.degrees for row in rows) == found.row(whole).degrees


def test_more_seedlings_with_the_same_shares_change_the_dispersion_only() -> None:
    """With the unit the trial, ten times the seedlings per trial with the same scatter give the same tests."""
    found, tenfold = fitted(), weighted_fit(DESIGN, 10 * drawn(), 10 * TOTALS, NAMES)
    assert tenfold.values == pytest.approx(found.values)
    assert tenfold.dispersion.estimate == pytest.approx(10 * (found.dispersion.estimate or 0))
    assert [each.f for each in tenfold.anova] == pytest.approx([each.f for each in found.anova])


def test_the_dispersion_has_a_chi_square_interval_and_is_planned_with_at_least_1() -> None:
    low, high = Dispersion(2.0, 5).interval() or (0.0, 0.0)
    assert (low, high) == pytest.approx((10 / stats.chi2.ppf(0.975, 5), 10 / stats.chi2.ppf(0.025, 5)))
    assert (Dispersion(2.0, 5).value, Dispersion(0.4, 5).value, Dispersion(None, 0).value) == (2.0, 1.0, 1.0)
    assert Dispersion(2.42, 5).correlation(143) == pytest.approx(0.01)
    assert Dispersion(0.4, 5).correlation(144) == 0
    assert Dispersion(None, 0).interval() is None


@pytest.mark.parametrize("kind", ["no repeated trials", "equal trials"])
def test_without_an_error_intervals_are_lower_bounds_and_p_values_are_refused(kind: str) -> None:
    """The binomial variance stands in for the unknown one."""
    counts, kept = 144 * drawn() / TOTALS, slice(None, 9) if kind == "no repeated trials" else slice(None)
    counts[8:] = 120
    found = weighted_fit(DESIGN[kept], counts[kept], np.full(len(counts[kept]), 144.0), NAMES)
    assert found.is_lower_bound
    assert found.interval_name == "lower bound of the 95 % interval"
    assert all(row.p is None for row in found.anova)
    assert all(each.p is None and each.t is None for each in found.coefficients.values())
    with pytest.raises(StudyError, match=r"^P value of X1: no repeated trials that differ, .*; repeat trials"):
        found.p_value("X1")
    low, high = found.mean_interval(np.zeros(2))
    weights = 144 / (found.predict(DESIGN[kept]) / 100 * (1 - found.predict(DESIGN[kept]) / 100))
    matrix = model_matrix(DESIGN[kept], ALL_NAMES)
    variance = np.linalg.inv(matrix.T @ (weights[:, np.newaxis] * matrix))[0, 0]
    assert float(high[0] - low[0]) == pytest.approx(2 * 1.959964 * 100 * variance**0.5, rel=1e-6)
    assert not fitted().is_lower_bound


def test_intervals_use_the_degrees_of_freedom_of_the_repeated_trials() -> None:
    found = fitted()
    error = found.coefficients["1"].standard_error
    low, high = found.mean_interval(np.zeros(2))
    assert float(high[0] - low[0]) / 2 == pytest.approx(stats.t.ppf(0.975, 4) * error)
    assert found.coefficient_interval("1") == pytest.approx((float(low[0]), float(high[0])))
    wide_low, wide_high = found.prediction_interval(np.zeros(2), seedlings=144)
    share = found.values["1"] / 100
    trial = 1e4 * (found.dispersion.estimate or 0) * share * (1 - share) / 144
    half = stats.t.ppf(0.975, 4) * (error**2 + trial) ** 0.5
    assert float(wide_high[0] - wide_low[0]) / 2 == pytest.approx(half)
    spread = found.drawn(20_000, seed=1)
    inside = np.abs(spread[:, 0] - found.values["1"]) <= half * error / (error**2 + trial) ** 0.5
    assert inside.mean() == pytest.approx(0.95, abs=0.006)  # four standard errors of 20,000 draws
    for confidence in (0.0, 1.0):
        with pytest.raises(StudyError, match="must be between 0 and 1"):
            found.mean_interval(np.zeros(2), confidence)


def test_the_prediction_interval_of_a_logit_fit_is_that_of_the_delta_method() -> None:
    found = fitted("logit")
    share = float(special.expit(found.values["1"]))
    error = found.coefficients["1"].standard_error
    trial = (found.dispersion.estimate or 0) * share * (1 - share) / 144
    half = 100 * stats.t.ppf(0.975, 4) * ((share * (1 - share) * error) ** 2 + trial) ** 0.5
    low, high = found.prediction_interval(np.zeros(2), seedlings=144)
    assert (float(low[0]), float(high[0])) == pytest.approx((100 * share - half, 100 * share + half))
    ends = found.mean_interval(np.zeros(2))
    wanted = [100 * special.expit(found.values["1"] + sign * stats.t.ppf(0.975, 4) * error) for sign in (-1, 1)]
    assert [float(each[0]) for each in ends] == pytest.approx(wanted)


@pytest.mark.parametrize("link", ["identity", "logit"])
def test_runs_without_failures_keep_finite_estimates(link: Link) -> None:
    """A trial in which no seedling fails has the weight of half a failed seedling, not an unlimited one."""
    counts = np.minimum(drawn() + 30, TOTALS)
    assert (counts == TOTALS).sum() == 5
    found = weighted_fit(DESIGN, counts, TOTALS, NAMES, link)
    assert np.isfinite(list(found.values.values())).all()
    low, high = found.prediction_interval(DESIGN)
    assert (low >= 0).all()
    assert (high <= 100).all()


def test_predicted_r2_is_that_of_fits_without_the_run_or_the_point() -> None:
    """With the weights of the complete fit, which is how PRESS is defined, refits give the same sum."""
    found = fitted()
    share = found.predict(DESIGN) / 100
    weights, response = TOTALS / (share * (1 - share)), drawn() / TOTALS
    matrix, root = model_matrix(DESIGN, ALL_NAMES), np.sqrt(TOTALS / (share * (1 - share)))
    mean = np.average(response, weights=weights)
    for groups, value in (
        (np.arange(len(DESIGN)), found.predicted_r2),
        (point_numbers(DESIGN), found.predicted_r2_by_point),
    ):
        press = 0.0
        for group in range(groups.max() + 1):
            kept = groups != group
            rest, *_ = np.linalg.lstsq(matrix[kept] * root[kept, np.newaxis], response[kept] * root[kept])
            press += float(np.sum(weights[~kept] * (response[~kept] - matrix[~kept] @ rest) ** 2))
        assert value == pytest.approx(1 - press / float(np.sum(weights * (response - mean) ** 2)))
    assert (found.predicted_r2 or 0) < found.adjusted_r2 < found.r2


def test_a_point_that_determines_a_coefficient_alone_cannot_be_left_out() -> None:
    design = np.array([[-1.0], [-1.0], [1.0], [1.0], [0.0]])
    counts = np.array([100.0, 105.0, 120.0, 118.0, 130.0])
    found = weighted_fit(design, counts, np.full(5, 144.0), ("X1", "X1^2"))
    assert found.predicted_r2 is None
    assert found.predicted_r2_by_point is None


def test_adequate_precision_residuals_and_misfit() -> None:
    """The mean variance of the fitted values is that of the hat matrix; the misfit is that of the points."""
    found = fitted()
    share = found.predict(DESIGN) / 100
    weights, matrix = TOTALS / (share * (1 - share)), model_matrix(DESIGN, ALL_NAMES)
    covariance = np.linalg.inv(matrix.T @ (weights[:, np.newaxis] * matrix))
    variance = np.einsum("ij,jk,ik->i", matrix, covariance, matrix)
    scale = found.dispersion.estimate or 0
    assert found.adequate_precision == pytest.approx(np.ptp(share) / np.sqrt(scale * variance.mean()), rel=1e-6)
    residual = (drawn() / TOTALS - share) * np.sqrt(weights)
    assert found.studentized == pytest.approx(residual / np.sqrt(scale * (1 - weights * variance)), rel=1e-6)
    groups = point_numbers(DESIGN)
    total = np.bincount(groups, TOTALS)
    _, first = np.unique(groups, return_index=True)
    off = 100 * (np.bincount(groups, drawn()) / total - share[first])
    own = 1e4 * scale * (share * (1 - share))[first] / total * (1 - np.bincount(groups, weights * variance))
    assert found.misfit == pytest.approx((np.sqrt(np.mean(off**2)), np.sqrt(own.mean())), rel=1e-6)


@pytest.mark.parametrize(
    ("counts", "totals", "complaint"),
    [
        (drawn()[:-1], TOTALS, "12 counts but 13 totals"),
        (drawn() - 500, TOTALS, "trial 1 counts -"),
        (np.append(drawn()[:-1], 145.0), TOTALS, "trial 13 counts 145 of 144 seedlings"),
        (np.append(drawn()[:-1], np.nan), TOTALS, "trial 13 counts nan"),
        (drawn(), np.append(TOTALS[:-1], 0.0), "trial 13 counts"),
        (0.5 * TOTALS, TOTALS, "the response is 0.5 in every run"),
    ],
)
def test_invalid_counts_are_refused(counts: Array, totals: Array, complaint: str) -> None:
    with pytest.raises(StudyError, match=complaint):
        weighted_fit(DESIGN, counts, totals, NAMES)


def test_a_missing_row_is_refused_with_the_available_ones() -> None:
    with pytest.raises(StudyError, match="has no row 'X9'; it has model, X1"):
        fitted().row("X9")


def test_the_floor_is_not_part_of_the_intervals() -> None:
    """An estimate below 1 stays in intervals and F tests, which have their degrees of freedom."""
    found = fitted()
    small = replace(found, dispersion=Dispersion(0.25, 4))
    ends = (each.mean_interval(np.zeros(2)) for each in (found, small))
    width, small_width = (float(high[0] - low[0]) for low, high in ends)
    assert small_width / width == pytest.approx((0.25 / (found.dispersion.estimate or 0)) ** 0.5)
