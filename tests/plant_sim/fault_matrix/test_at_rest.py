"""Second table of the fault matrix: stops, rest situations, cases, verdicts, reports and the command."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from controller.common.document.rendering import csv_text, markdown
from controller.program.states import HOMED_FROM
from controller.program.tags import SIDES, Side
from plant_sim.cli.main import main
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.fault_matrix.at_rest import KINDS, RestCase, RestOutcome, run_at_rest
from plant_sim.fault_matrix.rest_expected import AT_REST, WITHOUT_FAULT, complaints
from plant_sim.fault_matrix.rest_report import COLUMNS, RestResult, parts, records, summary
from plant_sim.fault_matrix.rest_table import ALL_FAULTS, jobs_at, jobs_of, periods, run_job, search, selection
from plant_sim.fault_matrix.run import MatrixSetup, undisturbed
from plant_sim.fault_matrix.situations import (
    TRAY_SWITCH,
    Situation,
    Spell,
    come_to_rest,
    longest_spells,
    spells_between,
    twin_at,
)
from plant_sim.fault_matrix.stops import STOPS, StopKind
from plant_sim.fault_matrix.table_files import cells
from plant_sim.links.in_process import InProcessLink, LinkDown
from plant_sim.machine.arm import ARM_SWITCHES
from plant_sim.twin.lock_step import SCAN_MS
from tests.paths import DOCS
from tests.sampling import first_of, one_in

ONE_TRAY = MatrixSetup(trays=1)
TWO_TRAYS = MatrixSetup(trays=2)
BY_NAME = {stop.name: stop for stop in STOPS}


def moment(side: Side, step: str, after_ms: int, setting: MatrixSetup = ONE_TRAY) -> int:
    """Return the time at which an arm has first been in a step for some time, ms."""
    twin = twin_at(undisturbed(setting).begins_ms, setting)
    twin.run_until(twin.step_of(f"{side} arm", step), within_ms=60_000)
    twin.run_for(after_ms)
    return twin.now_ms


# --- stops --------------------------------------------------------------------------------------


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_a_stop_leaves_the_machine_at_rest_and_ends_where_it_can_be_homed(stop: StopKind) -> None:
    """Nothing moves after the stop, and no alarm of the stop remains after its end."""
    twin = twin_at(moment("left", "slide to feed", 500), ONE_TRAY)
    stop.begin(twin)
    devices = [device for arm in twin.plant.arms.values() for device in (arm.slide, arm.lift)]
    before = [device.position_m for device in devices]
    twin.module.advance(200)
    assert [device.position_m for device in devices] == pytest.approx(before, abs=1e-5)
    twin.clock.advance(200)
    stop.end(twin)
    assert twin.state in HOMED_FROM
    assert twin.alarms() == []


def test_a_cut_link_transfers_nothing() -> None:
    twin = ONE_TRAY.twin()
    link = InProcessLink(twin.module)
    link.open()
    link.is_cut = True
    for use in (link.open, link.read_inputs, lambda: link.write_outputs(twin.io_map.safe_outputs())):
        with pytest.raises(LinkDown):
            use()
    link.is_cut = False
    with pytest.raises(LinkDown, match="not open"):
        link.read_inputs()
    link.open()
    assert link.read_inputs() == twin.plant.x


# --- situations ---------------------------------------------------------------------------------


def test_a_situation_contains_the_switches_and_the_memory_of_its_arm() -> None:
    twin = twin_at(moment("left", "slide to feed", 500), ONE_TRAY)
    left, right = come_to_rest(twin, BY_NAME["emergency stop"])
    assert (left.stop, left.side, right.side) == ("emergency stop", "left", "right")
    assert left.switches == ("lift_up", "claws_converged", TRAY_SWITCH)
    assert {"loaded", "clamped", "was up", "row 2 = 1", "tray = 1"} <= set(left.memory)
    assert "row 1 = 1" not in left.memory


@pytest.mark.parametrize("stop", first_of(STOPS[:4]), ids=str)
def test_a_search_by_bisection_finds_every_situation_of_a_period(stop: StopKind) -> None:
    """The period contains the closing of the claws on a row and the start of the lift."""
    start_ms = moment("left", "close claws", 0) - 60
    every, coarse = (
        spells_between(start_ms, start_ms + 480, ONE_TRAY, every_ms=every_ms, stops=[stop]) for every_ms in (10, 40)
    )
    assert coarse == every
    assert len({spell.situation for spell in every if spell.situation.side == "left"}) >= 3


@pytest.mark.weekly
@pytest.mark.timeout(3_000)
def test_a_search_by_bisection_finds_every_situation_of_the_trial() -> None:
    trial = undisturbed(TWO_TRAYS)
    for first_ms in range(trial.begins_ms, trial.ends_ms, 1_000):
        last_ms = min(first_ms + 1_000, trial.ends_ms)
        every, coarse = (spells_between(first_ms, last_ms, TWO_TRAYS, every_ms=ms) for ms in (SCAN_MS, 40))
        assert {spell.situation for spell in coarse} == {spell.situation for spell in every}


def test_spells_that_continue_each_other_are_joined_and_the_longest_is_chosen() -> None:
    one, two = (Situation("stopped", side, (), ()) for side in SIDES)
    spells = [Spell(one, 1_000, 1_090), Spell(one, 0, 50), Spell(two, 0, 30), Spell(one, 1_100, 1_200)]
    assert longest_spells(spells) == [Spell(two, 0, 30), Spell(one, 1_000, 1_200)]
    assert [spell.middle_ms for spell in longest_spells(spells)] == [10, 1_100]


def test_situations_of_one_stop_at_one_moment_share_a_job() -> None:
    left, right = (Situation("stopped", side, (), ()) for side in SIDES)
    (job,) = jobs_of([Spell(left, 0, 30), Spell(right, 0, 30)], selection())
    assert (job.stop, job.at_ms, job.situations) == ("stopped", 10, (left, right))
    assert len(job.cases) == len(set(job.cases)) == len(SIDES) * len(ALL_FAULTS)


def test_the_faults_are_all_position_switches_stuck_on_and_off() -> None:
    twin = ONE_TRAY.twin()
    optional = {point.tag for point in (*twin.io_map.inputs, *twin.io_map.unwired) if point.optional}
    sensed = {tag.partition(".")[2] or tag for tag in twin.plant.sensors if tag not in optional}
    assert {*ARM_SWITCHES, TRAY_SWITCH} == sensed - {"cup_pulse"}
    assert len(ALL_FAULTS) == len(set(ALL_FAULTS)) == len(KINDS) * len(sensed - {"cup_pulse"})
    assert len(jobs_at([0, 10], selection())) == 2 * len(STOPS)


# --- cases --------------------------------------------------------------------------------------

FOUND: list[tuple[str, int, str, str]] = [
    ("slide to feed", 600, "stuck_on", "slide_at_feed"),
    ("converge", 400, "stuck_on", "claws_converged"),
    ("spread", 400, "stuck_on", "claws_spread"),
    ("lift from row", 300, "stuck_on", "lift_down"),
    ("lift from row", 300, "stuck_on", "lift_up"),
]
"""Step, time in it, ms, and a switch of a place where the device is not."""


@pytest.mark.parametrize(
    ("step", "after_ms", "kind", "switch"), one_in(3, FOUND), ids=[f"{each[0]}, {each[3]}" for each in FOUND]
)
@pytest.mark.parametrize("side", first_of(SIDES))
def test_a_switch_that_welds_in_an_emergency_stop_in_mid_stroke_does_no_harm(
    step: str, after_ms: int, kind: str, switch: str, side: Side
) -> None:
    """The switch of a place where the device is not turns on: it is told, or does no harm."""
    at_ms = moment(side, step, after_ms)
    case = RestCase("emergency stop", at_ms, side, kind, switch)
    _, outcome = run_at_rest(BY_NAME["emergency stop"], at_ms, [case], ONE_TRAY)
    assert complaints(outcome) == []


SAMPLE: list[tuple[str, str, int, str, str, str]] = [
    ("emergency stop", "slide to feed", 600, "stuck_off", "lift_up", "home: raise loaded"),
    ("controller off", "approach row", 500, "stuck_on", "lift_up", "lift switches"),
    ("power off", "approach row", 500, "stuck_off", "lift_down", "home: lower"),
    ("link lost", "spread", 600, "stuck_off", "claws_spread", "spread"),
    ("held, homed", "wait for cups", 100, "stuck_off", "slide_at_feed", "home: out"),
    ("held, resumed", "wait for cups", 100, "stuck_off", TRAY_SWITCH, "tray_lost"),
    ("stopped", "lift from row", 100, "stuck_on", "claws_spread", "belt switches"),
    ("complete", "lift from row", 100, "stuck_off", "slide_at_pick_2", "approach row"),
]
"""Stop, step and time in it, ms, fault, and its first alarm."""


@pytest.mark.parametrize(
    ("stop", "step", "after_ms", "kind", "switch", "alarm"),
    one_in(3, SAMPLE),
    ids=[f"{each[0]}, {each[4]}" for each in SAMPLE],
)
def test_a_switch_that_sticks_at_rest_is_told_and_the_trial_completes(
    stop: str, step: str, after_ms: int, kind: str, switch: str, alarm: str
) -> None:
    """After the same stop without a fault, the operator finds nothing to repair."""
    at_ms = moment("left", step, after_ms)
    case = RestCase(stop, at_ms, "left", kind, switch)
    reference, outcome = run_at_rest(BY_NAME[stop], at_ms, [case], ONE_TRAY)
    assert (complaints(reference), reference.rounds, reference.signal) == ([], 0, "")
    assert (complaints(outcome), outcome.rounds, outcome.signal) == ([], 1, alarm)


@pytest.mark.timeout(3_600)
@pytest.mark.parametrize("one_in", first_of([20, 1], 0, nightly=1))
@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_every_switch_in_every_rest_situation(stop: StopKind, one_in: int) -> None:
    """Of one second in 20, and of all seconds of a trial of two trays."""
    chosen = selection([stop.name])
    seconds = periods(TWO_TRAYS)[one_in // 4 :: one_in]
    spells = [spell for second in seconds for spell in search(second, TWO_TRAYS, chosen.stops)]
    jobs = jobs_of(spells, chosen)
    assert len(jobs) >= 3
    assert [complaint for job in jobs for outcome in run_job(job, TWO_TRAYS) for complaint in complaints(outcome)] == []


@pytest.mark.timeout(3_600)
@pytest.mark.parametrize("every_ms", first_of([1_010, 110], 0, nightly=1))
@pytest.mark.parametrize("stop", STOPS[:4], ids=str)
def test_every_switch_at_regular_moments_of_a_cycle(stop: StopKind, every_ms: int) -> None:
    """The moments are not in the middle of the situations; one cycle of the left arm."""
    begin_ms = moment("left", "approach row", 0)
    for job in jobs_at(range(begin_ms, begin_ms + 16_000, every_ms), selection([stop.name])):
        assert [complaint for outcome in run_job(job, ONE_TRAY) for complaint in complaints(outcome)] == []


# --- judgement and reports ----------------------------------------------------------------------

CASE = RestCase("stopped", 20_000, "left", "stuck_on", "lift_up")
SOUND = RestOutcome(CASE, SeedlingCounts(0, 0, 72, 0, 0, 0, 72), signal="lift switches", signal_after_ms=700, rounds=1)


@pytest.mark.parametrize(
    ("outcome", "complaint"),
    [
        (replace(SOUND, trips={"dropped": "12 seedlings"}), "monitor dropped: 12 seedlings"),
        (replace(SOUND, lost=12), "seedlings lost: 12"),
        (replace(SOUND, lost=12, signal=""), "seedlings lost without a signal: 12"),
        (replace(SOUND, rounds=2), "stopped too often: 2 times"),
        (replace(SOUND, reason="1 trays counted, not 2"), "not recovered: 1 trays counted, not 2"),
        (replace(SOUND, case=CASE._replace(kind="")), "stopped too often: 1 times"),
    ],
)
def test_each_deviation_gives_exactly_one_complaint(outcome: RestOutcome, complaint: str) -> None:
    assert complaints(SOUND) == []
    assert complaints(outcome) == [complaint]


def test_a_violation_is_accepted_only_where_it_is_expected() -> None:
    passed = replace(SOUND, trips={"arm_through_tray": "column 1"})
    dead = CASE._replace(kind="stuck_off", switch="slide_at_pick_1")
    assert complaints(replace(passed, case=dead)) == []
    assert len(complaints(passed)) == 1
    assert complaints(replace(passed, case=dead, lost=12)) == ["seedlings lost: 12"]


def test_every_expectation_belongs_to_a_case_and_has_a_reason() -> None:
    assert AT_REST.keys() <= set(ALL_FAULTS)
    assert all(expected.note for expected in AT_REST.values())


SITUATION = Situation("stopped", "left", ("lift_down", "slide_at_feed"), ("was down",))


def test_the_table_has_a_row_per_stop_and_fault() -> None:
    results = [RestResult(SITUATION, outcome) for outcome in (SOUND, replace(SOUND, lost=12, trips={"dropped": "12"}))]
    table = markdown("At rest", parts(results), is_literal=False).splitlines()
    assert "| stopped | `stuck_on:lift_up` | 2 | lift switches 2 | dropped 1 | 0 to 12 | 1 | 2 |" in table
    assert "- stopped at 20000 ms, stuck_on:left.lift_up: seedlings lost: 12" in table
    assert [line for line in table if line.startswith("#")] == ["# At rest", "### Findings at rest"]
    head, findings, *kinds = summary(results, 3.0).splitlines()
    assert head == "1 rest situations, 2 cases in 3 s: 2 with a signal, 1 with harm"
    assert findings == "findings: 2"
    assert [" ".join(line.split()) for line in kinds] == [
        "1 stuck_on:lift_up, stopped: monitor dropped",
        "1 stuck_on:lift_up, stopped: seedlings lost",
    ]


def test_a_csv_line_equals_the_record() -> None:
    result = RestResult(SITUATION, SOUND)
    (line,) = csv.DictReader(csv_text(COLUMNS, cells(records([result]), COLUMNS)).splitlines())
    (record,) = records([result])
    assert tuple(line) == tuple(record) == COLUMNS
    assert (line["fault"], line["switches"]) == ("stuck_on:left.lift_up", "lift_down; slide_at_feed")


def test_the_page_names_every_stop_and_every_limit() -> None:
    page = (DOCS / "fault-matrix.md").read_text(encoding="utf-8").partition("## Switches that stick at rest")[2]
    assert all(f"| {stop.name} | {stop.meaning} |" in page for stop in STOPS)
    assert all(f"- `{kind}:{switch}`: {expected.note}" in page for (kind, switch), expected in AT_REST.items())
    assert all(f"- `{stop}`: {expected.note}" in page for stop, expected in WITHOUT_FAULT.items())


# --- command ------------------------------------------------------------------------------------

PART = ("--at-rest", "--stop", "stopped", "--fault", "stuck_on:lift_up", "--every", "30000")


@pytest.mark.parametrize("jobs", first_of(["1", "2"]))
def test_the_command_writes_table_csv_and_json_and_ends_with_0(
    jobs: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["faults", "--trays", "1", "--jobs", jobs, "--out", str(tmp_path), *PART]) == 0
    assert capsys.readouterr().out.splitlines()[1] == "findings: none"
    cases = json.loads((tmp_path / "fault-matrix-at-rest.json").read_text())["cases"]
    assert [case["fault"] for case in cases] == ["no fault", "stuck_on:left.lift_up", "stuck_on:right.lift_up"] * 2
    assert len((tmp_path / "fault-matrix-at-rest.csv").read_text(encoding="utf-8").splitlines()) == 7
    assert "| stopped | `stuck_on:lift_up` | 4 |" in (tmp_path / "fault-matrix-at-rest.md").read_text(encoding="utf-8")


def test_a_finding_gives_exit_code_1(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("plant_sim.fault_matrix.rest_report.complaints", lambda _outcome: ["seedlings lost: 12"])
    assert main(["faults", "--trays", "1", "--jobs", "1", *PART]) == 1
    assert capsys.readouterr().out.splitlines()[1] == "findings: 6"
