"""Campaigns in memory: the rows of a stored campaign, as a table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.faults import parse_fault
from plant_sim.machine.parameters import load_machine
from plant_sim.study.campaign.file import load_campaign
from plant_sim.study.campaign.frame import campaign_frame, trial_frame
from plant_sim.study.campaign.run import CampaignPlan
from plant_sim.study.errors import StudyError
from plant_sim.twin.trial import run_trial
from tests.plant_sim.study.campaign.folders import written

PRESSURE, PAUSE = "crop.claw_pressure_mpa", "program.pause_at_feed"
FILE = f"""\
design: factorial
seed: 7
seedlings: 6
faults: [[], ["stuck_off:left.lift_up"]]
factors:
  {PRESSURE}: {{levels: [0.3, 0.4]}}
fixed: {{{PAUSE}: 200 ms}}
"""


def test_a_frame_has_the_rows_of_a_stored_campaign(tmp_path: Path) -> None:
    machine, io_map = load_machine(), load_io_map(DEFAULT_IO_MAP)
    fault = parse_fault("stuck_off:left.lift_up")
    frame = campaign_frame({PRESSURE: [0.3, 0.4], PAUSE: [200]}, faults=[[], [fault]], seed=7, seedlings=6)
    runs = [*CampaignPlan(load_campaign(written(tmp_path, FILE), machine, io_map), machine, io_map, "1").runs()]
    assert [*frame.seed] == [run.seed for run in runs]
    assert [*zip(frame[PRESSURE], frame[PAUSE], strict=True)] == [(0.3, 200), (0.3, 200), (0.4, 200), (0.4, 200)]
    assert [*frame.faults] == ["", str(fault)] * 2
    assert [*frame.completed] == [True, False] * 2
    assert [*frame.S.isna()] == [False, True] * 2
    assert frame.alarms[1].startswith("S934 ")
    assert not {"key", "version", "cycle_times"} & {*frame.columns}


def test_a_frame_of_reports_has_their_numbers() -> None:
    report = run_trial(seed=3, seedlings=6)
    (row,) = trial_frame([report]).to_dict("records")
    assert (row["seed"], row["seedlings"], row["in_cups"], row["S"]) == (3, 6, report.in_cups, report.S)
    assert (row["S_low"], row["S_high"]) == report.intervals["S"]
    assert row["alarms"] == ""
    assert repr(report) == (
        f"<TrialReport seed 3: {report.in_cups} of 6 seedlings in cups, S {report.S:.1f} % ({row['S_low']:.1f} to "
        f"{row['S_high']:.1f}), {report.simulated_s:.1f} s of machine time>"
    )


@pytest.mark.parametrize(
    ("factors", "options", "message"),
    [
        (
            {"crop.claw_presure_mpa": [1]},
            {},
            "crop.claw_presure_mpa: unknown parameter of the machine; did you mean claw_pressure_mpa?",
        ),
        ({}, {}, "a factor or its levels are missing"),
        ({PRESSURE: []}, {}, "a factor or its levels are missing"),
        ({PRESSURE: [0.3]}, {"replicates": 0}, "replicates: must be 1 or more, not 0"),
        ({PRESSURE: [0.3]}, {"seedlings": 0}, "seedlings: must be 1 or more, not 0"),
        ({PRESSURE: [-1]}, {}, PRESSURE),
    ],
)
def test_a_wrong_setting_is_told_before_the_first_trial(
    factors: dict[str, list[float]], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(StudyError, match=message.replace("?", r"\?")):
        campaign_frame(factors, **options)
