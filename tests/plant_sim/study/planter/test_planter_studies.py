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
from plant_sim.study.planter import verdict_study as verdicts
from plant_sim.study.planter.lodging_trials import (
    LodgingSetting,
    SeedlingCount,
    equation_trials,
    pooled,
    simulate_trials,
)
from plant_sim.study.planter.verdicts import FallPoint, VerdictCount, count_verdicts, crossings
from plant_sim.study.report.study import Study, write
from tests.sampling import first_of

PLANTER, RANGES = load_planter(), load_ranges()
CLAIMED = LodgingSetting(1.6, 57.0, 91.83)


def record_of(study: Study) -> Any:
    return study.record


@pytest.mark.nightly
def test_verdicts_of_the_cases_of_the_paper_hold_in_most_draws() -> None:
    points = [FallPoint(case.motion(PLANTER).ratio, PLANTER.chain.release_deg, 30) for case in verdicts.CASES]
    for case, count in zip(verdicts.CASES, count_verdicts(PLANTER, RANGES, points, seed=4, workers=1), strict=True):
        assert count.share(case.verdict) >= 0.9, case
        assert sum(count.counts.values()) == 30
        low, high = count.interval(case.verdict)
        assert low < count.share(case.verdict) <= high


def test_verdicts_hold_with_another_opener_and_another_guide_plate() -> None:
    """The paper's verdicts also result with other openers and a smaller gap; with 4 mm, the middle case is weaker."""
    points = [
        FallPoint(case.motion(PLANTER).ratio, opener_deg, 6, (("chain.guide_behind_m", 0.0205),))
        for case in verdicts.CASES
        for opener_deg in (50.0, 65.0)
    ]
    counts = count_verdicts(PLANTER, RANGES, points, seed=2, workers=1)
    for count, case in zip(counts, np.repeat(np.arange(3), 2).tolist(), strict=True):
        assert count.share(verdicts.CASES[case].verdict) >= 0.8


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
        patch.setattr(verdicts, "CASE_DRAWS", 8)
        patch.setattr(verdicts, "CHECK_DRAWS", 1)
        patch.setattr(verdicts, "RATIOS", (0.85, 0.92, 1.0, 1.05, 1.3))
        patch.setattr(verdicts, "OPENERS_DEG", (75.0, 120.0))
        return verdicts.verdict_study(PLANTER, RANGES, draws=4, seed=1, workers=1)


@pytest.mark.nightly
def test_verdict_study_finds_the_switches(verdict_report: Study, tmp_path: Path) -> None:
    switches = record_of(verdict_report)["switches"]
    assert [0.865 < at < 1.0 for at in switches["tipped to pushed"]] == [True]
    assert [1.0 <= at < 1.1 for at in switches["pushed to clean"]] == [True]
    text = verdict_report.text()
    assert str(verdict_report.parts[0]).startswith("What was fitted to what: ")
    assert "The verdicts of all three cases are reproduced." in text
    assert "The paper contradicts itself" in text
    assert "lodging is 1.99 to 8.53 %" in text
    names = {path.name for path in write(verdict_report, tmp_path / "out")}
    assert {"report.md", "report.html", "study.json", "sweep.csv", "check.csv", "cases.csv", "verdicts.png"} <= names


@pytest.mark.parametrize(
    ("clean_of_4", "sentence"),
    [(4, "3 of 3 points {} There are no exceptions."), (3, "2 of 3 points {} Exceptions: λ 1.1743, gap 0.5 mm, 75°.")],
)
def test_openers_without_the_verdict_of_the_paper_are_named(
    monkeypatch: pytest.MonkeyPatch, clean_of_4: int, sentence: str
) -> None:
    """Three cases with one guide plate and two openers; the case with a clean verdict has some other falls."""
    monkeypatch.setattr(verdicts, "OPENERS_DEG", (75.0, 120.0))
    counts = []
    for case in verdicts.CASES:
        falls = Counter({case.verdict: 4})
        if case.verdict is FallVerdict.CLEAN:
            falls = Counter({FallVerdict.CLEAN: clean_of_4, FallVerdict.PUSHED: 4 - clean_of_4})
        points = [
            FallPoint(case.motion(PLANTER).ratio, opener_deg, 4, (("chain.guide_behind_m", 0.0205),))
            for opener_deg in (75.0, 120.0)
        ]
        counts += [VerdictCount(point, falls) for point in points]
    parts = verdicts._check_parts(verdicts.VerdictSweep(PLANTER, counts[::2], (), counts))
    have = "have the verdict of the paper in at least 90 % of the falls."
    assert sentence.format(have) in "".join(part for part in parts if isinstance(part, str))


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
    assert rigid["clean"][ratios.index(1.17), place] == 1.0
    assert rigid["windows_deg"][ratios.index(1.0)] == [(120.0, 150.0)]
    assert {path.suffix for path in write(study, tmp_path / "out")} == {".md", ".html", ".json", ".csv", ".png", ".svg"}


def test_the_parts_of_the_loop_are_compared_between_its_points_of_zero_speed() -> None:
    """With a ratio of 1.17 the points are at about 59° and 121°; a ratio of 0.9 has no loop and does not count."""
    openers_deg = np.array([45.0, 60.0, 75.0, 90.0, 105.0, 150.0])
    clean = np.array([[0.0, 1.0, 0.5, 0.25, 0.75, 0.0], [1.0] * 6])
    made = release.ReleaseMap(
        Ground.RIGID, np.array([1.17, 0.9]), openers_deg, clean, 1 - clean, (), default_table(Ground.RIGID)
    )
    text = release._comparison(PLANTER, made)
    assert "50.0 % of the falls are clean for an opener on the rising part" in text
    assert "75.0 % on the falling part" in text
    assert "not confirmed" in text


def test_windows_are_uninterrupted_ranges() -> None:
    openers_deg = np.array([45.0, 60.0, 75.0, 90.0, 105.0])
    clean = np.array([[1.0, 0.9, 0.5, 0.95, 0.2], [0.0] * 5])
    table = default_table(Ground.RIGID)
    made = release.ReleaseMap(Ground.RIGID, np.array([1.0, 1.1]), openers_deg, clean, 1 - clean, (), table)
    assert made.windows_deg(0) == [(45.0, 60.0), (90.0, 90.0)]
    assert made.windows_deg(1) == []


@pytest.fixture(scope="module")
def lodging_report() -> Study:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lodging, "FIELD_SEEDLINGS", 10)
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
    check = record["check"]
    assert [each["seedlings"] for each in check["mechanics"]] == [6, 6, 6, 10, 10, 10]
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
def test_verdicts_hold_in_at_least_90_percent_of_200_draws() -> None:
    study = record_of(verdicts.verdict_study(PLANTER, RANGES, draws=60, seed=1))
    for case, count in zip(verdicts.CASES, study["cases"], strict=True):
        assert count["verdicts"][case.verdict.value] >= 0.9 * 200
    (tipped,), (clean,) = study["switches"].values()
    assert 0.90 < tipped < 0.94
    assert 1.01 < clean < 1.04
    assert count["verdicts"][FallVerdict.CLEAN.value] == 200
