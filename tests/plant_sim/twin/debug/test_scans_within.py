"""Scans of a recorded twin, recomputed from the ladder of its program; and the debug adapter on such a run."""

from __future__ import annotations

import pytest

from controller.debug.timeline import RunTimeline
from controller.fx.observation.hidden_state import hidden_instructions
from plant_sim.faults import parse_fault
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import Twin
from tests.controller.debug.adapter.editor import Editor
from tests.plant_sim.twin.debug.test_recorded_run import Witness, disturbed


class Unwatched(Witness):
    """Twin that is run without images of its scans."""

    def run(self, ms: int) -> None:
        self.twin.run_for(ms)


@pytest.fixture(scope="module")
def line() -> RunTimeline:
    twin = Twin(seed=7, faults=[parse_fault("leak:left.slide.plus=2e-9@5s..9s")])
    recorder = TwinRecorder(twin)
    disturbed(Unwatched(twin))
    return recorder.close()


def test_a_scan_of_the_ladder_is_that_of_the_machine_whatever_enters(line: RunTimeline) -> None:
    observer = line.machine.observer
    scans = sorted({scan + after for scan in line.entry_scans() for after in (0, 1) if scan < line.last})
    assert len(scans) > 15
    for scan in scans:
        assert observer.observe(line, scan).differing == (), scan
        executed = line.machine.image("")
        line.seek(line.first)
        line.seek(scan)
        assert line.machine.image("") == executed, scan


def test_the_ladder_has_no_state_but_its_devices(line: RunTimeline) -> None:
    assert list(hidden_instructions(line.machine.ladder)) == []


def test_an_editor_stops_at_a_position_of_the_plant_and_sees_its_values(line: RunTimeline) -> None:
    editor = Editor(line)
    editor.start()
    height, pressure = "left.lift.position_m", "left.slide.plus.chamber.pressure_pa"
    breakpoints = [{"name": f"{height} < 0.05"}, {"name": f"{pressure} > 300000"}, {"name": height}]
    *valid, invalid = editor.call("setFunctionBreakpoints", breakpoints=breakpoints)["breakpoints"]
    assert [each["verified"] for each in valid] == [True, True]
    assert invalid["message"].startswith(f"{height}: a condition compares it with < or > to a number")
    found = []
    editor.call("continue", threadId=1)
    while "description" not in editor.stop():
        found.append(int(editor.variables("Run")["scan"]))
        editor.call("continue", threadId=1)
    limits = {height: 0.05, pressure: 300_000.0}
    begun = []
    line.seek(0)
    signals = {name: line.machine.signal(name) for name in limits}
    before = {name: float(signal.read()) for name, signal in signals.items()}
    for scan in line.walk(0, line.last):
        now = {name: float(signal.read()) for name, signal in signals.items()}
        if now[height] < limits[height] <= before[height] or now[pressure] > limits[pressure] >= before[pressure]:
            begun.append(scan)
        before = now
    assert found == begun != []
    editor.call("evaluate", expression=f"goto {found[0]}", context="repl")
    assert any(name.startswith("S") for name in (frame["name"] for frame in stack(editor)[1:]))
    assert editor.variables("Plant")[height] == editor.call("evaluate", expression=height)["result"].split()[0]
    assert editor.variables("Inputs X")[f"X1 {line.machine.signal('X1').tag}"] in {"on", "off"}
    info = editor.call("dataBreakpointInfo", name=height, variablesReference=10)
    assert (info["dataId"], info["description"]) == (
        None,
        f"{height}: changes in nearly every scan; set a function breakpoint such as {height} < 1",
    )


def stack(editor: Editor) -> list[dict[str, str]]:
    frames: list[dict[str, str]] = editor.call("stackTrace", threadId=1)["stackFrames"]
    return frames
