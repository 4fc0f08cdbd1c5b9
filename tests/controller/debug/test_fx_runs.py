"""Recorded runs of FX programs: every state can be returned to, in any order, whatever instructions a program has."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from controller.common.errors import InputError
from controller.debug.adapter.variables import ShownVariables
from controller.debug.commands import Debugger
from controller.debug.comparison import branch, first_difference, parse_change
from controller.debug.condition import parse_condition
from controller.debug.fx_machine import FxMachine, record_run
from controller.debug.search import condition_changes, device_changes, following, last
from controller.debug.timeline import RunTimeline
from controller.fx.engine.peripherals.peripherals import Peripherals
from controller.fx.engine.plc import FxPlc
from controller.fx.engine.python_functions import PythonFunctions
from controller.fx.language.cpu_model import FX3U
from controller.fx.language.il import read_il
from controller.fx.observation.observation import ScanObservation
from controller.fx.stimulus.running import StimulusRun
from controller.fx.stimulus.stimulus import load_stimulus
from tests.controller.fx.engine.test_conformance import ABOUT, OPTIONAL, RUNNING, cpu, peripherals, program
from tests.sampling import one_in

COUNTING = """\
LD X0
OUT C0 K3
LD X1
RST C0
LD C0
OUT Y0
LD M8013
OUT Y1
LD X2
PLS M5
END
"""
STIMULUS = """\
scan_ms: 10
scans: 400
inputs:
  - {at_ms: 100, set: {X0: 1}}
  - {at_ms: 200, set: {X0: 0}}
  - {at_ms: 1000, set: {X2: 1}}
pulses:
  - {input: X0, from_ms: 500, period_ms: 100, count: 20}
watch: [Y0]
"""


def state(machine: FxMachine, connected: Peripherals) -> tuple[object, ...]:
    plc = machine.running.plc
    return machine.image(""), plc.cpu.latches.copy(), plc.running, plc.scans, connected.record(), machine.now_ms


@pytest.mark.parametrize("path", one_in(6, RUNNING), ids=lambda path: path.stem)
def test_every_scan_of_a_program_can_be_returned_to_in_any_order(path: Path, tmp_path: Path) -> None:
    stimulus = load_stimulus(path, others=ABOUT | OPTIONAL | {"expect"}, cpu=cpu(path))
    connected = peripherals(path, tmp_path)
    machine = FxMachine(StimulusRun(program(path), stimulus, connected))
    line = RunTimeline(machine, interval=4)
    states = [state(machine, connected)]
    for scan in range(stimulus.scans):
        line.extend(scan + 1)
        states.append(state(machine, connected))
    scans = [*range(len(states))] * 2
    random.Random(1).shuffle(scans)
    for scan in scans:
        line.seek(scan)
        assert state(machine, connected) == states[scan], scan


@pytest.mark.parametrize("path", one_in(12, RUNNING), ids=lambda path: path.stem)
def test_every_scan_of_a_program_is_recomputed_as_it_was_executed_in_any_order(path: Path, tmp_path: Path) -> None:
    stimulus = load_stimulus(path, others=ABOUT | OPTIONAL | {"expect"}, cpu=cpu(path))
    connected = peripherals(path, tmp_path)
    machine = FxMachine(StimulusRun(program(path), stimulus, connected))
    line = RunTimeline(machine)
    line.extend(stimulus.scans)
    ended = state(machine, connected)
    scans = [*range(line.last, 0, -1)]
    scans += random.Random(1).sample(scans, len(scans))
    seen: dict[int, ScanObservation] = {}
    for scan in scans:
        found = machine.observer.observe(line, scan)
        assert found.differing == (), scan
        assert seen.setdefault(scan, found.seen) == found.seen, scan
    line.seek(line.last)
    assert state(machine, connected) == ended


def counting(tmp_path: Path) -> RunTimeline:
    (tmp_path / "stimulus.yaml").write_text(STIMULUS, encoding="utf-8")
    stimulus = load_stimulus(tmp_path / "stimulus.yaml")
    line = RunTimeline(FxMachine(StimulusRun(read_il(COUNTING, "counting.il"), stimulus)))
    line.extend(stimulus.scans)
    return line


def test_python_functions_can_be_returned_to_too() -> None:
    plc = FxPlc(read_il(COUNTING, "counting.il"), execution=PythonFunctions, input_filter_ms=0)
    levels = [False] * 256
    saved = plc.save()
    images = []
    for _ in range(2):
        plc.restore(saved)
        for scan in range(8):
            levels[0] = scan % 2 == 1
            plc.scan(10 * scan, levels)
        images.append((plc.memory.CV[0], plc.memory.Y[0], plc.scans))
    assert images[0] == images[1] == (3, True, 8)


def test_changes_and_conditions_are_found(tmp_path: Path) -> None:
    line = counting(tmp_path)
    signal = line.machine.signal
    pulse = device_changes(line, [signal("M5")])
    assert line.changes(0, 400, [signal("M5")]) == [101, 102]  # the scan at 1,000 ms is the 101st
    assert (last(line, pulse, 401), last(line, pulse, 102), last(line, pulse, 101)) == (102, 101, None)
    assert (following(line, pulse, 0), following(line, pulse, 102)) == (101, None)
    third = condition_changes(line, parse_condition("CN0 >= 3", signal))
    assert following(line, third, 0) == 61  # pulses at 100, 500 and 600 ms


def test_scans_as_short_as_the_input_filter_are_recomputed(tmp_path: Path) -> None:
    (tmp_path / "stimulus.yaml").write_text(f"input_filter_ms: 10\n{STIMULUS}", encoding="utf-8")
    line = record_run(read_il(COUNTING, "counting.il"), load_stimulus(tmp_path / "stimulus.yaml"))
    observer = line.machine.observer
    assert {observer.observe(line, scan).differing for scan in range(40, 120)} == {()}


def test_a_branch_changes_a_terminal_for_some_scans(tmp_path: Path) -> None:
    line = counting(tmp_path)
    reset = branch(line, parse_change("X1=on@200..210"))
    first = first_difference(line, reset)
    assert first is not None
    assert (first.scan, {row.name for row in first.devices}) == (200, {"X1", "CN0", "C0", "Y0"})
    assert reset.changes(199, 400, [reset.machine.signal("X1")]) == [200, 211]
    held = branch(line, parse_change("X0=off@1.."))
    held.seek(400)
    assert held.machine.signal("CN0").read() == 0
    line.seek(400)
    assert line.machine.signal("CN0").read() == 3
    written = branch(line, parse_change("D5=7@300"))
    assert written.changes(0 + written.first, 400, [written.machine.signal("D5")]) == [300]


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        ("show X9", "X9"),
        ("show nothing", "no such device or comment"),
        ("back 1 step", "has no steps"),
        ("branch X1=2@5", "on or off"),
        ("branch D5=70000@5", "a number from -32768 to 32767"),
        ("branch M1=on@5..6", "happens once"),
        ("use branch", "no branch"),
    ],
)
def test_an_invalid_command_has_a_clear_answer(command: str, answer: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=answer) as error:
        list(Debugger(counting(tmp_path)).execute(command))
    assert "\n" not in str(error.value)


def test_extension_registers_of_a_recorded_run(tmp_path: Path) -> None:
    path = tmp_path / "r.yaml"
    path.write_text("scan_ms: 10\nscans: 5\ninitial: {R9: 3}\nwatch: [R9, R32767]\n", encoding="utf-8")
    ladder = read_il("LD M8000\nINC R9\nMOV R9 R32767\nEND\n", cpu=FX3U)
    line = record_run(ladder, load_stimulus(path, cpu=FX3U))
    machine = line.machine
    assert [machine.signal(name).read() for name in ("R9", "R32767", "D8511")] == [8, 8, 0]
    assert (machine.devices()["R32767"], machine.devices()["D8511"]) == (8, 0)
    assert "D8512" not in machine.devices()
    assert machine.observer.observe(line, 3).differing == ()
    shown = ShownVariables(Debugger(line))
    (scope,) = (each for each in shown.scopes() if each["name"] == "Extension registers R")
    variables = shown.of_scope(scope["variablesReference"]) or []
    assert [(each["name"], each["value"]) for each in variables] == [("R9", "8"), ("R32767", "8")]
