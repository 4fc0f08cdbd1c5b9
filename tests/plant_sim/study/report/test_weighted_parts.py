"""Report parts of weighted fits: error, effects with or without P values, quality of the model, residuals."""

from __future__ import annotations

import numpy as np
import pytest

from controller.common.document.parts import Picture, Table
from plant_sim.common.polynomial import Polynomial
from plant_sim.study.doe.design import central_composite
from plant_sim.study.doe.regression import terms
from plant_sim.study.doe.weighted import WeightedFit, weighted_fit
from plant_sim.study.report.fit_parts import doubts, fit_record
from plant_sim.study.report.weighted_parts import effects_table, error_text, weighted_parts
from tests.plant_sim.study.figures import axes_of

DESIGN = central_composite(2, axial=1.4, centres=5)
TOTALS = np.full(len(DESIGN), 144.0)
TRUE = Polynomial({"1": 85.0, "X1": 6.0, "X2": -4.0, "X1^2": -5.0})
NAMES = terms(2, "quadratic")


def fitted(scatter: float = 1.0, *, runs: int = len(DESIGN)) -> WeightedFit:
    """Return a fit whose trials deviate from a quadratic by a multiple of some binomial deviations."""
    shares = TRUE.predict(DESIGN) / 100
    counts = np.random.default_rng(4).binomial(144, shares)
    observed = np.clip(144 * shares + scatter * (counts - 144 * shares), 0, 144)
    return weighted_fit(DESIGN[:runs], observed[:runs], TOTALS[:runs], NAMES)


def test_measured_trials_have_p_values_and_simulated_ones_have_not() -> None:
    fit = fitted()
    measured = effects_table("a", "", {"fit": fit.values}, fit, is_simulated=False)
    simulated = effects_table("a", "", {"fit": fit.values}, fit, is_simulated=True)
    assert measured.heading == ("term", "fit", "standard error", "95 % interval: from", "to", "P")
    assert simulated.heading == ("term", "fit", "Monte Carlo error", "95 % interval: from", "to")
    low, high = fit.coefficient_interval("X1")
    x1 = fit.coefficients["X1"]
    assert simulated.rows[1] == ("X1", x1.value, x1.standard_error, low, high)
    assert measured.rows[1][:5] == simulated.rows[1]
    assert measured.rows[1][5] is not None
    foreign = effects_table("a", "", {"paper": {"X9": 1.0}, "fit": fit.values}, fit, is_simulated=True)
    assert foreign.rows[0] == ("X9", 1.0, None, None, None, None)


def test_parts_of_simulated_trials_contain_no_p_value() -> None:
    fit = fitted()
    parts = weighted_parts("s", fit, response="S, %", is_simulated=True)
    assert [part.name for part in parts if isinstance(part, Table)] == ["s-quality"]
    assert "no P value is given" in str(parts[0])
    found, by_error = fit.misfit
    assert (
        f"by {found:.2f} percentage points (root mean square); Monte Carlo error alone would give {by_error:.2f}"
        in (str(parts[0]))
    )
    measured = weighted_parts("s", fit, response="S, %", is_simulated=False)
    anova, quality = (part for part in measured if isinstance(part, Table))
    assert [row[0] for row in anova.rows] == [row.source for row in fit.anova]
    assert [row[1] for row in quality.rows] == [
        fit.r2,
        fit.adjusted_r2,
        fit.predicted_r2,
        fit.predicted_r2_by_point,
        fit.adequate_precision,
    ]


def test_the_residuals_are_drawn_over_the_fitted_values_and_normal_quantiles() -> None:
    fit = fitted()
    (picture,) = (p for p in weighted_parts("s", fit, response="S, %", is_simulated=False) if isinstance(p, Picture))
    against, quantiles = axes_of(picture)
    points = np.asarray(against.lines[1].get_xydata())
    assert points == pytest.approx(np.column_stack([fit.predict(DESIGN), fit.studentized]))
    assert np.asarray(quantiles.lines[1].get_xydata())[:, 1] == pytest.approx(np.sort(fit.studentized))


@pytest.mark.parametrize(
    ("scatter", "sentences"),
    [
        (3.0, []),
        (0.8, ["The estimate is below 1, which can be chance."]),
        (0.1, ["scatter less than counts of that many independent seedlings can"]),
    ],
)
def test_an_estimate_below_1_is_told_with_the_result_for_1(scatter: float, sentences: list[str]) -> None:
    fit = fitted(scatter)
    text = error_text(fit, is_simulated=False)
    assert all(sentence.rstrip(".") in text for sentence in sentences)
    assert ("With a dispersion of 1" in text) is bool(sentences)
    if sentences:
        assert f"are {(fit.dispersion.estimate or 0) ** -0.5:.2f} times as large" in text
        f, p = fit.lack_of_fit_with_least_dispersion() or (0.0, 0.0)
        assert f"the lack of fit has F {f:.2f}, P {p:.4f}." in text


def test_without_repeated_trials_the_report_says_that_intervals_are_lower_bounds() -> None:
    fit = fitted(runs=9)
    assert "every interval is only a lower bound, and no P value is given" in error_text(fit, is_simulated=False)
    table = effects_table("a", "", {"fit": fit.values}, fit, is_simulated=False)
    assert table.heading[3] == "lower bound of the 95 % interval: from"
    assert {row[5] for row in table.rows} == {None}
    assert doubts("S", fit)[0].startswith("S: no repeated trials that differ, so the error is unknown")
    assert fit.lack_of_fit_with_least_dispersion() is None


def test_the_record_contains_the_dispersion_and_the_quality() -> None:
    fit = fitted()
    record = fit_record(fit)
    assert record["dispersion"] == {
        "estimate": fit.dispersion.estimate,
        "degrees": 4,
        "interval_95": fit.dispersion.interval(),
        "value": fit.dispersion.value,
    }
    assert (record["link"], record["predicted_r2"]) == ("identity", fit.predicted_r2)


def test_simulated_effects_within_the_error_are_reported_without_p() -> None:
    shares = np.full(len(DESIGN), 0.85)
    counts = np.random.default_rng(6).binomial(144, shares).astype(np.float64)
    fit = weighted_fit(DESIGN, counts, TOTALS, terms(2, "linear"))
    (doubt,) = doubts("S", fit, is_simulated=True)
    assert doubt.startswith("S: the effects do not exceed the Monte Carlo error of these trials (adjusted R²")
    (measured,) = doubts("S", fit)
    assert measured.startswith("S: the model is not significant (P 0.")
