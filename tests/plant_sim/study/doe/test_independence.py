"""Independence of the seedlings of the twin, by tray, row and claw: false alarms and power of the tests."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Hashable
from functools import cache
from statistics import fmean

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from plant_sim.crop.seedling import CELLS_ALONG, COLUMNS, Location, Seedling
from plant_sim.crop.traits import Traits, draw_traits
from plant_sim.study.doe.independence import FALSE_ALARMS, GROUPS, LossScatter, group_scatter, trial_scatter
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.trial import run_trial

Group = Callable[[Seedling], Hashable]

SHARED: dict[str, Group] = {
    "tray": lambda each: each.tray,
    "row": lambda each: (each.tray, each.column),
    "claw": lambda each: each.along,
}
"""Seedlings of equal value share a part of their traits, by group."""
SHAPE = (2, COLUMNS, CELLS_ALONG)
"""Trays, rows and claws of a trial."""


def share_traits(twin: Twin, seed: int, group: Group, correlation: float) -> None:
    """Correlate the traits of the seedlings of each group; every trait keeps its standard normal distribution."""
    for seedling in twin.plant.seedlings:
        common = draw_traits(random.Random(f"{seed}, {group(seedling)}"))
        own, shared = math.sqrt(1 - correlation), math.sqrt(correlation)
        mixed = (own * a + shared * b for a, b in zip(seedling.traits, common, strict=True))
        seedling.traits = Traits(*mixed)


def lost(seed: int, group: Group | None = None, correlation: float = 0.0) -> NDArray[np.bool_]:
    """Run a trial of the delivered machine; return which seedling of each tray, row and claw is lost."""
    twins: list[Twin] = []

    def prepare(twin: Twin) -> None:
        twins.append(twin)
        if group is not None:
            share_traits(twin, seed, group, correlation)

    assert run_trial(seed=seed, prepare=prepare).completed
    seedlings = twins[0].plant.seedlings
    outcomes = [
        [[each.location is not Location.IN_CUP for each in seedlings.column(tray, row)] for row in range(COLUMNS)]
        for tray in range(seedlings.trays)
    ]
    return np.array(outcomes)


@cache
def twin_trials(number: int) -> NDArray[np.bool_]:
    """Return the losses of trials of the delivered machine."""
    return np.array([lost(seed) for seed in range(1000, 1000 + number)])


def passes(found: dict[str, LossScatter]) -> bool:
    """Return whether no group fails together."""
    return all(each.is_independent(len(found)) for each in found.values())


def test_trials_of_the_twin_are_independent_by_tray_row_and_claw() -> None:
    assert passes(group_scatter(twin_trials(8), draws=599))


@pytest.mark.nightly
def test_many_trials_of_the_twin_are_independent_by_tray_row_and_claw() -> None:
    """300 trials, 43,200 seedlings: each dispersion is close to 1."""
    found = group_scatter(twin_trials(300))
    assert passes(found), found
    assert all(0.85 < each.dispersion < 1.15 for each in found.values()), found
    counts = twin_trials(300).sum(axis=(1, 2, 3))
    scatter = trial_scatter([counts], 144)
    assert scatter is not None
    assert scatter.is_independent(), scatter


@pytest.mark.nightly
@pytest.mark.parametrize("name", sorted(SHARED))
def test_a_shared_part_of_the_traits_is_found_in_its_group(name: str) -> None:
    """A correlation of the traits of 0.3 within each group: found in 40 trials."""
    failed = np.array([lost(seed, SHARED[name], 0.3) for seed in range(40)])
    found = group_scatter(failed, draws=999)
    assert not found[name].is_independent(len(GROUPS)), found


@pytest.mark.parametrize("tables", [12, pytest.param(600, marks=pytest.mark.nightly)])
def test_independent_losses_raise_the_stated_false_alarms(tables: int) -> None:
    """Rows and claws of different shares, as in the twin, but no seedling depends on another."""
    rng = np.random.default_rng(1)
    cells = rng.uniform(0.01, 0.12, SHAPE)
    alarms = sum(not passes(group_scatter(rng.random((12, *SHAPE)) < cells, draws=599)) for _ in range(tables))
    assert stats.binomtest(alarms, tables, FALSE_ALARMS, alternative="greater").pvalue > 0.001


def test_counts_of_trials_raise_the_stated_false_alarms() -> None:
    rng = np.random.default_rng(2)
    shares = rng.uniform(0.001, 0.2, 8)
    alarms, dispersions = 0, []
    for _ in range(300):
        scatter = trial_scatter([rng.binomial(144, share, 5) for share in shares], 144, draws=199)
        assert scatter is not None
        alarms += not scatter.is_independent()
        dispersions.append(scatter.dispersion)
    assert stats.binomtest(alarms, 300, FALSE_ALARMS, alternative="greater").pvalue > 0.001
    assert fmean(dispersions) == pytest.approx(1, abs=0.06)


def test_trials_that_share_a_loss_of_a_row_fail_the_test() -> None:
    """A row of 12 lost at once in every fourth trial, beside independent losses."""
    rng = np.random.default_rng(3)
    counts = rng.binomial(144, 0.05, 20) + 12 * (np.arange(20) % 4 == 0)
    scatter = trial_scatter([counts], 144)
    assert scatter is not None
    assert not scatter.is_independent()
    assert trial_scatter([np.array([0, 0, 0]), np.array([4])], 144) is None
