"""Live run of a machine whose constants differ: the controller gets the derived file, and X25 is pressed."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from plant_sim.common.defaults import DEFAULT_MACHINE
from tests.real_time import COMMAND_S


def run(machine: Path) -> subprocess.CompletedProcess[str]:
    """Run a trial with plant and controller as processes, as fast as possible."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = ["-m", "plant_sim", "run", "--machine", str(machine), "--trays", "1", "--pace", "65535", "--no-panel"]
    return subprocess.run(
        [sys.executable, *command, "--port", str(port), "--hmi-port", "0"],
        check=False,
        cwd=machine.parent,
        capture_output=True,
        text=True,
        timeout=COMMAND_S,
    )


def changed(tmp_path: Path, name: str, before: str, after: str) -> Path:
    """Return a machine file with one changed value."""
    text = DEFAULT_MACHINE.read_text(encoding="utf-8")
    assert text.count(f"{name}: {{value: {before}") == 1
    path = tmp_path / "machine.yaml"
    path.write_text(text.replace(f"{name}: {{value: {before}", f"{name}: {{value: {after}"), encoding="utf-8")
    return path


@pytest.mark.nightly
def test_the_operator_of_the_live_run_confirms_the_constants_of_the_machine(tmp_path: Path) -> None:
    ended = run(changed(tmp_path, "row_spacing_m", "0.600", "0.450"))
    assert ended.returncode == 0, ended.stderr
    assert "machine constant slide_least: 53 instead of 90" in ended.stderr
    assert "Complete" in ended.stderr
    assert "Emergency stop pressed" in ended.stdout


@pytest.mark.nightly
def test_the_live_run_of_a_machine_that_does_not_fit_ends_in_one_line(tmp_path: Path) -> None:
    """The controller refuses the file; the plant is stopped, and nothing has moved."""
    ended = run(changed(tmp_path, "stroke_m", "0.150", "0.232"))
    assert ended.returncode == 2
    (line,) = [line for line in ended.stderr.splitlines() if "constants.yaml" in line]
    assert "left lift: its arrival is believed after 1500 ms, but the travel takes 1510 ms" in line
    assert "Traceback" not in ended.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["machine.yaml"], "a failed start leaves nothing"
