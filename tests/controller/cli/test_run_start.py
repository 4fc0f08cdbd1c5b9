"""Messages of the command ``run`` at its start, and the files that it opens."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.common.stop_request import StopRequest
from controller.history.schema import create_statements
from controller.iomap.loader import DEFAULT_IO_MAP
from controller.program.tags import FORGOTTEN
from tests.retained import retained
from tests.wiring import DELIVERED

LAMP = DELIVERED["lamp_amber"]
LINES = DEFAULT_IO_MAP.read_text(encoding="utf-8").splitlines(keepends=True)


CHECK = ("--check",)
SAYS = "questions need a panel or a command; with a lamp,"


def messages(capsys: pytest.CaptureFixture[str], recorded: Path | None) -> list[str]:
    """Return the printed lines without the place of the history, which a start prints for its folder."""
    lines = capsys.readouterr().err.splitlines()
    if recorded is not None:
        lines.remove(f"history: {recorded / 'history.sqlite'}, at most 200 MB and 90 days")
    return lines


def start_messages(
    folder: Path, lines: list[str], capsys: pytest.CaptureFixture[str], more: tuple[str, ...] = ()
) -> str:
    """Start the controller on an I/O map, stopped before the field responds, and return its messages."""
    path = folder / "map.yaml"
    path.write_text("".join(lines), encoding="utf-8")
    options = ["--io-map", str(path), *retained(folder / "r.json"), "--hmi-port", "0", "--no-console", *more]
    with StopRequest() as stop:
        stop.set()
        assert main(["run", *options], stop) == 0
    return "\n".join(messages(capsys, folder if more != CHECK else None))


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


# files of the last run


def database(*statements: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with closing(sqlite3.connect(path)) as db:
            db.executescript("; ".join(statements))

    return write


def text(content: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_text(content, encoding="utf-8")

    return write


LOST = "retentive memory is lost; check rows and claws before resetting"
SETS_ASIDE = {
    "history of another program": ("history.sqlite", database("CREATE TABLE mine (id)"), "is not a history"),
    "history without runs": (
        "history.sqlite",
        database(*(each for each in create_statements() if "TABLE runs" not in each)),
        "table runs is missing",
    ),
    "damaged history": ("history.sqlite", text("no database " * 100), "file is not a database"),
    "nested memory": ("r.json", text("[" * 100_000), f"not a retentive store, or truncated; {LOST}"),
    "memory of another program": ("r.json", text('{"format": "mine"}'), f"not a retentive store, or truncated; {LOST}"),
}
REFUSED = {
    "newer history": (
        "history.sqlite",
        database(*create_statements(), "PRAGMA user_version = 2"),
        "schema 2 is newer than schema 1 of this program",
    ),
    "newer memory": (
        "r.json",
        text('{"format": "transplanter-retentive-3"}'),
        "format transplanter-retentive-3 is newer than transplanter-retentive-2 of this program",
    ),
}


def start(folder: Path, expected: int) -> None:
    with StopRequest() as stop:
        stop.set()
        assert main(["run", *retained(folder / "r.json"), "--hmi-port", "0", "--no-console"], stop) == expected


def written(folder: Path, name: str, write: Callable[[Path], object], reason: str) -> tuple[Path, bytes, str]:
    """Write a file that cannot be used, and return it with its content and the reason."""
    path = folder / name
    write(path)
    return path, path.read_bytes(), reason


@pytest.mark.parametrize("case", SETS_ASIDE)
def test_a_file_that_cannot_be_used_is_renamed_with_one_line_and_the_start_goes_on(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    path, before, reason = written(tmp_path, *SETS_ASIDE[case])
    start(tmp_path, expected=0)
    (line,) = [*messages(capsys, tmp_path), *caplog.messages]
    assert line.startswith(f"{path}: {reason}; renamed to {path}.damaged-1")
    assert path.with_name(f"{path.name}.damaged-1").read_bytes() == before
    start(tmp_path, expected=0)
    assert [*messages(capsys, tmp_path), *caplog.messages[1:]] == [], "the next start finds sound files"


@pytest.mark.parametrize("case", REFUSED)
def test_a_file_of_a_newer_program_ends_the_start_and_is_not_changed(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, before, reason = written(tmp_path, *REFUSED[case])
    start(tmp_path, expected=2)
    (line,) = capsys.readouterr().err.splitlines()
    assert f"{path}: {reason}; use the program version that wrote the file" in line
    assert path.read_bytes() == before
    assert list(tmp_path.glob("*.damaged*")) == []


# new machine


def test_a_missing_memory_counts_as_lost_and_the_line_names_the_remedies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The loss is stored before the first scan, so that the next start asks as well."""
    path = tmp_path / "r.json"
    with StopRequest() as stop:
        stop.set()
        assert main(["run", "--retain", str(path), "--hmi-port", "0", "--no-console"], stop) == 0
    (line,) = messages(capsys, tmp_path)
    assert line.startswith(f"{path}: no memory, which counts as lost; ")
    assert "--new-machine" in line
    assert "command new_machine" in line
    assert json.loads(path.read_bytes())["values"]["D561"] == FORGOTTEN


@pytest.mark.parametrize("name", ["r.json", "r.json.mark"])
def test_a_machine_whose_memory_has_been_written_cannot_be_declared_new(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line, exit code 2, and no file is changed, whatever the file contains."""
    start(tmp_path, expected=0)
    left = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for other in {"r.json", "r.json.mark"} - {name}:
        (tmp_path / other).unlink()
        del left[other]
    capsys.readouterr()
    with StopRequest() as stop:
        command = ["run", "--retain", str(tmp_path / "r.json"), "--new-machine", "--hmi-port", "0", "--no-console"]
        assert main(command, stop) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        f"--new-machine: {tmp_path / name} exists, so the memory has been written; omit --new-machine"
    )
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == left
