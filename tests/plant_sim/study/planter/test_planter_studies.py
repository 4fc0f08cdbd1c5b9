"""Tests of the studies of the planter with few random falls: contents, determinism and files."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.common.document.parts import Table
from plant_sim.planter.falls import OPENERS_DEG, default_table
from plant_sim.planter.parameters import load_planter, load_ranges
from plant_sim.planter.quality import lodging_share
from plant_sim.planter.scatter import Ground
from plant_sim.planter.verdict import FallVerdict
from plant_sim.study.planter import lodging_study as lodging
from plant_sim.study.planter import release_study as release
from plant_sim.study.planter import release_windows as windows
from plant_sim.study.planter import verdict_study as verdicts
from plant_sim.study.planter.lodging_trials import (
    LodgingSetting,
    SeedlingCount,
    equation_trials,
    pooled,
    simulate_trials,
)
from plant_sim.study.planter.verdict_robustness import robust_up_to_deg, robustness
from plant_sim.study.planter.verdict_space import VerdictSpace
from plant_sim.study.planter.verdicts import CASES, FallPoint, VerdictCount, count_verdicts, crossings
from plant_sim.study.report.study import Study, write
from tests.sampling import first_of

PLANTER, RANGES = load_planter(), load_ranges()
CLAIMED = LodgingSetting(1.6, 57.0, 91.83)


def record_of(study: Study) -> Any:
    return study.record


UNDISTURBED = (("scatter.pitch_deg", 0.0), ("scatter.slope_deg", 0.0), ("scatter.uneven_s", 0.0))


@pytest.mark.nightly
def test_verdicts_of_the_cases_of_the_paper_hold_in_most_undisturbed_draws() -> None:
    release_deg = PLANTER.chain.release_deg
    points = [FallPoint(case.motion(PLANTER).ratio, release_deg, 30, UNDISTURBED) for case in CASES]
    for case, count in zip(CASES, count_verdicts(PLANTER, RANGES, points, seed=4, workers=1), strict=True):
        assert count.proportion(case.verdict).share >= 0.9, case
        assert sum(count.counts.values()) == 30
        low, high = count.proportion(case.verdict).interval
        assert low < count.proportion(case.verdict).share <= high


def test_verdicts_hold_with_another_opener_and_another_guide_plate() -> None:
    """Without disturbances, the paper's verdicts also result with other openers and a smaller gap."""
    points = [
        FallPoint(case.motion(PLANTER).ratio, opener_deg, 6, (*UNDISTURBED, ("chain.guide_behind_m", 0.0205)))
        for case in CASES
        for opener_deg in (50.0, 65.0)
    ]
    counts = count_verdicts(PLANTER, RANGES, points, seed=2, workers=1)
    for count, case in zip(counts, np.repeat(np.arange(3), 2).tolist(), strict=True):
        assert count.proportion(CASES[case].verdict).share >= 0.8


@pytest.mark.parametrize("workers", first_of([1, 2]))
def test_equal_seeds_give_equal_verdicts_with_any_number_of_processes(workers: int) -> None:
    points = [FallPoint(0.92, 75.0, 3), FallPoint(0.95, 75.0, 3), FallPoint(0.85, 90.0, 2, kind=Ground.SOIL)]
    alone = count_verdicts(PLANTER, RANGES, points, seed=5, workers=1)
    assert count_verdicts(PLANTER, RANGES, points, seed=5, workers=workers) == alone


def test_crossings_are_interpolated_in_both_directions() -> None:
    assert crossings([1.0, 2.0, 3.0], np.array([0.0, 1.0, 0.25])) == pytest.approx([1.5, 2.0 + 2 / 3])
    assert crossings([1.0, 2.0], np.array([0.2, 0.4])) == []


@pytest.fixture(scope="module")
def verdict_report() -> Study:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verdicts, "RATIOS", (0.85, 0.92, 1.0, 1.05, 1.3))
        return verdicts.verdict_study(PLANTER, RANGES, draws=4, seed=1, workers=2)


@pytest.mark.nightly
def test_verdict_study_has_switches_robustness_and_influences(verdict_report: Study, tmp_path: Path) -> None:
    record = record_of(verdict_report)
    assert [0.865 < at < 1.0 for at in record["switches"]["tipped to pushed"]] == [True]
    assert len(record["robustness"]) == 21
    assert [each["ratio"] for each in record["sensitivity"]] == [0.87, 1.0, 1.17]
    assert all(len(each["indices"]) <= 8 < len(each["effects"]) for each in record["sensitivity"])
    text = verdict_report.text()
    assert str(verdict_report.parts[0]).startswith("What was fitted to what: ")
    assert "The paper contradicts itself" in text
    assert "lodging is 1.99 to 8.53 %" in text
    names = {path.name for path in write(verdict_report, tmp_path / "out")}
    assert {"sweep.csv", "cases.csv", "verdicts.png", "robustness.csv", "robustness.png", "influence-87.csv"} <= names


@pytest.mark.nightly
def test_release_study_draws_the_window(tmp_path: Path) -> None:
    tables = {kind: default_table(kind) for kind in Ground}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(release, "SAMPLES", 2)
        study = release.release_study(PLANTER, RANGES, tables, draws=2, seed=1, workers=1)
    assert str(study.parts[0]).startswith("What was fitted to what: ")
    rigid = record_of(study)["grounds"]["rigid_ground"]
    ratios = rigid["ratios"].tolist()
    assert (ratios[0], ratios[-1]) == (0.8, 1.6)
    place = OPENERS_DEG.index(75.0)
    assert rigid["clean"][ratios.index(0.85), place] == 0.0
    assert rigid["lodged"][ratios.index(0.85), place] > 0.9
    assert rigid["clean"][ratios.index(1.17), place] > 0.7
    assert len(record_of(study)["loops"]) == len(record_of(study)["late"]) / 4 == 9
    assert {path.suffix for path in write(study, tmp_path / "out")} == {".md", ".html", ".json", ".csv", ".png", ".svg"}


def counted(point: FallPoint, clean: int) -> VerdictCount:
    return VerdictCount(point, Counter({FallVerdict.CLEAN: clean, FallVerdict.PUSHED: point.draws - clean}))


def test_parts_of_the_loop_are_between_its_points_of_zero_speed() -> None:
    """With a ratio of 1.17 the points are at about 59° and 121°."""
    points = [each for each in windows.window_points(PLANTER, 5) if each.ratio == 1.17][:6]
    assert [each.opener_deg for each in points] == pytest.approx([66.6, 74.4, 82.2, 97.8, 105.6, 113.4], abs=0.2)
    assert {each.values for each in points} == {(("scatter.pitch_deg", 0.0),)}


def test_better_part_of_the_loop_depends_on_ratio_and_pitch() -> None:
    """The rising part is better at 1.10 without pitch, the falling part at 1.30 with 6°; elsewhere they are equal."""
    counts = []
    for point in windows.window_points(PLANTER, 40):
        is_rising, pitch_deg = point.opener_deg > 90.0, dict(point.values)["scatter.pitch_deg"]
        percent = 75
        if (point.ratio, pitch_deg) in ((1.1, 0.0), (1.3, 6.0)):
            percent = 95 if is_rising is (point.ratio == 1.1) else 55
        counts.append(counted(point, point.draws * percent // 100))
    loops, late = windows.windows_of(counts)
    better = {(each.ratio, each.pitch_deg): each.better for each in loops}
    assert better[1.1, 0.0] == "rising"
    assert better[1.3, 6.0] == "falling"
    assert list(better.values()).count("undecided") == 7
    assert loops[0].rising == (342, 360)
    texts = [part for part in windows.window_parts(loops, late) if isinstance(part, str)]
    assert (
        "The paper recommends the rising part of the loop. On rigid ground: depends on λ and on the pitch." in texts[1]
    )
    assert "at 58 plants per minute is 75 % (59 to 87), at λ 0.85 and 120°: less than 90 %." in texts[3]
    assert [len(each.points) for each in late] == [12] * 3


def test_windows_are_uninterrupted_ranges() -> None:
    openers_deg = np.array([45.0, 60.0, 75.0, 90.0, 105.0])
    clean = np.array([[1.0, 0.9, 0.5, 0.95, 0.2], [0.0] * 5])
    table = default_table(Ground.RIGID)
    made = release.ReleaseMap(Ground.RIGID, np.array([1.0, 1.1]), openers_deg, clean, 1 - clean, (), table)
    assert made.windows_deg(0) == [(45.0, 60.0), (90.0, 90.0)]
    assert made.windows_deg(1) == []


@pytest.fixture(scope="module")
def lodging_report() -> Study:
    return lodging.lodging_study(PLANTER, RANGES, blocks=10, seedlings=6, seed=1, workers=1)


@pytest.mark.nightly
def test_lodging_study_holds_runs_back_and_compares(lodging_report: Study, tmp_path: Path) -> None:
    record = record_of(lodging_report)
    fits = record["fits"]
    assert set(fits) == {"reconciled", "printed"}
    assert len(fits["reconciled"]["fitted_runs"]) == 13
    assert fits["reconciled"]["observed"]["Y1"][3] == 3.18
    assert fits["printed"]["observed"]["Y1"][3] == 2.25
    assert next(iter(fits["reconciled"]["lodging_by"])) == "mechanics"
    assert record["seedlings_per_run"] == 18
    knowledge = record["knowledge"]
    assert set(knowledge) == {"reconciled", "printed"}
    for both in knowledge.values():
        assert [len(both[response]["constants"]) for response in ("lodging", "injury")] == [3, 2]
    check = record["check"]
    assert [each["seedlings"] for each in check["mechanics"]] == [6, 6, 6]
    assert check["codes"][2] == pytest.approx(-1.455, abs=5e-4)
    text = lodging_report.text()
    assert str(lodging_report.parts[0]).startswith("What was fitted to what: ")
    for part in lodging_report.parts:
        if isinstance(part, Table) and "-errors-" in part.name:
            assert part.heading[2:4] == ("fitted, in-sample", "held back")
            *others, equation = part.rows
            assert equation[3:6] == (None, None, None)
            assert equation[6] is not None
            assert all(row[3] is not None and row[6] is None for row in others)
    for phrase in (
        "would crush 50 % of them",
        "the model says nothing about the difference between bench and field",
        "neither the equations nor the fitted constants apply to plugs of pepper",
    ):
        assert phrase in text
    assert "lodging-runs.png" in {path.name for path in write(lodging_report, tmp_path / "out")}


@pytest.mark.nightly
def test_seedlings_needed_for_the_scatter_of_the_centres(lodging_report: Study) -> None:
    assert "would need 2233 per run" in lodging_report.text()
    rows = {line.split()[0]: line.split() for line in lodging_report.text().splitlines() if line.endswith(" 7.91")}
    assert rows["2200"][1] == "0.50"


def test_trials_count_every_seedling() -> None:
    trials = simulate_trials(PLANTER, RANGES, CLAIMED, [12, 5], seed=3, workers=1)
    assert [trial.seedlings for trial in trials] == [12, 5]
    assert trials == simulate_trials(PLANTER, RANGES, CLAIMED, [12, 5], seed=3, workers=1)
    certain = PLANTER.with_values(
        {
            "scatter.stick_share": 1.0,
            "scatter.stick_exponent": 0.0,
            "scatter.strength_n": 1.0,
            "scatter.strength_sd_n": 1.0,
        }
    )
    (all_lost,) = simulate_trials(certain, RANGES, CLAIMED, [4], seed=3, workers=1)
    assert all_lost == SeedlingCount(4, 4, 4)


def test_trials_by_the_equations_have_their_shares() -> None:
    total = pooled(equation_trials(CLAIMED, [20_000] * 3, seed=1))
    assert total.seedlings == 60_000
    lodged, low, high, *_ = total.percent()
    assert low < 100 * lodging_share(*CLAIMED).value < high
    assert lodged == pytest.approx(100 * total.lodged / 60_000)


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_no_verdict_survives_all_ranges_and_pitches() -> None:
    """The middle case, whose verdict has a limit on both sides, is the weakest."""
    shares = robustness(VerdictSpace(PLANTER, RANGES), draws=100, seed=2)
    by_case = {case: [each.agreeing.share for each in shares if each.case is case] for case in CASES}
    assert robust_up_to_deg([each for each in shares if each.case is CASES[1]]) is None
    assert max(by_case[CASES[1]]) < 0.8
