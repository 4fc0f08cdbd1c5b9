"""Campaign files: designs, sets of faults, and errors with file, line, key and remedy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.machine.parameters import load_machine
from plant_sim.study.campaign.file import Campaign, load_campaign
from plant_sim.study.campaign.run import CampaignPlan, CampaignRun
from plant_sim.study.campaign.shards import shard_schema
from plant_sim.study.errors import StudyError
from tests.paths import DOCS
from tests.plant_sim.study.campaign.folders import SMALL, written

MACHINE = load_machine()
IO_MAP = load_io_map(DEFAULT_IO_MAP)

LIST = """\
design: list
points:
  - {crop.claw_pressure_mpa: 0.3, program.pause_at_feed: 200 ms}
  - {program.pause_at_feed: 0.3 s, crop.claw_pressure_mpa: 5 bar}
fixed: {crop.seedling_age_d: 45 d}
"""
SURFACE = """\
design: central-composite
centres: 3
factors:
  crop.claw_pressure_mpa: {low: 0.35, high: 0.45}
  crop.foam_thickness_mm: {low: 10 mm, high: 14 mm}
"""


def loaded(folder: Path, text: str, **options: int) -> Campaign:
    return load_campaign(written(folder, text), MACHINE, IO_MAP, **options)


def runs(campaign: Campaign, version: str = "1") -> Iterator[CampaignRun]:
    return CampaignPlan(campaign, MACHINE, IO_MAP, version).runs()


def keys(campaign: Campaign, version: str = "1") -> list[str]:
    return [run.key for run in runs(campaign, version)]


def test_a_list_of_points_contains_exactly_these_points(tmp_path: Path) -> None:
    campaign = loaded(tmp_path, LIST)
    assert campaign.runs == 2
    assert [dict(run.levels) for run in runs(campaign)] == [
        {"crop.seedling_age_d": 45.0, "crop.claw_pressure_mpa": 0.3, "program.pause_at_feed": 200.0},
        {"crop.seedling_age_d": 45.0, "crop.claw_pressure_mpa": 0.5, "program.pause_at_feed": 300.0},
    ]
    assert [run.parameters.crop.claw_pressure_mpa for run in runs(campaign)] == [0.3, 0.5]
    assert [run.set_points for run in runs(campaign)] == [{"pause_at_feed": 20}, {"pause_at_feed": 30}]


def test_a_file_without_factors_varies_seeds_and_faults_only(tmp_path: Path) -> None:
    campaign = loaded(tmp_path, "replicates: 3\nfaults: [[], [stuck_off:left.lift_up@12s..]]\n")
    assert campaign.runs == 6
    seeds = [run.seed for run in runs(campaign)]
    assert seeds[:3] == seeds[3:]
    assert len(set(seeds)) == 3
    assert len(set(keys(campaign))) == 6


def test_the_repeated_centre_of_a_design_has_different_seeds(tmp_path: Path) -> None:
    campaign = loaded(tmp_path, SURFACE, trials=2)
    planned = list(runs(campaign))
    assert len(planned) == campaign.runs == 2 * (4 + 4 + 3)
    assert len({run.key for run in planned}) == len(planned)
    centre = [run for run in planned if run.levels == planned[-1].levels]
    assert [run.trial for run in centre] == list(range(6))
    assert len({run.seed for run in centre}) == 6


def test_a_key_depends_on_everything_that_determines_the_result(tmp_path: Path) -> None:
    """The order of the runs and of the faults does not matter; more trials and levels keep the existing keys."""
    campaign = loaded(tmp_path, SMALL)
    first = set(keys(campaign))
    assert len(first) == campaign.runs
    for changed in (
        loaded(tmp_path, SMALL, seed=2),
        loaded(tmp_path, SMALL, seedlings=13),
        loaded(tmp_path, SMALL + "fixed: {crop.seedling_age_d: 51 d}\n"),
    ):
        assert first.isdisjoint(keys(changed))
    assert first.isdisjoint(keys(campaign, version="2"))
    warm = CampaignPlan(campaign, MACHINE.with_values({"supply.pressure_pa": 550e3}), IO_MAP, "1")
    assert first.isdisjoint(run.key for run in warm.runs())
    assert first < set(keys(loaded(tmp_path, SMALL, trials=3)))
    assert first < set(keys(loaded(tmp_path, SMALL.replace("[0.3, 0.5]", "[0.5, 0.4, 0.3]"))))
    assert first == set(keys(loaded(tmp_path, SMALL.replace("  - []\n", "") + "  - []\n")))


def test_the_example_of_the_guide_is_valid(tmp_path: Path) -> None:
    campaign = load_campaign(DOCS / "examples/campaign.yaml", MACHINE, IO_MAP)
    assert campaign.runs == len(list(runs(campaign))) > 0


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("design: factorial", "design: factorail", ":1: design: unknown design 'factorail'; did you mean factorial?"),
        ("design: factorial\n", "", ":1: design: is missing; add it"),
        ("replicates: 2", "replicates: 0", ":5: replicates: must be an integer, 1 to 100000, not '0'"),
        ("replicates: 2", "replicates: 99999999", ":5: replicates: must be an integer, 1 to 100000, not "),
        (
            "[200 ms, 300 ms]}\nreplicates: 2",
            "[200 ms, 250 ms, 300 ms]}\nreplicates: 90000",
            ":5: replicates: results in 1080000 ",
        ),
        ("replicates", "trials", ":5: trials: unknown key; "),
        ("seedlings: 12", "responses: [S]", ":6: responses: unknown key; "),
        ("seedlings: 12", "points: []", ":6: points: does not apply to design factorial; remove it"),
        ("  - []\n", "  - none\n", ":8: faults[1]: must be a list, not 'none'; write it in brackets, [] for none"),
        ("  - []\n", "  - [[a]]\n", ":8: faults[1]: must be a list of words, not of a list"),
        ("stuck_off", "stuck_of", ":9: faults[2]: stuck_of: unknown fault; did you mean stuck_off?"),
        ("left.lift_up", "left.lift", ":7: faults: "),
        ("  - []\n", "  - [stuck_off:left.lift_up@26s..34s]\n", ":7: faults: contains [stuck_off:left.lift_up@"),
        ("[0.3, 0.5]", "[0.3, 1.5]", ":3: factors.crop.claw_pressure_mpa: must be 0 to 1, not 1.5"),
        ("seedlings: 12", "fixed: {crop.foam_thickness_mm: 99}", ":6: fixed.crop.foam_thickness_mm: must be 0 to 30"),
    ],
)
def test_an_invalid_file_is_reported_with_line_key_and_remedy(
    old: str, new: str, complaint: str, tmp_path: Path
) -> None:
    assert SMALL.count(old) == 1
    text = SMALL.replace(old, new)
    with pytest.raises(StudyError) as raised:
        loaded(tmp_path, text)
    assert str(raised.value).startswith(f"{tmp_path / 'campaign.yaml'}{complaint}")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("program.pause_at_feed: 0.3 s, ", "", ":4: points[2].program.pause_at_feed: is missing; specify the same "),
        ("crop.claw_pressure_mpa: 5 bar", "crop.claw_pressure_mpa: 50 bar", ":4: points[2].crop.claw_pressure_mpa: "),
        ("0.3 s,", "301 ms,", ":4: points[2].program.pause_at_feed: must be "),
        ("0.3 s,", "0.3 s, crop.foam_thickness_mm: 9,", ":4: points[2].crop.foam_thickness_mm: is not in the first "),
        ("crop.seedling_age_d", "crop.claw_pressure_mpa", ":5: fixed.crop.claw_pressure_mpa: is also a factor; "),
        ("45 d", "-1 d", ":5: fixed.crop.seedling_age_d: must be "),
        ("design: list", "design: list\nfactors: {}", ":2: factors: does not apply to design list; remove it"),
    ],
)
def test_an_invalid_list_of_points_is_reported_at_its_point(old: str, new: str, complaint: str, tmp_path: Path) -> None:
    assert LIST.count(old) == 1
    with pytest.raises(StudyError) as raised:
        loaded(tmp_path, LIST.replace(old, new))
    assert str(raised.value).startswith(f"{tmp_path / 'campaign.yaml'}{complaint}")


def test_a_level_that_becomes_fixed_changes_neither_keys_nor_columns(tmp_path: Path) -> None:
    varied = loaded(
        tmp_path, "design: list\npoints:\n  - {program.pause_at_feed: 200 ms, crop.claw_pressure_mpa: 0.3}\n"
    )
    fixed = loaded(tmp_path, "fixed: {crop.claw_pressure_mpa: 3 bar, program.pause_at_feed: 0.2 s}\n")
    assert keys(varied) == keys(fixed)
    assert shard_schema(varied, "1").equals(shard_schema(fixed, "1"), check_metadata=True)
