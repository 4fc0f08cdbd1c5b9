"""Verdicts on rows: pass, fail and undecided by passes, targets, depth with and without the clearance, capacity."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from plant_sim.common.proportion import Proportion
from plant_sim.line.command import line_result
from plant_sim.line.file import LineFile, WorkEntry, find_line, load_line
from plant_sim.line.ground import SpeedProfile, Stretch
from plant_sim.line.judge.capacity import area_capacity
from plant_sim.line.judge.targets import RowCriterion, RowTargets, row_targets
from plant_sim.line.judge.verdicts import JudgedCriterion, PassValues, RowVerdict, pass_values, row_verdicts
from plant_sim.line.row import HandoverCount, PlantRow, TractorMotion
from plant_sim.line.run import LineRun
from plant_sim.machine.parameters import load_machine
from tests.plant_sim.line.test_indices import DOUBLE, INJURED, LODGED, TILTED, UPRIGHT, row_of

CABBAGE = find_line("cabbage").read_text(encoding="utf-8")
LINE = load_line(find_line("cabbage"))
TARGETS = row_targets(LINE.values, LINE.assumed)


def judged(passes: Sequence[PassValues], targets: RowTargets = TARGETS) -> dict[RowCriterion, JudgedCriterion]:
    return {each.criterion: each for each in row_verdicts(passes, targets, range(len(passes))).criteria}


def lodged(*hits: int, of: int = 1_000) -> JudgedCriterion:
    """Return the verdict on the lodged plants of several passes; the target is at most 5 %."""
    values = [PassValues({RowCriterion.LODGED: Proportion(each, of)}, {}) for each in hits]
    return judged(values)[RowCriterion.LODGED]


@pytest.mark.parametrize(
    ("hits", "verdict"),
    [
        ((20, 24, 22, 18), RowVerdict.PASS),
        ((80, 90, 85, 88), RowVerdict.FAIL),
        ((40, 55, 48, 52), RowVerdict.UNDECIDED),
        ((5, 90, 10, 8), RowVerdict.UNDECIDED),
        ((20,), RowVerdict.UNDECIDED),
    ],
)
def test_an_interval_between_passes_decides(hits: tuple[int, ...], verdict: RowVerdict) -> None:
    """Passes that scatter much, or a single one, decide nothing; plants are not the units."""
    assert lodged(*hits).verdict is verdict


def test_the_interval_is_that_of_students_t_between_the_passes() -> None:
    each = lodged(20, 60, 40, 20)
    low, high = stats.t.interval(0.95, 3, 0.035, stats.sem([0.02, 0.06, 0.04, 0.02]))
    assert each.value == pytest.approx(0.035)
    assert each.interval is not None
    assert each.interval == pytest.approx((low, high))


def test_equal_passes_have_at_least_the_binomial_interval() -> None:
    """Four passes without a loss of 10 plants each have an upper limit of 8.8 %, so that 5 % is not decided."""
    each = lodged(0, 0, 0, 0, of=10)
    assert each.interval == pytest.approx((0.0, 1 - 0.025 ** (1 / 40)))
    assert each.verdict is RowVerdict.UNDECIDED
    assert lodged(0, 0, 0, 0, of=100).verdict is RowVerdict.PASS


def test_the_values_of_a_pass_are_those_of_its_plants() -> None:
    row = row_of([UPRIGHT, UPRIGHT, TILTED, LODGED, INJURED, DOUBLE])
    row.scraped[0] = True
    row = dataclasses.replace(
        row,
        depth_m=np.array([0.060, 0.070, 0.081, 0.060, 0.070, 0.061]),
        handovers=(HandoverCount(TractorMotion.STEADY, 6, 1), HandoverCount(TractorMotion.STOPS, 2, 2)),
    )
    values, geometry = pass_values([row, row], TARGETS, spacing_m=0.4, clearance_m=0.022)
    assert values[RowCriterion.UPRIGHT] == Proportion(8, 12)
    assert (
        values[RowCriterion.TILTED] == values[RowCriterion.LODGED] == values[RowCriterion.SCRAPED] == Proportion(2, 12)
    )
    assert values[RowCriterion.QUALIFIED] == Proportion(2, 12)
    assert values[RowCriterion.HANDOVER] == Proportion(6, 16)
    assert values[RowCriterion.DEPTH_QUALIFIED] == Proportion(10, 12)
    assert values[RowCriterion.DEPTH_MEAN] == pytest.approx(0.067)
    assert geometry[RowCriterion.DEPTH_MEAN] == pytest.approx(0.045)
    assert geometry[RowCriterion.DEPTH_QUALIFIED] == Proportion(6, 12)
    sd_m = float(np.std(np.tile(row.depth_m, 2), ddof=1))
    assert values[RowCriterion.DEPTH_CV] == pytest.approx(sd_m / 0.067)
    assert geometry[RowCriterion.DEPTH_CV] == pytest.approx(sd_m / 0.045)
    without = pass_values([row], TARGETS, spacing_m=0.4, clearance_m=None)
    assert RowCriterion.SCRAPED not in without.values
    assert without.by_geometry == {}


def test_a_depth_that_depends_on_the_fitted_clearance_is_undecided() -> None:
    """72 mm with the clearance is within 40 to 80 mm; 50 mm without it is too, but 35 mm is not."""
    both = [
        PassValues({RowCriterion.DEPTH_MEAN: value}, {RowCriterion.DEPTH_MEAN: value - 0.022})
        for value in (0.072, 0.073)
    ]
    (each,) = judged(both).values()
    assert each.verdict is RowVerdict.PASS
    assert each.remark == "50.5 mm by the geometry of the planter alone"
    shallow = [each._replace(by_geometry={RowCriterion.DEPTH_MEAN: 0.035}) for each in both]
    (each,) = judged(shallow).values()
    assert each.verdict is RowVerdict.UNDECIDED


def test_plants_on_the_surface_have_no_coefficient_of_variation() -> None:
    """At a mean depth of 0, or above the soil by the geometry alone, the coefficient is unknown."""
    row = row_of([UPRIGHT] * 4)
    deep = dataclasses.replace(row, depth_m=np.array([0.019, 0.020, 0.020, 0.021]))
    flat = dataclasses.replace(row, depth_m=np.zeros(4))
    passes = [pass_values([deep], TARGETS, spacing_m=0.4, clearance_m=0.022)] * 2
    each = judged(passes)[RowCriterion.DEPTH_CV]
    assert each.verdict is RowVerdict.UNDECIDED
    assert each.remark == "unknown by the geometry of the planter alone"
    assert RowCriterion.DEPTH_CV not in judged([pass_values([flat], TARGETS, spacing_m=0.4, clearance_m=None)] * 2)


def line_with(tmp_path: Path, text: str, name: str = "cabbage") -> tuple[LineFile, tuple[str, ...]]:
    path = tmp_path / "line.yaml"
    path.write_text(find_line(name).read_text(encoding="utf-8") + text, encoding="utf-8")
    line = load_line(path)
    return line.values, line.assumed


def test_targets_are_the_users_or_assumed(tmp_path: Path) -> None:
    values, assumed = line_with(
        tmp_path, "targets: {lodged: 3 %, upright: '95 %, assumed', depth: 50 mm, depth_tolerance: 10 mm}\n"
    )
    targets = row_targets(values, assumed)
    of = targets.by_criterion
    assert of[RowCriterion.LODGED].bounds.text == "at most 3 %"
    assert not of[RowCriterion.LODGED].is_assumed
    assert of[RowCriterion.UPRIGHT].bounds.low == 0.95
    assert of[RowCriterion.UPRIGHT].is_assumed
    assert of[RowCriterion.DEPTH_MEAN].bounds[:2] == pytest.approx((0.04, 0.06))
    assert not of[RowCriterion.DEPTH_MEAN].is_assumed
    assert of[RowCriterion.SPACING_MEAN].bounds[:2] == pytest.approx((0.378, 0.462))
    assert of[RowCriterion.SPACING_MEAN].is_assumed
    assert RowCriterion.HANDOVER not in of
    assert "targets.lodged 5 % (default)" not in assumed
    assert "targets.tilted 10 % (default)" in assumed
    assert "work.turn 30 s (default)" in assumed


def test_the_limit_of_the_chutes_is_a_target() -> None:
    line = load_line(find_line("combined"))
    target = row_targets(line.values, line.assumed).by_criterion[RowCriterion.HANDOVER]
    assert (target.bounds.text, target.is_assumed) == ("at most 1 %", True)
    assert "chute.most_lost 1 % (default)" in line.assumed


def test_a_row_that_leans_and_was_scraped_fails(tmp_path: Path) -> None:
    """At 55 cm, λ is 0.89: of the upright plants most were scraped. The headline states it, and no rate hides it."""
    path = tmp_path / "line.yaml"
    path.write_text(CABBAGE.replace("42 cm, assumed", "55 cm"), encoding="utf-8")
    done = line_result(str(path), metres=150.0, seed=1)
    assert done.verdicts.verdict is RowVerdict.FAIL
    headline = next(line for line in done.text().splitlines() if line.startswith("row judged: FAIL"))
    for name in ("qualified", "upright", "tilted", "scraped"):
        assert name in headline.partition("undecided")[0]
    assert done.rates["qualified"].percent < 15.0
    record = json.loads(json.dumps(done.record(), allow_nan=False))["judged"]
    assert record["seeds"] == [1, 2, 3, 4, 5]
    assert record["verdict"] == "fail"
    assert {each["name"] for each in record["criteria"]} == {*RowCriterion} - {RowCriterion.HANDOVER}
    assert sum(line.endswith(("pass", "fail", "undecided", "alone")) for line in done.verdicts.lines()) == 14


def test_further_passes_do_not_change_the_row() -> None:
    one, three = (line_result("cabbage", metres=20.0, seed=4, repeat=number) for number in (1, 3))
    assert np.array_equal(one.rows[0].position_m, three.rows[0].position_m)
    assert one.verdicts.verdict is RowVerdict.UNDECIDED
    assert one.verdicts.lines()[0] == "judged by one pass, seed 4: no interval; increase --repeat"
    assert one.verdicts.headline() == "row judged: UNDECIDED, by one pass"
    assert three.verdicts.seeds == (4, 5, 6)
    spacing = next(each for each in three.verdicts.criteria if each.criterion is RowCriterion.SPACING_MEAN)
    assert spacing.interval is not None
    assert spacing.interval[0] < spacing.value - 1e-6 < spacing.value + 1e-6 < spacing.interval[1]


def run_of(row: PlantRow, rows: int, air_l_min: float | None) -> LineRun:
    profile = SpeedProfile([Stretch(0.3, for_m=50.0)], acceleration_m_s2=0.3, length_m=50.0)
    return LineRun((row,) * rows, (), None, (), profile, air_l_min=air_l_min)


def test_the_area_capacity_includes_headlands_and_reloading() -> None:
    """Rows of 100 m with 251 plants each take 333 s; 30 s on the headland and 502/1,000 of 300 s are added."""
    row = row_of([UPRIGHT] * 251)
    work = WorkEntry.model_validate({"row_length": "200 m", "turn": "30 s", "load": "1000", "reload": "300 s"})
    found = area_capacity(work, run_of(row, 2, 120.0), load_machine(), metres=100.0)
    assert found is not None
    planting_s, reload_s = 2 * 250 / 0.75, 300 * 4 * 251 / 1000
    whole_s = planting_s + 30 + reload_s
    assert found.width_m == pytest.approx(1.2)
    assert found.ha_per_h == pytest.approx(1.2 * 200 / 1e4 * 3600 / whole_s)
    assert found.plants_per_h == pytest.approx(4 * 251 * 3600 / whole_s)
    assert found.efficiency + found.turning + found.reloading == pytest.approx(1.0)
    assert found.air_l_per_1000 == pytest.approx(120 * planting_s / 60 / (4 * 251) * 1000)
    assert found.air_l_per_1000 is not None
    isothermal_j = 101_325 * found.air_l_per_1000 / 1000 * math.log(1 + 0.70e6 / 101_325)
    assert found.kwh_per_1000 == pytest.approx(isothermal_j / 0.5 / 3.6e6)
    assert len(found.lines()) == 2


def test_a_line_without_arms_has_no_air() -> None:
    found = area_capacity(WorkEntry(), run_of(row_of([UPRIGHT] * 9), 1, None), load_machine(), metres=3.2)
    assert found is not None
    assert (found.air_l_per_1000, found.kwh_per_1000) == (None, None)
    assert len(found.lines()) == 1
    alone = run_of(row_of([UPRIGHT]), 1, None)
    assert area_capacity(WorkEntry(), alone, load_machine(), metres=3.2) is None
