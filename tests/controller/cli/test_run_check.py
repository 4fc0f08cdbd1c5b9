"""``run --check`` checks what a start checks, and a start that fails leaves no files behind."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.common.stop_request import StopRequest
from tests.retained import retained

REFUSED = {
    "unknown set-point": (["--set", "traystarget=2"], "--set traystarget=2: unknown set-point 'traystarget'"),
    "set-point that is no number": (["--set", "trays_target=banana"], "--set trays_target=banana: must be an integer"),
    "set-point out of range": (["--set", "trays_target=99999999"], "--set trays_target=99999999: must be 0 to 1000"),
    "missing constants": (["--constants", "{0}/none.yaml"], "{0}/none.yaml: cannot be read"),
    "input filter": (["--input-filter-ms", "61"], "--input-filter-ms 61: must be 0 to 60"),
    "pace": (["--simulated-time", "--pace", "5001"], "--pace 5001: must be 0 to 5000, or 65535"),
    "memory without a folder": (["--retain", "{0}/no/such/r.json"], "--retain {0}/no/such/r.json: folder {0}/no does"),
    "memory that is a folder": (["--retain", "{0}"], "--retain {0}: is a folder"),
    "memory that is this folder": (["--retain", ".", "--new-machine"], "--retain .: is a folder"),
    "folder that is a file": (["--retain", "{0}/file/r.json"], "--retain {0}/file/r.json: Not a directory"),
    "memory of a machine that is not new": (
        ["--new-machine", "--retain", "{0}/file"],
        "--new-machine: {0}/file exists, so the memory has been written",
    ),
    "newer memory": (["--retain", "{0}/newer"], "{0}/newer: format transplanter-retentive-3 is newer"),
    "history without a folder": (["--history", "{0}/no/such/h"], "--history: {0}/no/such/h: folder {0}/no does not"),
    "capture without a folder": (["--capture", "{0}/no/c"], "--capture {0}/no/c: No such file"),
    "port": (["--hmi-port", "65536"], "--hmi-port 65536: must be 0 to 65535"),
    "address": (["--hmi-host", "192.0.2.1"], "HMI server: host 192.0.2.1: "),
    "address of the MC server": (["--mc", "1e", "--mc-host", "192.0.2.1"], "MC server: host 192.0.2.1: "),
    "key without a certificate": (["--hmi-key", "{0}/file"], "--hmi-key and --hmi-clients require a certificate"),
    "line of the panel": (["--hmi-serial", "{0}/tty:9600:8E1:1"], "serial line {0}/tty: No such file or directory; "),
    "programming port": (["--fx-port", "{0}/tty"], "serial line {0}/tty: No such file or directory; "),
}


def check(folder: Path, *options: str) -> int:
    """Return the exit code of --check; a later option replaces an earlier one."""
    with StopRequest() as stop:
        return main(["run", "--check", "--retain", str(folder / "var" / "r.json"), *options], stop)


def content(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "file").write_text("no memory", encoding="utf-8")
    (tmp_path / "newer").write_text('{"format": "transplanter-retentive-3"}', encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("case", REFUSED)
def test_a_check_refuses_what_a_start_refuses_and_writes_nothing(
    case: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options, message = REFUSED[case]
    before = content(folder)
    assert check(folder, *(option.format(folder) for option in options)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(message.format(folder))
    assert content(folder) == before


def test_a_check_accepts_the_defaults_and_prints_the_places_of_all_wires(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = content(folder)
    assert check(folder, "--set", "trays_target=2", "--mc", "3e") == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert "Y0    tray_run" in output.out
    assert content(folder) == before


def test_a_check_reports_damaged_files_that_a_start_renames(
    folder: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    before = content(folder)
    assert check(folder, "--retain", str(folder / "file"), "--history", str(folder / "newer")) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"{folder / 'file'}: not a retentive store, or truncated; ")
    assert line.endswith("; a start renames the file")
    assert caplog.messages == [f"{folder / 'newer'}: file is not a database; a start renames the file"]
    assert content(folder) == before


# a start that fails


@pytest.fixture
def occupied() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener.getsockname()[1]


def start(folder: Path, *options: str) -> int:
    with StopRequest() as stop:
        stop.set()
        return main(["run", *retained(folder / "r.json"), "--no-console", *options], stop)


def test_a_start_that_fails_leaves_no_files(folder: Path, occupied: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Neither the folder of the memory remains, nor a memory that --new-machine would refuse at the next start."""
    before = content(folder)
    capture = ("--capture", str(folder / "capture.txt"))
    assert start(folder / "var", "--hmi-port", str(occupied), *capture) == 2
    assert "address already in use" in capsys.readouterr().err
    assert content(folder) == before
    assert start(folder / "var", "--hmi-port", "0") == 0


def test_a_start_that_fails_keeps_earlier_files(folder: Path, occupied: int) -> None:
    assert start(folder, "--hmi-port", "0") == 0
    before = content(folder)
    memory = (folder / "r.json").read_bytes()
    assert start(folder, "--hmi-port", str(occupied)) == 2
    assert set(before) <= set(content(folder))
    assert len((folder / "r.json").read_bytes()) == len(memory)
