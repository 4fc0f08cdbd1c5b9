"""History file: size limit, and damaged, foreign, incomplete, newer or locked files."""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from controller.events.kinds import TrayEvent
from controller.history.file import HistoryFile, HistoryRow, WalBusyError
from controller.history.query import HistoryReader, open_history
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


def foreign(path: Path) -> None:
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as db:
        db.executescript("CREATE TABLE notes (text); INSERT INTO notes VALUES ('mine');")


def altered(path: Path, statement: str) -> None:
    filled(path, 4 * MB, 1).close()
    with closing(sqlite3.connect(path)) as db:
        db.execute(statement)


def without_runs(path: Path) -> None:
    altered(path, "DROP TABLE runs")


def with_another_column(path: Path) -> None:
    altered(path, "ALTER TABLE cycles DROP COLUMN missed_cups")


def overwritten(path: Path, place: int, content: bytes) -> None:
    filled(path, 4 * MB, 1).close()
    with path.open("r+b") as file:
        file.seek(place)
        file.write(content)


def unknown_schema_format(path: Path) -> None:
    overwritten(path, 44, b"\0\0\0\xff")


def unknown_write_format(path: Path) -> None:
    """Make a file that SQLite would open for reading only."""
    overwritten(path, 18, b"\3")


def damaged_statement(path: Path) -> None:
    """Make a file for which the error of SQLite is no valid text."""
    filled(path, 4 * MB, 1).close()
    overwritten(path, path.read_bytes().index(b"TABLE runs"), b"\xff")


@pytest.mark.parametrize(
    "damage",
    [
        garbage,
        hole,
        truncated,
        foreign,
        without_runs,
        with_another_column,
        unknown_schema_format,
        unknown_write_format,
        damaged_statement,
    ],
)
def test_a_damaged_file_is_renamed_and_logged_in_one_line(
    damage: Callable[[Path], None], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "history.sqlite"
    for number in (1, 2):
        damage(path)
        damaged = path.read_bytes()
        assert HistoryReader(path).problem is not None or damage in {hole, truncated, unknown_write_format}
        with history(path) as writer:
            writer.write(TrayEvent(10, number))
        assert (tmp_path / f"history.sqlite.damaged-{number}").read_bytes() == damaged
        assert [row["number"] for row in table(path, "events")] == [number]
        assert len(caplog.messages) == number
        assert f"renamed to {path}.damaged-{number}" in caplog.messages[-1]
        assert "\n" not in caplog.messages[-1]


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


def copied_with_its_log(path: Path) -> None:
    """Make a history whose newer schema is only in its write-ahead log, as after a crash."""
    origin = path.with_name("origin.sqlite")
    filled(origin, 4 * MB, 1).close()
    with closing(sqlite3.connect(origin)) as db:
        db.execute("PRAGMA user_version = 2")
        for ending in ("", "-wal"):
            shutil.copy(f"{origin}{ending}", f"{path}{ending}")


@pytest.mark.parametrize("make", [newer, copied_with_its_log])
def test_a_newer_history_is_not_opened_for_writing(make: Callable[[Path], None], tmp_path: Path) -> None:
    """Opening it would empty its write-ahead log."""
    path = tmp_path / "history.sqlite"
    make(path)
    parts = [path, path.with_name(f"{path.name}-wal")]
    before = [part.read_bytes() for part in parts if part.exists()]
    assert len(before) == (1 if make is newer else 2)
    with pytest.raises(HistoryError, match="schema 2 is newer"), history(path):
        pass
    assert [part.read_bytes() for part in parts if part.exists()] == before


def test_a_database_in_use_by_another_program_is_not_renamed(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    foreign(path)
    with closing(sqlite3.connect(path)) as db:
        db.execute("BEGIN EXCLUSIVE")
        with pytest.raises(HistoryError, match="database is locked"), history(path):
            pass
    assert list(tmp_path.glob("*.damaged*")) == []


@pytest.mark.parametrize("code", [sqlite3.SQLITE_IOERR_READ, sqlite3.SQLITE_FULL])
def test_an_error_of_the_disk_in_the_check_of_the_file_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, code: int
) -> None:
    path = tmp_path / "history.sqlite"
    with history(path):
        pass

    def read_only(*_: object) -> None:
        error = sqlite3.OperationalError("disk I/O error")
        error.sqlite_errorcode = code
        raise error

    monkeypatch.setattr("controller.history.file.read_only", read_only)
    with history(path):
        pass
    assert [record.message for record in caplog.records] == [
        f"{path}: disk I/O error; the check before opening is omitted"
    ]
    assert len(table(path, "runs")) == 2


def test_a_damaged_row_does_not_end_the_answer_to_a_panel(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    file = HistoryFile(path, 4 * MB)
    details = ('{"side":"left"}', "[" * 100_000, "{")
    file.append([run_row(), *(HistoryRow("events", WALL_MS, 0, ("row", 1, "", detail)) for detail in details)])
    file.close()
    assert [row["detail"] for row in HistoryReader(path).events()] == [None, None, {"side": "left"}]


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
