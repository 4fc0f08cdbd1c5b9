"""Standard designs: their points are those of the library, of their definitions, and of the paper."""

from __future__ import annotations

import itertools

import numpy as np
import pyDOE3
import pytest
from numpy.typing import NDArray

from plant_sim.common.polynomial import model_matrix
from plant_sim.study.doe.block_columns import block_columns
from plant_sim.study.doe.design import central_composite, full_factorial, rotatable_axial, two_level
from plant_sim.study.doe.regression import terms
from plant_sim.study.doe.standard_designs import (
    ARRAYS,
    FRACTIONS,
    blocked_composite,
    box_behnken,
    complete_blocks,
    fractional_factorial,
    orthogonal_array,
    randomised,
)
from plant_sim.study.errors import StudyError
from plant_sim.study.paper_tables import cabbage_experiment, pepper_experiment

COLUMNS = {"L4": 3, "L8": 7, "L9": 4, "L12": 11, "L16": 15, "L16x4": 5, "L18": 8, "L25": 6, "L27": 13}


def as_set(points: NDArray[np.float64]) -> list[tuple[float, ...]]:
    """Return the points in an order of their own."""
    return sorted(tuple(point) for point in (np.round(points, 9) + 0.0).tolist())


@pytest.mark.parametrize("k", range(2, 6))
def test_own_factorials_and_composites_have_the_points_of_the_library(k: int) -> None:
    """Own code stays because the library fixes the axial level, and has another order of the runs."""
    assert as_set(two_level(k)) == as_set(pyDOE3.ff2n(k))
    assert as_set(full_factorial([(0, 1, 2)] * k)) == as_set(pyDOE3.fullfact([3] * k))
    library = pyDOE3.ccdesign(k, center=(0, 6), alpha="rotatable", face="circumscribed")
    assert as_set(central_composite(k, axial=rotatable_axial(k), centres=6)) == as_set(library)


def test_composites_are_the_designs_of_the_papers() -> None:
    """Pepper Table 4: axial level 1.525, six centres; cabbage Table 2: axial level 1.682, nine centres."""
    assert as_set(central_composite(3, axial=1.525, centres=6)) == as_set(pepper_experiment().coded)
    cabbage = cabbage_experiment("printed").coded
    assert as_set(central_composite(3, axial=1.682, centres=9)) == as_set(cabbage)


@pytest.mark.parametrize("k", [3, 4, 5])
def test_a_box_behnken_design_varies_two_factors_at_a_time(k: int) -> None:
    points = box_behnken(k, centres=2)
    assert as_set(points) == as_set(pyDOE3.bbdesign(k, 2))
    corners = {
        tuple(np.eye(k)[i] * a + np.eye(k)[j] * b)
        for i, j in itertools.combinations(range(k), 2)
        for a, b in itertools.product((-1, 1), repeat=2)
    }
    assert as_set(points) == sorted([*corners, (0.0,) * k, (0.0,) * k])


@pytest.mark.parametrize("name", ARRAYS)
def test_each_pair_of_levels_of_an_array_occurs_equally_often(name: str) -> None:
    points = orthogonal_array(name, COLUMNS[name])
    assert f"L{len(points)}" == name.partition("x")[0]
    assert points.min() == -1
    assert points.max() == 1
    for first, second in itertools.combinations(points.T, 2):
        _, counts = np.unique(np.column_stack([first, second]), axis=0, return_counts=True)
        assert len(counts) == len(np.unique(first)) * len(np.unique(second))
        assert len(set(counts.tolist())) == 1
    with pytest.raises(StudyError, match=f"must be 1 to {COLUMNS[name]}"):
        orthogonal_array(name, COLUMNS[name] + 1)


def test_l18_has_one_column_of_two_levels_and_seven_of_three() -> None:
    assert [len(np.unique(column)) for column in orthogonal_array("L18", 8).T] == [2, 3, 3, 3, 3, 3, 3, 3]


def test_l9_is_the_array_as_printed() -> None:
    """The levels of the second to fourth column in the first block are equal, in the others they are rotated."""
    printed = "1111 1222 1333 2123 2231 2312 3132 3213 3321"
    levels = (orthogonal_array("L9", 4) + 2).astype(int)
    assert " ".join("".join(map(str, row)) for row in levels.tolist()) == printed


@pytest.mark.parametrize(("k", "runs"), FRACTIONS)
def test_a_fraction_is_balanced_and_its_main_effects_are_separate(k: int, runs: int) -> None:
    points = fractional_factorial(k, runs)
    assert np.array_equal(points.T @ points, runs * np.eye(k))
    assert len(np.unique(points, axis=0)) == runs
    assert as_set(points)[0] in as_set(two_level(k))


@pytest.mark.parametrize("blocks", [2, 3])
def test_blocks_of_a_composite_leave_linear_terms_and_products_unchanged(blocks: int) -> None:
    plan = blocked_composite(3, axial=1.525, centres=9, blocks=blocks)
    assert as_set(plan.coded) == as_set(central_composite(3, axial=1.525, centres=9))
    matrix = model_matrix(plan.coded, terms(3, "interactions"))
    sums = np.array([matrix[plan.blocks == block].sum(axis=0) for block in range(1, blocks + 1)])
    assert np.abs(sums).max() == pytest.approx(0, abs=1e-12)
    assert all((~plan.coded[plan.blocks == block].any(axis=1)).sum() >= 3 for block in range(1, blocks + 1))


def test_runs_are_in_random_order_within_their_blocks() -> None:
    plan = complete_blocks(box_behnken(3, centres=3), 4)
    shuffled = randomised(plan, seed=1)
    assert shuffled.blocks.tolist() == sorted(plan.blocks.tolist())
    orders = []
    for block in range(1, 5):
        own = shuffled.coded[shuffled.blocks == block]
        assert as_set(own) == as_set(plan.coded[:15])
        orders.append(own.tolist())
    assert orders[0] != orders[1]
    assert np.array_equal(shuffled.coded, randomised(plan, seed=1).coded)
    assert not np.array_equal(shuffled.coded, randomised(plan, seed=2).coded)


def test_the_columns_of_blocks_sum_to_zero_over_the_blocks() -> None:
    columns = block_columns(["a", "b", "b", "c"])
    assert columns[[0, 1, 3]].sum(axis=0).tolist() == [0, 0]


def test_invalid_standard_designs_are_rejected() -> None:
    for k in (2, 6):
        with pytest.raises(StudyError, match="must be 3 to 5"):
            box_behnken(k, centres=1)
    with pytest.raises(StudyError, match="0 or more"):
        box_behnken(3, centres=-1)
    with pytest.raises(StudyError, match="is unknown; use one of L4, L8"):
        orthogonal_array("L7", 3)
    with pytest.raises(StudyError, match="4 runs for 5 factors; use 8 or 16"):
        fractional_factorial(5, 4)
    with pytest.raises(StudyError, match="3 to 8 factors"):
        fractional_factorial(9, 16)
    for k, blocks in ((2, 3), (3, 4)):
        with pytest.raises(StudyError, match="must be 1 or 2, or 3 from three"):
            blocked_composite(k, axial=1.5, centres=9, blocks=blocks)
    with pytest.raises(StudyError, match="at least one per block"):
        blocked_composite(3, axial=1.5, centres=1, blocks=2)
