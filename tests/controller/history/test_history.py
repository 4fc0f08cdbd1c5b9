"""History: contents, time of writing, crashes, full disks and reading."""

from __future__ import annotations

import json
import logging
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from controller.events.alarm_list import AlarmChange
from controller.events.alarm_states import AlarmState
from controller.events.cycle_edges import Edge
from controller.events.kinds import (
    AlarmEvent,
    CycleEvent,
    Event,
    ModeEvent,
    QuestionEvent,
    RefusalEvent,
    StateEvent,
    TrayEvent,
)
from controller.history import writer as history_module
from controller.history.file import HistoryFile, HistoryRow
from controller.history.query import HistoryReader
from controller.history.schema import TABLES
from controller.program.texts.operator import LANGUAGES, Language, Text
from tests.controller.history.history_rig import WALL_MS, history, is_sound, table

PATIENCE_S = 60.0
"""Timeout for a thread or a process, s; reached only in a failing test."""


# contents

EVENTS: list[tuple[Event, tuple[object, ...]]] = [
    (StateEvent(10, 11, Text.plain("Held"), Text.plain("alarm")), ("state", 11, "Held", {"reason": "alarm"})),
    (StateEvent(10, 6, Text.plain("运行")), ("state", 6, "运行", {})),
    (ModeEvent(20, 3, Text.plain("manual")), ("mode", 3, "manual", {})),
    (RefusalEvent(30, "start", 2, Text.plain("cannot start")), ("refusal", 2, "cannot start", {"command": "start"})),
    (
        QuestionEvent(40, "tray", True, Text.plain("Which?")),
        ("question", 1, "Which?", {"question": "tray", "active": True}),
    ),
    (
        QuestionEvent(50, "tray", False, Text.plain("Which?")),
        ("question", 0, "Which?", {"question": "tray", "active": False}),
    ),
    (TrayEvent(60, 7), ("tray", 7, "", {})),
]


def test_every_production_event_is_a_row(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as writer:
        for event, _ in EVENTS:
            writer.write(event)
    rows = table(path, "events")
    actual = [(row["kind"], row["number"], row["text"], json.loads(str(row["detail"]))) for row in rows]
    assert actual == [expected for _, expected in EVENTS]
    assert [row["at_ms"] for row in rows] == [event.at_ms for event, _ in EVENTS]
    assert [row["utc_ms"] for row in rows] == [WALL_MS + 1 + n for n in range(len(rows))], (
        "time of the event, not of the write"
    )


def test_a_cycle_is_a_row_with_its_edges(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    event = CycleEvent(9_000, "right", 2, 8_000, 1_500, 3, "tray")
    edges: dict[CycleEvent, list[Edge]] = {event: [(0, "Y7", 0), (0, "Y7", 1), (8_000, "Y13", 0)]}
    with history(path, edges_of=edges.__getitem__) as writer:
        writer.write(event)
    (row,) = table(path, "cycles")
    assert [row[name] for name in list(TABLES["cycles"])[2:]] == [
        9_000,
        1,
        "right",
        2,
        8_000,
        1_500,
        3,
        "tray",
        '[[0,"Y7",0],[0,"Y7",1],[8000,"Y13",0]]',
    ]
    last = HistoryReader(path).last_cycle("right")
    assert last is not None
    assert last["edges"] == [[0, "Y7", 0], [0, "Y7", 1], [8_000, "Y13", 0]]
    assert HistoryReader(path).last_cycle("left") is None


@pytest.mark.parametrize("language", LANGUAGES)
def test_texts_are_recorded_in_the_selected_language(language: Language, tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    held, alarm, message = Text("Held", "已保持"), Text("alarm", "有报警"), Text("magazine empty", "苗盘仓空")
    with history(path, language=language) as writer:
        writer.write(StateEvent(10, 11, held, alarm))
        writer.write(AlarmChange(20, 990, "k", AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, None, message))
    (event,), (change,) = table(path, "events"), table(path, "alarms")
    recorded = event["text"], json.loads(str(event["detail"]))["reason"], change["text"]
    assert recorded == tuple(getattr(text, language) for text in (held, alarm, message))


def test_alarms_are_recorded_only_from_the_alarm_list(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    change = AlarmChange(
        70,
        990,
        "magazine_empty",
        AlarmState.ACKNOWLEDGED,
        AlarmState.SHELVED,
        "Li",
        Text.plain("magazine empty"),
        60_070,
    )
    with history(path) as writer:
        writer.write(AlarmEvent(70, 990, True, Text.plain("magazine empty")))
        writer.write(change)
    (row,) = table(path, "alarms")
    assert HistoryReader(path).newest_alarm() == row["id"]
    assert list(row.values())[2:] == [
        70,
        1,
        990,
        "magazine_empty",
        "acknowledged",
        "shelved",
        "Li",
        "magazine empty",
        60_070,
    ]
    assert table(path, "events") == []


def test_an_operator_action_with_any_text_is_in_the_audit(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as writer:
        writer.audit("127.0.0.1:4711", "王", "trays_target", "5", "refused: exception 03", 80)
        writer.audit("127.0.0.1:4711", "\ud800", "x" * 5_000, "\0", "done", 90)
    first, second = table(path, "audit")
    assert list(first.values())[2:] == [80, 1, "127.0.0.1:4711", "王", "trays_target", "5", "refused: exception 03"]
    assert (second["who"], second["what"], second["value"]) == ("?", "x" * 1_000, "\0")


def test_ids_increase_over_all_tables_and_runs(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    for _ in range(2):
        with history(path) as writer:
            writer.write(TrayEvent(10, 1))
            writer.audit("p", "w", "a", "1", "done", 20)
    rows = sorted((row["id"], name, row["run"]) for name in TABLES for row in table(path, name))
    assert rows == [
        (1, "runs", 1),
        (2, "events", 1),
        (3, "audit", 1),
        (4, "runs", 4),
        (5, "events", 4),
        (6, "audit", 4),
    ]
    assert [(row["program"], row["version"]) for row in table(path, "runs")] == [("transplanter", "0.1.0")] * 2


# time of writing


class Disk:
    """Simulated disk used by all histories; it can fail or block, and signals each attempted and completed write."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.attempts = threading.Semaphore(0)
        self.done = threading.Semaphore(0)
        self.free = threading.Event()
        self.free.set()
        self.full = False
        append = HistoryFile.append

        def guarded(file: HistoryFile, rows: Sequence[HistoryRow]) -> None:
            self.attempts.release()
            assert self.free.wait(PATIENCE_S)
            if self.full:
                raise sqlite3.OperationalError("database or disk is full")
            append(file, rows)
            self.done.release()

        monkeypatch.setattr(HistoryFile, "append", guarded)


def wait(semaphore: threading.Semaphore) -> None:
    assert semaphore.acquire(timeout=PATIENCE_S), "the writer did not write within the timeout"


def test_operator_actions_and_alarms_are_written_immediately_with_all_pending_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history_module, "COMMIT_S", 10 * PATIENCE_S)
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    with history(path) as writer:
        wait(disk.done)  # row of the run
        writer.write(TrayEvent(10, 1))
        writer.audit("p", "w", "a", "1", "done", 20)
        wait(disk.done)
        assert len(table(path, "events")) == len(table(path, "audit")) == 1
        writer.write(AlarmChange(30, 900, "k", AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, None, Text.plain("t")))
        wait(disk.done)
        assert len(table(path, "alarms")) == 1


def test_other_rows_are_written_after_a_short_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    with history(path) as writer:
        wait(disk.done)  # row of the run
        writer.write(TrayEvent(10, 1))
        wait(disk.done)
        assert len(table(path, "events")) == 1
    assert history_module.COMMIT_S <= 0.5


def test_pending_rows_are_written_on_close(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as writer:
        for n in range(2_500):
            writer.write(TrayEvent(n, n))
    assert [row["number"] for row in table(path, "events")] == list(range(2_500))
    writer.close()
    writer.write(TrayEvent(1, 1))
    assert writer.dropped == 1


# disk failures


def test_a_blocked_disk_delays_no_caller_and_the_loss_is_recorded_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    disk.free.clear()
    with history(path, max_pending=1_000) as writer:
        wait(disk.attempts)
        for n in range(3_000):
            writer.write(TrayEvent(n, n))
        lost = writer.dropped
        assert lost == 2_001, "the row of the run is also queued"
        disk.free.set()
    rows = table(path, "events")
    assert [row["number"] for row in rows[:-1]] == list(range(3_000 - lost))
    assert [(row["kind"], row["number"], json.loads(str(row["detail"]))) for row in rows[-1:]] == [
        ("history", lost, {"lost": lost, "why": "the disk is too slow"})
    ]


def test_a_full_disk_is_logged_once_and_pending_rows_are_written_when_space_is_available(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    with history(path, max_pending=2, language="zh") as writer:
        wait(disk.done)  # row of the run
        writer.audit("p", "w", "before", "1", "done", 0)
        wait(disk.done)
        disk.full = True
        disk.attempts = threading.Semaphore(0)
        writer.audit("p", "w", "first", "1", "done", 1)
        wait(disk.attempts)
        writer.audit("p", "w", "second", "1", "done", 2)
        writer.audit("p", "w", "lost", "1", "done", 3)
        for _ in ("lost", "automatic retry"):
            wait(disk.attempts)
        assert str(writer.error) == "database or disk is full"
        disk.full = False
    assert writer.error is None
    assert [row["what"] for row in table(path, "audit")] == ["before", "first", "second"]
    (event,) = table(path, "events")
    assert (event["kind"], event["number"], writer.dropped) == ("history", 1, 1)
    assert event["text"] == "丢失 1 条记录：历史文件无法写入（database or disk is full）"
    assert len([record for record in caplog.records if record.levelno >= logging.ERROR]) == 1


FULL_DISK = """
import resource, sqlite3, sys
from pathlib import Path
from controller.history.file import HistoryFile, HistoryRow
file = HistoryFile(Path(sys.argv[1]), 4_000_000)
file.append([HistoryRow("runs", 0, 0, ("p", "v"))])
row = HistoryRow("audit", 0, 0, ("p", "w", "a", "1", "x" * 1000))
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
committed = failed = 0
for _ in range(200):
    try:
        file.append([row])
        committed += 1
    except sqlite3.Error:
        failed += 1
resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
file.append([row] * 3)
print(committed, failed)
file.close()
"""


def test_a_file_that_cannot_grow_rejects_complete_batches_and_recovers_with_free_space(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path)], check=True, capture_output=True, text=True, timeout=PATIENCE_S
    )
    committed, failed = map(int, done.stdout.split())
    assert committed > 0
    assert failed > 100
    assert [row["id"] for row in table(path, "audit")] == list(range(2, 2 + committed + 3))
    assert is_sound(path)


KILLED = """
import sys
from itertools import count
from pathlib import Path
from controller.history.writer import HistoryWriter
from controller.events.kinds import TrayEvent
writer = HistoryWriter(Path(sys.argv[1]), wall_ms=lambda: int(sys.argv[2]), program="p", version="v",
               limit_bytes=100_000_000, max_pending=10_000_000)
for n in count():
    writer.write(TrayEvent(n, n))
    writer.audit("p", "w", "a", str(n), "done" * 50, n)
    if n % 100 == 0:
        print(n, flush=True)
"""


def test_kill_9_while_writing_loses_no_committed_row(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    command = [sys.executable, "-c", KILLED, str(path), str(WALL_MS)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        try:
            for line in writer.stdout:
                assert int(line) < 1_000_000, "nothing is committed"
                if len(HistoryReader(path).audit(1_000)) == 1_000:
                    break
            seen = {name: [(row["id"], row["at_ms"]) for row in table(path, name)] for name in ("events", "audit")}
        finally:
            writer.send_signal(signal.SIGKILL)
    assert writer.returncode == -signal.SIGKILL
    assert len(seen["audit"]) >= 1_000
    with history(path):
        pass
    assert is_sound(path)
    assert list(tmp_path.glob("*.damaged*")) == []
    for name, rows in seen.items():
        stored = [(row["id"], row["at_ms"]) for row in table(path, name)]
        assert stored[: len(rows)] == rows
        assert [at_ms for _, at_ms in stored] == list(range(len(stored))), "no gap, no duplicate"
    assert len(table(path, "runs")) == 2


def test_commits_are_synchronized_to_disk(tmp_path: Path) -> None:
    """The database is set to synchronize every commit to disk; a power loss itself cannot be tested."""
    file = HistoryFile(tmp_path / "history.sqlite", 4_000_000)
    full = 2
    assert file._db.execute("PRAGMA synchronous").fetchone() == (full,)
    assert file._db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    file.close()


# reading


def test_reading_while_the_history_is_written(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as writer:
        reader = HistoryReader(path)
        longest = 0
        for n in range(300):
            writer.audit("p", "w", "a", str(n), "done", n)
            values = [row["value"] for row in reader.audit(1_000)]
            assert values == [str(m) for m in reversed(range(len(values)))], "no gap since the oldest row"
            assert len(values) >= longest
            longest = len(values)
        while not longest:  # on a busy computer, the writer may not have written before
            longest = len(reader.audit(1_000))
    assert 0 < longest <= 300
    assert len(reader.audit(1_000)) == 300


def test_a_panel_reads_pages_backwards_from_the_newest_row(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as writer:
        for event, _ in EVENTS:
            writer.write(event)
        writer.write(CycleEvent(9_000, "left", 1, 8_000, 0, 0))
    reader = HistoryReader(path)
    newest = reader.events(2)
    older = reader.events(100, before_id=int(str(newest[-1]["id"])))
    assert [row["at_ms"] for row in newest + older] == [60, 50, 40, 30, 20, 10, 10]
    assert newest[1]["detail"] == {"question": "tray", "active": False}
    assert [reader.events(0), reader.events(-1), reader.events(5, before_id=-(2**70))] == [[], [], []]
    assert len(reader.events(2**70, before_id=2**70)) == len(EVENTS)
    (cycle,) = reader.cycles()
    assert "edges" not in cycle
    assert [row["program"] for row in reader.runs()] == ["transplanter"]
    assert reader.alarms() == []


def test_a_missing_history_is_empty_until_the_file_exists(tmp_path: Path) -> None:
    path = tmp_path / "later" / "a b?#.sqlite"
    reader = HistoryReader(path)
    assert (reader.present, reader.events()) == (False, [])
    assert reader.problem == f"{path}: no such file; specify a history written by a controller"
    assert reader.alarms() == reader.cycles() == reader.audit() == []
    assert reader.last_cycle("left") is None
    assert reader.newest_alarm() is None
    with history(path) as writer:
        writer.write(TrayEvent(10, 1))
        assert reader.newest_alarm() == 0
    assert (reader.present, len(reader.events())) == (True, 1)
    path.write_bytes(b"this is not a database")
    assert (reader.present, reader.events()) == (False, [])


def test_a_history_in_a_read_only_folder_can_be_read() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with history(folder / "history.sqlite") as writer:
            writer.write(TrayEvent(10, 1))
        (folder / "history.sqlite").chmod(0o444)
        folder.chmod(0o555)
        user = os.geteuid()
        if user == 0:
            os.seteuid(65_534)  # user nobody, because file permissions do not apply to root
        try:
            assert [row["number"] for row in HistoryReader(folder / "history.sqlite").events()] == [1]
        finally:
            os.seteuid(user)
            folder.chmod(0o755)
