"""Texts of twins and results: one line with numbers and units."""

from __future__ import annotations

from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import load_planter
from plant_sim.planter.report import MotionReport
from plant_sim.twin.ladder.trial import LadderReport
from plant_sim.twin.lock_step import Twin


def test_a_twin_tells_time_state_seedlings_and_alarms() -> None:
    twin = Twin(trays=1)
    assert repr(twin) == "<Twin at 0.00 s: no scan yet, 0 of 72 seedlings in cups, alarms none>"
    twin.press("emergency_stop", for_ms=1_000)
    twin.run_for(200)
    assert repr(twin).startswith("<Twin at 0.20 s: ABORTED, 0 of 72 seedlings in cups, alarms emergency_stop")


def test_a_trial_of_a_program_tells_counts_incidents_and_its_reason() -> None:
    counts = SeedlingCounts(in_tray=2, in_claw=0, in_cups=70, P=0, D=0, T=0, total=72)
    text = "<LadderReport: 70 of 72 seedlings in cups, incidents 1, 20.0 s of machine time, did not complete: limit>"
    assert repr(LadderReport(counts, 1, ("fall",), 20.0, "", reason="limit")) == text


def test_a_motion_tells_speed_frequency_spacing_and_lambda() -> None:
    planter = load_planter()
    motion = Motion(planter.chain, speed_m_s=0.5, frequency_per_min=90)
    text = "<Motion, model rigid: 0.5 m/s, 90 plants/min, spacing 333 mm, lambda 1.468>"
    assert repr(motion) == text
    assert repr(MotionReport(motion, 75.0)) == f"<MotionReport: trochoid, release at 75 degrees, of {text}>"
