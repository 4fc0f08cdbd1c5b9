"""Regression coefficients, analysis of variance, and rejection of singular designs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.common.errors import InputError
from plant_sim.common.polynomial import CONSTANT, Polynomial, model_matrix
from plant_sim.study.doe.design import central_composite, latin_hypercube, two_level
from plant_sim.study.doe.regression import fit, terms
from plant_sim.study.errors import StudyError
from tests.sampling import examples

QUADRATIC = terms(3, "quadratic")
DESIGN = central_composite(3, axial=1.6, centres=5)

coefficients = st.lists(st.integers(-50, 50), min_size=10, max_size=10).filter(lambda values: any(values[1:]))
seeds = st.integers(0, 10_000)


def noisy(values: list[int], seed: int, sd: float = 1.0) -> NDArray[np.float64]:
    exact = Polynomial(dict(zip([CONSTANT, *QUADRATIC], map(float, values), strict=True))).predict(DESIGN)
    return exact + np.random.default_rng(seed).normal(scale=sd, size=len(DESIGN))


def test_terms_are_named_as_in_the_papers() -> None:
    assert terms(3, "linear") == ("X1", "X2", "X3")
    assert terms(3, "interactions") == ("X1", "X2", "X3", "X1 X2", "X1 X3", "X2 X3")
    assert QUADRATIC[6:] == ("X1^2", "X2^2", "X3^2")


def test_columns_of_terms() -> None:
    point = np.array([[2.0, 3.0, 5.0]])
    names = ["1", "X2", "X1 X3", "X3^2", "X1 X2^2"]
    assert model_matrix(point, names).tolist() == [[1.0, 3.0, 10.0, 25.0, 18.0]]


@examples(30, nightly=100)
@given(coefficients)
def test_known_coefficients_are_recovered(values: list[int]) -> None:
    found = fit(DESIGN, noisy(values, 0, sd=1e-9), QUADRATIC)
    assert list(found.values.values()) == pytest.approx(values, abs=1e-6)
    assert found.r2 == pytest.approx(1.0)
    fresh = latin_hypercube(3, 5, seed=1)
    expected = Polynomial(dict(zip([CONSTANT, *QUADRATIC], map(float, values), strict=True))).predict(fresh)
    assert found.predict(fresh) == pytest.approx(expected, abs=1e-6)
    assert found.predict(fresh[0]) == pytest.approx(expected[:1], abs=1e-6)


@examples(30, nightly=100)
@given(coefficients, seeds)
def test_the_analysis_of_variance_adds_up(values: list[int], seed: int) -> None:
    found = fit(DESIGN, noisy(values, seed), QUADRATIC)
    for whole, parts in (("total", ("model", "residual")), ("residual", ("lack of fit", "pure error"))):
        rows = [found.row(part) for part in parts]
        assert sum(row.sum_of_squares for row in rows) == pytest.approx(found.row(whole).sum_of_squares)
        assert sum(row.degrees for row in rows) == found.row(whole).degrees
    assert found.row("pure error").degrees == 4
    assert found.row("pure error").sum_of_squares == pytest.approx(4 * found.response[-5:].var(ddof=1))


@examples(30, nightly=100)
@given(coefficients, seeds, st.sampled_from(QUADRATIC))
def test_the_sum_of_squares_of_a_term_is_the_increase_of_the_residual_without_it(
    values: list[int], seed: int, term: str
) -> None:
    response = noisy(values, seed)
    whole = fit(DESIGN, response, QUADRATIC)
    without = fit(DESIGN, response, [name for name in QUADRATIC if name != term])
    cost = without.row("residual").sum_of_squares - whole.row("residual").sum_of_squares
    assert whole.row(term).sum_of_squares == pytest.approx(cost, rel=1e-6, abs=1e-6)
    assert whole.row(term).p == pytest.approx(whole.coefficients[term].p)


@examples(30, nightly=100)
@given(coefficients, seeds)
def test_r2_and_its_adjustment(values: list[int], seed: int) -> None:
    found = fit(DESIGN, noisy(values, seed), QUADRATIC)
    left = found.row("residual").sum_of_squares / found.row("total").sum_of_squares
    assert found.r2 == pytest.approx(1 - left)
    assert found.adjusted_r2 == pytest.approx(1 - left * (len(DESIGN) - 1) / (len(DESIGN) - 10))


def test_a_prediction_interval_has_its_coverage() -> None:
    rng = np.random.default_rng(7)
    design = central_composite(2, axial=1.4, centres=5)
    matrix = model_matrix(design, [CONSTANT, "X1", "X2"])
    point = np.array([0.5, -0.3])
    inside = 0
    for _ in range(400):
        found = fit(design, matrix @ [90.0, 2.0, -1.0] + rng.normal(size=len(design)), ["X1", "X2"])
        low, high = found.prediction_interval(point, 0.9)
        inside += bool(low[0] <= 90.0 + 2.0 * 0.5 + 0.3 + rng.normal() <= high[0])
    assert 0.86 <= inside / 400 <= 0.94


def test_a_missing_square_term_is_detected_as_lack_of_fit() -> None:
    response = noisy([90, 2, -3, 1, 0, 0, 0, -8, 0, 0], 3, sd=0.5)
    assert (fit(DESIGN, response, terms(3, "linear")).row("lack of fit").p or 0) < 1e-4
    assert (fit(DESIGN, response, QUADRATIC).row("lack of fit").p or 0) > 0.05


def test_lack_of_fit_needs_repeated_points() -> None:
    corners = two_level(3)
    found = fit(corners, corners @ [1.0, 2.0, 3.0] + np.cos(np.arange(8)), terms(3, "linear"))
    assert [row.source for row in found.anova] == ["model", "X1", "X2", "X3", "residual", "total"]
    with pytest.raises(StudyError, match="no row 'lack of fit'; it has model"):
        found.row("lack of fit")


def test_a_saturated_design_has_only_pure_error() -> None:
    design = np.array([[-1.0], [-1.0], [1.0], [1.0]])
    found = fit(design, np.array([1.0, 2.0, 5.0, 7.0]), ["X1"])
    assert [row.source for row in found.anova] == ["model", "X1", "residual", "pure error", "total"]
    assert found.row("pure error").sum_of_squares == pytest.approx(2.5)


def test_repeats_without_scatter_have_no_f_value_of_the_lack_of_fit() -> None:
    design = np.array([[-1.0], [-1.0], [0.0], [0.0], [1.0], [1.0]])
    lack = fit(design, np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.5]) * 2, ["X1"]).row("lack of fit")
    assert lack.f is not None
    flat = fit(design, np.array([1.0, 1.0, 0.0, 0.0, 2.0, 2.0]), ["X1"]).row("lack of fit")
    assert flat.sum_of_squares > 0.5
    assert flat.f is None
    assert flat.p is None


@pytest.mark.parametrize("level", [0.0, 95.0, 1e6])
def test_a_perfect_fit_has_sums_of_squares_but_no_f_and_no_p(level: float) -> None:
    """S = level + 2 X1 - X1 X2 in 8 runs: the sums of squares are 8 * 4 and 8 * 1; the rest is rounding error."""
    corners = np.vstack([two_level(2)] * 2)
    found = fit(corners, level + 2 * corners[:, 0] - corners[:, 0] * corners[:, 1], ["X1", "X2", "X1 X2"])
    squares = {row.source: row.sum_of_squares for row in found.anova}
    assert [squares[term] for term in ("X1", "X2", "X1 X2", "model")] == pytest.approx([32, 0, 8, 40], abs=1e-6)
    assert (squares["residual"], squares["pure error"]) == (0.0, 0.0)
    assert all(row.f is None and row.p is None for row in found.anova)
    assert found.values == pytest.approx({"1": level, "X1": 2, "X2": 0, "X1 X2": -1}, abs=1e-9)
    assert {(each.standard_error, each.t, each.p) for each in found.coefficients.values()} == {(0.0, None, None)}


def test_a_very_small_scatter_is_not_rounding_error() -> None:
    """The scatter is a ten-millionth of the response."""
    found = fit(DESIGN, noisy([90, *range(9)], 4, sd=1e-5), QUADRATIC)
    assert found.row("residual").sum_of_squares > 0
    assert (found.row("X3").f or 0) > 1e6
    assert found.row("pure error").mean_square == pytest.approx(found.response[-5:].var(ddof=1), rel=1e-4)


def test_rounding_error_is_not_reported_as_lack_of_fit() -> None:
    """If there are two runs per point and the model passes through their means, the entire residual is pure error."""
    design = np.repeat(central_composite(2, axial=1.4, centres=1), 2, axis=0)
    scatter = np.tile([0.1, -0.1], len(design) // 2)
    lack = fit(design, 95 + 2 * design[:, 0] + scatter, ["X1"]).row("lack of fit")
    assert lack.sum_of_squares == pytest.approx(0.0, abs=1e-12)
    assert lack.f == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("coded", "response", "names", "says"),
    [
        (np.empty((0, 2)), [], ["X1"], "has no runs"),
        (two_level(2), [1, 2, 3, 4], [], "no terms"),
        (two_level(2), [1, 2, 3], ["X1"], "4 runs but 3 responses"),
        (two_level(2), [1, 2, np.nan, 4], ["X1"], "run 3 contains a non-finite number"),
        (two_level(2), [1, 2, 3, 4], ["X1", "X2", "X1 X2"], "4 runs for 4 coefficients"),
        (two_level(2), [1, 2, 3, 4], ["X1", "X2", "X1 X2", "X1^2"], "4 runs for 5 coefficients"),
        (two_level(3), [5] * 8, ["X1"], "is 5 in every run"),
        (two_level(3), range(8), ["X4"], "'X4': the design has X1 to X3"),
        (two_level(3), range(8), ["X0"], "'X0'"),
        (two_level(3), range(8), ["X1^3"], r"'X1\^3'"),
        (two_level(3), range(8), ["foam"], "'foam'"),
    ],
)
def test_invalid_fits_are_rejected(
    coded: NDArray[np.float64], response: Sequence[float], names: list[str], says: str
) -> None:
    with pytest.raises(InputError, match=says) as error:
        fit(coded, np.array(response, dtype=float), names)
    assert "\n" not in str(error.value)


def test_a_singular_design_is_rejected_with_the_names_of_the_terms() -> None:
    corners = two_level(3)
    with pytest.raises(StudyError, match=r"separate these terms: 1, X2\^2;"):
        fit(corners, np.arange(8.0), ["X1", "X3", "X2^2"])
    halved = np.vstack([corners[np.prod(corners, axis=1) > 0]] * 3)  # the half fraction with X3 = X1 X2
    with pytest.raises(StudyError, match="separate these terms: X3, X1 X2;"):
        fit(halved, np.arange(12.0), ["X1", "X2", "X3", "X1 X2"])
    many = np.tile(corners, (20_000, 1))
    with pytest.raises(StudyError, match=r"separate these terms: 1, X2\^2;"):
        fit(many, np.arange(160_000.0), ["X1", "X3", "X2^2"])


def test_an_invalid_confidence_is_rejected() -> None:
    found = fit(DESIGN, noisy([90] + [1] * 9, 1), QUADRATIC)
    for confidence in (0.0, 1.0, 95.0):
        with pytest.raises(StudyError, match="must be between 0 and 1"):
            found.prediction_interval(DESIGN, confidence)
