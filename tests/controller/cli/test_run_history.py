"""History of the command ``run``: place, limits, and several controllers in one folder."""

from __future__ import annotations

import socket
from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.common.stop_request import StopRequest
from controller.history.file import HistoryFile, HistoryRow
from controller.history.query import HistoryReader
from tests.controller.history.history_rig import WALL_MS, history, table
from tests.retained import retained

ALONE = "history.sqlite"
MB = 1_000_000
DAY_MS = 86_400_000


def start(folder: Path, *options: str) -> int:
    """Return the exit code of a start that is stopped before the field responds."""
    with StopRequest() as stop:
        stop.set()
        return main(["run", *retained(folder / "r.json"), "--hmi-port", "0", "--no-console", *options], stop)


def test_a_start_records_in_the_folder_of_the_memory_and_prints_the_place_and_the_limits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert start(tmp_path) == 0
    assert capsys.readouterr().err.splitlines() == [f"history: {tmp_path / ALONE}, at most 200 MB and 90 days"]
    assert len(HistoryReader(tmp_path / ALONE).runs()) == 1


def test_without_a_history_nothing_is_recorded_or_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert start(tmp_path, "--no-history") == 0
    assert capsys.readouterr().err == ""
    assert list(tmp_path.glob("history*")) == []


def test_the_limits_are_those_of_the_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first row of a run deletes those that are too old; the start deletes what is too much."""
    path = tmp_path / ALONE
    old_ms = WALL_MS - 1_000 * DAY_MS
    file = HistoryFile(path, 200 * MB)
    file.append([HistoryRow("runs", old_ms, 0, ("p", "v"))])
    file.append([HistoryRow("audit", old_ms, n, ("p", "w", "a", "1", "x" * 2_000)) for n in range(2_400)])
    file.close()
    assert start(tmp_path, "--history-days", "36500") == 0
    assert (path.stat().st_size > 4 * MB, len(table(path, "audit"))) == (True, 2_400)
    assert start(tmp_path, "--history-days", "36500", "--history-mb", "4") == 0
    assert path.stat().st_size < 4 * MB
    assert 0 < len(table(path, "audit")) < 2_400
    assert "at most 4 MB and 36500 days" in capsys.readouterr().err
    assert start(tmp_path, "--history-mb", "4") == 0
    assert table(path, "audit") == []


@pytest.mark.parametrize("option", [("--history-days", "0"), ("--history-mb", "3")])
def test_a_limit_beyond_its_range_is_refused(
    option: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert start(tmp_path, *option) == 2
    assert f"{' '.join(option)}: must be" in capsys.readouterr().err


def test_each_of_several_controllers_has_a_file_of_its_own_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = tmp_path / ALONE
    with history(first):
        assert start(tmp_path) == 0
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"history: {tmp_path / 'history-2.sqlite'}, ")
        assert line.endswith(f"; {first} is in use by another controller")
        with history(tmp_path / "history-2.sqlite"):
            assert start(tmp_path) == 0
        assert "history-3.sqlite, " in capsys.readouterr().err
    assert [len(table(tmp_path / name, "runs")) for name in (ALONE, "history-2.sqlite", "history-3.sqlite")] == [
        1,
        2,
        1,
    ]


def test_a_file_that_was_named_is_never_replaced_by_another(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    named = tmp_path / "named.sqlite"
    with history(named):
        before = sorted(tmp_path.iterdir())
        assert start(tmp_path, "--history", str(named)) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line == (
            f"--history: {named}: in use by another controller; stop that controller or choose another file"
        )
        assert sorted(tmp_path.iterdir()) == before


def test_the_number_of_files_is_limited(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with ExitStack() as stack:
        for name in (ALONE, *(f"history-{n}.sqlite" for n in range(2, 10))):
            stack.enter_context(history(tmp_path / name))
        assert start(tmp_path) == 2
        assert "history-9.sqlite: in use by another controller" in capsys.readouterr().err


def test_a_second_controller_that_fails_to_start_leaves_no_history(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Such as one that would serve the port of the first."""
    with history(tmp_path / ALONE), socket.create_server(("127.0.0.1", 0)) as occupied:
        before = sorted(tmp_path.iterdir())
        assert start(tmp_path, "--hmi-port", str(occupied.getsockname()[1])) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "address already in use" in line
        assert sorted(tmp_path.iterdir()) == before
