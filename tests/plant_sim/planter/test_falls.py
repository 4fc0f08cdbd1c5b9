"""Tests of random falls: ranges, table, neighbouring cells, sticking blocks and storage."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from plant_sim.planter.falls import OPENERS_DEG, RATIOS, FallTable, Grid, default_table, fall_table
from plant_sim.planter.parameters import load_planter, load_ranges
from plant_sim.planter.scatter import Ground, draw
from plant_sim.planter.verdict import FallVerdict, Stand, verdict_of

PLANTER, RANGES = load_planter(), load_ranges()


def table(along_m: np.ndarray, *, kind: Ground = Ground.RIGID, stick_share: float = 0.0) -> FallTable:
    """Return a table of upright blocks at the given positions."""
    cells = np.zeros((len(RATIOS), len(OPENERS_DEG), 1, 4))
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
    assert max(abs(each.behind_m) for each in draws) <= PLANTER.scatter.place_m
    assert max(abs(each.opener_deg) for each in draws) <= PLANTER.scatter.opener_deg
    clearances = {each.ground.clearance_m for each in draws}
    assert (len(clearances) == 1) == (kind is Ground.RIGID)
    assert any(each.sticks for each in draws) == (kind is Ground.SOIL)


def test_equal_seeds_give_equal_draws() -> None:
    first, second = (draw(PLANTER, RANGES, Ground.SOIL, np.random.default_rng(3)) for _ in range(2))
    assert first == second


def test_value_between_grid_points_is_a_neighbour_weighted_by_distance() -> None:
    ratios = table(np.array(RATIOS)[:, None, None])
    drawn = ratios.draw(np.full(4_000, 0.96), np.random.default_rng(1), opener_deg=75.0).along_m
    assert set(drawn) == {0.95, 1.00}
    assert (drawn == 1.00).mean() == pytest.approx(0.2, abs=0.03)
    exact = ratios.draw(np.full(100, 0.90), np.random.default_rng(1), opener_deg=75.0).along_m
    assert set(exact) == {0.90}


def test_value_outside_the_grid_is_marked() -> None:
    drawn = table(np.zeros(1)).draw([0.5, 1.0, 2.5], np.random.default_rng(1), opener_deg=75.0)
    assert drawn.within.tolist() == [False, True, False]
    assert not table(np.zeros(1)).draw([1.0], np.random.default_rng(1), opener_deg=20.0).within.any()


def test_sticking_share_depends_on_the_clamp_force_and_on_the_ground() -> None:
    soil = table(np.zeros(1), kind=Ground.SOIL, stick_share=0.1)
    scatter, count = soil.planter.scatter, 20_000
    for clamp_n in (89.95, 104.62, 119.29):
        drawn = soil.draw(np.ones(count), np.random.default_rng(2), clamp_n=clamp_n)
        share = scatter.stick_share_at(clamp_n)
        assert (drawn.stand == Stand.LODGED).mean() == pytest.approx(share, abs=4 * (share / count) ** 0.5)
    rigid = table(np.zeros(1), stick_share=0.5).draw(np.ones(100), np.random.default_rng(2))
    assert (rigid.stand == Stand.UPRIGHT).all()


def test_depth_is_that_of_the_furrow() -> None:
    falls_of = default_table(Ground.SOIL).draw(np.ones(2_000), np.random.default_rng(1))
    chain, soil = PLANTER.chain, PLANTER.bench_soil
    tip_m = chain.sprocket_radius_m + chain.tip_height_m - chain.axle_height_m
    assert falls_of.depth_m.mean() == pytest.approx(tip_m + soil.clearance_m, abs=0.002)


def test_default_table_contains_the_paper_verdicts() -> None:
    """On rigid ground, most blocks tip at a ratio of 0.85, few at 1 and none at 1.17."""
    lodged = default_table(Ground.RIGID).verdict_share(FallVerdict.FORWARD)[:, OPENERS_DEG.index(75.0)]
    by_ratio = dict(zip(RATIOS, lodged, strict=True))
    assert by_ratio[0.85] > 0.9
    assert by_ratio[1.00] < 0.1
    assert by_ratio[1.17] == 0.0


def test_table_of_other_parameters_is_built_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    grid = Grid(ratios=(0.87, 1.17), openers_deg=(75.0, 80.0), blocks=2)
    done: list[tuple[int, int]] = []
    built = fall_table(PLANTER, RANGES, Ground.RIGID, grid=grid, progress=lambda *step: done.append(step))
    assert done == [(1, 2), (2, 2)]
    assert built.draw([0.87, 1.17], np.random.default_rng(1)).stand.tolist() == [Stand.LODGED, Stand.UPRIGHT]
    again = fall_table(PLANTER, RANGES, Ground.RIGID, grid=grid, progress=lambda *step: done.append(step))
    assert len(done) == 2
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
