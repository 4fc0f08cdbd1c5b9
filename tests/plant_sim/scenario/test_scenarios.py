"""Scenario files: the library, the file format, and rejected files."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import pytest

from plant_sim.cli.options.scenario import add_arguments
from plant_sim.cli.options.shared import add_fault_arguments
from plant_sim.cli.scenario import scenario_of
from plant_sim.cli.settings import faults_of
from plant_sim.faults import Fault, FaultError
from plant_sim.scenario.actions import VERBS
from plant_sim.scenario.checks import GAUGES
from plant_sim.scenario.errors import ScenarioError
from plant_sim.scenario.file import SCENARIOS, find_scenario, load_scenario
from plant_sim.scenario.run import ScenarioReport, run_scenario
from plant_sim.twin.lock_step import Twin
from tests.paths import DOCS
from tests.sampling import one_in

SHIPPED = sorted(path.stem for path in SCENARIOS.glob("*.yaml"))
BRIEF = """\
title: A story
until: {time: 3 s}
expect: {alarms: []}
"""


def scenario_file(folder: Path, text: str) -> Path:
    """Write a scenario file and return its path."""
    path = folder / "story.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def run_file(folder: Path, text: str) -> tuple[ScenarioReport, Twin]:
    """Run a scenario; return the report and the machine."""
    twins: list[Twin] = []
    report = run_scenario(load_scenario(scenario_file(folder, text)), prepare=twins.append)
    return report, twins[0]


# --- library --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scenario_passes(name: str) -> None:
    report = run_scenario(load_scenario(find_scenario(name)))
    assert report.passed, report.text()
    assert report.faults


@pytest.mark.parametrize("name", ["stuck-reed-switch", "emergency-stop-leaking-check-valve"])
def test_a_shipped_scenario_fails_without_its_fault(name: str) -> None:
    """The checks of a scenario fail on a machine that does not have its fault."""
    scenario = load_scenario(find_scenario(name))
    sound = [action for action in scenario.actions if not action.text.startswith("fault")]
    until = replace(scenario.until, limit_ms=min(scenario.until.limit_ms, 45_000))
    report = run_scenario(replace(scenario, faults=(), actions=tuple(sound), until=until))
    assert not report.passed
    assert report.failures


# --- file format --------------------------------------------------------------------------------


def test_without_actions_the_machine_is_homed_and_started(tmp_path: Path) -> None:
    report, twin = run_file(tmp_path, "title: t\nuntil: {state: EXECUTE, limit: 20 s}\nexpect: {state: EXECUTE}\n")
    assert report.passed, report.text()
    assert 2_000 < twin.now_ms < 15_000


def test_machine_values_set_points_seed_and_trays_are_applied(tmp_path: Path) -> None:
    text = BRIEF + (
        "seed: 7\ntrays: 3\n"
        "machine: {supply.pressure_pa: 4.5 bar, cups.planting_frequency_per_min: 30, crop.claw_pressure_mpa: 350 kPa,\n"
        "  layout.arms_may_meet_in_plant: true, claws.grippers: 12}\n"
        "set_points: {release_delay: 150 ms, converge_at: 1}\n"
    )
    scenario = load_scenario(scenario_file(tmp_path, text))
    assert (scenario.seed, scenario.trays) == (7, 3)
    assert scenario.machine.supply.pressure_pa == pytest.approx(450_000.0)
    assert scenario.machine.crop.claw_pressure_mpa == pytest.approx(0.35)
    assert scenario.machine.cups.planting_frequency_per_min == 30
    assert scenario.machine.layout.arms_may_meet_in_plant
    assert scenario.set_points == {"trays_target": 3, "release_delay": 15, "converge_at": 1}
    assert load_scenario(scenario.path, seed=9).seed == 9


def test_values_are_checked_together(tmp_path: Path) -> None:
    """A different pitch is valid if cups and spreader change together, although either change alone is invalid."""
    text = BRIEF + "machine: {cups.pitch_m: 62 mm, spreader.travel_m: 209 mm}\n"
    assert load_scenario(scenario_file(tmp_path, text)).machine.cups.pitch_m == pytest.approx(0.062)


def test_actions_wait_for_time_state_and_step(tmp_path: Path) -> None:
    """An action set for half a second after the start of a step runs at that time; actions run in sequence."""
    text = """\
title: t
actions:
  - {at: 100 ms, press: start}
  - {at: IDLE, after: 250 ms, planting_frequency: 0/min}
  - {at: 1 s, press: start, for: 300 ms}
  - {at: "left arm: wait for cups", after: 500 ms, hold: emergency_stop}
  - {at: ABORTED, after: 1 s, release: emergency_stop}
  - {at: ABORTED, after: 500 ms, command: clear}
until: {state: STOPPED, limit: 40 s}
expect: {state: STOPPED, alarms: [{alarm: emergency_stop, time: 3 s..30 s}], cycles: 0, time: 5 s..35 s}
"""
    scenario = load_scenario(scenario_file(tmp_path, text))
    samples: list[tuple[int, bool, bool]] = []

    def watch(twin: Twin) -> None:
        pressed = twin.plant.box.emergency_stop
        twin.watch(lambda twin: samples.append((twin.now_ms, twin.in_step("left arm", "wait for cups"), pressed)))
        twin.watch(lambda twin: buttons.append((twin.now_ms, twin.plant.box.start, twin.plant.box.emergency_stop)))

    buttons: list[tuple[int, bool, bool]] = []
    report = run_scenario(scenario, prepare=watch)
    assert report.passed, report.text()
    in_step_ms = next(ms for ms, in_step, _ in samples if in_step)
    pressed_ms = [ms for ms, _, stop in buttons if stop]
    assert pressed_ms[0] - in_step_ms == pytest.approx(500, abs=20)
    assert len(pressed_ms) == pytest.approx(100, abs=5)
    assert report.alarms["emergency_stop"] * 1_000 == pytest.approx(pressed_ms[0], abs=30)
    assert sum(start for _, start, _ in buttons) == 10 + 30


def test_an_action_changes_the_mode(tmp_path: Path) -> None:
    """With one-cycle mode selected before homing, each arm throws the row it is assumed to hold."""
    text = """\
title: t
actions:
  - {at: 100 ms, command: mode_one_cycle}
  - {at: 200 ms, press: start}
  - {at: IDLE, after: 500 ms, press: start}
until: {state: COMPLETE, limit: 60 s}
expect: {state: COMPLETE, cycles: 0, counts: {in_tray: 72}}
"""
    report, _ = run_file(tmp_path, text)
    assert report.passed, report.text()


def test_actions_start_and_end_faults(tmp_path: Path) -> None:
    """A fault with a duration ends automatically, and a fault without one lasts until the mend action."""
    text = """\
title: t
actions:
  - {at: 500 ms, fault: "stuck_on:left.lift_up", for: 200 ms}
  - {at: 600 ms, fault: "jammed:right.slide"}
  - {at: 900 ms, mend: "jammed:right.slide"}
until: {time: 2 s}
expect: {state: STOPPED}
"""
    active: dict[int, list[str]] = {}

    def prepare(twin: Twin) -> None:
        def note(twin: Twin) -> None:
            active[twin.now_ms] = [fault.name for fault in twin.plant.faults.active]

        twin.watch(note)

    report = run_scenario(load_scenario(scenario_file(tmp_path, text)), prepare=prepare)
    assert report.passed
    stuck = [ms for ms, names in active.items() if "stuck_on:left.lift_up" in names]
    jammed = [ms for ms, names in active.items() if "jammed:right.slide" in names]
    assert (min(stuck), max(stuck)) == (500, 690)
    assert (min(jammed), max(jammed)) == (600, 890)
    assert report.faults == ["stuck_on:left.lift_up@500ms..700ms", "jammed:right.slide@600ms.."]


def test_a_power_cycle_restarts_the_controller(tmp_path: Path) -> None:
    report, twin = run_file(
        tmp_path,
        "title: t\nactions: [{at: 100 ms, press: start}, {at: IDLE, power_cycle: 2 s}]\n"
        "until: {state: STOPPED, limit: 30 s}\nexpect: {alarms: []}\n",
    )
    assert report.passed, report.text()
    assert twin.now_ms > 4_000


def test_every_expectation_is_checked(tmp_path: Path) -> None:
    """Each failed expectation is reported with its line and the actual value."""
    text = """\
title: t
actions: []
until: {time: 1 s}
expect:
  state: HELD
  alarms: [{alarm: "left: spread", time: 1 s..2 s}]
  incidents: [torn]
  counts:
    in_tray: ">= 73"
    P: 1
  cycles: 1..3
  missed_cups: ">= 1"
  time: 2 s..3 s
  measures:
    supply.pressure: 0.1 MPa..0.2 MPa
    left.lift.rise: ">= 20 mm"
"""
    report, _ = run_file(tmp_path, text)
    path = tmp_path / "story.yaml"
    assert report.failures == [
        f"{path}:7: incidents is none, expected torn",
        f"{path}:5: state is STOPPED, expected HELD",
        f"{path}:6: alarms is none, expected left: spread",
        f"{path}:6: time of left: spread, ms is None, expected 1 s..2 s",
        f"{path}:11: cycles is 0, expected 1..3",
        f"{path}:12: missed_cups is 0, expected >= 1",
        f"{path}:13: time, ms is 1000, expected 2 s..3 s",
        f"{path}:9: in_tray is 72, expected >= 73",
        f"{path}:10: P is 0, expected 1",
        f"{path}:15: supply.pressure, Pa is 500000, expected 0.1 MPa..0.2 MPa",
        f"{path}:16: left.lift.rise, m is 0, expected >= 20 mm",
    ]
    assert not report.passed
    assert f"0 of {report.checks} checks passed" in report.text()
    assert json.loads(json.dumps(report.record()))["passed"] is False


def test_an_unexpected_incident_or_alarm_fails(tmp_path: Path) -> None:
    report, _ = run_file(
        tmp_path,
        "title: t\nfaults: [{kind: stuck_off, at: left.slide_at_pick_1}]\nuntil: {state: HELD, limit: 60 s}\n"
        "expect: {state: HELD, alarms: []}\n",
    )
    assert [failure.partition(": ")[2] for failure in report.failures] == [
        "incidents is arm_through_tray, expected none",
        "alarms is left: approach row, expected none",
    ]


def test_a_trigger_that_is_not_reached_is_reported_with_the_situation(tmp_path: Path) -> None:
    report, twin = run_file(
        tmp_path, "title: t\nactions: [{at: HELD, press: start}]\nuntil: {time: 1 s}\nexpect: {cycles: 0}\n"
    )
    assert twin.now_ms == 1_000
    assert report.reason.startswith("HELD (press: start) not reached within 1000 ms; at 1000 ms STOPPED")
    assert not report.passed


def test_an_action_with_a_fault_already_active_ends_the_scenario(tmp_path: Path) -> None:
    report, _ = run_file(
        tmp_path,
        "title: t\nfaults: [{kind: jammed, at: left.lift}]\nactions: [{at: 1 s, fault: jammed:left.lift}]\n"
        "until: {time: 2 s}\nexpect: {cycles: 0}\n",
    )
    assert report.reason.startswith("jammed:left.lift@1000ms..: changes the same value as jammed:left.lift;")
    assert not report.passed


# --- rejected files -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "complaint"),
    one_in(
        3,
        [
            ("titel: t", "1: titel: unknown key; did you mean title?"),
            ("title: t\ntitle: u", "2: file: key 'title' is already defined on line 1; delete one"),
            ("title: t\nseed: one", "2: seed: must be an integer, 0 to 2147483647, not 'one'"),
            ("title: t\ntrays: 0", "2: trays: must be an integer, 1 to 1000, not '0'"),
            ("title: t\nmachine: [a]", "2: machine: must be a mapping; write a key, a colon and a value per line"),
            (
                "title: t\nmachine:\n  slide.bore_mm: 5",
                "3: machine.slide.bore_mm: unknown parameter of the machine; did you mean bore_m?",
            ),
            (
                "title: t\nmachine:\n  supply.pressure_pa: 5 mm",
                "3: machine.supply.pressure_pa: '5 mm': mm is a unit of another quantity; "
                "use Pa or kPa or MPa or mbar or bar",
            ),
            (
                "title: t\nmachine:\n  supply.pressure_pa: 50 bar",
                "3: machine.supply.pressure_pa: must be 50000 to 1e+06, not 5e+06",
            ),
            (
                "title: t\nmachine:\n  cups.pitch_m: 62 mm",
                "3: machine.spreader.travel_m: spreads the claws to 0.06 m; it must equal cups.pitch_m to 1 mm",
            ),
            ("title: t\nset_points: {clam: 1}", "2: set_points.clam: unknown key; did you mean clamp?"),
            (
                "title: t\nset_points: {converge_at: 2}",
                "2: set_points.converge_at: must be an integer, 0 to 1, not '2'",
            ),
            ("title: t\nset_points: {clamp: 205 ms}", "2: set_points.clamp: '205 ms': must be a multiple of 10 ms"),
            (
                "title: t\nfaults:\n  - {kind: stuck, at: left.lift_up}",
                "3: faults[1]: stuck: unknown fault; did you mean stuck_on?",
            ),
            (
                "title: t\nfaults:\n  - {kind: stuck_on, at: left.lift_op}",
                "3: faults[1]: stuck_on:left.lift_op: not a sensor; did you mean left.lift_up?",
            ),
            (
                "title: t\nfaults:\n  - {kind: jammed, at: left.lift, from: 5}",
                "3: faults[1].from: '5': a time requires a unit; write 5 s or 5 ms",
            ),
            (
                "title: t\nfaults:\n  - {kind: leak, at: supply, size: 3 N}",
                "3: faults[1].size: '3 N': N is a unit of another quantity; use m3/(s Pa) or dm3/(s bar) or L/(s bar)",
            ),
            ("title: t\nfaults:\n  - {kind: jammed}", "3: faults[1].at: is missing; add it"),
            (
                "title: t\nactions: [{at: 1 s}]",
                "2: actions[1]: must contain exactly one action, not 0; use one of press, hold, release, "
                "command, planting_frequency, power_cycle, air, fault, mend",
            ),
            (
                "title: t\nactions: [{at: 1 s, press: resett}]",
                "2: actions[1].press: unknown button 'resett'; did you mean reset?",
            ),
            ("title: t\nactions: [{at: idle, press: start}]", "2: actions[1].at: unknown time, state or step 'idle'; "),
            (
                "title: t\nactions: [{at: 1 s, after: 1 s, press: start}]",
                "2: actions[1].after: does not apply to a time; specify the final time in at",
            ),
            (
                "title: t\nactions: [{at: 1 s, hold: stop, for: 1 s}]",
                "2: actions[1].for: does not apply to hold; remove it",
            ),
            (
                "title: t\nuntil: {time: 9 s}\nactions: [{at: 1 s, fault: jammed:left.slyde}]",
                "3: actions[1].fault: jammed:left.slyde: not a moving part; did you mean left.slide?",
            ),
            (
                "title: t\nactions: [{at: 1 s, fault: missing_cells:tray_1=5}]",
                "2: actions[1].fault: missing_cells:tray_1: must be set before the run; list it under faults",
            ),
            (
                "title: t\nactions: [{at: 1 s, mend: jammed:left.slyde}]",
                "2: actions[1].mend: jammed:left.slyde: not a moving part; did you mean left.slide?",
            ),
            ("title: t\nexpect: {cycles: 1}", "1: until: is missing; add until: {state: COMPLETE, limit: 300 s} or "),
            ("title: t\nuntil: {state: HELD}", "2: until.limit: is missing; add it"),
            ("title: t\nuntil: {time: 1 s}", "1: expect: is missing; add the expected results"),
            (
                "title: t\nuntil: {time: 1 s}\nexpect: {}",
                "3: expect: contains no expectation; add one or more of state, alarms, ",
            ),
            (
                "title: t\nuntil: {time: 1 s}\nexpect: {alarms: [tray_jamm]}",
                "3: expect.alarms: unknown alarm 'tray_jamm'; did you mean tray_jam?",
            ),
            (
                "title: t\nuntil: {time: 1 s}\nexpect: {counts: {Q: 1}}",
                "3: expect.counts.Q: unknown key; use one of in_tray, ",
            ),
            ("title: t\nuntil: {time: 1 s}\nexpect: {cycles: many}", "3: expect.cycles: 'many': not a number; "),
            (
                "title: t\nuntil: {time: 1 s}\nexpect: {alarms: [tray_jam, [a]]}",
                "3: expect.alarms[2]: must be a word or a mapping, not a list",
            ),
            (
                "title: t\nuntil: {time: 1 s}\nexpect: {incidents: [[a]]}",
                "3: expect.incidents[1]: must be a word or a number, not a list",
            ),
            ("until: {time: 1 s}\nexpect: {cycles: 0}", "1: title: is missing; add it"),
            ("- a", "1: file: does not begin with a section; write its name and a colon"),
        ],
    ),
)
def test_an_invalid_file_is_rejected_in_one_line(tmp_path: Path, lines: str, complaint: str) -> None:
    path = scenario_file(tmp_path, lines + "\n")
    with pytest.raises(ScenarioError) as error:
        load_scenario(path)
    text = str(error.value)
    assert text.removeprefix(f"{path}:").startswith(complaint), text
    assert "\n" not in text


def test_an_unknown_name_is_rejected_with_a_suggestion() -> None:
    with pytest.raises(ScenarioError) as error:
        find_scenario("stuck-reed-swich")
    assert str(error.value).startswith("stuck-reed-swich: unknown scenario; did you mean stuck-reed-switch?")
    with pytest.raises(ScenarioError, match=r"^nowhere\.yaml: cannot be read"):
        load_scenario(find_scenario("nowhere.yaml"))


# --- command line -------------------------------------------------------------------------------


def test_the_command_line_accepts_a_scenario_and_faults() -> None:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    add_fault_arguments(parser)
    options = parser.parse_args(
        ["stuck-reed-switch", "--seed", "5", "--fault", "jammed:left.slide@2s..", "--fault", "stuck_on:left.lift_up"]
    )
    scenario = scenario_of(options)
    assert (scenario.path.stem, scenario.seed) == ("stuck-reed-switch", 5)
    assert faults_of(options) == [Fault("jammed", "left.slide", 2_000), Fault("stuck_on", "left.lift_up")]
    options.fault.append("jammed")
    with pytest.raises(FaultError):
        faults_of(options)


def test_the_scenario_of_the_guide_passes(tmp_path: Path) -> None:
    guide = (DOCS / "faults.md").read_text(encoding="utf-8")
    story = guide.partition("```yaml\n")[2].partition("```")[0]
    report, _ = run_file(tmp_path, story)
    assert report.passed, report.text()


def test_the_guide_names_every_action_expectation_and_shipped_scenario() -> None:
    guide = (DOCS / "faults.md").read_text(encoding="utf-8")
    gauges = [name.replace("right", "left") for name in GAUGES]
    names = [*(f"`{verb}: " for verb in VERBS), *gauges, *(f"`{name}`" for name in SHIPPED)]
    assert [name for name in names if name not in guide] == []
