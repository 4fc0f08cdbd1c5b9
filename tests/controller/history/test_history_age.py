"""Age limit of a history: rows are deleted oldest first, by the wall clock of the rows that are written."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.history.file import HistoryFile, HistoryRow, WalBusyError
from controller.history.query import open_history
from tests.controller.history.history_rig import WALL_MS, is_sound, table

MB = 1_000_000
HOUR_MS = 3_600_000
DAY_MS = 24 * HOUR_MS


def run_row(utc_ms: int) -> HistoryRow:
    return HistoryRow("runs", utc_ms, 0, ("transplanter", "0.1.0"))


def event_row(utc_ms: int, number: int = 0) -> HistoryRow:
    return HistoryRow("events", utc_ms, 0, ("tray", number, "", "{}"))


def audit_row(utc_ms: int) -> HistoryRow:
    return HistoryRow("audit", utc_ms, 0, ("127.0.0.1:1", "Li", "clamp", "1", "done"))


def days(path: Path, name: str = "events") -> list[float]:
    """Return the days of the rows of a table since the first one was written."""
    return [(int(str(row["utc_ms"])) - WALL_MS) / DAY_MS for row in table(path, name)]


def recorded(path: Path, *, last_day: int, limit_days: int = 90) -> HistoryFile:
    """Record a run a day with an event and an order, from day 0."""
    for day in range(last_day):
        file = HistoryFile(path, 4 * MB, limit_days)
        at_ms = WALL_MS + day * DAY_MS
        file.append([run_row(at_ms), event_row(at_ms), audit_row(at_ms)])
        file.close()
    return HistoryFile(path, 4 * MB, limit_days)


def test_rows_that_are_older_than_the_limit_are_deleted_oldest_first_with_their_runs(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    file = recorded(path, last_day=20, limit_days=10)
    file.append([run_row(WALL_MS + 20 * DAY_MS)])
    file.close()
    for name in ("events", "audit"):
        assert days(path, name) == list(range(10, 20)), "the row of exactly ten days is kept"
    assert days(path, "runs") == list(range(10, 21))
    assert is_sound(path)


def test_the_age_is_checked_again_after_an_hour(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    file = recorded(path, last_day=5, limit_days=5)
    at_ms = WALL_MS + 5 * DAY_MS
    file.append([run_row(at_ms)])
    assert days(path) == [0, 1, 2, 3, 4]
    file.append([event_row(at_ms + HOUR_MS - 1)])
    assert days(path)[0] == 0
    file.append([event_row(at_ms + HOUR_MS)])
    assert days(path)[0] == 1
    file.close()


def test_after_a_long_pause_all_rows_are_deleted_and_ids_continue(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    file = HistoryFile(path, 4 * MB)
    file.append([run_row(WALL_MS), *(event_row(WALL_MS + n) for n in range(500))])
    file.close()
    file = HistoryFile(path, 4 * MB)
    at_ms = WALL_MS + 200 * DAY_MS
    file.append([run_row(at_ms), event_row(at_ms)])
    file.close()
    assert days(path) == [200]
    assert [row["id"] for row in table(path, "events")] == [503]
    assert is_sound(path)


def test_no_younger_row_is_deleted_with_a_portion_of_old_ones(tmp_path: Path) -> None:
    """A transaction deletes a part of the rows, here 15."""
    path = tmp_path / "history.sqlite"
    file = HistoryFile(path, 4 * MB)
    file.append([run_row(WALL_MS), *(event_row(WALL_MS + n * HOUR_MS, n) for n in range(1_000))])
    file.append([event_row(WALL_MS + 90 * DAY_MS + 701 * HOUR_MS, 1_000)])
    file.close()
    assert [row["number"] for row in table(path, "events")] == list(range(701, 1_001))


def test_a_clock_that_is_set_back_deletes_nothing(tmp_path: Path) -> None:
    """Rows with an earlier time between later ones are deleted with these."""
    path = tmp_path / "history.sqlite"
    file = recorded(path, last_day=3)
    file.append([run_row(0), event_row(0)])
    assert days(path)[:3] == [0, 1, 2]
    file.append([event_row(WALL_MS + 91 * DAY_MS)])
    assert days(path) == [1, 2, -WALL_MS / DAY_MS, 91], "only what is older than all younger rows"
    file.close()


def test_a_deletion_that_a_reader_blocks_is_completed_later(tmp_path: Path) -> None:
    """The deletion fills the log, which a reader with an open transaction keeps; some of the old rows remain."""
    path = tmp_path / "history.sqlite"
    file = HistoryFile(path, 4 * MB)
    file.append([run_row(WALL_MS)])
    for _ in range(40):
        file.append([event_row(WALL_MS), *([audit_row(WALL_MS)] * 500)])
    at_ms = WALL_MS + 91 * DAY_MS
    with open_history(path) as reader:
        reader.execute("BEGIN")
        before = reader.execute("SELECT count(*) FROM audit").fetchone()[0]
        with pytest.raises(WalBusyError):
            file.append([event_row(at_ms)])
        left = len(days(path, "audit"))
        reader.execute("ROLLBACK")
    assert 0 < left < before
    file.append([event_row(at_ms)])
    assert days(path) == [91]
    assert days(path, "audit") == []
    file.close()
