"""Scenario files: those that come with the package, all that can be written, and all that is refused."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import pytest

from plant_sim.bench.scenario import ScenarioReport, run_scenario
from plant_sim.bench.scenario_actions import VERBS
from plant_sim.bench.scenario_checks import GAUGES
from plant_sim.bench.scenario_cli import add_fault_arguments, add_scenario_arguments, faults_of, scenario_of
from plant_sim.bench.scenario_file import SCENARIOS, find_scenario, load_scenario
from plant_sim.bench.scenario_section import ScenarioError
from plant_sim.bench.twin import Twin
from plant_sim.faults import Fault, FaultError

SHIPPED = sorted(path.stem for path in SCENARIOS.glob("*.yaml"))
BRIEF = """\
title: A story
until: {time: 3 s}
expect: {alarms: []}
"""


def written(folder: Path, text: str) -> Path:
    """Return a scenario file."""
    path = folder / "story.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def told(folder: Path, text: str) -> tuple[ScenarioReport, Twin]:
    """Run a scenario; return the report and the machine."""
    twins: list[Twin] = []
    report = run_scenario(load_scenario(written(folder, text)), prepare=twins.append)
    return report, twins[0]


# --- those that come with the package -----------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scenario_passes(name: str) -> None:
    report = run_scenario(load_scenario(find_scenario(name)))
    assert report.passed, report.text()
    assert report.faults


@pytest.mark.parametrize("name", ["stuck-reed-switch", "emergency-stop-leaking-check-valve"])
def test_a_shipped_scenario_fails_without_its_fault(name: str) -> None:
    """Given the story with a sound machine, its checks do not hold: the fault is what they see."""
    scenario = load_scenario(find_scenario(name))
    sound = [action for action in scenario.actions if not action.text.startswith("fault")]
    until = replace(scenario.until, limit_ms=min(scenario.until.limit_ms, 45_000))
    report = run_scenario(replace(scenario, faults=(), actions=tuple(sound), until=until))
    assert not report.passed
    assert report.failures


# --- what can be written ------------------------------------------------------------------------


def test_without_actions_the_machine_is_homed_and_started(tmp_path: Path) -> None:
    report, twin = told(tmp_path, "title: t\nuntil: {state: EXECUTE, limit: 20 s}\nexpect: {state: EXECUTE}\n")
    assert report.passed, report.text()
    assert 2_000 < twin.now_ms < 15_000


def test_machine_values_set_points_seed_and_trays_are_taken(tmp_path: Path) -> None:
    text = BRIEF + (
        "seed: 7\ntrays: 3\n"
        "machine: {supply.pressure_pa: 4.5 bar, cups.planting_frequency_per_min: 30, crop.claw_pressure_mpa: 350 kPa,\n"
        "  layout.arms_may_meet_in_plant: true, claws.grippers: 12}\n"
        "set_points: {release_delay: 150 ms, converge_at: 1}\n"
    )
    scenario = load_scenario(written(tmp_path, text))
    assert (scenario.seed, scenario.trays) == (7, 3)
    assert scenario.machine.supply.pressure_pa == pytest.approx(450_000.0)
    assert scenario.machine.crop.claw_pressure_mpa == pytest.approx(0.35)
    assert scenario.machine.cups.planting_frequency_per_min == 30
    assert scenario.machine.layout.arms_may_meet_in_plant
    assert scenario.set_points == {"trays_target": 3, "release_delay": 15, "converge_at": 1}
    assert load_scenario(scenario.path, seed=9).seed == 9


def test_values_that_only_fit_together_are_accepted(tmp_path: Path) -> None:
    """Given cups and spreader of another pitch, each alone impossible, both together are a machine."""
    text = BRIEF + "machine: {cups.pitch_m: 62 mm, spreader.travel_m: 209 mm}\n"
    assert load_scenario(written(tmp_path, text)).machine.cups.pitch_m == pytest.approx(0.062)


def test_actions_wait_for_time_state_and_step(tmp_path: Path) -> None:
    """Given a button pressed as a step is on for half a second, it is pressed then; each action waits for the last."""
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
    scenario = load_scenario(written(tmp_path, text))
    seen: list[tuple[int, bool, bool]] = []

    def watch(twin: Twin) -> None:
        pressed = twin.plant.box.emergency_stop
        twin.watch(lambda twin: seen.append((twin.now_ms, twin.in_step("left arm", "wait for cups"), pressed)))
        twin.watch(lambda twin: buttons.append((twin.now_ms, twin.plant.box.start, twin.plant.box.emergency_stop)))

    buttons: list[tuple[int, bool, bool]] = []
    report = run_scenario(scenario, prepare=watch)
    assert report.passed, report.text()
    in_step_ms = next(ms for ms, in_step, _ in seen if in_step)
    pressed_ms = [ms for ms, _, stop in buttons if stop]
    assert pressed_ms[0] - in_step_ms == pytest.approx(500, abs=20)
    assert len(pressed_ms) == pytest.approx(100, abs=5)
    assert report.alarms["emergency_stop"] * 1_000 == pytest.approx(pressed_ms[0], abs=30)
    assert sum(start for _, start, _ in buttons) == 10 + 30


def test_an_action_changes_the_mode(tmp_path: Path) -> None:
    """Given one-cycle mode ordered before homing, each arm throws what it may hold, and the machine is Complete."""
    text = """\
title: t
actions:
  - {at: 100 ms, command: mode_one_cycle}
  - {at: 200 ms, press: start}
  - {at: IDLE, after: 500 ms, press: start}
until: {state: COMPLETE, limit: 60 s}
expect: {state: COMPLETE, cycles: 0, counts: {in_tray: 72}}
"""
    report, _ = told(tmp_path, text)
    assert report.passed, report.text()


def test_an_action_breaks_and_mends(tmp_path: Path) -> None:
    """Given faults by actions, one lasts its time and the other until it is mended."""
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

    report = run_scenario(load_scenario(written(tmp_path, text)), prepare=prepare)
    assert report.passed
    stuck = [ms for ms, names in active.items() if "stuck_on:left.lift_up" in names]
    jammed = [ms for ms, names in active.items() if "jammed:right.slide" in names]
    assert (min(stuck), max(stuck)) == (500, 690)
    assert (min(jammed), max(jammed)) == (600, 890)
    assert report.faults == ["stuck_on:left.lift_up@500ms..700ms", "jammed:right.slide@600ms.."]


def test_a_power_cycle_starts_the_controller_anew(tmp_path: Path) -> None:
    report, twin = told(
        tmp_path,
        "title: t\nactions: [{at: 100 ms, press: start}, {at: IDLE, power_cycle: 2 s}]\n"
        "until: {state: STOPPED, limit: 30 s}\nexpect: {alarms: []}\n",
    )
    assert report.passed, report.text()
    assert twin.now_ms > 4_000


def test_every_expectation_is_checked(tmp_path: Path) -> None:
    """Given expectations of which each is wrong, each is told with its line and what was found."""
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
    report, _ = told(tmp_path, text)
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
    assert f"0 of {report.checks} checks hold" in report.text()
    assert json.loads(json.dumps(report.record()))["passed"] is False


def test_an_incident_or_alarm_nobody_expects_fails(tmp_path: Path) -> None:
    report, _ = told(
        tmp_path,
        "title: t\nfaults: [{kind: stuck_off, at: left.slide_at_pick_1}]\nuntil: {state: HELD, limit: 60 s}\n"
        "expect: {state: HELD, alarms: []}\n",
    )
    assert [failure.partition(": ")[2] for failure in report.failures] == [
        "incidents is arm_through_tray, expected none",
        "alarms is left: approach row, expected none",
    ]


def test_what_is_not_reached_is_told_with_the_situation(tmp_path: Path) -> None:
    report, twin = told(
        tmp_path, "title: t\nactions: [{at: HELD, press: start}]\nuntil: {time: 1 s}\nexpect: {cycles: 0}\n"
    )
    assert twin.now_ms == 1_000
    assert report.reason.startswith("HELD (press: start) not reached within 1000 ms; at 1000 ms STOPPED")
    assert not report.passed


def test_an_action_that_breaks_what_is_broken_ends_the_story(tmp_path: Path) -> None:
    report, _ = told(
        tmp_path,
        "title: t\nfaults: [{kind: jammed, at: left.lift}]\nactions: [{at: 1 s, fault: jammed:left.lift}]\n"
        "until: {time: 2 s}\nexpect: {cycles: 0}\n",
    )
    assert report.reason.startswith("jammed:left.lift@1000ms..: changes the same as jammed:left.lift;")
    assert not report.passed


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ("titel: t", "1: titel: is no key here; did you mean title?"),
        ("title: t\ntitle: u", "2: file: key 'title' is already on line 1; delete one"),
        ("title: t\nseed: one", "2: seed: must be a whole number, 0 to 2147483647, not 'one'"),
        ("title: t\ntrays: 0", "2: trays: must be a whole number, 1 to 1000, not '0'"),
        ("title: t\nmachine: [a]", "2: machine: must be a mapping; write a key, a colon and a value a line"),
        ("title: t\nmachine:\n  slide.bore_mm: 5",
         "3: machine.slide.bore_mm: is no parameter of the machine; did you mean bore_m?"),
        ("title: t\nmachine:\n  supply.pressure_pa: 5 mm",
         "3: machine.supply.pressure_pa: '5 mm': mm does not fit; write it in Pa or kPa or MPa or mbar or bar"),
        ("title: t\nmachine:\n  supply.pressure_pa: 50 bar",
         "3: machine.supply.pressure_pa: must lie within 50000 to 1e+06, not 5e+06"),
        ("title: t\nmachine:\n  cups.pitch_m: 62 mm",
         "3: machine.spreader.travel_m: spreads the claws to 0.06 m; it must be cups.pitch_m to a millimetre"),
        ("title: t\nset_points: {clam: 1}", "2: set_points.clam: is no key here; did you mean clamp?"),
        ("title: t\nset_points: {converge_at: 2}",
         "2: set_points.converge_at: must be a whole number, 0 to 1, not '2'"),
        ("title: t\nset_points: {clamp: 205 ms}", "2: set_points.clamp: '205 ms': must be a multiple of 10 ms"),
        ("title: t\nfaults:\n  - {kind: stuck, at: left.lift_up}",
         "3: faults[1]: stuck: is no fault; did you mean stuck_on?"),
        ("title: t\nfaults:\n  - {kind: stuck_on, at: left.lift_op}",
         "3: faults[1]: stuck_on:left.lift_op: is no sensor; did you mean left.lift_up?"),
        ("title: t\nfaults:\n  - {kind: jammed, at: left.lift, from: 5}",
         "3: faults[1].from: '5': a time needs its unit; write 5 s or 5 ms"),
        ("title: t\nfaults:\n  - {kind: leak, at: supply, size: 3 N}",
         "3: faults[1].size: '3 N': N does not fit; write it in m3/(s Pa) or dm3/(s bar) or L/(s bar)"),
        ("title: t\nfaults:\n  - {kind: jammed}", "3: faults[1].at: is missing; add it"),
        ("title: t\nactions: [{at: 1 s}]", "2: actions[1]: must do one thing, not 0; there are press, hold, release, "
         "command, planting_frequency, power_cycle, fault, mend"),
        ("title: t\nactions: [{at: 1 s, press: resett}]",
         "2: actions[1].press: 'resett' is no button; did you mean reset?"),
        ("title: t\nactions: [{at: idle, press: start}]", "2: actions[1].at: 'idle' is no time, state or step; "),
        ("title: t\nactions: [{at: 1 s, after: 1 s, press: start}]",
         "2: actions[1].after: means nothing after a time; write at: the time itself"),
        ("title: t\nactions: [{at: 1 s, hold: stop, for: 1 s}]",
         "2: actions[1].for: means nothing with hold; leave it out"),
        ("title: t\nuntil: {time: 9 s}\nactions: [{at: 1 s, fault: jammed:left.slyde}]",
         "3: actions[1].fault: jammed:left.slyde: is no moving part; did you mean left.slide?"),
        ("title: t\nactions: [{at: 1 s, fault: missing_cells:tray_1=5}]",
         "2: actions[1].fault: missing_cells:tray_1: is decided before the run; put it under faults"),
        ("title: t\nactions: [{at: 1 s, mend: jammed:left.slyde}]",
         "2: actions[1].mend: jammed:left.slyde: is no moving part; did you mean left.slide?"),
        ("title: t\nexpect: {cycles: 1}", "1: until: is missing; add until: {state: COMPLETE, limit: 300 s} or "),
        ("title: t\nuntil: {state: HELD}", "2: until.limit: is missing; add it"),
        ("title: t\nuntil: {time: 1 s}", "1: expect: is missing; add what must come of it"),
        ("title: t\nuntil: {time: 1 s}\nexpect: {}", "3: expect: expects nothing; add state, alarms, "),
        ("title: t\nuntil: {time: 1 s}\nexpect: {alarms: [tray_jamm]}",
         "3: expect.alarms: 'tray_jamm' is no alarm; did you mean tray_jam?"),
        ("title: t\nuntil: {time: 1 s}\nexpect: {counts: {Q: 1}}",
         "3: expect.counts.Q: is no key here; there are in_tray, "),
        ("title: t\nuntil: {time: 1 s}\nexpect: {cycles: many}", "3: expect.cycles: 'many': is no number; "),
        ("title: t\nuntil: {time: 1 s}\nexpect: {alarms: [tray_jam, [a]]}",
         "3: expect.alarms[2]: must be a word or a mapping, not a list"),
        ("title: t\nuntil: {time: 1 s}\nexpect: {incidents: [[a]]}",
         "3: expect.incidents[1]: must be a word or a number, not a list"),
        ("until: {time: 1 s}\nexpect: {cycles: 0}", "1: title: is missing; add it"),
        ("- a", "1: file: does not begin with a section; write its name and a colon"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_refused_in_one_line(tmp_path: Path, lines: str, complaint: str) -> None:
    path = written(tmp_path, lines + "\n")
    with pytest.raises(ScenarioError) as error:
        load_scenario(path)
    text = str(error.value)
    assert text.removeprefix(f"{path}:").startswith(complaint), text
    assert "\n" not in text


def test_a_name_that_is_none_is_refused_with_the_names_there_are() -> None:
    with pytest.raises(ScenarioError) as error:
        find_scenario("stuck-reed-swich")
    assert str(error.value).startswith("stuck-reed-swich: is no scenario; did you mean stuck-reed-switch?")
    with pytest.raises(ScenarioError, match=r"^nowhere\.yaml: cannot be read"):
        load_scenario(find_scenario("nowhere.yaml"))


# --- command line -------------------------------------------------------------------------------


def test_the_command_line_takes_a_scenario_and_faults() -> None:
    parser = argparse.ArgumentParser()
    add_scenario_arguments(parser)
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


def test_the_story_of_the_guide_passes(tmp_path: Path) -> None:
    guide = (Path(__file__).parents[1] / "docs" / "faults.md").read_text(encoding="utf-8")
    story = guide.partition("```yaml\n")[2].partition("```")[0]
    report, _ = told(tmp_path, story)
    assert report.passed, report.text()


def test_the_guide_names_every_action_expectation_and_shipped_scenario() -> None:
    guide = (Path(__file__).parents[1] / "docs" / "faults.md").read_text(encoding="utf-8")
    gauges = [name.replace("right", "left") for name in GAUGES]
    names = [*(f"`{verb}: " for verb in VERBS), *gauges, *(f"`{name}`" for name in SHIPPED)]
    assert [name for name in names if name not in guide] == []
