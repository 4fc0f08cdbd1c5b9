"""Experiments of the pepper paper on the twin: settings, pooled shares, statements and optimum."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from controller.common.document.parts import Picture, Table
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.cli.options.study import add_arguments
from plant_sim.cli.study.command import run as study_command
from plant_sim.common.paper_sheet import sheet
from plant_sim.crop.response import CropSpec
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.study import fleet
from plant_sim.study.errors import StudyError
from plant_sim.study.factors import FactorSetting
from plant_sim.study.pepper.calibration import shares_at
from plant_sim.study.pepper.experiment import PooledResult, point_of, setting_of
from plant_sim.study.pepper.nominal import NominalMotion, nominal_motion, observed_rows
from plant_sim.study.pepper.response_surface import rsm_study
from plant_sim.study.pepper.single_factor import _statements_table, single_study
from plant_sim.study.pepper.statements import STATEMENTS
from plant_sim.study.report.study import Study
from plant_sim.study.runner import RunOptions, trial_seed
from plant_sim.twin.repeats import pool
from plant_sim.twin.report import TrialReport, make_report
from tests.sampling import first_of

MACHINE = load_machine()
MANY = 72_000
"""Number of seedlings for which the counts match the expected shares almost exactly."""
OPTIONS = RunOptions(trials=2, seed=5, workers=1, machine=MACHINE, io_map=load_io_map(DEFAULT_IO_MAP), seedlings=MANY)
LEVELS = {
    "foam": [(foam, 52.0, 0.45) for foam in (2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 17.5)],
    "age": [(12.5, age, 0.45) for age in (40.0, 43.0, 46.0, 49.0, 52.0, 55.0, 58.0)],
    "pressure": [(12.5, 52.0, mpa) for mpa in (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75)],
}
"""Settings of the single-factor tests: section 3.3 of the paper, docs/sources/machine.md 5."""
TABLE_3 = {
    "foam_thickness_mm": (6.51, 8.4, 12.0, 15.6, 17.49),
    "seedling_age_d": (42.375, 45.0, 50.0, 55.0, 57.625),
    "claw_pressure_mpa": (0.25175, 0.32, 0.45, 0.58, 0.64825),
}
"""Natural levels of the codes -1.525, -1, 0, 1, 1.525."""


def trial(P: int, D: int, T: int, *, of: int, seed: int = 1, reason: str = "") -> TrialReport:  # noqa: N803
    """Return the report of a trial with the given numbers of failed seedlings."""
    counts = SeedlingCounts(in_tray=0, in_claw=0, in_cups=of - P - D - T, P=P, D=D, T=T, total=of)
    return make_report(seed=seed, counts=counts, events=[], reason=reason, simulated_s=1.0, wall_s=0.0)


class Expected:
    """Substitute for a trial: seedlings fail at the expected rates, and every setting is recorded."""

    def __init__(self) -> None:
        self.motion: NominalMotion = nominal_motion(MACHINE)
        self.asked: list[tuple[int, int, Machine]] = []

    def __call__(self, *, seed: int, seedlings: int, parameters: Machine, **_: object) -> TrialReport:
        self.asked.append((seed, seedlings, parameters))
        crop = parameters.crop
        shares = shares_at(
            parameters.seedling, self.motion, crop.foam_thickness_mm, crop.seedling_age_d, crop.claw_pressure_mpa
        )
        lost = (round(seedlings * np.asarray(each).item()) for each in shares[:3])
        return trial(*lost, of=seedlings, seed=seed)


@cache
def expected() -> Expected:
    """Return the substitute that all tests share."""
    return Expected()


@pytest.fixture
def no_chance(monkeypatch: pytest.MonkeyPatch) -> Expected:
    """Replace the trials with trials that have no random scatter."""
    stand_in = expected()
    stand_in.asked.clear()
    monkeypatch.setattr(fleet, "run_trial", stand_in)
    return stand_in


@cache
def typical(study: Callable[[RunOptions], Study]) -> Study:
    """Return a study without random scatter, run once for all tests that only read it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fleet, "run_trial", expected())
        return study(OPTIONS)


def tables(study: Study) -> dict[str, Table]:
    return {part.name: part for part in study.parts if isinstance(part, Table)}


def pictures(study: Study) -> set[str]:
    return {part.name for part in study.parts if isinstance(part, Picture)}


def natural(machine: Machine) -> tuple[float, float, float]:
    crop = machine.crop
    return crop.foam_thickness_mm, crop.seedling_age_d, crop.claw_pressure_mpa


# --- settings


def test_a_setting_contains_the_factors_of_the_paper_only() -> None:
    assert setting_of((10, 51, 0.4), MACHINE) == FactorSetting(
        {"crop.foam_thickness_mm": 10.0, "crop.seedling_age_d": 51.0, "crop.claw_pressure_mpa": 0.4}
    )


@pytest.mark.parametrize(
    ("mpa", "is_raised"), [(0.59, False), (0.60, False), (0.601, True), (0.65, True), (0.75, True)]
)
def test_the_compressor_pressure_is_raised_if_its_margin_is_too_small(mpa: float, is_raised: bool) -> None:
    """The compressor starts at 0.65 MPa; the regulator of the claws needs a margin of 0.05 MPa."""
    values = setting_of((10, 51, mpa), MACHINE).values
    raised = {name: value for name, value in values.items() if name.startswith("supply.")}
    wanted = {"supply.compressor_on_pa": 1e6 * mpa + 5e4, "supply.compressor_off_pa": 1e6 * mpa + 15e4}
    assert raised == (pytest.approx(wanted) if is_raised else {})


def test_a_sufficient_compressor_pressure_is_unchanged() -> None:
    strong = MACHINE.with_values({"supply.compressor_on_pa": 0.85e6, "supply.compressor_off_pa": 0.95e6})
    assert len(setting_of((10, 51, 0.75), strong).values) == 3


@pytest.mark.parametrize("mpa", first_of([0.75, 0.60, 0.65]))
def test_the_fingers_reach_the_force_of_every_pressure(mpa: float) -> None:
    """The force follows from a moment of 0.39 N m at 0.5 MPa, in proportion to the pressure, and a lever of 40 mm."""
    rows = observed_rows(setting_of((12.5, 52, mpa), MACHINE).machine(MACHINE))
    assert [row.force_n for row in rows] == pytest.approx([0.78 * mpa / 0.040] * len(rows), rel=1e-3)
    assert len(rows) >= 12


def test_the_fingers_do_not_reach_the_force_with_the_default_compressor() -> None:
    rows = observed_rows(MACHINE.with_values({"crop.claw_pressure_mpa": 0.75}))
    assert min(row.force_n for row in rows) < 0.98 * 0.78 * 0.75 / 0.040


# --- pooling of trials


def test_trials_at_a_setting_are_pooled_seedling_by_seedling() -> None:
    """The rate and its interval are those of all 180 seedlings; the rate is not the mean of two percentages."""
    crop = CropSpec(10.0, 51.0, 0.40)
    point = point_of(crop, [trial(2, 3, 4, of=144), trial(5, 6, 7, of=36)])
    assert point.crop == crop
    wanted = {"S": 100 * 153 / 180, "F_p": 100 * 7 / 180, "F_d": 100 * 9 / 180, "F_t": 100 * 11 / 180}
    assert point.shares == pytest.approx(wanted)
    assert point.intervals["S"] == pytest.approx((78.93, 89.88), abs=0.01)  # Clopper and Pearson of 153 in 180
    assert point.by_equation_5 == pytest.approx(94.93, abs=0.01)


def test_a_trial_that_does_not_complete_is_left_out() -> None:
    """The seedlings of such a trial count neither as planted nor in the total."""
    crop = CropSpec(10.0, 51.0, 0.40)
    broken = trial(8, 8, 8, of=36, seed=77, reason="jammed")
    whole = [trial(2, 3, 4, of=144), trial(5, 6, 7, of=36)]
    assert point_of(crop, [whole[0], broken, whole[1]]) == point_of(crop, whole)


def test_a_setting_without_a_complete_trial_stops_the_study() -> None:
    with pytest.raises(
        StudyError,
        match=r"^seed 77: neither this nor any other trial of its setting completed \(jammed\); use a machine",
    ):
        point_of(CropSpec(10.0, 51.0, 0.40), [trial(0, 0, 0, of=9, seed=seed, reason="jammed") for seed in (77, 78)])


def breaking(monkeypatch: pytest.MonkeyPatch, no_chance: Expected, seeds: set[int]) -> None:
    """Replace the trials that have certain seeds with jammed trials in which no seedling is planted."""

    def breaks(*, seed: int, **rest: Any) -> TrialReport:
        report = no_chance(seed=seed, **rest)
        return trial(report.seedlings, 0, 0, of=report.seedlings, reason="jammed") if seed in seeds else report

    monkeypatch.setattr(fleet, "run_trial", breaks)


@pytest.mark.parametrize(
    ("study", "run"), first_of([(single_study, 1), (rsm_study, 21), (single_study, 21), (rsm_study, 1)])
)
def test_an_incomplete_trial_is_reported_and_changes_no_figure(
    monkeypatch: pytest.MonkeyPatch, no_chance: Expected, study: Callable[[RunOptions], Study], run: int
) -> None:
    """The incomplete trial is at the first or the last setting, which in the orthogonal test is the verification."""
    usual = typical(study)
    breaking(monkeypatch, no_chance, {trial_seed(5, run - 1, 1)})
    found = study(OPTIONS)
    assert f"1 of 42 trials did not complete; they are excluded. run {run}: jammed." in found.text()
    assert "did not complete" not in usual.text()
    run_json, wanted = json.loads(found.json()), json.loads(usual.json())
    assert (run_json["incomplete_trials"], wanted["incomplete_trials"]) == (1, 0)
    for name in ("foam", "age", "pressure", "runs", "twin"):
        for one, other in zip(run_json.get(name, ()), wanted.get(name, ()), strict=True):
            assert (one["S"], one["F_t"]) == (other["S"], other["F_t"]) if isinstance(one, dict) else one == other
    if study is rsm_study:
        assert run_json["verification"]["mean"] == wanted["verification"]["mean"]


@pytest.mark.parametrize("study", [single_study, rsm_study])
@pytest.mark.parametrize("setting", [0, 20])
def test_a_study_fails_if_no_trial_of_a_setting_completes(
    monkeypatch: pytest.MonkeyPatch, no_chance: Expected, study: Callable[[RunOptions], Study], setting: int
) -> None:
    breaking(monkeypatch, no_chance, {trial_seed(5, setting, number) for number in range(2)})
    with pytest.raises(StudyError, match=r"neither this nor any other trial of its setting completed \(jammed\)"):
        study(OPTIONS)


# --- the single-factor tests


def test_single_runs_the_levels_of_the_paper_with_different_seeds(no_chance: Expected) -> None:
    study = single_study(OPTIONS)
    wanted = [each for name in ("foam", "age", "pressure") for each in LEVELS[name] for _ in range(2)]
    assert [natural(machine) for _, _, machine in no_chance.asked] == wanted
    assert [seed for seed, _, _ in no_chance.asked] == [trial_seed(5, run, one) for run in range(21) for one in (0, 1)]
    assert {seedlings for _, seedlings, _ in no_chance.asked} == {MANY}
    raised = [
        machine.crop.claw_pressure_mpa
        for _, _, machine in no_chance.asked
        if machine.supply.compressor_on_pa > MACHINE.supply.compressor_on_pa
    ]
    assert raised == [0.65, 0.65, 0.75, 0.75]
    assert study.command == "python -m plant_sim study pepper-single --trials 2 --seed 5 --seedlings 72000"


def test_single_lists_every_share_of_every_level(no_chance: Expected) -> None:
    """The record and the tables contain the same values."""
    study = typical(single_study)
    record = json.loads(study.json())
    for name, levels in LEVELS.items():
        for level, row, run_json in zip(levels, tables(study)[f"single-{name}"].rows, record[name], strict=True):
            shares = shares_at(MACHINE.seedling, no_chance.motion, *level)
            wanted = {"F_p": shares.P, "F_d": shares.D, "F_t": shares.T, "S": 1 - shares.P - shares.D - shares.T}
            for share, value in wanted.items():
                assert run_json[share] == pytest.approx(100 * np.asarray(value).item(), abs=0.01)
            assert (run_json["foam_thickness_mm"], run_json["seedling_age_d"], run_json["claw_pressure_mpa"]) == level
            assert run_json["S_by_equation_5"] == pytest.approx(PooledResult(CropSpec(*level), pool([])).by_equation_5)
            low, high = run_json["intervals"]["S"]
            place = list(LEVELS).index(name)
            assert row == (
                f"{level[place]:g}",
                run_json["F_p"],
                run_json["F_d"],
                run_json["F_t"],
                run_json["S"],
                low,
                high,
                run_json["S_by_equation_5"],
                "yes" if CropSpec(*level).extrapolates else "no",
            )
            assert low < run_json["S"] < high


def test_verdicts_on_all_statements_without_random_scatter() -> None:
    """All but two statements are true of the expected failure rates with 144000 seedlings per level.

    The exceptions: throw failures rise with the foam thickness, from 0.1 to 2.7 %, and carry failures never fall with
    the pressure.
    """
    study = typical(single_study)
    for name, sentences in STATEMENTS.items():
        rows = tables(study)[f"words-{name}"].rows
        assert [row[0] for row in rows] == [each.text for each in sentences]
        against = {"foam": ["15 mm or more: throw failures unchanged"], "pressure": ["carry failures fluctuate"]}
        assert [row[0] for row in rows if row[3] != "yes"] == against.get(name, [])
        assert {row[3] for row in rows} <= {"yes", "no"}


def test_single_reports_the_limitations_of_its_figures() -> None:
    text = typical(single_study).text()
    beyond = sum(CropSpec(*level).extrapolates for levels in LEVELS.values() for level in levels)
    assert f"{beyond} of 21 settings are outside the paper's orthogonal test" in text
    assert "In 2 settings the compressor pressure is raised" in text
    assert "0.65 MPa is outside the rating of the MHC2 claws" in text
    assert text.count("outside the rating") == 2
    assert "2 trials of 72000 seedlings at each level" in text


def test_single_shows_that_equation_5_and_the_statements_are_consistent() -> None:
    """Success falls by 8.9 percentage points from 52 to 58 d because throw failures rise more than the others fall."""
    study = typical(single_study)
    young, old = (json.loads(study.json())["age"][place] for place in (4, 6))
    fallen = old["F_p"] + old["F_d"] - young["F_p"] - young["F_d"]
    risen = old["F_t"] - young["F_t"]
    assert fallen < 0
    assert risen > 8.9
    assert "equation 5 falls by 8.9 percentage points, while the paper states" in study.text()
    assert f"F_p and F_d together change by {fallen:+.1f} percentage points and F_t by {risen:+.1f}." in study.text()


# --- statements of the paper

HOLD: Mapping[str, Mapping[str, Sequence[float]]] = {
    "foam": {"F_p": (1, 1, 1, 2, 2, 5, 9), "F_d": (9, 7, 5, 3, 2, 1, 1), "F_t": (2, 2, 2, 2, 3, 2, 2)},
    "age": {"F_p": (9, 7, 5, 4, 3, 2, 2), "F_d": (8, 6, 4, 3, 2, 1, 1), "F_t": (1, 1, 1, 1, 2, 5, 12)},
    "pressure": {"F_p": (9, 6, 3, 2, 3, 9, 14), "F_d": (2, 1, 3, 1, 3, 4, 4), "F_t": (9, 6, 3, 2, 3, 3, 4)},
}
"""Courses for which every statement holds, %."""


def points(factor: str, courses: Mapping[str, Sequence[float]], seedlings: int = MANY) -> list[PooledResult]:
    """Return pooled trials that follow the given curves, %, with a number of seedlings per level."""
    return [
        PooledResult(
            CropSpec(*level),
            pool(
                [
                    trial(
                        *(round(seedlings * courses[name][place] / 100) for name in ("F_p", "F_d", "F_t")), of=seedlings
                    )
                ]
            ),
        )
        for place, level in enumerate(LEVELS[factor])
    ]


def verdicts(factor: str, courses: Mapping[str, Sequence[float]], seedlings: int = MANY) -> list[object]:
    return [row[3] for row in _statements_table(factor, points(factor, courses, seedlings)).rows]


@pytest.mark.parametrize("factor", list(HOLD))
def test_courses_of_the_paper_confirm_its_statements(factor: str) -> None:
    assert set(verdicts(factor, HOLD[factor])) == {"yes"}


@pytest.mark.parametrize("factor", list(HOLD))
@pytest.mark.parametrize("seedlings", [1, 12, 25])
def test_statements_are_undecided_with_few_seedlings(factor: str, seedlings: int) -> None:
    """The curves are the same, but 1 % of 25 or fewer seedlings is less than one seedling."""
    assert set(verdicts(factor, HOLD[factor], seedlings)) == {"undecided"}


AGAINST: list[tuple[str, int, str, Sequence[float]]] = [
    ("foam", 0, "F_p", (6, 1, 1, 2, 2, 7, 9)),
    ("foam", 0, "F_p", (1, 1, 6, 2, 2, 7, 19)),
    ("foam", 1, "F_d", (9, 7, 3, 5, 8, 1, 1)),
    ("foam", 1, "F_d", (1, 7, 5, 3, 4, 1, 1)),
    ("foam", 1, "F_d", (9, 1, 5, 3, 4, 1, 1)),
    ("foam", 2, "F_p", (1, 1, 1, 2, 3, 2, 9)),
    ("foam", 2, "F_p", (1, 1, 1, 2, 5, 9, 4)),
    ("foam", 3, "F_d", (9, 7, 5, 3, 2, 3, 1)),
    ("foam", 3, "F_d", (9, 7, 5, 3, 2, 1, 3)),
    ("foam", 4, "F_t", (2, 2, 2, 2, 3, 3, 3)),
    ("foam", 4, "F_t", (3, 2, 3, 2, 2, 2, 2)),
    ("foam", 4, "F_t", (2, 2, 2, 2, 2, 2, 7)),
    ("age", 0, "F_p", (9, 2, 5, 4, 4, 3, 2)),
    ("age", 0, "F_p", (2, 7, 5, 4, 4, 3, 2)),
    ("age", 1, "F_d", (8, 1, 4, 3, 3, 2, 1)),
    ("age", 1, "F_d", (1, 6, 4, 3, 3, 2, 1)),
    ("age", 2, "F_p", (9, 7, 5, 4, 2, 3, 2)),
    ("age", 2, "F_p", (9, 7, 5, 4, 3, 3, 4)),
    ("age", 3, "F_d", (8, 6, 4, 3, 1, 2, 2)),
    ("pressure", 0, "F_p", (9, 2, 3, 4, 3, 9, 14)),
    ("pressure", 0, "F_p", (2, 6, 3, 4, 3, 9, 14)),
    ("pressure", 1, "F_p", (9, 6, 3, 4, 3, 2, 14)),
    ("pressure", 1, "F_p", (9, 6, 3, 4, 3, 9, 2)),
    ("pressure", 2, "F_d", (0, 1, 2, 3, 4, 5, 5)),
    ("pressure", 2, "F_d", (1.2, 1, 2, 3, 4, 5, 5)),
    ("pressure", 2, "F_d", (4, 4, 3, 2, 1, 4, 5)),
    ("pressure", 3, "F_d", (2, 1, 3, 1, 3, 1, 2)),
    ("pressure", 3, "F_d", (2, 1, 3, 1, 3, 8, 9)),
    ("pressure", 4, "F_t", (5, 6, 3, 2, 3, 3, 4)),
    ("pressure", 5, "F_t", (9, 6, 3, 2, 2, 2, 2)),
    ("pressure", 5, "F_t", (9, 6, 3, 2, 3, 9, 12)),
]


@pytest.mark.parametrize(("factor", "sentence", "share", "course"), AGAINST)
def test_a_contradicting_course_affects_only_its_statement(
    factor: str, sentence: int, share: str, course: Sequence[float]
) -> None:
    """If one curve contradicts its statement, the verdict on that statement is no, and all others are unchanged."""
    results = verdicts(factor, {**HOLD[factor], share: course})
    assert [index for index, verdict in enumerate(results) if verdict == "no"] == [sentence]
    assert results.count("yes") == len(results) - 1


def test_every_statement_has_a_contradicting_course() -> None:
    against = {(factor, sentence) for factor, sentence, *_ in AGAINST}
    assert against == {(factor, index) for factor, each in STATEMENTS.items() for index in range(len(each))}


@pytest.mark.parametrize(("factor", "sentence", "share", "course"), AGAINST)
def test_a_contradicting_course_is_undecided_with_few_seedlings(
    factor: str, sentence: int, share: str, course: Sequence[float]
) -> None:
    assert verdicts(factor, {**HOLD[factor], share: course}, 12)[sentence] == "undecided"


def test_an_unchanged_share_is_not_reported_as_higher() -> None:
    """If the rate is equal at both levels, the verdict is undecided for any number of seedlings."""
    assert verdicts("age", {**HOLD["age"], "F_p": (9, 7, 5, 3, 3, 3, 3)}) == ["yes", "yes", "undecided", "yes"]


def test_unchanged_requires_a_much_larger_change_of_the_other_shares() -> None:
    """If carry failures hardly change either, the verdict that throw failures are unchanged is undecided."""
    courses = {**HOLD["foam"], "F_d": (3, 3, 3, 3, 2.9, 2.9, 2.9)}
    assert verdicts("foam", courses)[4] == "undecided"


def test_the_verdict_of_one_comparison_is_that_of_its_interval() -> None:
    """The Newcombe interval of 40/800 - 50/2000 is above 0 (0.9 to 4.3 percentage points), so pick failures fall."""
    courses = dict.fromkeys(("F_p", "F_d", "F_t"), (0.0,) * 7)
    for failed, verdict in ((40, "yes"), (24, "undecided"), (5, "no")):  # 5.0, 3.0 and 0.6 % against 2.5 %
        course = [point.pool for point in points("age", courses, 1000)]
        course[4] = pool([trial(failed, 0, 0, of=800)])
        course[5] = course[6] = pool([trial(25, 0, 0, of=1000)])
        assert STATEMENTS["age"][2].verdict(tuple(course)) == verdict


def test_statements_are_listed_with_their_criterion_and_the_complete_course() -> None:
    row = _statements_table("pressure", points("pressure", HOLD["pressure"])).rows[4]
    assert row == (
        "throw failures fall fast",
        "rate at 0.15 MPa more than twice that at 0.35 MPa",
        "F_t 9.0, 6.0, 3.0, 2.0, 3.0, 3.0, 4.0",
        "yes",
    )


# --- the orthogonal test


@pytest.mark.nightly
def test_rsm_runs_table_4_and_the_verification(no_chance: Expected) -> None:
    """Runs have the levels of Table 3 in the order of Table 4, then the paper's optimum; all seeds are different."""
    record = json.loads(rsm_study(OPTIONS).json())
    codes = sheet("pepper-table-4").points("X1", "X2", "X3")
    place = {-1.525: 0, -1.0: 1, 0.0: 2, 1.0: 3, 1.525: 4}
    wanted = [[levels[place[code]] for code, levels in zip(point, TABLE_3.values(), strict=True)] for point in codes]
    asked = [natural(machine) for _, _, machine in no_chance.asked]
    assert np.array(asked[:40:2]) == pytest.approx(np.array(wanted))
    assert asked[0::2] == asked[1::2]
    assert asked[40] == (10.0, 51.0, 0.4)
    assert len({seed for seed, _, _ in no_chance.asked}) == 42
    assert [[run[name] for name in TABLE_3] for run in record["runs"]] == [list(point) for point in asked[:40:2]]
    raised = {
        machine.crop.claw_pressure_mpa
        for _, _, machine in no_chance.asked
        if machine.supply.compressor_on_pa > MACHINE.supply.compressor_on_pa
    }
    assert list(raised) == pytest.approx([0.64825])


@pytest.mark.nightly
def test_the_optimum_without_random_scatter_is_that_of_the_data_of_the_paper() -> None:
    """The optima agree within 1 mm, 2 d and 0.03 MPa, success rate and coefficients within 0.5 percentage points."""
    study = typical(rsm_study)
    record = json.loads(study.json())
    twin, paper = record["optimum"], record["paper_optimum"]
    off = np.abs(np.subtract(twin["natural"], paper["natural"]))
    assert (off < (1.0, 2.0, 0.03)).all()
    assert twin["S"] == pytest.approx(paper["S"], abs=0.5)
    assert "S: no repeated trials that differ, so the error is unknown: there is no P value" in study.text()
    assert paper["natural"] == pytest.approx([10.1, 51.0, 0.394], abs=0.05)
    for term, value in record["paper"]["coefficients"].items():
        assert record["twin"]["coefficients"][term]["value"] == pytest.approx(value, abs=0.5), term
    assert record["twin"]["r2"] > 0.95
    shift = np.subtract(twin["natural"], paper["natural"])
    assert f"by {shift[0]:+.2f} mm, {shift[1]:+.2f} d and {shift[2]:+.3f} MPa." in study.text()


@pytest.mark.nightly
def test_rsm_compares_paper_refit_and_twin() -> None:
    """Every table contains the values of the record under the correct heading."""
    study = typical(rsm_study)
    record, found = json.loads(study.json()), tables(study)
    assert list(found) == [*("runs", "coefficients", "success-quality", "anova", "optimum", "pareto", "verification")]
    assert pictures(study) == {"success-residuals", "success-contours", "success-runs", "pareto-front"}
    columns = found["runs"].heading
    for row, run in zip(found["runs"].rows, record["runs"], strict=True):
        run_json = dict(zip(columns, row, strict=True))
        assert [run_json[f"{name}, twin"] for name in ("S", "F_p", "F_d", "F_t")] == [
            run[name] for name in ("S", "F_p", "F_d", "F_t")
        ]
    assert [dict(zip(columns, row, strict=True))["S, paper"] for row in found["runs"].rows][:3] == [86.1, 79.2, 94.6]
    optimum = {row[0]: row[1:] for row in found["optimum"].rows}
    assert list(optimum) == ["best of the twin", "rounded by the paper", "best of the refit"]
    assert optimum["best of the twin"][3] == pytest.approx(record["optimum"]["S"])
    assert optimum["best of the refit"][4] == pytest.approx(record["paper_optimum"]["S"])
    assert optimum["rounded by the paper"][5] == pytest.approx(94.93, abs=0.01)
    assert found["coefficients"].heading[1:4] == ("paper", "refit of Table 4", "twin")
    constant = found["coefficients"].rows[0]
    assert constant[1:4] == pytest.approx(
        (93.76, record["refit"]["coefficients"]["1"]["value"], record["twin"]["coefficients"]["1"]["value"]), abs=1e-9
    )


@pytest.mark.nightly
def test_rsm_reports_the_uncertainty_of_its_optimum() -> None:
    """The prediction interval ends at 100 %, and the location is within the search range."""
    study = typical(rsm_study)
    optimum = json.loads(study.json())["optimum"]
    low, high = optimum["prediction_interval_95"]
    assert low < optimum["S"] < high <= 100
    place = optimum["place_interval_95"]
    for least, value, most, (_, smallest, _, largest, _) in zip(
        place["low"], optimum["natural"], place["high"], TABLE_3.values(), strict=True
    ):
        assert smallest - 1e-9 <= least <= value + 1e-2 * largest
        assert value - 1e-2 * largest <= most <= largest + 1e-9
    assert f"is expected between {low:.1f} and {high:.1f} % (95 % prediction interval, limited" in study.text()
    assert "which cannot be" not in study.text()
    assert "The unit is the trial: 40 trials, weighted by the binomial variance function" in study.text()


@pytest.mark.nightly
def test_an_optimum_above_100_percent_is_reported(monkeypatch: pytest.MonkeyPatch, no_chance: Expected) -> None:
    """For random runs of 0 or 100 %, the caveat appears at the top of the report and beside the optimum."""
    lots = np.random.default_rng(0)

    def trial_of(*, seed: int, seedlings: int, **_: object) -> TrialReport:
        return trial(seedlings * int(lots.integers(0, 2)), 0, 0, of=seedlings, seed=seed)

    monkeypatch.setattr(fleet, "run_trial", trial_of)
    study = rsm_study(replace(OPTIONS, trials=1))
    optimum = json.loads(study.json())["optimum"]
    assert optimum["S"] > 100
    assert optimum["prediction_interval_95"][1] == 100
    assert study.text().count(f"the quadratic model gives S {optimum['S']:.1f} %, which is impossible") == 2
    assert "trials the fitted share is within 0.5 % of 0 or 100 %, or beyond; the variance is not known" in study.text()


@pytest.mark.parametrize("study", first_of([rsm_study, single_study]))
def test_the_record_contains_seed_setting_and_result_of_every_trial(study: Callable[[RunOptions], Study]) -> None:
    record = json.loads(typical(study).json())
    if study is rsm_study:
        runs = [*record["runs"], record["verification"]]
    else:
        runs = [run for name in LEVELS for run in record[name]]
    assert len(runs) == 21
    for place, run in enumerate(runs):
        assert [each["seed"] for each in run["trials"]] == [trial_seed(5, place, number) for number in (0, 1)]
        assert run["setting"]["crop.foam_thickness_mm"] == run["foam_thickness_mm"]
        counts = {share: sum(each[name] for each in run["trials"]) for share, name in (("F_p", "P"), ("F_t", "T"))}
        for share, count in counts.items():
            assert run[share] == pytest.approx(100 * count / (2 * MANY))
        assert all(each["completed"] for each in run["trials"])
        low, high = run["intervals"]["F_p"]
        assert low <= run["F_p"] <= high


def test_single_reports_contradicted_statements_first() -> None:
    """The verdicts beside the statements, in the record and at the top are the same."""
    study = typical(single_study)
    recorded = {
        (name, each["words"]): each["verdict"]
        for name, sentences in json.loads(study.json())["sentences"].items()
        for each in sentences
    }
    shown = {(name, row[0]): row[3] for name in LEVELS for row in tables(study)[f"words-{name}"].rows}
    assert recorded == shown
    (text,) = (str(part) for part in study.parts if str(part).startswith(f"Of the {len(recorded)} statements"))
    for (name, words), verdict in recorded.items():
        assert (f"{name}, {words}" in text) is (verdict != "yes")
    assert f"confirm {list(recorded.values()).count('yes')}." in text


@pytest.mark.nightly
def test_the_verification_compares_every_trial_with_those_of_the_paper(
    monkeypatch: pytest.MonkeyPatch, no_chance: Expected
) -> None:
    """The table lists five trials of the paper, three of the twin and their means; the text gives the interval."""
    usual = no_chance(seed=1, seedlings=MANY, parameters=MACHINE)
    lucky = {trial_seed(5, 20, number): one for number, one in enumerate((usual, trial(0, 0, 0, of=MANY), usual))}

    def trial_of(*, seed: int, **rest: Any) -> TrialReport:
        return lucky.get(seed) or no_chance(seed=seed, **rest)

    monkeypatch.setattr(fleet, "run_trial", trial_of)
    study = rsm_study(replace(OPTIONS, trials=3))
    record, table = json.loads(study.json()), tables(study)["verification"]
    success = record["verification"]["S"]
    assert table.caption == "Trials at 10 mm, 51 d, 0.40 MPa: S, %"
    assert table.rows[:2] == (("1", 93.9, success[0]), ("2", 94.5, success[1]))
    assert table.rows[2:5] == (("3", 95.2, success[2]), ("4", 94.0, None), ("5", 95.3, None))
    name, paper, twin = table.rows[5]
    assert name == "mean"
    assert (paper, twin) == pytest.approx((94.58, sum(success) / 3))
    assert record["verification"]["mean"] == twin
    pooled = point_of(CropSpec(10.0, 51.0, 0.40), list(lucky.values()))
    low, high = pooled.intervals["S"]
    assert (
        f"S {pooled.shares['S']:.2f} %, 95 % binomial {low:.2f} to {high:.2f}; equation 5 gives 94.93." in study.text()
    )


# --- on the twin


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    """Run the command and return its record."""
    parser = argparse.ArgumentParser()
    parser.set_defaults(command="study")
    add_arguments(parser)
    assert study_command(parser.parse_args([*arguments, "--json", "--workers", "1"])) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.nightly
@pytest.mark.parametrize("name", first_of(["pepper-rsm", "pepper-single"]))
def test_the_command_runs_the_twin(capsys: pytest.CaptureFixture[str], name: str) -> None:
    """With 24 seedlings per trial, every rate is a multiple of 1/24, and every loss has a reason."""
    record = run_json(capsys, name, "--trials", "1", "--seedlings", "24", "--seed", "3")
    assert record["command"] == f"python -m plant_sim study {name} --trials 1 --seed 3 --seedlings 24"
    runs = record["runs"] if name == "pepper-rsm" else [run for factor in LEVELS for run in record[factor]]
    for run in runs:
        lost = run["F_p"] + run["F_d"] + run["F_t"]
        assert run["S"] + lost == pytest.approx(100)
        assert all((24 * run[share] / 100) == pytest.approx(round(24 * run[share] / 100)) for share in ("S", "F_t"))
    assert len({run["S"] for run in runs}) > 3


NIGHTLY_TRIALS = 50


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_the_complete_orthogonal_test_finds_the_optimum_of_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    """The test has twenty runs of five trials with 144 seedlings each."""
    record = run_json(capsys, "pepper-rsm")
    off = np.abs(np.subtract(record["optimum"]["natural"], record["paper_optimum"]["natural"]))
    assert (off < (1.0, 2.0, 0.03)).all()
    assert record["twin"]["r2"] > 0.8, "of single trials, whose scatter the model does not explain"
    low, high = record["twin"]["dispersion"]["interval_95"]
    assert low < 1 < high, "the seedlings of the twin are independent"


@pytest.mark.nightly
@pytest.mark.timeout(1800)
def test_fifty_trials_at_the_optimum_of_the_paper_reach_its_success() -> None:
    """Equation 5 gives 94.9 %; the mean for 7200 seedlings has a standard error of 0.27 percentage points."""
    options = replace(OPTIONS, trials=NIGHTLY_TRIALS, seed=1, seedlings=144)
    (reports,) = options.run([setting_of((10, 51, 0.40), MACHINE)])
    assert np.mean([report.S for report in reports]) == pytest.approx(94.9, abs=0.8)
