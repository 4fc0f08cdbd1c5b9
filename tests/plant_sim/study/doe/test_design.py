"""Properties of the designs, and rejection of invalid ones."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.common.polynomial import Polynomial, model_matrix
from plant_sim.study.doe.design import (
    Factor,
    central_composite,
    full_factorial,
    latin_hypercube,
    orthogonal_axial,
    rotatable_axial,
    to_coded,
    to_natural,
    two_level,
)
from plant_sim.study.doe.regression import terms
from plant_sim.study.errors import StudyError
from plant_sim.study.report.surface import contours

factors = st.integers(1, 5)


@given(centre=st.floats(-1e3, 1e3), step=st.floats(0.01, 100), coded=st.floats(-3, 3))
def test_decoding_reverses_coding(centre: float, step: float, coded: float) -> None:
    factor = Factor("speed", "m/s", centre, step)
    assert factor.coded(factor.natural(coded)) == pytest.approx(coded, abs=1e-6)
    assert factor.natural(1.0) - factor.natural(0.0) == pytest.approx(step, rel=1e-6)
    points = np.array([[coded], [0.0]])
    assert to_coded([factor], to_natural([factor], points)) == pytest.approx(points, abs=1e-6)
    assert to_natural([factor], points)[1, 0] == centre


@pytest.mark.parametrize(("centre", "step"), [(0.0, 0.0), (0.0, math.nan), (math.inf, 1.0)])
def test_an_invalid_factor_is_rejected(centre: float, step: float) -> None:
    with pytest.raises(StudyError, match="factor speed"):
        Factor("speed", "m/s", centre, step)


def test_the_first_factor_changes_fastest_in_standard_order() -> None:
    assert two_level(3)[:, 0].tolist() == [-1, 1] * 4
    assert two_level(3)[:, 1].tolist() == [-1, -1, 1, 1] * 2
    assert two_level(3)[:, 2].tolist() == [-1] * 4 + [1] * 4


@given(factors)
def test_a_two_level_factorial_is_orthogonal_and_complete(k: int) -> None:
    design = two_level(k)
    assert np.array_equal(design.T @ design, 2**k * np.eye(k))
    assert len(np.unique(design, axis=0)) == 2**k


@given(st.lists(st.lists(st.floats(-9, 9), min_size=1, max_size=4, unique=True), min_size=1, max_size=4))
def test_a_full_factorial_runs_every_combination_once(levels: list[list[float]]) -> None:
    runs = [tuple(run) for run in full_factorial(levels).tolist()]
    assert sorted(runs) == sorted(itertools.product(*levels))


@given(factors, st.integers(0, 9))
def test_a_central_composite_design_has_corners_axes_and_centres(k: int, centres: int) -> None:
    design = central_composite(k, axial=1.7, centres=centres)
    assert len(design) == 2**k + 2 * k + centres
    on_axis = design[2**k : 2**k + 2 * k]
    assert np.array_equal(np.abs(on_axis).sum(axis=1), np.full(2 * k, 1.7))
    assert on_axis[0, 0] == -1.7
    assert on_axis[1, 0] == 1.7
    assert not design[2**k + 2 * k :].any()


@given(st.integers(2, 5), st.integers(1, 9), st.integers(0, 1000))
def test_a_rotatable_design_has_equal_variance_in_every_direction(k: int, centres: int, seed: int) -> None:
    """The variance of the prediction depends only on the distance from the centre."""
    names = ["1", *terms(k, "quadratic")]
    matrix = model_matrix(central_composite(k, axial=rotatable_axial(k), centres=centres), names)
    inverse = np.linalg.inv(matrix.T @ matrix)
    directions = np.random.default_rng(seed).normal(size=(6, k))
    rows = model_matrix(1.2 * directions / np.linalg.norm(directions, axis=1, keepdims=True), names)
    variance = np.einsum("ij,jk,ik->i", rows, inverse, rows)
    assert variance == pytest.approx(np.full(6, variance[0]))


@given(st.integers(2, 5), st.integers(1, 9))
def test_an_orthogonal_design_leaves_squares_uncorrelated(k: int, centres: int) -> None:
    design = central_composite(k, axial=orthogonal_axial(k, centres), centres=centres)
    squares = np.corrcoef((design**2).T)
    assert squares == pytest.approx(np.eye(k), abs=1e-9)


def test_the_axial_levels_of_the_papers() -> None:
    assert orthogonal_axial(3, 6) == pytest.approx(1.525, abs=5e-4)
    assert rotatable_axial(3) == pytest.approx(1.682, abs=5e-4)


@given(factors, st.integers(1, 40), st.integers(0, 2**32))
def test_a_latin_hypercube_has_one_point_in_every_stratum(k: int, n: int, seed: int) -> None:
    points = latin_hypercube(k, n, seed=seed)
    strata = np.floor((points + 1) / 2 * n).astype(int)
    assert np.array_equal(np.sort(strata, axis=0), np.tile(np.arange(n)[:, np.newaxis], (1, k)))
    assert np.array_equal(points, latin_hypercube(k, n, seed=seed))


def test_another_seed_gives_another_latin_hypercube() -> None:
    assert not np.array_equal(latin_hypercube(3, 10, seed=1), latin_hypercube(3, 10, seed=2))


def test_invalid_designs_are_rejected() -> None:
    with pytest.raises(StudyError, match="at least one level per factor"):
        full_factorial([])
    with pytest.raises(StudyError, match="at least one level per factor"):
        full_factorial([(1.0, 2.0), ()])
    for k in (0, 13):
        with pytest.raises(StudyError, match="must be 1 to 12"):
            two_level(k)
    for axial in (0.0, -1.0, math.nan):
        with pytest.raises(StudyError, match="above 0"):
            central_composite(3, axial=axial, centres=1)
    with pytest.raises(StudyError, match="0 or more"):
        central_composite(3, axial=1.0, centres=-1)
    for k, n, seed in ((0, 5, 1), (2, 0, 1), (2, 5, -1)):
        with pytest.raises(StudyError, match="latin hypercube"):
            latin_hypercube(k, n, seed=seed)


def test_a_factor_without_unit_is_labelled_by_its_name_alone() -> None:
    """The axis label and the title of a contour panel have no comma and no dash."""
    cups, foam = Factor("cups", "-", 6.0, 2.0), Factor("foam", "mm", 12.0, 3.6)
    assert (cups.label, foam.label) == ("cups", "foam, mm")
    surface = Polynomial({"1": 1.0, "X1": 1.0, "X2": 2.0, "X3": 0.5})
    figure = contours(surface, (cups, foam, cups), response="S, %", held=(0.0, 0.0, 1.0), reach=(1.0, 1.0, 1.0))
    shown = [(axes.get_xlabel(), axes.get_ylabel(), axes.get_title()) for axes in figure.axes[:3]]
    assert shown == [("cups", "foam, mm", "cups 8"), ("cups", "cups", "foam 12 mm"), ("foam, mm", "cups", "cups 6")]
