"""A client of the Debug Adapter Protocol that nobody here wrote: that of Microsoft's tests of debug adapters (npm)."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.controller.debug.step_program import MOTOR, recorded

ROOT = Path(__file__).parents[4]
SCRIPT = Path(__file__).parent / "foreign_session.js"
INSTALLED = ROOT / "tests/controller/hmi/mitsubishi/node/node_modules"
LIMIT_S = 120.0


def results(plan: dict[str, Any]) -> list[Any]:
    """Return the results of the orders of a session."""
    node = shutil.which("node")
    assert node is not None, "the tests need nodejs: run scripts/setup dev"
    done = subprocess.run(
        [node, SCRIPT, json.dumps(plan)],
        env=os.environ | {"NODE_PATH": str(INSTALLED)},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: list[Any] = json.loads(done.stdout)
    return found


def adapter(folder: Path, *arguments: str) -> str:
    """Return a shell script that starts a command as a debug adapter."""
    script = folder / "adapter.sh"
    script.write_text(f"exec {shlex.join([sys.executable, '-m', *arguments])}\n", encoding="utf-8")
    return str(script)


THREAD = {"threadId": 1}
CONTINUE, BACK = ("continue", THREAD), ("reverseContinue", THREAD)
STACK = ("stackTrace", THREAD)


@pytest.mark.nightly
def test_the_client_debugs_an_fx_program(tmp_path: Path) -> None:
    program = recorded(tmp_path).machine.ladder.source
    script = adapter(
        tmp_path, "controller", "ladder", "debug", program, "--stimulus", str(tmp_path / "steps.yaml"), "--dap"
    )
    lines = {"source": {"path": program}, "breakpoints": [{"line": MOTOR, "condition": "TN0 = 2"}]}
    orders = [
        ("attach", {"port": 502}),
        ("setBreakpoints", lines),
        ("setDataBreakpoints", {"breakpoints": [{"dataId": "Y2"}]}),
        CONTINUE,
        STACK,
        ("scopes", {"frameId": 1}),
        ("variables", {"variablesReference": 1}),
        ("stepIn", THREAD),
        ("stepBack", THREAD),
        ("stepOut", THREAD),
        ("evaluate", {"expression": "TN0", "context": "watch"}),
        ("evaluate", {"expression": "events", "context": "repl"}),
        CONTINUE,
        CONTINUE,
        BACK,
        ("next", THREAD),
        ("setVariable", {"variablesReference": 3, "name": "X0 start", "value": "on"}),
        ("unknown", {}),
        ("threads", {}),
    ]
    found = dict(
        zip(
            [f"{number} {name}" for number, (name, _) in enumerate(orders)],
            results({"script": script, "launch": {"program": program}, "orders": orders}),
            strict=True,
        )
    )
    assert found["0 attach"]["error"].startswith("attach: refused")
    assert found["1 setBreakpoints"]["breakpoints"][0]["line"] == MOTOR
    assert found["3 continue"]["reason"] == "breakpoint"
    assert found["4 stackTrace"]["stackFrames"][0]["line"] == MOTOR
    assert [each["value"] for each in found["6 variables"]["variables"]] == ["driven", "driven"]
    assert found["10 evaluate"]["result"] == "3"
    assert found["12 continue"]["reason"] == "data breakpoint"
    assert found["13 continue"]["reason"] == "breakpoint"
    assert found["14 reverseContinue"]["reason"] == "data breakpoint"
    assert found["16 setVariable"] == {"value": "on"}
    assert found["17 unknown"]["error"].startswith("unknown: no such request")
    assert found["18 threads"]["threads"][0]["id"] == 1


@pytest.mark.nightly
def test_the_client_debugs_a_trial_of_the_machine(tmp_path: Path) -> None:
    script = adapter(tmp_path, "plant_sim", "debug", "--seed", "1", "--trays", "1", "--max-s", "60", "--dap", "stdio")
    functions = [{"name": "left.lift.position_m < 0.05", "condition": "left.slide.plus.chamber.pressure_pa > 200000"}]
    orders = [
        ("loadedSources", {}),
        ("source", {"sourceReference": 1}),
        ("setFunctionBreakpoints", {"breakpoints": functions}),
        CONTINUE,
        ("evaluate", {"expression": "left.lift.position_m", "context": "hover"}),
        STACK,
        ("next", THREAD),
        ("stackTrace", THREAD),
        BACK,
    ]
    sources, text, functions_, stop, height, _, _, stack, again = results(
        {"script": script, "launch": {}, "orders": orders}
    )
    assert sources["sources"][0]["sourceReference"] == 1
    assert text["content"].splitlines()[-1].endswith(" END")
    assert functions_["breakpoints"][0]["verified"]
    assert stop["reason"] == "function breakpoint"
    value, unit = height["result"].split()
    assert (0 < float(value) < 0.05, unit) == (True, "m")
    assert stack["stackFrames"][0]["name"] == "rung 0, step 0"
    assert again == stop
