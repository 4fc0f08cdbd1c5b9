"""Third table of the fault matrix: vented and leaked chambers, freed jams; remedies, reports and the command."""

from __future__ import annotations

import csv
import itertools
import json
from dataclasses import replace
from pathlib import Path

import pytest

from controller.common.document.rendering import csv_text, markdown
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.cli.faults import run_stored_air
from plant_sim.cli.main import main
from plant_sim.fault_matrix.air_report import COLUMNS, AirResult, all_findings, parts, records, summary
from plant_sim.fault_matrix.run import MatrixSetup
from plant_sim.fault_matrix.stored_air import (
    CONDITIONS,
    REMEDIES,
    AirCase,
    AirOutcome,
    air_cases,
    air_trial,
    machine_with,
    run_air_case,
)
from plant_sim.fault_matrix.table_files import cells
from plant_sim.machine.stored_air import leak_down, set_air
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import clear, home_again, press_emergency_stop
from tests.plant_sim.machine.plant_rig import MACHINE, make_rig
from tests.sampling import first_of

ONE_TRAY = MatrixSetup(trays=1)
MOMENTS = 10
RATING = MACHINE.rating
FITTED = tuple(remedy for remedy in REMEDIES if remedy != "none")


def sample(remedy: str, every: int) -> list[AirCase]:
    """Return one in `every` of the remedied cases at ten moments."""
    cases = air_cases(ONE_TRAY, remedy, moments=MOMENTS)
    return [case for case in cases if CONDITIONS[case.condition].is_remedied][::every]


# --- the table ----------------------------------------------------------------------------------


def check(remedy: str, cases: list[AirCase]) -> None:
    results = [AirResult(remedy, run_air_case(case, ONE_TRAY, remedy)) for case in cases]
    assert all_findings(results) == []
    assert all(result.outcome.slide_m_s < RATING.slide_m_s for result in results)
    assert all(result.outcome.lift_m_s < RATING.lift_m_s for result in results)


@pytest.mark.parametrize("remedy", first_of(FITTED))
def test_with_a_remedy_no_speed_exceeds_its_rating_and_work_goes_on(remedy: str) -> None:
    """Both arms, every remedied condition, all seedlings in the cups and no other stop."""
    cases = sample(remedy, 14)
    assert {(case.condition, case.side) for case in cases} >= {("vented", side) for side in SIDES}
    check(remedy, cases)


@pytest.mark.nightly
@pytest.mark.parametrize("remedy", FITTED)
def test_the_whole_table_with_a_remedy(remedy: str) -> None:
    check(remedy, sample(remedy, 1))


@pytest.mark.parametrize(("condition", "every"), first_of([("vented", 6), ("vented", 3), ("leaked", 3)]))
def test_without_a_remedy_slides_are_too_fast_in_mid_stroke_but_work_goes_on(condition: str, every: int) -> None:
    """The figures of the page: homing cannot limit the speed of a slide without back pressure."""
    cases = [case for case in air_cases(ONE_TRAY, "none", moments=MOMENTS) if case.condition == condition]
    outcomes = [run_air_case(case, ONE_TRAY, "none") for case in cases[::every]]
    assert any("slide" in outcome.too_fast for outcome in outcomes)
    assert all(outcome.lost == 0 and not outcome.reason and not outcome.trips for outcome in outcomes)


@pytest.mark.parametrize(("side", "drive"), [("left", "lift"), ("right", "slide")])
def test_a_jam_freed_under_pressure_jumps_faster_than_rated(side: Side, drive: str) -> None:
    """No program can prevent this: the coils are off. Vented first, the same device does not exceed its rating."""
    trial = air_trial(ONE_TRAY, "none")
    at_ms = trial.moves_ms[side][len(trial.moves_ms[side]) // 2]
    freed, vented = (
        run_air_case(AirCase(condition, side, drive, at_ms), ONE_TRAY, "meter-in")
        for condition in ("freed", "vented, freed")
    )
    assert drive in freed.too_fast
    assert freed.jump_m > 0.005
    assert vented.is_good


def test_a_lift_with_a_speed_regulator_keeps_its_rating_when_it_is_freed_under_pressure() -> None:
    remedy = "meter-in, lift regulators"
    cases = [
        case for case in air_cases(ONE_TRAY, remedy, moments=3) if case.condition == "freed" and case.drive == "lift"
    ]
    outcomes = [run_air_case(case, ONE_TRAY, remedy) for case in cases]
    assert len(outcomes) == 6
    assert max(outcome.lift_m_s for outcome in outcomes) < RATING.lift_m_s
    assert sum(outcome.lost for outcome in outcomes) == 0


# --- starts without air -------------------------------------------------------------------------


def to_complete(twin: Twin) -> tuple[float, float]:
    """Run to Complete; return the highest speeds of slides and lifts since the last reset, m/s."""
    twin.run_until_state(State.COMPLETE, State.HELD, within_ms=120_000)
    assert twin.state is State.COMPLETE, twin.situation()
    assert twin.plant.counts().in_cups == twin.plant.counts().total
    arms = twin.plant.arms.values()
    return max(arm.slide.fastest_m_s for arm in arms), max(arm.lift.fastest_m_s for arm in arms)


def test_a_machine_vented_at_its_ends_needs_no_remedy_to_home() -> None:
    """Switched off after its work and vented: one coil fills the far chamber before lift or slide may move."""
    twin = Twin(trays=1, set_points={"trays_target": 1})
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=120_000)
    set_air(twin.plant, 0.0)
    twin.power_cycle()
    devices = [device for arm in twin.plant.arms.values() for device in (arm.slide, arm.lift)]
    for device in devices:
        device.fastest_m_s = 0.0
    twin.home()
    assert max(arm.lift.fastest_m_s for arm in twin.plant.arms.values()) < 0.75 * RATING.lift_m_s
    assert max(arm.slide.fastest_m_s for arm in twin.plant.arms.values()) < 0.1 * RATING.slide_m_s


@pytest.mark.parametrize("remedy", FITTED)
def test_a_machine_that_starts_vented_homes_and_works(remedy: str) -> None:
    """At its first power-up, it remembers no place and does not press its lifts down first."""
    parameters = machine_with(ONE_TRAY, remedy).with_values({"start.chamber_share": 0.0})
    twin = Twin(trays=1, parameters=parameters, set_points={"trays_target": 1})
    twin.plant.seedlings.make_typical()
    twin.home()
    twin.start()
    slide_m_s, lift_m_s = to_complete(twin)
    assert slide_m_s < RATING.slide_m_s
    assert lift_m_s < RATING.lift_m_s


@pytest.mark.parametrize("share", first_of([0.3, 0.1, 0.6]))
def test_with_meter_in_throttles_a_homed_machine_that_has_leaked_can_be_started(share: float) -> None:
    """Nothing homes the machine again between Idle and the start."""
    twin = Twin(trays=1, parameters=machine_with(ONE_TRAY, "meter-in"), set_points={"trays_target": 1})
    twin.plant.seedlings.make_typical()
    twin.home()
    leak_down(twin.plant, share, 60_000)
    twin.run_for(61_000)
    twin.start()
    slide_m_s, lift_m_s = to_complete(twin)
    assert slide_m_s < RATING.slide_m_s
    assert lift_m_s < RATING.lift_m_s


@pytest.mark.parametrize("after_ms", first_of([20, 0, 30, 60]))
def test_a_row_that_has_risen_in_a_stop_and_sunk_back_is_not_put_back(after_ms: int) -> None:
    """Its plugs have left their cells; released over the tray they would be lost. It is thrown instead."""
    twin = Twin(trays=1, parameters=machine_with(ONE_TRAY, "meter-in"), set_points={"trays_target": 1})
    twin.plant.seedlings.make_typical()
    twin.home()
    twin.start()
    lift = twin.plant.left.lift
    twin.run_until(twin.step_of("left arm", "lift from row"), within_ms=60_000)
    while lift.rise_m < 0.001:
        twin.scan()
    twin.run_for(after_ms)
    press_emergency_stop(twin)
    set_air(twin.plant, 0.0)
    twin.run_for(3_000)
    clear(twin)
    home_again(twin)
    twin.start()
    to_complete(twin)


# --- what else was tried ------------------------------------------------------------------------


def pulsed(x_m: float, on_ms: int, off_ms: int, *coils: str) -> tuple[float, bool]:
    """Pulse coils of a vented slide in turn for 5 s; return its highest speed, m/s, and True if it reaches feed."""
    rig = make_rig(x_m=x_m, y_m=0.0)
    set_air(rig.plant, 0.0)
    for coil in itertools.islice(itertools.cycle(coils), 5_000 // (on_ms + off_ms)):
        rig.run(on_ms, coil)
        rig.run(off_ms)
        if rig.active("left.slide_at_feed"):
            return rig.left.slide.fastest_m_s, True
    return rig.left.slide.fastest_m_s, False


@pytest.mark.parametrize("off_ms", first_of([60, 150, 400]))
def test_only_pulses_of_two_scans_would_keep_the_rating_of_a_vented_slide(off_ms: int) -> None:
    """Pulses of 20 ms outward would do, pulses of 60 ms do not; pulses of both coils in turn lead nowhere."""
    short_m_s, _ = pulsed(0.28, 20, off_ms, "left.slide_outward")
    long_m_s, _ = pulsed(0.28, 60, off_ms, "left.slide_outward")
    _, arrives = pulsed(0.28, 60, off_ms, "left.slide_outward", "left.slide_inward")
    assert short_m_s < RATING.slide_m_s < long_m_s
    assert not arrives


@pytest.mark.parametrize(("conductance_m3_s_pa", "keeps"), [(2e-9, False), (0.2e-9, True)])
def test_a_soft_start_of_the_main_line_must_be_ten_times_slower_to_keep_the_rating(
    conductance_m3_s_pa: float, keeps: bool
) -> None:
    """The manifold is filled during the 3 s for which X24 is held; what it stores accelerates the slide."""
    rig = make_rig(
        {"supply.soft_conductance_m3_s_pa": conductance_m3_s_pa, "supply.soft_until": 1.0}, x_m=0.28, y_m=0.0
    )
    rig.plant.box.emergency_stop = True
    rig.run(1_500)
    rig.plant.box.emergency_stop = False
    set_air(rig.plant, 0.0)
    rig.run(3_000)
    rig.run(8_000, "left.slide_outward")
    assert (rig.left.slide.fastest_m_s < RATING.slide_m_s) is keeps


# --- reports and command ------------------------------------------------------------------------

GOOD = AirOutcome(AirCase("vented", "left", "", 1_000), slide_m_s=0.2, lift_m_s=0.5)
BAD = AirOutcome(
    AirCase("vented, freed", "right", "lift", 2_000), lift_m_s=0.9, jump_m=0.012, lost=12, too_fast=("lift",)
)


def test_a_deviation_is_a_finding_only_where_a_remedy_should_help() -> None:
    assert not AirResult("meter-in", GOOD).finding
    assert AirResult("meter-in", BAD).finding == (
        "meter-in: vented, freed, right arm at 2000 ms, lift jammed: lift too fast; 12 lost"
    )
    assert not AirResult("none", BAD).finding
    assert not AirResult("meter-in", replace(BAD, case=BAD.case._replace(condition="freed"))).finding
    held = AirResult("meter-in", replace(GOOD, reason="Held: left: slide switches", trips={"dropped": "x"}))
    assert held.finding.endswith("dropped; Held: left: slide switches")


def test_the_table_has_a_row_per_condition_arm_and_device() -> None:
    text = markdown("Air", parts([AirResult("none", GOOD), AirResult("meter-in", BAD)]), is_literal=False)
    assert "| none | vented | left | - | 1 | 0.20 | 0.50 | 0 | 0 | - |" in text
    assert "| meter-in | vented, freed | right | lift | 1 | 0.00 | 0.90 | 12 | 12 | 1 |" in text
    assert text.endswith("lift too fast; 12 lost\n")
    assert "findings: 1" in summary([AirResult("none", GOOD), AirResult("meter-in", BAD)], 1.0)


def test_a_csv_line_equals_the_record() -> None:
    results = [AirResult("none", GOOD), AirResult("meter-in", BAD)]
    lines = list(csv.DictReader(csv_text(COLUMNS, cells(records(results), COLUMNS)).splitlines()))
    assert tuple(lines[0]) == COLUMNS
    assert [line["at_ms"] for line in lines] == [str(record["at_ms"]) for record in records(results)]


def test_the_command_writes_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "plant_sim.cli.faults.run_stored_air", lambda *_, **__: [AirResult("none", GOOD), AirResult("meter-in", BAD)]
    )
    assert main(["faults", "--stored-air", "--trays", "1", "--jobs", "1", "--out", str(tmp_path)]) == 1
    assert capsys.readouterr().out.count("stored-air.") == 3
    assert len(json.loads((tmp_path / "stored-air.json").read_text(encoding="utf-8"))["cases"]) == 2


@pytest.mark.nightly
def test_parallel_processes_give_the_same_results_as_one() -> None:
    one, two = (records(run_stored_air(ONE_TRAY, moments=1, jobs=jobs)) for jobs in (1, 2))
    assert one == two


def test_it_has_cases_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["faults", "--stored-air", "--all"]) == 2
    assert capsys.readouterr().err.startswith("--stored-air: has cases of its own")
