"""Messages of the command ``run`` at its start."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cli.main import main
from controller.common.stop_request import StopRequest
from controller.iomap.loader import DEFAULT_IO_MAP
from tests.wiring import DELIVERED

LAMP = DELIVERED["lamp_amber"]
LINES = DEFAULT_IO_MAP.read_text(encoding="utf-8").splitlines(keepends=True)


CHECK = ("--check",)
SAYS = "questions need a panel or a command; with a lamp,"


def start_messages(
    folder: Path, lines: list[str], capsys: pytest.CaptureFixture[str], more: tuple[str, ...] = ()
) -> str:
    """Start the controller on an I/O map, stopped before the field responds, and return its messages."""
    path = folder / "map.yaml"
    path.write_text("".join(lines), encoding="utf-8")
    options = ["--io-map", str(path), "--retain", str(folder / "r.json"), "--hmi-port", "0", "--no-console", *more]
    with StopRequest() as stop:
        stop.set()
        assert main(["run", *options], stop) == 0
    return capsys.readouterr().err


def test_a_map_without_the_lamp_says_at_start_that_questions_need_a_panel_or_a_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line names file, line, lamp and remedy, also with --check; the delivered map causes none."""
    entry = LINES[LAMP.line - 1]
    assert "wired: true" in entry
    unwired = [*LINES[: LAMP.line - 1], entry.replace("wired: true", "wired: false"), *LINES[LAMP.line :]]
    place, remedy = f"{tmp_path / 'map.yaml'}:{LAMP.line}", f"set wired: true ({LAMP.address})"
    for more in ((), CHECK):
        assert start_messages(tmp_path, unwired, capsys, more).splitlines() == [
            f"{place}: lamp_amber is not wired: {SAYS} {remedy}"
        ]
    assert start_messages(tmp_path, LINES, capsys) == ""


def test_a_map_without_an_entry_of_the_lamp_says_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    absent = [*LINES[: LAMP.line - 1], *LINES[LAMP.line :]]
    assert start_messages(tmp_path, absent, capsys).splitlines() == [
        f"{tmp_path / 'map.yaml'}: lamp_amber is not wired: {SAYS} add lamp_amber"
    ]
