"""Tests of the fit of the mechanical model: held-back runs, known constants and weights of the clearances."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from plant_sim.planter.parameters import load_planter, load_ranges
from plant_sim.study.doe.design import to_natural
from plant_sim.study.errors import StudyError
from plant_sim.study.paper_tables import CABBAGE_FACTORS, cabbage_experiment
from plant_sim.study.planter.lodging_fit import (
    InjuryConstants,
    LodgingConstants,
    comparisons,
    fit_injury,
    fit_lodging,
    fitted_runs,
    injury_percent,
    lodging_percent,
    rms,
)
from plant_sim.study.planter.tipping import DEEPEST_M, Tipping, simulate_tipping

PLANTER, RANGES = load_planter(), load_ranges()
EXPERIMENT = cabbage_experiment("reconciled")
FORCE_N = to_natural(CABBAGE_FACTORS, EXPERIMENT.coded)[:, 2]
FITTED = fitted_runs(EXPERIMENT)


def tipping(blocks: int = 400) -> Tipping:
    """Return falls that tip below a limit of the clearance, which depends on the speed."""
    clearance_m = (np.arange(blocks) + 0.5) / blocks * DEEPEST_M
    limit_m = 0.012 + 0.003 * EXPERIMENT.coded[:, 0]
    return Tipping(clearance_m, clearance_m[np.newaxis, :] < limit_m[:, np.newaxis])


def test_corners_and_five_centres_are_fitted_and_the_axial_runs_are_held_back() -> None:
    assert (np.flatnonzero(FITTED) + 1).tolist() == [*range(1, 9), *range(15, 20)]


def test_weights_are_those_of_a_normal_distribution() -> None:
    """The share below a limit is the normal distribution function; the limit at the centre is 12 mm."""
    share = tipping().share(0.017, 0.005)
    assert share[14] == pytest.approx(0.158_655, abs=0.003)
    assert share[9] > share[14] > share[8]
    certain = dataclasses.replace(tipping(), lodged=np.ones((1, 400), dtype=bool))
    assert certain.share(0.02, 0.005) == pytest.approx(1.0)
    assert certain.standard_error(0.02, 0.005) == pytest.approx(0.0, abs=1e-12)
    assert 0.0 < tipping().standard_error(0.017, 0.005)[14] < 0.05


def test_known_constants_of_lodging_are_recovered_from_the_fitted_runs_alone() -> None:
    known = LodgingConstants(0.03, 4.0, 0.0205)
    observed = lodging_percent(tipping(), FORCE_N, known, PLANTER.scatter)
    observed[~FITTED] = 99.0
    found = fit_lodging(tipping(), FORCE_N, observed, FITTED, PLANTER.scatter)
    assert found == pytest.approx(known, rel=1e-4)


def test_sticking_and_tipping_exclude_each_other() -> None:
    """The shares of sticking and tipping are combined, not added, because a block that sticks does not fall."""
    constants = LodgingConstants(0.5, 0.0, 0.017)
    tips = tipping().share(constants.clearance_m, PLANTER.scatter.clearance_sd_m)
    expected = 100 * (0.5 + 0.5 * tips)
    assert lodging_percent(tipping(), FORCE_N, constants, PLANTER.scatter) == pytest.approx(expected)


def test_known_constants_of_injury_are_recovered_from_the_fitted_runs_alone() -> None:
    known = InjuryConstants(230.0, 70.0)
    observed = injury_percent(FORCE_N, known, PLANTER.scatter)
    observed[~FITTED] = 99.0
    assert fit_injury(FORCE_N, observed, FITTED, PLANTER.scatter) == pytest.approx(known, rel=1e-4)


def test_comparisons_use_the_fitted_runs_only() -> None:
    observed = EXPERIMENT.responses["Y1"]
    mean, linear, printed = comparisons(EXPERIMENT, "Y1", FITTED, observed)
    assert mean.percent == pytest.approx(observed[FITTED].mean())
    assert rms((linear.percent - observed)[FITTED]) < rms((mean.percent - observed)[FITTED])
    assert linear.percent[[14, 19]] == pytest.approx(observed[FITTED].mean())
    assert printed.percent is observed


def test_constants_in_planter_yaml_are_those_of_the_injury_fit() -> None:
    """The constants in the file agree with the fit to within rounding; its standard errors are several newtons."""
    found = fit_injury(FORCE_N, EXPERIMENT.responses["Y2"], FITTED, PLANTER.scatter)
    assert found.strength_n == pytest.approx(PLANTER.scatter.strength_n, abs=1.0)
    assert found.strength_sd_n == pytest.approx(PLANTER.scatter.strength_sd_n, abs=0.5)


def test_equal_settings_and_seeds_give_equal_falls() -> None:
    settings = np.array([[1.9, 57.0, 104.62], [1.6, 57.0, 104.62], [1.9, 57.0, 104.62]])
    falls = simulate_tipping(PLANTER, RANGES, settings, blocks=10, seed=3, workers=1)
    assert np.array_equal(falls.lodged[0], falls.lodged[2])
    assert falls.lodged[0].sum() > falls.lodged[1].sum() == 0
    assert falls.clearance_m[falls.lodged[0]].max() < 0.015
    again = simulate_tipping(PLANTER, RANGES, settings[1:], blocks=10, seed=3, workers=1)
    assert np.array_equal(again.lodged, falls.lodged[1:])


def test_too_few_blocks_are_rejected() -> None:
    with pytest.raises(StudyError, match="--trials 9: must be 10 or more"):
        simulate_tipping(PLANTER, RANGES, np.array([[1.9, 57.0, 104.62]]), blocks=9, seed=1)


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_constants_in_planter_yaml_are_those_of_the_lodging_fit() -> None:
    natural = to_natural(CABBAGE_FACTORS, EXPERIMENT.coded)
    falls = simulate_tipping(PLANTER, RANGES, natural, blocks=160, seed=1)
    found = fit_lodging(falls, FORCE_N, EXPERIMENT.responses["Y1"], FITTED, PLANTER.scatter)
    assert found.stick_share == pytest.approx(PLANTER.scatter.stick_share, abs=0.002)
    assert found.stick_exponent == pytest.approx(PLANTER.scatter.stick_exponent, abs=0.15)
    assert found.clearance_m == pytest.approx(PLANTER.bench_soil.clearance_m, abs=0.0015)
