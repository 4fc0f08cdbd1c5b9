"""Tests of the packaged tables of falls, their storage, and the report on the falls."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from plant_sim.planter.contact import drop
from plant_sim.planter.fall_report import FallReport
from plant_sim.planter.falls import (
    BLOCKS,
    FREQUENCIES_PER_MIN,
    OPENERS_DEG,
    PACKAGED,
    RATIOS,
    FallTable,
    Grid,
    build_cells,
    cell_values,
    default_table,
    drawn_blocks,
    motion_at,
    stored_table,
    table_name,
    write_table,
)
from plant_sim.planter.motion import Motion
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.parameters import load_planter, load_ranges
from plant_sim.planter.scatter import Ground
from plant_sim.planter.verdict import FallVerdict, verdict_of, verdicts_of

PLANTER, RANGES = load_planter(), load_ranges()
TOLERANCE = 1e-4
"""Difference from the stored values, which have single precision, m or degrees."""
SAME = 0.95
"""Share of the falls that must be the same: other processors may round differently, and a block that nearly tips may
then fall the other way."""


def fresh(kind: Ground, frequency_per_min: float, ratio: float, opener_deg: float, blocks: int) -> np.ndarray:
    motion = motion_at(PLANTER, ratio, frequency_per_min)
    return np.array(
        [cell_values(each, motion, opener_deg) for each in drawn_blocks(PLANTER, RANGES, kind, BLOCKS)[:blocks]]
    )


def same_share(simulated: np.ndarray, stored: np.ndarray) -> float:
    """Return the share of the falls whose results are all within the tolerance."""
    return float(np.isclose(simulated, stored, rtol=TOLERANCE, atol=TOLERANCE).all(axis=-1).mean())


def test_package_contains_one_current_table_for_each_ground() -> None:
    """The packaged tables match the default parameters.

    Together they are small: the package is installed on industrial PCs. If this test fails, run
    ``python -m plant_sim planter --falls plant_sim/planter/data`` and delete the old files.
    """
    assert {path.name for path in PACKAGED.iterdir()} == {table_name(PLANTER, RANGES, kind) for kind in Ground}
    assert sum(path.stat().st_size for path in PACKAGED.iterdir()) < 2e6


@pytest.mark.parametrize("kind", list(Ground))
def test_sampled_cells_equal_fresh_simulations(kind: Ground) -> None:
    rng = np.random.default_rng(5)
    shares = []
    for layer, frequency_per_min in enumerate(FREQUENCIES_PER_MIN):
        row, column = int(rng.integers(len(RATIOS))), int(rng.integers(len(OPENERS_DEG)))
        stored = default_table(kind).cells[layer, row, column, :8]
        shares.append(same_share(fresh(kind, frequency_per_min, RATIOS[row], OPENERS_DEG[column], 8), stored))
    assert float(np.mean(shares)) >= SAME


def test_cells_are_in_the_order_of_the_axes() -> None:
    grid = Grid((0.87, 1.17), (75.0, 120.0), 2, (30.0, 66.0))
    cells, blocks = build_cells(PLANTER, RANGES, Ground.SOIL, grid=grid), drawn_blocks(PLANTER, RANGES, Ground.SOIL, 2)
    for layer, row, column, block in ((0, 0, 1, 0), (1, 0, 0, 1), (1, 1, 1, 1)):
        motion = motion_at(PLANTER, grid.ratios[row], grid.frequencies_per_min[layer])
        expected = cell_values(blocks[block], motion, grid.openers_deg[column])
        assert cells[layer, row, column, block].tolist() == list(expected)


@pytest.mark.nightly
@pytest.mark.timeout(2400)
@pytest.mark.parametrize("kind", list(Ground))
def test_all_cells_equal_fresh_simulations(kind: Ground) -> None:
    stored = default_table(kind).cells
    assert same_share(build_cells(PLANTER, RANGES, kind), stored) >= SAME


def test_written_table_is_found_in_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    grid = Grid(ratios=(1.17, 1.3), openers_deg=(75.0, 80.0), blocks=1, frequencies_per_min=(56.0, 58.0))
    assert stored_table(PLANTER, RANGES, Ground.SOIL, grid=grid) is None
    path = write_table(PLANTER, RANGES, Ground.SOIL, tmp_path / "seedling-transplanter", grid=grid)
    assert path.name == table_name(PLANTER, RANGES, Ground.SOIL, grid)
    table = stored_table(PLANTER, RANGES, Ground.SOIL, grid=grid)
    assert table is not None
    assert np.array_equal(table.cells, np.load(path))


def test_name_of_a_table_depends_on_what_its_cells_depend_on() -> None:
    changes = (
        {"bench_soil.clearance_m": 0.021},
        {"block.cube_kg": 0.051},
        {"scatter.place_m": 0.0004},
        {"scatter.pitch_deg": 2.0},
        {"scatter.uneven_s": 0.001},
        {"scatter.slope_deg": 1.0},
        {"scatter.clearance_sd_m": 0.004},
        {"chain.teeth": 27},
    )
    names = {table_name(PLANTER.with_values(change), RANGES, Ground.SOIL) for change in ({}, *changes)}
    assert len(names) == 1 + len(changes)
    stick = PLANTER.with_values({"scatter.stick_share": 0.2, "scatter.strength_n": 300.0})
    assert table_name(stick, RANGES, Ground.SOIL) in names


def test_shares_between_grid_points_are_interpolated_and_outside_marked() -> None:
    cells = np.zeros((len(FREQUENCIES_PER_MIN), len(RATIOS), len(OPENERS_DEG), 2, 5))
    cells[1:, RATIOS.index(1.0) :, :, 0, 2] = 80.0
    table = FallTable(PLANTER, Ground.RIGID, cells)
    shares, inside = table.verdict_shares_at(0.96, 75.0, 58.0)
    assert (shares[FallVerdict.FORWARD], shares[FallVerdict.CLEAN]) == pytest.approx((0.1, 0.9))
    assert inside
    shares, inside = table.verdict_shares_at(2.5, 75.0, 58.0)
    assert shares[FallVerdict.FORWARD] == 0.5
    assert not inside
    shares, inside = table.verdict_shares_at(1.0, 75.0, 35.5)
    assert shares[FallVerdict.FORWARD] == pytest.approx(0.125)
    assert inside
    shares, inside = table.verdict_shares_at(1.0, 75.0, 20.0)
    assert shares[FallVerdict.FORWARD] == 0.0
    assert not inside


def test_shares_of_the_verdicts_add_up_to_one() -> None:
    for kind in Ground:
        total = sum(default_table(kind).verdict_share(verdict, 45.0) for verdict in FallVerdict)
        assert np.asarray(total) == pytest.approx(1.0)


def test_verdicts_of_arrays_are_those_of_numbers() -> None:
    tilts_deg, pushes_m = np.array([0.0, 0.0, -40.0, 70.0, -70.0]), np.array([0.0005, 0.002, 0.0, 0.0, 0.02])
    one_by_one = [verdict_of(*pair) for pair in zip(tilts_deg.tolist(), pushes_m.tolist(), strict=True)]
    assert (
        verdicts_of(tilts_deg, pushes_m).tolist()
        == one_by_one
        == [
            FallVerdict.CLEAN,
            FallVerdict.PUSHED,
            FallVerdict.TILTED,
            FallVerdict.FORWARD,
            FallVerdict.BACKWARD,
        ]
    )


def test_block_that_the_guide_plate_does_not_touch_is_not_pushed() -> None:
    """With a late opener, the block lands with forward speed after the guide plate has moved away from it."""
    fall = drop(PLANTER, PLANTER.rigid_ground, motion_at(PLANTER, 0.87), opener_deg=135.0)
    assert fall.scrape_n_s == 0.0
    assert fall.pushed_m == 0.0
    early = drop(PLANTER, PLANTER.rigid_ground, motion_at(PLANTER, 1.0), opener_deg=75.0)
    assert early.scrape_n_s > 0.0
    assert early.pushed_m > 0.001


def report(speed_km_h: float, frequency_per_min: float = 58.0, model: MotionModel = MotionModel.RIGID) -> FallReport:
    motion = Motion(PLANTER.chain, speed_m_s=speed_km_h / 3.6, frequency_per_min=frequency_per_min, model=model)
    return FallReport(PLANTER, motion, 75.0, {kind: default_table(kind) for kind in Ground})


def test_report_has_verdicts_shares_and_equations() -> None:
    lines = report(1.75).lines()
    assert lines[0] == "falls, opener at 75°"
    assert lines[1] == "  rigid ground      default block: scraped and pushed, upright"
    assert lines[5].endswith("sticking to a plate: 4.7 % more lodge (bench soil)")
    assert lines[6].startswith(
        "grip                104.62 N holds the block, compressed by 5.2 mm; free 10.5 ms, open 20.5"
    )
    assert lines[7] == (
        "cabbage blocks      lodging 5.52 % (eq. 10), injury 4.08 % (eq. 11) at 104.62 N; not valid for pepper plugs"
    )


def test_report_marks_what_is_beyond_the_tested_levels_or_the_table() -> None:
    assert "; beyond the tested levels; " in report(1.4).lines()[-1]
    assert "outside the table" not in report(1.75).lines()[2]
    assert report(1.75, 100.0).lines()[2].endswith("; outside the table, nearest point of it")


def test_report_without_tables_or_in_another_model() -> None:
    without = report(1.75)
    without = FallReport(PLANTER, without.motion, 75.0, {})
    assert without.lines()[2].endswith("no table of these parameters; --falls DIR simulates it")
    falls = without.record()["falls"]
    assert isinstance(falls, dict)
    assert falls["bench_soil"]["shares"] is None
    other = report(1.75, model=MotionModel.CORRECTED)
    assert other.record()["falls"] is None
    assert other.lines()[0] == "falls               only simulated in model rigid"


def test_injured_share_is_a_normal_distribution() -> None:
    scatter = PLANTER.scatter
    assert scatter.injured_share_at(scatter.strength_n) == 0.5
    assert scatter.injured_share_at(scatter.strength_n - scatter.strength_sd_n) == pytest.approx(0.158655, abs=1e-6)
    assert 0.03 < scatter.injured_share_at(104.62) < 0.05
    assert default_table(Ground.SOIL).cells.shape[3] == BLOCKS
