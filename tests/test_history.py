"""The history: what is written, what a crash, a full disk or a reader may do to it, and the edges of a real cycle."""

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
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import cache
from itertools import count
from pathlib import Path
from typing import NamedTuple

import pytest
from twin_rig import Recorder, at_work, go_on, to_complete, until_picking, until_step

from controller.core.scan import Plc
from controller.hmi import history as history_module
from controller.hmi.alarm_list import AlarmChange, AlarmList, AlarmState
from controller.hmi.cycle_edges import MOST_EDGES, CycleEdges, Edge
from controller.hmi.history import History
from controller.hmi.history_file import HeldError, HistoryFile, Row
from controller.hmi.history_query import HistoryReader, opened
from controller.hmi.history_schema import TABLES, HistoryError
from controller.hmi.production import (
    AlarmEvent,
    CycleEvent,
    Event,
    ModeEvent,
    ProductionLog,
    QuestionEvent,
    RefusalEvent,
    StateEvent,
    TrayEvent,
)
from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.tags import SIDES, Side
from plant_sim.bench.twin import Twin

MB = 1_000_000
WALL_MS = 1_790_000_000_000
PATIENCE_S = 20.0
"""Longest wait for a thread or a process; no test waits for it unless something is broken."""


@contextmanager
def history(path: Path, **options: object) -> Iterator[History]:
    """Keep a history for as long as the context lasts; each row is a millisecond of the wall clock later."""
    wall = count(WALL_MS)
    kept = History(path, wall_ms=lambda: next(wall), program="transplanter", version="0.1.0", **options)  # type: ignore[arg-type]
    try:
        yield kept
    finally:
        kept.close()


def table(path: Path, name: str) -> list[dict[str, object]]:
    """Return a whole table, oldest first."""
    with opened(path) as db:
        return [dict(zip(TABLES[name], row, strict=True)) for row in db.execute(f"SELECT * FROM {name} ORDER BY id")]  # noqa: S608


def is_sound(path: Path) -> bool:
    with closing(sqlite3.connect(path)) as db:
        return db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]


def audit_row(number: int, text: str = "") -> Row:
    return Row("audit", WALL_MS + number, number, ("127.0.0.1:1", "Li", "clamp", str(number), text or "done"))


def run_row() -> Row:
    return Row("runs", WALL_MS, 0, ("transplanter", "0.1.0"))


def size_bytes(path: Path) -> int:
    """Return what a history takes, its write-ahead log and the index of the log included."""
    parts = (path.with_name(path.name + suffix) for suffix in ("", "-wal", "-shm"))
    return sum(part.stat().st_size for part in parts if part.exists())


# what is written

EVENTS: list[tuple[Event, tuple[object, ...]]] = [
    (StateEvent(10, 11, "Held", "alarm"), ("state", 11, "Held", {"reason": "alarm"})),
    (StateEvent(10, 6, "运行"), ("state", 6, "运行", {})),
    (ModeEvent(20, 3, "manual"), ("mode", 3, "manual", {})),
    (RefusalEvent(30, "start", 2, "cannot start"), ("refusal", 2, "cannot start", {"command": "start"})),
    (QuestionEvent(40, "tray", True, "Which?"), ("question", 1, "Which?", {"question": "tray", "active": True})),
    (QuestionEvent(50, "tray", False, "Which?"), ("question", 0, "Which?", {"question": "tray", "active": False})),
    (TrayEvent(60, 7), ("tray", 7, "", {})),
]


def test_every_event_of_production_is_a_row(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as kept:
        for event, _ in EVENTS:
            kept.tell(event)
    rows = table(path, "events")
    found = [(row["kind"], row["number"], row["text"], json.loads(str(row["detail"]))) for row in rows]
    assert found == [expected for _, expected in EVENTS]
    assert [row["at_ms"] for row in rows] == [event.at_ms for event, _ in EVENTS]
    assert [row["utc_ms"] for row in rows] == [WALL_MS + 1 + n for n in range(len(rows))], "as it came, not as written"


def test_a_cycle_is_a_row_with_its_edges(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    event = CycleEvent(9_000, "right", 2, 8_000, 1_500, 3, "tray")
    edges: dict[CycleEvent, list[Edge]] = {event: [(0, "Y7", 0), (0, "Y7", 1), (8_000, "Y13", 0)]}
    with history(path, edges_of=edges.__getitem__) as kept:
        kept.tell(event)
    (row,) = table(path, "cycles")
    assert [row[name] for name in list(TABLES["cycles"])[2:]] == [
        9_000, 1, "right", 2, 8_000, 1_500, 3, "tray", '[[0,"Y7",0],[0,"Y7",1],[8000,"Y13",0]]'
    ]  # fmt: skip
    last = HistoryReader(path).last_cycle("right")
    assert last is not None
    assert last["edges"] == [[0, "Y7", 0], [0, "Y7", 1], [8_000, "Y13", 0]]
    assert HistoryReader(path).last_cycle("left") is None


def test_alarms_come_from_the_alarm_list_alone(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    change = AlarmChange(
        70, 990, "magazine_empty", AlarmState.ACKNOWLEDGED, AlarmState.SHELVED, "Li", "magazine empty", 60_070
    )
    with history(path) as kept:
        kept.tell(AlarmEvent(70, 990, True, "magazine empty"))
        kept.tell(change)
    (row,) = table(path, "alarms")
    assert list(row.values())[2:] == [
        70, 1, 990, "magazine_empty", "acknowledged", "shelved", "Li", "magazine empty", 60_070
    ]  # fmt: skip
    assert table(path, "events") == []


def test_an_order_is_in_the_audit_whatever_its_text(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as kept:
        kept.audit("127.0.0.1:4711", "王", "trays_target", "5", "refused: exception 03", 80)
        kept.audit("127.0.0.1:4711", "\ud800", "x" * 5_000, "\0", "done", 90)
    first, second = table(path, "audit")
    assert list(first.values())[2:] == [80, 1, "127.0.0.1:4711", "王", "trays_target", "5", "refused: exception 03"]
    assert (second["who"], second["what"], second["value"]) == ("?", "x" * 1_000, "\0")


def test_ids_are_one_order_over_all_tables_and_runs(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    for _ in range(2):
        with history(path) as kept:
            kept.tell(TrayEvent(10, 1))
            kept.audit("p", "w", "a", "1", "done", 20)
    rows = sorted((row["id"], name, row["run"]) for name in TABLES for row in table(path, name))
    assert rows == [
        (1, "runs", 1), (2, "events", 1), (3, "audit", 1), (4, "runs", 4), (5, "events", 4), (6, "audit", 4)
    ]  # fmt: skip
    assert [(row["program"], row["version"]) for row in table(path, "runs")] == [("transplanter", "0.1.0")] * 2


# when it is written


class Disk:
    """Stands between histories and their files: can refuse, can hang, and tells when it was asked."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.asked = threading.Semaphore(0)
        self.done = threading.Semaphore(0)
        self.free = threading.Event()
        self.free.set()
        self.full = False
        append = HistoryFile.append

        def guarded(file: HistoryFile, rows: Sequence[Row]) -> None:
            self.asked.release()
            assert self.free.wait(PATIENCE_S)
            if self.full:
                raise sqlite3.OperationalError("database or disk is full")
            append(file, rows)
            self.done.release()

        monkeypatch.setattr(HistoryFile, "append", guarded)


def wait(semaphore: threading.Semaphore) -> None:
    assert semaphore.acquire(timeout=PATIENCE_S), "the writer did not come"


def test_orders_and_alarms_are_written_at_once_and_the_rest_with_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(history_module, "COMMIT_S", 10 * PATIENCE_S)
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    with history(path) as kept:
        wait(disk.done)  # the run
        kept.tell(TrayEvent(10, 1))
        kept.audit("p", "w", "a", "1", "done", 20)
        wait(disk.done)
        assert len(table(path, "events")) == len(table(path, "audit")) == 1
        kept.tell(AlarmChange(30, 900, "k", AlarmState.NORMAL, AlarmState.UNACKNOWLEDGED, None, "t"))
        wait(disk.done)
        assert len(table(path, "alarms")) == 1


def test_the_rest_is_written_by_itself_soon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    with history(path) as kept:
        wait(disk.done)  # the run
        kept.tell(TrayEvent(10, 1))
        wait(disk.done)
        assert len(table(path, "events")) == 1
    assert history_module.COMMIT_S <= 0.5


def test_what_waits_at_the_end_is_written(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as kept:
        for n in range(2_500):
            kept.tell(TrayEvent(n, n))
    assert [row["number"] for row in table(path, "events")] == list(range(2_500))
    kept.close()
    kept.tell(TrayEvent(1, 1))
    assert kept.dropped == 1


# disks that do not do what they should


def test_a_disk_that_hangs_holds_nobody_and_what_is_lost_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    disk.free.clear()
    with history(path, most_waiting=1_000) as kept:
        wait(disk.asked)
        for n in range(3_000):
            kept.tell(TrayEvent(n, n))
        lost = kept.dropped
        assert lost == 2_001, "the run waits, too"
        disk.free.set()
    rows = table(path, "events")
    assert [row["number"] for row in rows[:-1]] == list(range(3_000 - lost))
    assert [(row["kind"], row["number"], json.loads(str(row["detail"]))) for row in rows[-1:]] == [
        ("history", lost, {"lost": lost, "why": "the disk is too slow"})
    ]


def test_a_full_disk_is_told_of_once_and_what_waits_is_written_when_it_has_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "history.sqlite"
    disk = Disk(monkeypatch)
    with history(path, most_waiting=2, language="zh") as kept:
        wait(disk.done)  # the run
        kept.audit("p", "w", "before", "1", "done", 0)
        wait(disk.done)
        disk.full = True
        disk.asked = threading.Semaphore(0)
        kept.audit("p", "w", "first", "1", "done", 1)
        wait(disk.asked)
        kept.audit("p", "w", "second", "1", "done", 2)
        kept.audit("p", "w", "lost", "1", "done", 3)
        wait(disk.asked)
        wait(disk.asked)  # tried again by itself
        assert str(kept.error) == "database or disk is full"
        disk.full = False
    assert kept.error is None
    assert [row["what"] for row in table(path, "audit")] == ["before", "first", "second"]
    (told,) = table(path, "events")
    assert (told["kind"], told["number"], kept.dropped) == ("history", 1, 1)
    assert told["text"] == "丢失 1 条记录：历史文件无法写入（database or disk is full）"
    assert len([record for record in caplog.records if record.levelno >= logging.ERROR]) == 1


FULL_DISK = """
import resource, sqlite3, sys
from pathlib import Path
from controller.hmi.history_file import HistoryFile, Row
file = HistoryFile(Path(sys.argv[1]), 4_000_000)
file.append([Row("runs", 0, 0, ("p", "v"))])
row = Row("audit", 0, 0, ("p", "w", "a", "1", "x" * 1000))
hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
good = refused = 0
for _ in range(200):
    try:
        file.append([row])
        good += 1
    except sqlite3.Error:
        refused += 1
resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
file.append([row] * 3)
print(good, refused)
file.close()
"""


def test_a_file_that_cannot_grow_refuses_whole_batches_and_works_again_with_room(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    done = subprocess.run(
        [sys.executable, "-c", FULL_DISK, str(path)], check=True, capture_output=True, text=True, timeout=PATIENCE_S
    )
    good, refused = map(int, done.stdout.split())
    assert good > 0
    assert refused > 100
    assert [row["id"] for row in table(path, "audit")] == list(range(2, 2 + good + 3))
    assert is_sound(path)


KILLED = """
import sys
from itertools import count
from pathlib import Path
from controller.hmi.history import History
from controller.hmi.production import TrayEvent
kept = History(Path(sys.argv[1]), wall_ms=lambda: 0, program="p", version="v",
               limit_bytes=100_000_000, most_waiting=10_000_000)
for n in count():
    kept.tell(TrayEvent(n, n))
    kept.audit("p", "w", "a", str(n), "done" * 50, n)
    if n % 100 == 0:
        print(n, flush=True)
"""


def test_kill_9_in_the_midst_of_writing_loses_nothing_that_was_committed(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with subprocess.Popen([sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True) as writer:
        assert writer.stdout is not None
        for line in writer.stdout:
            assert int(line) < 1_000_000, "nothing is committed"
            if len(HistoryReader(path).audit(1_000)) == 1_000:
                break
        seen = {name: [(row["id"], row["at_ms"]) for row in table(path, name)] for name in ("events", "audit")}
        writer.send_signal(signal.SIGKILL)
        assert writer.wait(PATIENCE_S) == -signal.SIGKILL
    assert len(seen["audit"]) >= 1_000
    with history(path):
        pass
    assert is_sound(path)
    assert list(tmp_path.glob("*.damaged*")) == []
    for name, rows in seen.items():
        kept = [(row["id"], row["at_ms"]) for row in table(path, name)]
        assert kept[: len(rows)] == rows
        assert [at_ms for _, at_ms in kept] == list(range(len(kept))), "no gap, nothing twice"
    assert len(table(path, "runs")) == 2


def test_what_is_committed_is_forced_to_the_disk(tmp_path: Path) -> None:
    """The loss of power cannot be had in a test; the setting that promises to survive it can."""
    file = HistoryFile(tmp_path / "history.sqlite", 4 * MB)
    full = 2
    assert file._db.execute("PRAGMA synchronous").fetchone() == (full,)
    assert file._db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    file.close()


# its size


def filled(path: Path, limit_bytes: int, batches: int, *, each: Callable[[int], None] = lambda _: None) -> HistoryFile:
    """Append batches of 20 orders with 1.5 kB each, one event between, and look after every one."""
    file = HistoryFile(path, limit_bytes)
    file.append([run_row()])
    for batch in range(batches):
        rows = [audit_row(20 * batch + n, "x" * 1_500) for n in range(20)]
        file.append([*rows, Row("events", WALL_MS, batch, ("tray", batch, "", "{}"))])
        each(batch)
    return file


def test_the_file_stays_within_its_limit_and_the_oldest_rows_of_all_tables_go_first(tmp_path: Path) -> None:
    path, limit_bytes = tmp_path / "history.sqlite", 4 * MB
    sizes: list[int] = []
    filled(path, limit_bytes, 300, each=lambda _: sizes.append(size_bytes(path))).close()
    assert max(sizes) <= limit_bytes
    assert max(sizes[100:]) - min(sizes[100:]) < limit_bytes / 10, "written three times over, it does not grow"
    assert sizes[-1] > limit_bytes / 2, "nor is it emptied more than need be"
    audit, events = table(path, "audit"), table(path, "events")
    assert audit[-1]["at_ms"] == 300 * 20 - 1
    assert [row["at_ms"] for row in audit] == list(range(6_000 - len(audit), 6_000)), "no gap"
    assert len(audit) > 1_000
    assert abs(int(str(audit[0]["id"])) - int(str(events[0]["id"]))) <= 21, "both begin at the same time"
    assert [row["id"] for row in table(path, "runs")] == [1], "the run of the rows that are left is known"
    assert is_sound(path)


def test_runs_go_with_their_last_row(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    for _ in range(6):
        filled(path, 4 * MB, 40).close()
    runs = {row["id"] for row in table(path, "runs")}
    assert runs == {row["run"] for row in table(path, "audit")}
    assert 2 <= len(runs) < 6


def test_runs_alone_do_not_fill_the_file_either(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    file = HistoryFile(path, 4 * MB)
    for _ in range(300):
        file.append([Row("runs", WALL_MS, 0, ("p" * 2_000, "v")) for _ in range(20)])
        assert size_bytes(path) <= 4 * MB
    file.close()
    assert table(path, "runs")[-1]["id"] == 6_000


def test_a_smaller_limit_makes_the_file_smaller(tmp_path: Path) -> None:
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


def test_a_reader_that_never_ends_cannot_make_it_grow(tmp_path: Path) -> None:
    """Given a transaction that is never ended, the write-ahead log cannot be emptied: rows wait until it is."""
    path, limit_bytes = tmp_path / "history.sqlite", 4 * MB
    file = filled(path, limit_bytes, 100)
    with opened(path) as reader:
        reader.execute("BEGIN")
        reader.execute("SELECT count(*) FROM audit").fetchone()
        with pytest.raises(HeldError, match="end the program that reads the history"):  # noqa: PT012 - the first that is held
            for n in range(300):
                file.append([audit_row(10_000 + n, "x" * 2_000)] * 20)
                assert size_bytes(path) <= limit_bytes
        reader.execute("ROLLBACK")
    file.append([audit_row(99_999)])
    file.close()
    assert table(path, "audit")[-1]["value"] == "99999"


# files that are not what they should be


def garbage(path: Path) -> None:
    path.write_bytes(b"this is no database" * 1_000)


def hole(path: Path) -> None:
    filled(path, 4 * MB, 5).close()
    with path.open("r+b") as file:
        file.seek(4_096)
        file.write(b"\xff" * 40_000)


def cut_short(path: Path) -> None:
    filled(path, 4 * MB, 5).close()
    os.truncate(path, 30_000)


@pytest.mark.parametrize("damage", [garbage, hole, cut_short])
def test_a_damaged_file_is_set_aside_with_one_line(
    damage: Callable[[Path], None], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "history.sqlite"
    for number in (1, 2):
        damage(path)
        damaged = path.read_bytes()
        with history(path) as kept:
            kept.tell(TrayEvent(10, number))
        assert (tmp_path / f"history.sqlite.damaged-{number}").read_bytes() == damaged
        assert [row["number"] for row in table(path, "events")] == [number]
        assert len(caplog.messages) == number
        assert f"moved to {path}.damaged-{number}" in caplog.messages[-1]
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
        (foreign, "is no history; name a file that a controller has written"),
        (newer, "history of schema 2, newer than the 1 of this program; use the program that has written it"),
        (a_folder, "is a folder; name a file"),
        (a_file_above, "name a file that can be written"),
    ],
)
def test_a_file_that_cannot_be_the_history_is_refused_in_one_line_and_left_alone(
    make: Callable[[Path], None], expected: str, tmp_path: Path
) -> None:
    path = tmp_path / "folder" / "history.sqlite"
    path.parent.mkdir()
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(HistoryError) as refused, history(path):
        pass
    assert str(path) in str(refused.value)
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)
    assert before is None or path.read_bytes() == before
    assert list(tmp_path.rglob("*.damaged*")) == []


def test_a_limit_too_small_is_refused(tmp_path: Path) -> None:
    with pytest.raises(HistoryError, match="give at least 4000000"), history(tmp_path / "h", limit_bytes=3_999_999):
        pass


def test_two_controllers_do_not_share_a_history(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with (
        history(path) as kept,
        pytest.raises(HistoryError, match="another controller is writing its history there"),
        history(path),
    ):
        pass
    kept.close()
    with history(path):
        pass
    assert len(table(path, "runs")) == 2


# reading


def test_reading_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as kept:
        reader = HistoryReader(path)
        longest = 0
        for n in range(300):
            kept.audit("p", "w", "a", str(n), "done", n)
            values = [row["value"] for row in reader.audit(1_000)]
            assert values == [str(m) for m in reversed(range(len(values)))], "the oldest without a gap"
            assert len(values) >= longest
            longest = len(values)
    assert 0 < longest <= 300
    assert len(reader.audit(1_000)) == 300


def test_a_panel_turns_pages_from_the_newest_backwards(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    with history(path) as kept:
        for event, _ in EVENTS:
            kept.tell(event)
        kept.tell(CycleEvent(9_000, "left", 1, 8_000, 0, 0))
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


def test_a_history_that_is_not_there_yet_is_empty_until_it_is(tmp_path: Path) -> None:
    path = tmp_path / "later" / "a b?#.sqlite"
    reader = HistoryReader(path)
    assert not reader.present
    assert reader.problem == f"{path}: no such file; name the history of a controller"
    assert reader.events() == reader.alarms() == reader.cycles() == reader.audit() == []
    assert reader.last_cycle("left") is None
    with history(path) as kept:
        kept.tell(TrayEvent(10, 1))
    assert reader.present
    assert len(reader.events()) == 1
    garbage(path)
    assert not reader.present
    assert reader.events() == []


def test_a_history_in_a_folder_that_cannot_be_written_can_be_read() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with history(folder / "history.sqlite") as kept:
            kept.tell(TrayEvent(10, 1))
        folder.chmod(0o555)
        user = os.geteuid()
        if user == 0:
            os.seteuid(65_534)  # nobody: what is forbidden is forbidden to root only as somebody else
        try:
            assert [row["number"] for row in HistoryReader(folder / "history.sqlite").events()] == [1]
        finally:
            os.seteuid(user)
            folder.chmod(0o755)


# the edges of cycles


class Recorded(NamedTuple):
    """A tray worked off, its history, and an independent record of outputs and steps."""

    path: Path
    twin: Twin
    cycles: list[CycleEvent]
    outputs: Recorder
    steps: Recorder


def watched(twin: Twin, path: Path) -> History:
    """Put a history on a twin, as a controller does: the edges in front of the log."""
    edges = CycleEdges(twin.machine)
    wall = count(WALL_MS)
    kept = History(path, wall_ms=lambda: next(wall), program="transplanter", version="0.1.0", edges_of=edges.of)
    first_out = twin.machine.tags.machine.first_out
    log = ProductionLog(twin.machine, kept.tell)
    twin.runtime.observers += [edges, log, AlarmList(twin.machine.alarms, first_out, kept.tell)]
    return kept


@cache
def trial() -> Recorded:
    folder = Path(tempfile.mkdtemp())
    twin = at_work({"trays_target": 1}, trays=1)
    outputs, steps = Recorder.of_outputs(twin), Recorder.of_steps(twin)
    kept = watched(twin, folder / "history.sqlite")
    to_complete(twin)
    kept.close()
    return Recorded(folder / "history.sqlite", twin, twin.cycles(), outputs, steps)


def cycle_of(side: Side, row: int) -> tuple[CycleEvent, list[Edge]]:
    """Return a cycle of the trial and what the history holds of it."""
    run = trial()
    event = next(cycle for cycle in run.cycles if (cycle.side, cycle.row) == (side, row))
    (found,) = [each for each in table(run.path, "cycles") if (each["side"], each["row"]) == (side, row)]
    return event, [(ms, device, level) for ms, device, level in json.loads(str(found["edges"]))]


def split(edges: list[Edge]) -> tuple[list[Edge], list[Edge]]:
    """Return the levels at the begin, and the edges."""
    devices = {device for _, device, _ in edges}
    return edges[: len(devices)], edges[len(devices) :]


EVERY_CYCLE = [(side, row) for side in SIDES for row in (1, 2, 3)]


@pytest.mark.parametrize(("side", "row"), EVERY_CYCLE)
def test_a_cycle_of_the_twin_has_every_edge_of_its_outputs_and_steps_to_the_scan(side: Side, row: int) -> None:
    run = trial()
    event, edges = cycle_of(side, row)
    began_ms = event.at_ms - event.cycle_ms
    _, changes = split(edges)
    address = {point.tag.removeprefix(f"{side}."): point.address for point in run.twin.io_map.outputs}
    outputs = {
        (change.at_ms - began_ms, address[change.name], int(change.on))
        for change in run.outputs.of(f"{side}.", began_ms, event.at_ms)
    }
    titles = {title: str(bit) for title, bit in run.twin.machine.cycles[side].bits.items()}
    steps = {
        (change.at_ms - began_ms, titles[change.name], int(change.on))
        for change in run.steps.of(f"{side} arm: ", began_ms, event.at_ms)
    }
    assert len(outputs) >= 12
    assert {edge for edge in changes if edge[1].startswith("Y")} == outputs
    assert {edge for edge in changes if edge[1].startswith("S")} == steps


@pytest.mark.parametrize(("side", "row"), EVERY_CYCLE)
def test_edges_are_within_their_cycle_in_order_and_alternate_from_the_levels_at_its_begin(side: Side, row: int) -> None:
    event, edges = cycle_of(side, row)
    begin, changes = split(edges)
    levels = {device: level for _, device, level in begin}
    assert len(levels) == len(begin)
    assert {at_ms for at_ms, _, _ in begin} == {0}
    times = [at_ms for at_ms, _, _ in changes]
    assert times == sorted(times)
    assert (times[0], times[-1]) == (0, event.cycle_ms)
    for _, device, level in changes:
        assert levels[device] == 1 - level, "an edge is a change"
        levels[device] = level


def test_the_coils_of_a_cycle_come_in_the_order_of_the_paper() -> None:
    _, edges = cycle_of("left", 3)
    begin, changes = split(edges)
    on = [device for _, device, level in changes if level and device.startswith("Y")]
    # in, close, up, out, spread, down, open, converge
    assert on == ["Y5", "Y16", "Y2", "Y6", "Y12", "Y1", "Y15", "Y11"]
    assert [edge for edge in changes if edge[0] == 0] == [(0, "S20", 0), (0, "S21", 1), (0, "Y5", 1)]
    assert {device for _, device, _ in begin if device[0] in "XY"} == {
        "X1", "X2", "X5", "X6", "X7", "X10", "X16", "X17", "X22", "Y1", "Y2", "Y5", "Y6", "Y11", "Y12", "Y15", "Y16"
    }  # fmt: skip
    cups = [edge for edge in changes if edge[1] == "X22" and edge[2]]
    assert len(cups) >= 6
    at = {(device, level): at_ms for at_ms, device, level in changes}
    assert at["X10", 1] <= at["Y5", 0], "the switch of row 3 ends the way in"


def test_the_history_of_a_trial_holds_its_production() -> None:
    run = trial()
    assert [(row["side"], row["row"], row["cycle_ms"]) for row in table(run.path, "cycles")] == [
        (cycle.side, cycle.row, cycle.cycle_ms) for cycle in run.cycles
    ]
    kinds = [row["kind"] for row in table(run.path, "events")]
    assert kinds.count("tray") == 1
    assert {"state", "question"} <= set(kinds)


def test_a_cycle_broken_off_leaves_no_edges_behind(tmp_path: Path) -> None:
    """Given an emergency stop on the way in, the next cycle's list begins with that cycle."""
    path = tmp_path / "history.sqlite"
    twin = at_work({"trays_target": 1})
    kept = watched(twin, path)
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "slide to feed")
    twin.press("emergency_stop")
    twin.run_for(500)
    twin.command("clear")
    twin.run_for(100)
    go_on(twin)
    to_complete(twin)
    kept.close()
    rows = table(path, "cycles")
    assert [row["row"] for row in rows if row["side"] == "left"] == [2, 3]
    for row in rows:
        edges = json.loads(str(row["edges"]))
        assert edges[0][0] == 0
        assert edges[-1][0] == row["cycle_ms"]
    assert table(path, "alarms")


def test_a_cycle_whose_begin_was_not_seen_has_no_edges(tmp_path: Path) -> None:
    path = tmp_path / "history.sqlite"
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.run_for(100)
    edges = CycleEdges(twin.machine)
    twin.runtime.observers.insert(0, edges)
    twin.run_until(lambda: any(cycle.side == "left" for cycle in twin.cycles()), within_ms=60_000)
    assert edges.of(twin.cycles()[-1]) == ()
    assert not path.exists()


def test_a_trembling_switch_does_not_fill_the_memory() -> None:
    machine = build(load_io_map(DEFAULT_IO_MAP))
    plc, edges = Plc(machine.program), CycleEdges(machine)
    start = machine.cycles["left"]["approach row"].number
    edges(0, plc)
    plc.memory.S[start] = True
    for scan in range(1, 2 * MOST_EDGES):
        plc.memory.X[1] = not plc.memory.X[1]
        edges(10 * scan, plc)
    plc.memory.S[start] = False
    found = edges.of(CycleEvent(90_000, "left", 1, 89_990, 0, 0))
    assert len(found) == MOST_EDGES
    assert edges.of(CycleEvent(90_000, "right", 1, 89_990, 0, 0)) == ()
