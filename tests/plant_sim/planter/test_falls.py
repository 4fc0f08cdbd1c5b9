"""Tests of random falls: ranges, table, neighbouring cells, sticking blocks and storage."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from plant_sim.planter.falls import (
    FREQUENCIES_PER_MIN,
    OPENERS_DEG,
    RATIOS,
    FallTable,
    Grid,
    default_table,
    fall_table,
    motion_at,
)
from plant_sim.planter.parameters import load_planter, load_ranges
from plant_sim.planter.scatter import Ground, draw
from plant_sim.planter.verdict import FallVerdict, Stand, verdict_of

PLANTER, RANGES = load_planter(), load_ranges()


def table(along_m: np.ndarray, *, kind: Ground = Ground.RIGID, stick_share: float = 0.0) -> FallTable:
    """Return a table of upright blocks at the given positions."""
    cells = np.zeros((len(FREQUENCIES_PER_MIN), len(RATIOS), len(OPENERS_DEG), 1, 4))
    cells[..., 0] = along_m
    planter = dataclasses.replace(PLANTER, scatter=dataclasses.replace(PLANTER.scatter, stick_share=stick_share))
    return FallTable(planter, kind, cells)


@pytest.mark.parametrize("kind", list(Ground))
def test_draws_are_within_their_ranges(kind: Ground) -> None:
    rng = np.random.default_rng(1)
    draws = [draw(PLANTER, RANGES, kind, rng) for _ in range(200)]
    masses = np.array([each.planter.block.cube_kg for each in draws])
    low, high = RANGES["block.cube_kg"]
    assert low <= masses.min() < low + 0.1 * (high - low)
    assert high - 0.1 * (high - low) < masses.max() <= high
    assert max(abs(each.opener_deg) for each in draws) <= PLANTER.scatter.opener_deg
    clearances = {each.ground.clearance_m for each in draws}
    assert (len(clearances) == 1) == (kind is Ground.RIGID)
    assert any(each.sticks for each in draws) == (kind is Ground.SOIL)


def test_equal_seeds_give_equal_draws() -> None:
    first, second = (draw(PLANTER, RANGES, Ground.SOIL, np.random.default_rng(3)) for _ in range(2))
    assert first == second


def test_value_between_grid_points_is_a_neighbour_weighted_by_distance() -> None:
    ratios = table(np.array(RATIOS)[:, None, None])
    drawn = ratios.draw(np.full(4_000, 0.96), np.random.default_rng(1), frequency_per_min=58, opener_deg=75.0).along_m
    assert set(drawn) == {0.95, 1.00}
    assert (drawn == 1.00).mean() == pytest.approx(0.2, abs=0.03)
    exact = ratios.draw(np.full(100, 0.90), np.random.default_rng(1), frequency_per_min=58, opener_deg=75.0).along_m
    assert set(exact) == {0.90}


def test_value_outside_the_grid_is_marked() -> None:
    rng = np.random.default_rng(1)
    drawn = table(np.zeros(1)).draw([0.5, 1.0, 2.5], rng, frequency_per_min=58, opener_deg=75.0)
    assert drawn.within.tolist() == [False, True, False]
    assert not table(np.zeros(1)).draw([1.0], rng, frequency_per_min=58, opener_deg=20.0).within.any()
    drawn = table(np.zeros(1)).draw(np.ones(4), rng, frequency_per_min=[29.0, 30.0, 66.0, 67.0])
    assert drawn.within.tolist() == [False, True, True, False]


def test_clamp_force_beyond_the_tested_ones_is_marked_on_soil() -> None:
    """The share of sticking blocks is fitted to forces of 89.95 to 119.29 N; on rigid ground no block sticks."""
    for kind, expected in ((Ground.SOIL, [False, True, True, False]), (Ground.RIGID, [True] * 4)):
        drawn = [
            table(np.zeros(1), kind=kind).draw([1.0], np.random.default_rng(1), frequency_per_min=58, clamp_n=clamp_n)
            for clamp_n in (89.0, 89.95, 119.29, 120.0)
        ]
        assert [bool(each.within.all()) for each in drawn] == expected


def test_frequency_between_grid_points_is_a_neighbour_weighted_by_distance() -> None:
    frequencies = table(np.array(FREQUENCIES_PER_MIN)[:, None, None, None])
    drawn = frequencies.draw(np.ones(4_000), np.random.default_rng(1), frequency_per_min=35.5).along_m
    assert set(drawn) == {30.0, 52.0}
    assert (drawn == 52.0).mean() == pytest.approx(0.25, abs=0.03)


def tipped_directly(ratios: tuple[float, ...], frequency_per_min: float, draws: int) -> int:
    """Return the number of new random blocks that tip forward with full contact."""
    tipped = 0
    rng = np.random.default_rng(11)
    for ratio in ratios:
        motion = motion_at(PLANTER, ratio, frequency_per_min)
        for _ in range(draws):
            fall = draw(PLANTER, RANGES, Ground.RIGID, rng).fall(motion, 75.0)
            tipped += verdict_of(fall.tilt_deg, fall.pushed_m) is FallVerdict.FORWARD
    return tipped


@pytest.mark.parametrize(
    ("frequency_per_min", "draws"),
    [
        (30.0, 25),
        pytest.param(38.0, 150, marks=pytest.mark.nightly),
        pytest.param(58.0, 150, marks=pytest.mark.nightly),
    ],
)
def test_share_that_tips_agrees_with_direct_simulation(frequency_per_min: float, draws: int) -> None:
    """At low ratios, most blocks tip at 58 plants per minute and few at 30.

    The difference of the shares is within 3.5 standard errors of both samples; between grid points, 10 percentage
    points are added for the linear interpolation.
    """
    ratios = (0.85, 0.90)
    stored = default_table(Ground.RIGID)
    shares = [stored.verdict_shares_at(ratio, 75.0, frequency_per_min)[0][FallVerdict.FORWARD] for ratio in ratios]
    expected, number = float(np.mean(shares)), len(ratios) * draws
    found = tipped_directly(ratios, frequency_per_min, draws) / number
    error = np.sqrt(0.25 * (1 / number + 1 / (len(ratios) * stored.grid.blocks)))
    between = 0.0 if frequency_per_min in FREQUENCIES_PER_MIN else 0.1
    assert abs(found - expected) < 3.5 * error + between
    assert frequency_per_min > 40 or expected < 0.65


def test_sticking_share_depends_on_the_clamp_force_and_on_the_ground() -> None:
    soil = table(np.zeros(1), kind=Ground.SOIL, stick_share=0.1)
    scatter, count = soil.planter.scatter, 20_000
    for clamp_n in (89.95, 104.62, 119.29):
        drawn = soil.draw(np.ones(count), np.random.default_rng(2), frequency_per_min=58, clamp_n=clamp_n)
        share = scatter.stick_share_at(clamp_n)
        assert (drawn.stand == Stand.LODGED).mean() == pytest.approx(share, abs=4 * (share / count) ** 0.5)
    rigid = table(np.zeros(1), stick_share=0.5).draw(np.ones(100), np.random.default_rng(2), frequency_per_min=58)
    assert (rigid.stand == Stand.UPRIGHT).all()


def test_depth_is_that_of_the_furrow() -> None:
    falls_of = default_table(Ground.SOIL).draw(np.ones(2_000), np.random.default_rng(1), frequency_per_min=58)
    chain, soil = PLANTER.chain, PLANTER.bench_soil
    tip_m = chain.sprocket_radius_m + chain.tip_height_m - chain.axle_height_m
    assert falls_of.depth_m.mean() == pytest.approx(tip_m + soil.clearance_m, abs=0.0005)
    assert falls_of.depth_m.std() == pytest.approx(PLANTER.scatter.clearance_sd_m, rel=0.05)


def test_default_table_contains_the_paper_verdicts() -> None:
    """On rigid ground, most blocks tip at a ratio of 0.85, few at 1 and none at 1.17."""
    lodged = default_table(Ground.RIGID).verdict_share(FallVerdict.FORWARD, 58)[:, OPENERS_DEG.index(75.0)]
    by_ratio = dict(zip(RATIOS, lodged, strict=True))
    assert by_ratio[0.85] > 0.9
    assert by_ratio[1.00] < 0.1
    assert by_ratio[1.17] == 0.0


def test_table_of_other_parameters_is_built_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    grid = Grid(ratios=(0.87, 1.17), openers_deg=(75.0, 80.0), blocks=2, frequencies_per_min=(56.0, 58.0))
    done: list[tuple[int, int]] = []
    built = fall_table(PLANTER, RANGES, Ground.RIGID, grid=grid, progress=lambda *step: done.append(step))
    assert done == [(number, 4) for number in range(1, 5)]
    assert built.draw([0.87, 1.17], np.random.default_rng(1), frequency_per_min=58).stand.tolist() == [
        Stand.LODGED,
        Stand.UPRIGHT,
    ]
    again = fall_table(PLANTER, RANGES, Ground.RIGID, grid=grid, progress=lambda *step: done.append(step))
    assert len(done) == 4
    assert np.array_equal(built.cells, again.cells)
    assert not list(tmp_path.rglob("*.part"))


@pytest.mark.parametrize(
    ("tilt_deg", "pushed_m", "verdict"),
    [
        (0.0, 0.0009, FallVerdict.CLEAN),
        (29.0, -0.0011, FallVerdict.PUSHED),
        (-30.0, 0.0, FallVerdict.TILTED),
        (60.0, 0.0, FallVerdict.FORWARD),
        (-60.0, 0.0, FallVerdict.BACKWARD),
    ],
)
def test_limits_of_the_verdicts(tilt_deg: float, pushed_m: float, verdict: FallVerdict) -> None:
    assert verdict_of(tilt_deg, pushed_m) is verdict
