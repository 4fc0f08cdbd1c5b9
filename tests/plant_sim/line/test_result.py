"""Result of a line: release forecast, catch window, limits of the models, assumed values."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from plant_sim.line.command import line_result
from plant_sim.line.planting import ChainPlanter
from plant_sim.line.release import SPACINGS_M, forecasts
from plant_sim.line.result import LineResult
from plant_sim.machine.parameters import load_machine
from plant_sim.planter.falls import default_table
from plant_sim.planter.ratio import Regime
from plant_sim.planter.scatter import Ground
from plant_sim.planter.verdict import Stand


def result(name: str, metres: float, profile: Path | None = None) -> LineResult:
    return line_result(name, profile=profile, metres=metres, seed=1, machine=load_machine(), repeat=1)


@pytest.fixture(scope="module")
def combined() -> LineResult:
    return result("combined", 150.0)


@pytest.fixture(scope="module")
def cabbage() -> LineResult:
    return result("cabbage", 2_000.0)


def test_the_target_spacing_determines_lambda_and_the_release() -> None:
    """35, 40, 45 and 50 cm require 1.398, 1.223, 1.087 and 0.979; the paper requires at least 1.17."""
    table = default_table(Ground.SOIL)
    each = forecasts(SPACINGS_M, ChainPlanter(table, 104.62), speed_m_s=0.42, seed=1)
    assert [forecast.ratio for forecast in each] == pytest.approx([1.398, 1.223, 1.087, 0.979], abs=5e-4)
    assert [forecast.record()["clean_by_paper"] for forecast in each] == [True, True, False, False]
    assert [forecast.is_clean for forecast in each] == [True, True, False, False]
    assert [forecast.regime for forecast in each] == [Regime.TROCHOID] * 3 + [Regime.SHORTENED_CYCLOID]
    assert "40 cm requires lambda 1.223" in each[1].text()
    assert "release clean" in each[1].text()
    (beyond,) = forecasts((0.20,), ChainPlanter(table, 104.62), speed_m_s=0.20, seed=1)
    assert beyond.text().endswith("extrapolated")
    assert [each.within for each in forecasts((0.40,), ChainPlanter(table, 104.62), speed_m_s=0.46, seed=1)] == [False]


@pytest.mark.parametrize("clamp_n", [89.95, 119.29])
def test_the_clamp_force_changes_the_share_of_sticking_blocks(clamp_n: float) -> None:
    """At a high lambda, only sticking blocks lodge; their share follows from the parameters of the planter."""
    planter = ChainPlanter(default_table(Ground.SOIL), clamp_n)
    number = 20_000
    falls = planter.draw(np.full(number, 1.4), np.random.default_rng(2), frequency_per_min=58)
    share = planter.table.planter.scatter.stick_share_at(clamp_n)
    lodged = np.count_nonzero(falls.stand == Stand.LODGED)
    assert lodged == pytest.approx(share * number, abs=5 * math.sqrt(share * number))


@pytest.mark.nightly
def test_the_needed_window_follows_from_the_scatter_of_the_chute(combined: LineResult) -> None:
    """The scatter of 25 ms is 1.87 % of a cycle; 99.9 % of a normal distribution is within 3.29 SD."""
    frequency_hz = 1.13 / 3.6 / 0.42
    assert combined.needed_window == pytest.approx(2 * 3.29 * 0.025 * frequency_hz, rel=0.15)
    assert combined.window == 0.15
    assert combined.missing["handover"] == 0


def test_injury_is_stated_for_cabbage_blocks_only(cabbage: LineResult) -> None:
    combined = result("combined", 5.0)
    assert "injured" not in combined.rates
    assert all(row.injured is None for row in combined.rows)
    assert (
        "limit: injury is not modelled: equation 11 of the cabbage paper holds for cabbage blocks only"
        in combined.text()
    )
    assert "injured" in cabbage.rates
    assert cabbage.extrapolated_injuries > 0
    first, _ = cabbage.text().split("row judged", 1)
    assert f"OUTSIDE: {cabbage.extrapolated_injuries:,} of {cabbage.plants:,} injuries" in first


def test_lodging_and_injury_of_the_cabbage_line_agree_with_its_sources(cabbage: LineResult) -> None:
    """Lodging equals the share of sticking blocks at 91.83 N; injury equals equation 11 at 1.5 km/h and 59.5/min."""
    low, high = cabbage.rates["lodged"].interval_percent
    assert low < 100 * default_table(Ground.SOIL).planter.scatter.stick_share_at(91.83) < high
    low, high = cabbage.rates["injured"].interval_percent
    x1, x2, x3 = (1.5 - 1.75) / 0.15, 1.52, (91.83 - 104.62) / 8.79
    assert low < 4.08 - 0.066 * x1 + 0.68 * x2 + 0.95 * x3 + 0.37 * x2 * x3 < high


def test_the_lambda_range_follows_from_the_slip(cabbage: LineResult) -> None:
    """The gear is set for 5 % slip at 42 cm; one standard deviation of the slip, 1 %, changes lambda by 1.05 %."""
    assert cabbage.ratios is not None
    low, high = cabbage.ratios
    middle = 0.48934 / 0.42
    assert low < middle < high
    assert (high - low) / middle == pytest.approx(2 * 3.2 * 0.01 / 0.95, rel=0.25)


def test_a_ground_file_replaces_the_assumptions_of_the_line(tmp_path: Path) -> None:
    path = tmp_path / "ground.yaml"
    path.write_text('segments:\n  - {speed: "1.2 km/h, assumed", over: 50 m}\n', encoding="utf-8")
    done = result("cabbage", 20.0, path)
    of_ground = [each for each in done.assumed if each.startswith("ground.")]
    assert of_ground == ["ground.segments[1].speed 1.2 km/h"]
    assert "spacing 42 cm" in done.assumed


def test_a_result_represents_itself_in_one_line(cabbage: LineResult) -> None:
    text = repr(cabbage)
    assert text.startswith(f"<LineResult {cabbage.title}, seed 1: rows 1 x 2000 m, {cabbage.plants} plants, ")
    assert text.endswith(f"plants/h, quality of feed {cabbage.spacing.quality.text()}>")
