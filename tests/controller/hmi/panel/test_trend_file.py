"""File of the trends: what survives a restart, its size, and damaged, locked and foreign files."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

import pytest

from controller.hmi.panel.view import trend_file, trends
from controller.hmi.panel.view.trend_file import NewerTrendsError, TrendFile
from controller.hmi.panel.view.trend_periods import TrendPeriod
from controller.hmi.panel.view.trends import (
    MOST_PERIODS,
    PERIOD_MS,
    SAMPLED_MS,
)
from tests.controller.hmi.panel.trend_rig import HOUR_MS, NAME, NOON_MS, Recorder, known, stored, values


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "new" / "trends.sqlite"


def test_the_periods_survive_a_restart(path: Path) -> None:
    recorder = Recorder(path)
    recorder.record([390.0] * 400 + [310.0] + [390.0] * 74)
    before = recorder.answer(HOUR_MS)
    recorder.close()
    after = Recorder(path, at_ms=recorder.at_ms)
    assert after.answer(HOUR_MS)["tables"] == before["tables"]
    after.at_ms += 5_000
    after.record([400.0])
    means = values(after.answer(HOUR_MS))["mean"]
    assert means[-2:] == [None, 400.0], "the time without a panel is a gap"


def test_a_killed_panel_loses_the_samples_since_the_last_write_only(path: Path) -> None:
    recorder = Recorder(path)
    recorder.record([390.0] * 325)
    recorder.write()
    recorder.record([390.0] * 325)
    recorder.trends._file._db.close()  # type: ignore[union-attr]
    assert stored(path) == [NOON_MS + n * PERIOD_MS for n in range(6)]


class ReportingFile(TrendFile):
    """File that reports its writes to an event loop."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, MOST_PERIODS)
        self.loop = asyncio.get_running_loop()
        self.written = asyncio.Event()

    def append(self, names: Sequence[str], rows: Iterable[TrendPeriod]) -> bool:
        done = super().append(names, rows)
        self.loop.call_soon_threadsafe(self.written.set)
        return done


def test_ended_periods_are_written_periodically(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trends, "WRITE_MS", 1)
    recorder = Recorder(path)
    recorder.record([390.0] * 325)
    periods = list(recorder.trends._periods)

    async def run() -> None:
        recorder.trends._file = file = ReportingFile(path)
        task = asyncio.create_task(recorder.trends.run())
        await asyncio.wait_for(file.written.wait(), 60)
        task.cancel()
        file.close()

    asyncio.run(run())
    assert stored(path) == [period.utc_ms for period in periods]


def test_samples_are_not_written_before_the_minute_is_over(path: Path) -> None:
    recorder = Recorder(path)
    recorder.record([390.0] * 1_000)
    assert not path.exists()


def test_the_file_keeps_a_limited_number_of_periods(path: Path) -> None:
    recorder = Recorder(None)
    recorder.record([390.0] * 40, every_ms=PERIOD_MS)
    rows = list(recorder.trends._periods)
    file = TrendFile(path, most_rows=20)
    for n in range(0, 39, 3):
        assert file.append([NAME], rows[n : n + 3])
    assert [row.utc_ms for row in file.load([NAME], 0, 2 * NOON_MS)] == [row.utc_ms for row in rows[19:39]]
    file.close()


def test_a_day_of_the_file_is_a_few_megabytes_and_no_more_on_the_next_day(path: Path) -> None:
    names = [f"left.series_{n}_mm" for n in range(12)]
    recorder = Recorder(None, *names)
    recorder.telemetry.given = dict.fromkeys(names, 123.4)
    recorder.record([123.4] * 2, every_ms=PERIOD_MS)
    (row,) = recorder.trends._periods
    file = TrendFile(path, MOST_PERIODS)
    sizes = []
    for day in range(2):
        for n in range(0, MOST_PERIODS, 720):
            start_ms = NOON_MS + (day * MOST_PERIODS + n) * PERIOD_MS
            assert file.append(names, [row._replace(utc_ms=start_ms + k * PERIOD_MS) for k in range(720)])
        sizes.append(path.stat().st_size)
    file.close()
    assert sizes[0] < 6_000_000
    assert sizes[1] < 1.1 * sizes[0]


def test_another_list_of_tags_finds_its_own_series(path: Path) -> None:
    recorder = Recorder(path)
    recorder.record([390.0] * 100)
    recorder.close()
    after = Recorder(path, "claw_pressure_kpa", NAME, at_ms=recorder.at_ms)
    answer = after.answer(SAMPLED_MS)
    assert known(values(answer)["mean"]) == [390.0, 390.0]
    assert known(values(answer, "claw_pressure_kpa")["mean"]) == []


@pytest.mark.parametrize("content", [b"", b"no database at all " * 500, b"SQLite format 3\0" + bytes(5_000)])
def test_a_damaged_file_is_set_aside_and_stops_nothing(
    path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    path.parent.mkdir()
    path.write_bytes(content)
    recorder = Recorder(path)
    recorder.record([390.0] * 100)
    assert known(values(recorder.answer(SAMPLED_MS))["mean"]) == [390.0] * 10
    recorder.close()
    assert stored(path) == [NOON_MS, NOON_MS + PERIOD_MS]
    aside = path.with_name("trends.sqlite.damaged-1")
    assert aside.exists() == (content != b"")
    assert [record.message.count("\n") for record in caplog.records] == [0] * aside.exists()


def test_a_file_with_damaged_pages_is_set_aside(path: Path) -> None:
    recorder = Recorder(path)
    recorder.record([390.0] * 5_000)
    recorder.close()
    content = bytearray(path.read_bytes())
    content[4_096:] = b"\xa5" * (len(content) - 4_096)
    path.write_bytes(content)
    after = Recorder(path, at_ms=recorder.at_ms)
    after.record([391.0] * 100)
    after.close()
    assert len(stored(path)) == 2
    assert path.with_name("trends.sqlite.damaged-1").exists()


@pytest.mark.parametrize(
    "spreads",
    ["[1]", "{", "[" * 100_000, '{"main_pressure_kpa": [1, 2]}', '{"main_pressure_kpa": ["a", 1, 2]}'],
    ids=["list", "cut", "nested", "short", "text"],
)
def test_a_period_that_is_none_is_damage(path: Path, spreads: str) -> None:
    recorder = Recorder(path)
    recorder.record([390.0] * 100)
    recorder.close()
    db = sqlite3.connect(path)
    with db:
        db.execute("UPDATE periods SET spreads = ? WHERE id = 1", (spreads,))
    db.close()
    assert known(values(Recorder(path, at_ms=recorder.at_ms).answer(HOUR_MS))["mean"]) == []
    assert path.with_name("trends.sqlite.damaged-1").exists()


def test_the_file_of_another_panel_is_not_touched_and_written_once_it_is_free(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(trend_file, "BUSY_S", 0.0)
    first = Recorder(path)
    first.record([390.0] * 100)
    first.write()
    second = Recorder(path, at_ms=first.at_ms)
    second.record([391.0] * 100)
    for _ in range(3):
        second.write()
    assert [record.message for record in caplog.records] == [
        f"{path}: database is locked; choose a writable file that no other panel uses; "
        "the trends are kept in memory until the file can be written"
    ]
    first.close()
    second.close()
    assert stored(path) == [NOON_MS + n * PERIOD_MS for n in range(4)]


def make_database(path: Path, *statements: str) -> None:
    path.parent.mkdir(exist_ok=True)
    with closing(sqlite3.connect(path)) as db:
        db.executescript("; ".join(statements))


PERIODS = "CREATE TABLE periods (id INTEGER PRIMARY KEY, utc_ms INTEGER, for_ms INTEGER, spreads TEXT)"
OWN = f"PRAGMA application_id = {trend_file.APPLICATION}"


@pytest.mark.parametrize(
    ("statements", "reason"),
    [
        ((PERIODS,), "is a database of another program"),
        ((OWN, "CREATE TABLE later (id)"), "table periods is missing"),
        ((OWN, "CREATE TABLE periods (id INTEGER PRIMARY KEY, utc_ms)"), "table periods has other columns"),
    ],
)
def test_a_foreign_or_incomplete_file_is_set_aside_unchanged(
    path: Path, statements: tuple[str, ...], reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    for number in (1, 2):
        make_database(path, *statements)
        before = path.read_bytes()
        recorder = Recorder(path)
        recorder.record([390.0] * 100)
        recorder.close()
        assert path.with_name(f"trends.sqlite.damaged-{number}").read_bytes() == before
        assert len(stored(path)) == 2
        assert len(caplog.messages) == number
        assert f"{path}: {reason}; renamed to trends.sqlite.damaged-{number}" in caplog.messages[-1]
        path.unlink()


def test_a_file_of_a_newer_program_is_refused_at_the_start_and_never_changed(
    path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    make_database(path, PERIODS, OWN, "PRAGMA user_version = 1")
    before = path.read_bytes()
    with pytest.raises(NewerTrendsError, match=f"{path}: schema 1 is newer than schema 0") as refused:
        TrendFile(path, MOST_PERIODS).check()
    assert "\n" not in str(refused.value)
    recorder = Recorder(path)  # exchanged while the panel runs
    recorder.record([390.0] * 100)
    recorder.close()
    assert known(values(recorder.answer(SAMPLED_MS))["mean"]) == [390.0] * 10
    assert [each.name for each in path.parent.iterdir()] == [path.name]
    assert path.read_bytes() == before
    assert [message.count(str(path)) for message in caplog.messages] == [1]


def test_a_folder_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    recorder = Recorder(tmp_path / "file" / "trends.sqlite")
    recorder.record([390.0] * 100)
    recorder.close()
    assert known(values(recorder.answer(SAMPLED_MS))["mean"]) == [390.0] * 10


def test_the_latest_periods_are_written_once_a_disk_that_failed_for_long_works(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trends, "MOST_PERIODS", 3)
    path.parent.write_text("")
    recorder = Recorder(path)
    recorder.record([390.0] * 6, every_ms=PERIOD_MS)
    recorder.write()
    path.parent.unlink()
    recorder.write()
    recorder.record([390.0] * 2, every_ms=PERIOD_MS)
    recorder.close()
    assert stored(path) == [NOON_MS + n * PERIOD_MS for n in range(2, 8)]
