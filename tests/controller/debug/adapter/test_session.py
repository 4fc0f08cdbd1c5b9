"""Requests of the Debug Adapter Protocol on a recorded run: breakpoints, steps, variables, branches."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from controller.debug.adapter.session import CAPABILITIES
from controller.debug.timeline import RunTimeline
from tests.controller.debug.adapter.editor import Editor
from tests.controller.debug.step_program import MOTOR, PROGRAM, on, recorded
from tests.paths import DOCS


@pytest.fixture
def line(tmp_path: Path) -> RunTimeline:
    return recorded(tmp_path)


@pytest.fixture
def editor(line: RunTimeline) -> Editor:
    editor = Editor(line)
    editor.start()
    return editor


def source(line: RunTimeline) -> dict[str, Any]:
    return {"path": line.machine.ladder.source}


def scans(editor: Editor, command: str) -> list[int]:
    """Return the scans of all stops of a repeated request, up to the end of the run."""
    found: list[int] = []
    while True:
        editor.call(command, threadId=1)
        if "description" in editor.stop():
            return found
        found.append(int(editor.variables("Run")["scan"]))


def test_a_session_begins_with_a_stop_before_the_first_scan(line: RunTimeline) -> None:
    editor = Editor(line)
    response, event = editor.send("initialize", adapterID="fx", columnsStartAt1=True)
    assert (response["body"], event["event"]) == (CAPABILITIES, "initialized")
    assert [each["type"] for each in editor.send("launch")] == ["response"]
    response, event = editor.send("configurationDone")
    assert event["body"] == {"reason": "entry", "threadId": 1, "allThreadsStopped": True}
    assert [each["seq"] for each in editor.messages] == [1, 2, 3, 4, 5]
    assert editor.call("threads")["threads"] == [{"id": 1, "name": "recorded run"}]
    assert editor.where() == ("before scan 1", PROGRAM.count("\n"))


def test_a_breakpoint_of_a_line_is_hit_in_every_scan_that_executes_it(editor: Editor, line: RunTimeline) -> None:
    lines = [{"line": MOTOR, "condition": "not X0"}, {"line": PROGRAM.count("\n")}]
    hit, end = editor.call("setBreakpoints", source=source(line), breakpoints=lines)["breakpoints"]
    assert (hit["verified"], hit["line"], hit["source"]["name"]) == (True, MOTOR, "steps.il")
    assert (end["verified"], end["message"]) == (
        False,
        "line 24: no instruction that a scan can stop at; choose an earlier line",
    )
    motor = {*on(line, "Y1"), *(scan + 1 for scan in on(line, "Y1"))}
    wanted = [scan - 1 for scan in sorted(motor) if scan <= line.last and scan - 1 not in on(line, "X0")]
    assert scans(editor, "continue") == wanted != []
    assert editor.stop()["description"] == "end of the recorded run"
    assert scans(editor, "reverseContinue") == wanted[::-1]
    assert editor.stop()["description"] == "beginning of the recorded run"
    editor.call("continue", threadId=1)
    assert (editor.stop()["reason"], editor.stop()["hitBreakpointIds"]) == ("breakpoint", [hit["id"]])
    assert editor.where() == ("rung 4, step 8", MOTOR)


def test_changes_and_conditions_are_found_in_both_directions(editor: Editor, line: RunTimeline) -> None:
    editor.call("setDataBreakpoints", breakpoints=[{"dataId": "Y1", "accessType": "write"}])
    editor.call("setFunctionBreakpoints", breakpoints=[{"name": "TN0 >= 2"}, {"name": "CN0", "condition": "CN0 = 2"}])
    changes = line.changes(0, line.last, [line.machine.signal("Y1")])
    timer = [scan for scan in on(line, "TN0") if line.changes(scan - 1, scan, [line.machine.signal("TN0")])]
    line.seek(0)
    values = [int(line.machine.signal("TN0").read()) for _ in line.walk(0, line.last)]
    begins = [scan for scan, (old, new) in enumerate(zip([0, *values], values, strict=False), 1) if old < 2 <= new]
    second = line.changes(0, line.last, [line.machine.signal("CN0")])[1]
    wanted = sorted({*changes, *begins, second})
    assert set(begins) <= set(timer)
    assert scans(editor, "continue") == wanted
    assert scans(editor, "reverseContinue") == wanted[::-1]


def test_lines_and_changes_are_found_in_the_order_of_time(editor: Editor, line: RunTimeline) -> None:
    editor.call("setFunctionBreakpoints", breakpoints=[{"name": "rung 4"}, {"name": "Y1"}])
    there = []
    while "description" not in editor.stop():
        editor.call("continue", threadId=1)
        there.append((editor.variables("Run")["scan"], editor.where(), editor.stop()["reason"]))
    assert [reason for _, _, reason in there[:4]] == ["breakpoint", "function breakpoint", "breakpoint", "breakpoint"]
    back = []
    editor.call("reverseContinue", threadId=1)
    while "description" not in editor.stop():
        back.append((editor.variables("Run")["scan"], editor.where(), editor.stop()["reason"]))
        editor.call("reverseContinue", threadId=1)
    assert back == there[-2::-1]


def test_steps_go_by_rung_instruction_and_scan(editor: Editor) -> None:
    places = []
    for command, arguments in (
        ("next", {}),
        ("next", {"granularity": "line"}),
        ("stepIn", {}),
        ("stepBack", {"granularity": "instruction"}),
        ("stepOut", {}),
        ("stepBack", {}),
    ):
        editor.call(command, threadId=1, **arguments)
        places.append(editor.where()[0])
        assert editor.stop()["reason"] == "step"
    first = ["rung 0, step 0", "rung 1, step 3", "rung 2, step 4", "rung 1, step 3"]
    assert places == [*first, "END of scan 1, 0.10 s", "rung 10, step 26"]


def test_the_stack_has_rung_block_scan_and_active_steps(editor: Editor) -> None:
    editor.call("setFunctionBreakpoints", breakpoints=[{"name": "rung 4", "condition": "S20"}])
    editor.call("continue", threadId=1)
    stack = editor.call("stackTrace", threadId=1)
    names = [frame["name"] for frame in stack["stackFrames"]]
    assert names == ["rung 4, step 8", "run", "scan 7, after scan 6, 0.60 s", "S20"]
    assert [frame["line"] for frame in stack["stackFrames"]] == [MOTOR, MOTOR - 1, 3, MOTOR - 1]
    assert editor.call("stackTrace", threadId=1, startFrame=1, levels=2)["stackFrames"] == stack["stackFrames"][1:3]
    assert editor.variables("Rung") == {"8 OUT Y1": "driven", "9 OUT T0 K3": "driven"}
    assert editor.variables("Run")["recomputed scan"] == "equal"
    assert editor.variables("Outputs Y") == {"Y1 motor": "on", "Y2": "off"}
    assert editor.variables("Timers T") == {"T0": "off", "TN0": "0"}


def test_expressions_and_commands_are_evaluated(editor: Editor) -> None:
    for expression, result in (("Y1", "off"), ("CN0", "0"), ("X0 or Y1", "false"), ("S0 or CN0 < 1", "true")):
        assert editor.call("evaluate", expression=expression, context="watch")["result"] == result
    assert editor.call("evaluate", expression="next Y1", context="repl")["result"] == "Y1: 0 -> 1 in scan 6, 0.60 s"
    assert (editor.stop()["reason"], editor.variables("Run")["scan"]) == ("goto", "6")
    assert "goto SCAN" in editor.call("evaluate", expression="help", context="repl")["result"]
    assert editor.call("evaluate", expression="Y1", context="repl")["result"] == "on"
    assert editor.error("evaluate", expression="goto 99", context="repl").startswith("scan 99: not recorded")
    assert editor.error("evaluate", expression="Q1", context="hover").startswith("Q1: no such device")


def test_a_position_of_the_next_scan_can_be_gone_to(editor: Editor) -> None:
    assert editor.call("gotoTargets", source={}, line=MOTOR)["targets"] == []  # S20 is not active
    (target,) = editor.call("gotoTargets", source={}, line=5)["targets"]
    editor.call("goto", threadId=1, targetId=target["id"])
    assert editor.where() == ("rung 1, step 3", 6)
    assert editor.error("goto", threadId=1, targetId=7).startswith("goto.targetId 7: not executed")


def test_a_changed_variable_is_a_branch_and_the_recorded_run_is_unchanged(editor: Editor, line: RunTimeline) -> None:
    before = [line.machine.image("") for _ in line.walk(0, line.last)]
    editor.call("evaluate", expression="goto 10", context="repl")
    reference = next(
        each["variablesReference"] for each in editor.call("scopes", frameId=1)["scopes"] if each["name"] == "Inputs X"
    )
    output, response, stopped = editor.send("setVariable", variablesReference=reference, name="X0 start", value="on")
    assert output["body"]["output"].startswith("branch X0=on@11..: ran to scan 40\n")
    assert "The recorded run is unchanged: this is a branch with X0=on from scan 11 on." in output["body"]["output"]
    assert (response["body"], stopped["event"]) == ({"value": "on"}, "stopped")
    assert (editor.variables("Run")["shown"], editor.variables("Run")["scan"]) == ("branch", "11")
    assert editor.error("setVariable", variablesReference=reference, name="X0", value="off").startswith(
        "setVariable: a branch is shown"
    )
    assert editor.error("setVariable", variablesReference=1, name="8 OUT Y1", value="on").startswith(
        "setVariable: choose a device"
    )
    assert [line.machine.image("") for _ in line.walk(0, line.last)] == before
    editor.call("evaluate", expression="use recorded", context="repl")
    assert editor.variables("Run")["shown"] == "recorded run"


def test_the_program_without_a_file_is_delivered_as_text(line: RunTimeline) -> None:
    (steps := Path(line.machine.ladder.source)).rename(steps.with_suffix(".prg"))
    object.__setattr__(line.machine.ladder, "source", "steps.csv")
    editor = Editor(line)
    editor.start()
    (program,) = editor.call("loadedSources")["sources"]
    assert (program["name"], program["sourceReference"], "path" in program) == ("steps.il", 1, False)
    text = editor.call("source", sourceReference=1)["content"].splitlines()
    motor = next(number for number, each in enumerate(text, start=1) if each == "    8 OUT Y1")
    (hit,) = editor.call("setBreakpoints", source=program, breakpoints=[{"line": motor}])["breakpoints"]
    assert (hit["verified"], hit["line"]) == (True, motor)
    editor.call("continue", threadId=1)
    assert editor.where()[1] == motor


def test_lines_can_be_counted_from_0(line: RunTimeline) -> None:
    editor = Editor(line)
    editor.call("initialize", linesStartAt1=False)
    editor.call("launch", stopOnEntry=False)
    (hit,) = editor.call("setBreakpoints", source=source(line), breakpoints=[{"line": MOTOR - 1}])["breakpoints"]
    assert hit["line"] == MOTOR - 1
    editor.call("configurationDone")
    assert editor.where() == ("rung 4, step 8", MOTOR - 1)


def test_a_search_can_be_paused_and_refuses_what_must_wait(editor: Editor, line: RunTimeline) -> None:
    editor.call("setBreakpoints", source=source(line), breakpoints=[{"line": 4, "condition": "C0 and not C0"}])
    editor.send("continue", threadId=1)
    editor.session.advance()
    assert editor.session.is_searching
    assert editor.error("stackTrace", threadId=1) == "stackTrace: the run is being searched; send pause first"
    assert editor.send("threads")[0]["success"]
    assert editor.session.is_searching
    response, event = editor.send("pause", threadId=1)
    assert (response["success"], event["body"]["reason"]) == (True, "pause")
    assert not editor.session.is_searching


def test_the_end_of_a_session(editor: Editor) -> None:
    response, event = editor.send("terminate")
    assert (response["success"], event["event"]) == (True, "terminated")
    editor.send("disconnect")
    assert editor.messages[-1]["success"]


@pytest.mark.parametrize(
    ("command", "arguments", "answer"),
    [
        (
            "attach",
            {"port": 502},
            "attach: refused, because nothing may stop a live controller or change it; look at its",
        ),
        ("attach", {}, "attach: refused"),
        ("initialize", {}, "initialize: sent twice"),
        ("launch", {}, "launch: sent twice"),
        ("writeMemory", {"memoryReference": "D0"}, "writeMemory: no such request"),
        ("_go", {}, "_go: no such request"),
        ("x" * 500, {}, "x" * 40 + ": no such request"),
        ("scopes", {"frameId": "1"}, "scopes.frameId: write a whole number from 0"),
        ("scopes", {"frameId": True}, "scopes.frameId: write a whole number from 0"),
        ("scopes", {}, "scopes.frameId: write a whole number from 0"),
        ("variables", {"variablesReference": 99}, "variables.variablesReference 99: no such scope"),
        ("variables", {"variablesReference": -1}, "variables.variablesReference: write a whole number from 0"),
        ("variables", {"variablesReference": 10**30}, "variables.variablesReference: write a whole number from 0"),
        ("setBreakpoints", {"source": {}, "breakpoints": 5}, "setBreakpoints.breakpoints: write a list of objects"),
        ("setBreakpoints", {"breakpoints": []}, "setBreakpoints.source: write an object"),
        ("setBreakpoints", {"source": {}, "breakpoints": [{}]}, r"setBreakpoints.breakpoints\[0\].line: write a whole"),
        ("evaluate", {}, "evaluate.expression: write a text"),
        ("evaluate", {"expression": ["X0"]}, "evaluate.expression: write a text"),
        ("evaluate", {"expression": "("}, "it ends too early"),
        ("evaluate", {"expression": "(" * 9_000}, "nested too deeply"),
        ("evaluate", {"expression": "", "context": "watch"}, "no such device"),
        ("next", {"granularity": 5}, "next.granularity: write a text"),
        ("setVariable", {"variablesReference": 3, "name": "X99", "value": "on"}, "X99"),
        ("setVariable", {"variablesReference": 3, "name": "", "value": "on"}, "setVariable"),
        ("setVariable", {"variablesReference": 3, "name": "X0", "value": "on@3 x"}, "not a change"),
    ],
)
def test_an_invalid_request_has_a_clear_answer(
    command: str, arguments: dict[str, Any], answer: str, editor: Editor
) -> None:
    with pytest.raises(AssertionError, match=answer):
        editor.call(command, **arguments)
    assert editor.where() == ("before scan 1", PROGRAM.count("\n"))


@pytest.mark.parametrize("command", ["launch", "continue", "disconnect", "evaluate"])
def test_nothing_is_answered_before_initialize(command: str, line: RunTimeline) -> None:
    assert Editor(line).error(command, expression="Y1") == f"{command}: send initialize first"


@pytest.mark.parametrize(
    ("request_", "item", "message"),
    [
        ("setFunctionBreakpoints", {"name": "Q1 > 3"}, "Q1: no such device or comment"),
        ("setFunctionBreakpoints", {"name": "rung 99"}, "rung 99: no such rung"),
        ("setFunctionBreakpoints", {"name": "Y1", "hitCondition": "3"}, "hitCondition: not supported"),
        ("setDataBreakpoints", {"dataId": "Q1"}, "Q1: no such device or comment"),
        ("setBreakpoints", {"line": 2, "condition": "X0 and"}, "'X0 and': it ends too early"),
        ("setBreakpoints", {"line": 10**6}, "line 1000000: no instruction that a scan can stop at"),
    ],
)
def test_an_invalid_breakpoint_says_why_and_never_stops(
    request_: str, item: dict[str, Any], message: str, editor: Editor, line: RunTimeline
) -> None:
    (verdict,) = editor.call(request_, source=source(line), breakpoints=[item])["breakpoints"]
    assert verdict["verified"] is False
    assert verdict["message"].startswith(message)
    assert scans(editor, "continue") == []


def test_breakpoints_of_another_file_are_not_those_of_the_program(editor: Editor) -> None:
    (verdict,) = editor.call("setBreakpoints", source={"path": "/other.il"}, breakpoints=[{"line": 3}])["breakpoints"]
    assert verdict == {"verified": False, "message": "not the program of the recorded run, steps.il"}


def test_the_configuration_of_the_guide_launches(line: RunTimeline) -> None:
    blocks = re.findall(r"```json\n(.+?)```", (DOCS / "debugger.md").read_text(encoding="utf-8"), re.DOTALL)
    extension, project = map(json.loads, blocks)
    (kind,) = extension["contributes"]["debuggers"]
    (configuration,) = project["configurations"]
    assert configuration["type"] == kind["type"]
    editor = Editor(line)
    editor.start(**configuration)
    assert editor.stop()["reason"] == "entry"
