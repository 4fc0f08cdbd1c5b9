"""Optimum of a response surface within bounds, and Pareto front of two responses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.common.polynomial import Polynomial
from plant_sim.study.doe.design import central_composite, full_factorial
from plant_sim.study.doe.optimum import best, best_location_interval, pareto
from plant_sim.study.doe.regression import Fit, fit, terms
from plant_sim.study.errors import StudyError
from tests.sampling import examples

LOW, HIGH = (-1.0, -1.0), (1.0, 1.0)
GRID = full_factorial([np.linspace(-1, 1, 41).tolist()] * 2)

quadratics = st.lists(st.integers(-9, 9), min_size=6, max_size=6).map(
    lambda values: Polynomial(dict(zip(("1", *terms(2, "quadratic")), map(float, values), strict=True)))
)


def test_an_optimum_within_the_bounds_has_zero_gradient() -> None:
    """The response is S = 90 - (X1 - 0.3)^2 - 2 (X2 + 0.4)^2."""
    surface = Polynomial({"1": 90 - 0.09 - 0.32, "X1": 0.6, "X2": -1.6, "X1^2": -1.0, "X2^2": -2.0})
    point, value = best(surface, LOW, HIGH)
    assert point == pytest.approx([0.3, -0.4], abs=1e-4)
    assert value == pytest.approx(90.0, abs=1e-6)


def test_an_optimum_out_of_bounds_is_moved_to_the_boundary() -> None:
    surface = Polynomial({"X1": 1.0, "X2": -1.6, "X2^2": -2.0})
    point, value = best(surface, LOW, (0.5, 1.0))
    assert point == pytest.approx([0.5, -0.4], abs=1e-4)
    assert value == pytest.approx(0.82, abs=1e-6)
    point, _ = best(surface, LOW, HIGH, maximise=False)
    assert point == pytest.approx([-1.0, 1.0])


def peak(sd: float, seed: int) -> Fit:
    """Return a fit of S = 90 - 3 (X1 - 0.3)^2 - 4 (X2 + 0.4)^2 with scatter."""
    coded = central_composite(2, axial=1.4, centres=6)
    exact = 90 - 3 * (coded[:, 0] - 0.3) ** 2 - 4 * (coded[:, 1] + 0.4) ** 2
    scatter = np.random.default_rng(seed).normal(scale=sd, size=len(coded))
    return fit(coded, exact + scatter, terms(2, "quadratic"))


@pytest.mark.nightly
def test_the_interval_of_the_location_of_an_optimum_has_its_coverage() -> None:
    """For each factor, nominally 95 % of 30 intervals contain the optimum; fewer than 25 of 30 is very unlikely."""
    held = np.zeros(2)
    for seed in range(30):
        low, high = best_location_interval(peak(0.5, seed), LOW, HIGH)
        held += (low <= [0.3, -0.4]) & (high >= [0.3, -0.4])
    assert np.all(held >= 25)


def test_the_interval_of_the_location_shrinks_with_the_scatter() -> None:
    """If the scatter is large, the interval is the complete search range; it never extends beyond that range."""
    widths = []
    for sd in (0.2, 2.0, 50.0):
        low, high = best_location_interval(peak(sd, 1), LOW, HIGH)
        assert np.all((low >= -1) & (high <= 1))
        widths.append(high - low)
    assert np.all(widths[0] < 0.1)
    assert np.all((widths[1] > 0.2) & (widths[1] < 1.2))
    assert np.all(widths[2] > 1.9)
    again, once = best_location_interval(peak(2.0, 1), LOW, HIGH), best_location_interval(peak(2.0, 1), LOW, HIGH)
    assert (again[0].tolist(), again[1].tolist()) == (once[0].tolist(), once[1].tolist())


@examples(15, nightly=40)
@given(quadratics, st.booleans())
def test_no_point_within_the_bounds_is_better_than_the_optimum(surface: Polynomial, maximise: bool) -> None:
    point, value = best(surface, LOW, HIGH, maximise=maximise)
    everywhere = surface.predict(GRID)
    assert value == pytest.approx(float(surface.predict(point)[0]))
    assert np.all(np.abs(point) <= 1)
    if maximise:
        assert value >= everywhere.max() - 1e-5
    else:
        assert value <= everywhere.min() + 1e-5


@pytest.mark.nightly
@examples(6, nightly=15)
@given(quadratics, quadratics)
def test_no_setting_dominates_the_front(a: Polynomial, b: Polynomial) -> None:
    front = pareto(a, b, LOW, HIGH, 9)
    assert np.all(np.abs(front.coded) <= 1)
    assert front.a == pytest.approx(a.predict(front.coded))
    assert np.all(np.diff(front.a) >= 0)
    assert np.all(np.diff(front.b) <= 0)
    for grid_a, grid_b in zip(a.predict(GRID), b.predict(GRID), strict=True):
        assert not np.any((grid_a < front.a - 1e-4) & (grid_b < front.b - 1e-4))
    assert front.a[0] == pytest.approx(best(a, LOW, HIGH, maximise=False)[1], abs=1e-4)
    assert front.b[-1] == pytest.approx(best(b, LOW, HIGH, maximise=False)[1], abs=1e-4)


def test_a_known_front_between_two_objectives() -> None:
    """The front of the squared distances from (-1, 0) and (1, 0) is the line between these points."""
    a = Polynomial({"1": 1.0, "X1": 2.0, "X1^2": 1.0, "X2^2": 1.0})
    b = Polynomial({"1": 1.0, "X1": -2.0, "X1^2": 1.0, "X2^2": 1.0})
    front = pareto(a, b, LOW, HIGH, 9)
    assert len(front.a) == 9
    assert front.coded[:, 1] == pytest.approx(np.zeros(9), abs=1e-3)
    assert np.sqrt(front.a) + np.sqrt(front.b) == pytest.approx(np.full(9, 2.0), abs=1e-3)
    assert front.b == pytest.approx(np.linspace(4.0, 0.0, 9), abs=1e-3)  # evenly spaced, not on the initial grid


def test_a_concave_front_is_complete() -> None:
    """On the boundary X2 = -1, b = 1 - a^2 for a = (X1 + 1) / 2; weighted sums would find only the ends."""
    a = Polynomial({"1": 1.5, "X1": 0.5, "X2": 1.0})
    b = Polynomial({"1": 1.75, "X1": -0.5, "X1^2": -0.25, "X2": 1.0})
    front = pareto(a, b, LOW, HIGH, 11)
    assert len(front.a) == 11
    assert front.coded[:, 1] == pytest.approx(np.full(11, -1.0), abs=1e-3)
    assert front.b == pytest.approx(1 - front.a**2, abs=1e-3)


def test_responses_with_a_common_optimum_have_a_front_of_one_point() -> None:
    surface = Polynomial({"X1": 1.0, "X2": 1.0})
    assert pareto(surface, surface, LOW, HIGH, 9).coded.tolist() == [[-1.0, -1.0]]


def test_ties_in_one_response_are_resolved_by_the_other() -> None:
    front = pareto(Polynomial({"X1": 1.0}), Polynomial({"X2": -1.0}), LOW, HIGH, 9)
    assert front.coded == pytest.approx(np.array([[-1.0, 1.0]]), abs=1e-6)


@pytest.mark.parametrize(
    ("low", "high", "says"),
    [
        ((), (), "specify one pair per factor"),
        ((-1.0,), (1.0, 1.0), "1 lower and 2 upper"),
        ((-1.0, 1.0), (1.0, -1.0), "bounds of X2: 1 to -1 is not a range"),
        ((-1.0, 0.0), (1.0, 0.0), "bounds of X2"),
        ((float("-inf"), 0.0), (1.0, 1.0), "bounds of X1"),
        ((-1.0,) * 7, (1.0,) * 7, "7 factors; must be at most six"),
    ],
)
def test_invalid_bounds_are_rejected(low: tuple[float, ...], high: tuple[float, ...], says: str) -> None:
    with pytest.raises(StudyError, match=says):
        best(Polynomial({"X1": 1.0}), low, high)


def test_a_request_for_a_single_front_point_is_rejected() -> None:
    surface = Polynomial({"X1": 1.0, "X2": 1.0})
    with pytest.raises(StudyError, match="at least 2"):
        pareto(surface, surface, LOW, HIGH, 1)
