"""Command ``hil`` with real processes: the controller of this project over Modbus TCP in lock step."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from controller.common.stop_request import StopRequest
from plant_sim.cli.main import main
from tests.paths import DOCS, ROOT

LIMIT_S = 480


def _start(*arguments: str, folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


@pytest.mark.nightly
def test_the_controller_passes_in_lock_step(tmp_path: Path) -> None:
    only = ("--cases", "emergency stop", "--only", "left: lift_retract, loaded")
    bench = _start(
        *("plant_sim", "hil", "serve", "--port", "0", "--lock-step-ms", "10", "--out", "reports", *only),
        folder=tmp_path,
    )
    controller = None
    try:
        assert bench.stdout is not None
        port = bench.stdout.readline().rpartition(":")[2].strip()
        assert port.isdigit(), bench.communicate()
        controller = _start(
            *("controller", "run", "--port", port, "--simulated-time", "--pace", "65535", "--no-hmi", "--no-history"),
            *("--retain", "retentive.json", "--new-machine", "--timeout-ms", "5000", "--link-limit-ms", "10000"),
            folder=tmp_path,
        )
        printed, errors = bench.communicate(timeout=LIMIT_S)
    finally:
        for process in filter(None, (bench, controller)):
            process.kill()
            process.communicate()
    assert bench.returncode == 0, printed + errors
    assert "6 passed, 0 failed, 0 not run" in printed
    root = ElementTree.parse(tmp_path / "reports" / "hil.xml").getroot()  # noqa: S314 - our own text
    assert (root.get("tests"), root.get("failures"), root.get("skipped")) == ("6", "0", "0")
    html = (tmp_path / "reports" / "hil.html").read_text("utf-8")
    assert html.count("<svg") == 6
    assert "outputs from 127.0.0.1" in html  # timing of the controller


@pytest.mark.nightly
def test_the_program_is_judged_in_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command of the guide."""
    (command,) = re.findall(r"-m plant_sim (hil program .*)", (DOCS / "hil-bench.md").read_text("utf-8"))
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(command)) == 0
    lines = capsys.readouterr().out.splitlines()
    numbers = lines.index("6 passed, 0 failed, 0 not run")
    assert lines[numbers - 1].startswith("passed   fault: jammed:right.lift (")
    assert "lock step, 10 ms" in (tmp_path / "var/hil/hil.html").read_text("utf-8")


def test_the_bench_of_the_program_can_be_interrupted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with StopRequest() as stop:
        stop.set()
        assert main(["hil", "program", "--no-reference", "--out", str(tmp_path)], stop) == 130
    assert capsys.readouterr().err.splitlines() == ["stopped before the last case"]


@pytest.mark.nightly
def test_an_interrupted_run_writes_reports_that_state_it(tmp_path: Path) -> None:
    bench = _start(
        *("plant_sim", "hil", "serve", "--port", "0", "--lock-step-ms", "10", "--no-reference", "--out", "reports"),
        folder=tmp_path,
    )
    try:
        assert bench.stdout is not None
        assert "plant listening on" in bench.stdout.readline()
        bench.send_signal(signal.SIGINT)
        printed, errors = bench.communicate(timeout=LIMIT_S)
    finally:
        bench.kill()
        bench.communicate()
    assert (bench.returncode, errors.splitlines()[-1]) == (130, "stopped before the last case"), printed + errors
    root = ElementTree.parse(tmp_path / "reports" / "hil.xml").getroot()  # noqa: S314 - our own text
    assert "stopped before the last case" in (root.get("name") or "")
    assert "(stopped before the last case)</h1>" in (tmp_path / "reports" / "hil.html").read_text("utf-8")


def test_a_controller_that_never_comes_ends_the_run_in_lock_step(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["hil", "serve", "--port", "0", "--lock-step-ms", "10", "--no-reference", "--wait-s", "1"]
    assert main([*arguments, "--out", str(tmp_path)]) == 1
    assert capsys.readouterr().err.splitlines() == ["stopped before the last case: no output was written for 1 s"]
    assert "no output was written for 1 s)</h1>" in (tmp_path / "hil.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["serve", "--no-reference", "--out", "{file}/x"], "choose another folder"),
        (["serve", "--out", "{folder}", "--stop-ms", "-1"], "--stop-ms -1: must be 0 to 10000"),
        (["serve", "--out", "{folder}", "--cases", "nothing"], "invalid choice"),
        (["serve", "--out", "{folder}", "--random-operator", "10"], "only in lock step"),
        (["program", "--out", "{folder}", "--wait-s", "0"], "--wait-s 0: must be 1 to 10000"),
        (["program", "--out", "{folder}", "--short", "--cases", "press"], "omit it, or --cases"),
        (["connect", "fx5u", "--out", "{folder}"], "--host"),
        pytest.param(
            ["serve", "--out", "{folder}", "--planting-frequency", "0"],
            "does not complete this trial; add --no-reference",
            marks=pytest.mark.nightly,  # the reference trial runs to its limit
        ),
    ],
)
def test_invalid_options_are_one_line(
    arguments: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("", "utf-8")
    given = [each.format(file=tmp_path / "file", folder=tmp_path / "out") for each in arguments]
    try:
        code = main(["hil", *given])
    except SystemExit as ended:
        code = int(ended.code or 0)
    errors = capsys.readouterr().err
    assert code == 2
    assert text in errors
    assert "Traceback" not in errors
    assert not (tmp_path / "out").exists()
