"""History file: size limit, and damaged, foreign, newer or locked files."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from controller.events.kinds import TrayEvent
from controller.history.file import HistoryFile, HistoryRow, WalBusyError
from controller.history.query import open_history
from controller.history.schema import HistoryError
from tests.controller.history.history_rig import WALL_MS, history, is_sound, table

MB = 1_000_000


def audit_row(number: int, text: str = "") -> HistoryRow:
    return HistoryRow("audit", WALL_MS + number, number, ("127.0.0.1:1", "Li", "clamp", str(number), text or "done"))


def run_row() -> HistoryRow:
    return HistoryRow("runs", WALL_MS, 0, ("transplanter", "0.1.0"))


def size_bytes(path: Path) -> int:
    """Return the size of a history including its write-ahead log and the index of the log."""
    parts = (path.with_name(path.name + suffix) for suffix in ("", "-wal", "-shm"))
    return sum(part.stat().st_size for part in parts if part.exists())


# size limit


def filled(path: Path, limit_bytes: int, batches: int, *, each: Callable[[int], None] = lambda _: None) -> HistoryFile:
    """Append batches of 20 audit rows of 1.5 kB and one event, and call `each` after every batch."""
    file = HistoryFile(path, limit_bytes)
    file.append([run_row()])
    for batch in range(batches):
        rows = [audit_row(20 * batch + n, "x" * 1_500) for n in range(20)]
        file.append([*rows, HistoryRow("events", WALL_MS, batch, ("tray", batch, "", "{}"))])
        each(batch)
    return file


def test_the_file_stays_within_its_limit_and_the_oldest_rows_of_all_tables_are_deleted_first(tmp_path: Path) -> None:
    path, limit_bytes = tmp_path / "history.sqlite", 4 * MB
    sizes: list[int] = []
    filled(path, limit_bytes, 300, each=lambda _: sizes.append(size_bytes(path))).close()
    assert max(sizes) <= limit_bytes
    assert max(sizes[100:]) - min(sizes[100:]) < limit_bytes / 10, (
        "the size is nearly constant after the first 100 batches"
    )
    assert sizes[-1] > limit_bytes / 2, "no more rows are deleted than necessary"
    audit, events = table(path, "audit"), table(path, "events")
    assert audit[-1]["at_ms"] == 300 * 20 - 1
    assert [row["at_ms"] for row in audit] == list(range(6_000 - len(audit), 6_000)), "no gap"
    assert len(audit) > 1_000
    assert abs(int(str(audit[0]["id"])) - int(str(events[0]["id"]))) <= 21, "both start at the same time"
    assert [row["id"] for row in table(path, "runs")] == [1], "the run of the remaining rows is retained"
    assert is_sound(path)


def test_runs_are_deleted_with_their_last_row(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    for _ in range(6):
        filled(path, 4 * MB, 40).close()
    runs = {row["id"] for row in table(path, "runs")}
    assert runs == {row["run"] for row in table(path, "audit")}
    assert 2 <= len(runs) < 6


def test_rows_of_runs_alone_do_not_exceed_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    file = HistoryFile(path, 4 * MB)
    for _ in range(300):
        file.append([HistoryRow("runs", WALL_MS, 0, ("p" * 2_000, "v")) for _ in range(20)])
        assert size_bytes(path) <= 4 * MB
    file.close()
    assert table(path, "runs")[-1]["id"] == 6_000


def test_a_smaller_limit_shrinks_the_file(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    filled(path, 16 * MB, 200).close()
    assert path.stat().st_size > 6 * MB
    file = HistoryFile(path, 4 * MB)
    assert size_bytes(path) <= 4 * MB
    file.append([run_row(), audit_row(9_999)])
    file.close()
    assert path.stat().st_size <= 3 * MB
    assert [row["value"] for row in table(path, "audit")][-2:] == ["3999", "9999"]
    assert is_sound(path)


def test_a_reader_with_an_open_transaction_does_not_make_the_file_grow(tmp_path: Path) -> None:
    """While a reader has an open transaction, the log cannot be checkpointed; at the size limit, rows are rejected."""
    path, limit_bytes = tmp_path / "history.sqlite", 4 * MB
    file = filled(path, limit_bytes, 100)
    with open_history(path) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM audit").fetchone()
        with pytest.raises(WalBusyError, match="close the program that reads"):  # noqa: PT012 - some append must raise
            for n in range(300):
                file.append([audit_row(10_000 + n, "x" * 2_000)] * 20)
                assert size_bytes(path) <= limit_bytes
        reader.execute("ROLLBACK")
    file.append([audit_row(99_999)])
    file.close()
    assert table(path, "audit")[-1]["value"] == "99999"


# invalid files


def garbage(path: Path) -> None:
    path.write_bytes(b"this is not a database" * 1_000)


def hole(path: Path) -> None:
    filled(path, 4 * MB, 5).close()
    with path.open("r+b") as file:
        file.seek(4_096)
        file.write(b"\xff" * 40_000)


def truncated(path: Path) -> None:
    filled(path, 4 * MB, 5).close()
    os.truncate(path, 30_000)


@pytest.mark.parametrize("damage", [garbage, hole, truncated])
def test_a_damaged_file_is_renamed_and_logged_in_one_line(
    damage: Callable[[Path], None], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "history.sqlite"
    for number in (1, 2):
        damage(path)
        damaged = path.read_bytes()
        with history(path) as writer:
            writer.write(TrayEvent(10, number))
        assert (tmp_path / f"history.sqlite.damaged-{number}").read_bytes() == damaged
        assert [row["number"] for row in table(path, "events")] == [number]
        assert len(caplog.messages) == number
        assert f"renamed to {path}.damaged-{number}" in caplog.messages[-1]
        assert "\n" not in caplog.messages[-1]


def foreign(path: Path) -> None:
    with closing(sqlite3.connect(path)) as db:
        db.executescript("CREATE TABLE notes (text); INSERT INTO notes VALUES ('mine');")


def newer(path: Path) -> None:
    filled(path, 4 * MB, 1).close()
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA user_version = 2")


def a_folder(path: Path) -> None:
    path.mkdir()


def a_file_above(path: Path) -> None:
    path.parent.rmdir()
    path.parent.write_text("")


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (foreign, "is not a history; specify a file written by a controller"),
        (newer, "schema 2 is newer than schema 1 of this program; use the program version that wrote the file"),
        (a_folder, "is a folder, not a file"),
        (a_file_above, "choose a writable file"),
    ],
)
def test_an_unusable_file_is_rejected_in_one_line_and_not_changed(
    make: Callable[[Path], None], expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "folder" / "history.sqlite"
    path.parent.mkdir()
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(HistoryError) as error, history(path):
        pass
    assert str(path) in str(error.value)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)
    assert before is None or path.read_bytes() == before
    assert list(tmp_path.rglob("*.damaged*")) == []


def test_a_limit_below_the_minimum_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="must be at least 4000000"), history(tmp_path / "h", limit_bytes=3_999_999):
        pass


def test_two_controllers_cannot_share_a_history(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with (
        history(path) as writer,
        pytest.raises(HistoryError, match="in use by another controller"),
        history(path),
    ):
        pass
    writer.close()
    with history(path):
        pass
    assert len(table(path, "runs")) == 2
