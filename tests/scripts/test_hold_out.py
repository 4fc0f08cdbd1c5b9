"""Hold-out study: runs, points and halves are left out of the fits that predict them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from plant_sim.study.doe.regression import point_numbers
from plant_sim.study.paper_tables import pepper_experiment
from plant_sim.study.pepper.paper import refit
from scripts.hold_out import half_by_table_4, least_squares, left_out, noise_floor, rms, weighted

Array = NDArray[np.float64]
EXPERIMENT = pepper_experiment()
SUCCESS = EXPERIMENT.responses["S"]


def test_the_noise_floor_is_the_scatter_of_the_centre_runs() -> None:
    assert noise_floor() == pytest.approx(1.35, abs=0.005)
    pure = refit().row("pure error")
    assert noise_floor() ** 2 == pytest.approx(pure.mean_square)


def test_runs_left_out_have_the_deviations_of_press() -> None:
    """For least squares each deviation is the residual divided by 1 minus the leverage."""
    fitted = refit()
    matrix = fitted._results.model.exog
    leverage = np.einsum("ij,jk,ik->i", matrix, np.linalg.inv(matrix.T @ matrix), matrix)
    wanted = (SUCCESS - fitted.predict(EXPERIMENT.coded)) / (1 - leverage)
    assert left_out(least_squares, np.arange(len(SUCCESS))) == pytest.approx(wanted)


def test_a_point_is_left_out_with_all_its_runs() -> None:
    seen: list[Array] = []

    def model(coded: Array, success: Array) -> Callable[[Array], Array]:
        seen.append(coded)
        return lambda points: np.zeros(len(points))

    left_out(model, point_numbers(EXPERIMENT.coded))
    assert len(seen) == 15
    centres = [int((coded == 0).all(axis=1).sum()) for coded in seen]
    assert sorted(set(centres)) == [0, 6]
    assert min(map(len, seen)) == 14


@pytest.mark.parametrize("model", [least_squares, weighted])
def test_the_other_half_is_extrapolated(model: Callable[[Array, Array], Callable[[Array], Array]]) -> None:
    """The fit has seen 15 runs; the deviations in the other half exceed those in its own."""
    inside, outside = half_by_table_4(model, 0, -1)
    kept = EXPERIMENT.coded[:, 0] <= 0
    assert kept.sum() == 15
    off = SUCCESS - least_squares(EXPERIMENT.coded[kept], SUCCESS[kept])(EXPERIMENT.coded)
    assert (inside, outside) == pytest.approx((rms(off[kept]), rms(off[~kept])), rel=0.01)
    assert outside > 10 * inside
