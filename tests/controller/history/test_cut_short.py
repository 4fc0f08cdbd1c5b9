"""Histories of this and of earlier versions, written by a program that is ended at any of its writes.

A file is new, or made by the first version with each schema. The next run finds all that was committed, and repeats
what was not: the tables of a new file, or the deletion of old rows.
"""

from __future__ import annotations

import _sqlite3
import ctypes
import sqlite3
import subprocess
import sys
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Final

import pytest

from controller.cli.history import add_arguments, history_text
from controller.common.command_line import Parser
from controller.history.file import HistoryFile, HistoryRow
from controller.history.query import HistoryReader
from controller.history.schema import SCHEMA, TABLES, create_statements
from tests.controller.history.cut_short import ACKNOWLEDGED, BATCHES, ENDS, LATER_MS
from tests.controller.history.history_rig import WALL_MS, history, is_sound, table
from tests.paths import ROOT
from tests.real_time import COMMAND_S
from tests.sampling import first_of, one_in

SCHEMAS: Final = Path(__file__).with_name("schemas")
VERSIONS: Final = range(1, SCHEMA + 1)
EARLIER_IDS: Final = list(range(2, 13))
"""Ids of the rows of the files in `SCHEMAS`, except for that of their run."""
NEW: Final = 0
"""Version of a file that does not exist yet."""
EVERY: Final = 24
"""Distance of the writes that are tested by default; a run has about 115."""


def made_by(version: int, folder: Path) -> Path:
    """Make the history that the first program with this schema has written, and return its path."""
    path = folder / "history.sqlite"
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.executescript((SCHEMAS / f"{version}.sql").read_text(encoding="utf-8"))
    return path


def test_there_is_a_file_of_each_schema() -> None:
    """A change of the tables needs a new schema, and a file that the program before the change has written."""
    assert sorted(path.stem for path in SCHEMAS.iterdir()) == [str(version) for version in VERSIONS]


@pytest.mark.parametrize("version", [*VERSIONS])
def test_a_history_of_an_earlier_version_is_continued_and_read(version: int, tmp_path: Path) -> None:
    path = made_by(version, tmp_path)
    before = {name: table(path, name) for name in TABLES}
    with history(path) as writer:
        writer.audit("p", "w", "a", "1", "done", 0)
    assert list(tmp_path.glob("*.damaged*")) == []
    for name, rows in before.items():
        assert rows
        assert table(path, name)[: len(rows)] == rows
    assert [row["id"] for row in table(path, "audit")] == [12, 14]
    parser = Parser()
    add_arguments(parser)
    for options in (*(("--table", name) for name in TABLES), ("--summary",)):
        assert "2026-09-21" in history_text(parser.parse_args([str(path), *options]), now_ms=WALL_MS)
    reader = HistoryReader(path)
    assert reader.last_cycle("left") is not None
    assert [row["number"] for row in reader.alarms()] == [7, 7]


def test_the_present_schema_has_the_tables_of_its_file(tmp_path: Path) -> None:
    """Tables cannot change without a new schema, by which an earlier program recognises the file."""
    with closing(sqlite3.connect(made_by(SCHEMA, tmp_path))) as db:
        made = {sql for (sql,) in db.execute("SELECT sql FROM sqlite_master")}
    assert made == {sql for sql in create_statements() if sql.startswith("CREATE")}


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(getattr(_sqlite3, "__file__", None)), "sqlite3_vfs_find"),
    reason="this Python contains SQLite without the names of its functions",
)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("version", one_in(2, [NEW, *VERSIONS]))
@pytest.mark.parametrize("every", first_of([EVERY, 1]))
def test_a_program_that_is_ended_at_any_write_loses_no_committed_row(
    every: int, version: int, end: str, tmp_path: Path
) -> None:
    begun = tmp_path / "begun"
    begun.mkdir()
    if version != NEW:
        made_by(version, begun)
    cases = tmp_path / "cases"
    command = [sys.executable, "-m", "tests.controller.history.cut_short", str(cases), str(begun), end, str(every)]
    subprocess.run(command, check=True, timeout=COMMAND_S, cwd=ROOT)
    folders = sorted(cases.iterdir(), key=lambda folder: int(folder.name))
    assert len(folders) > 90 / every
    acknowledged = [recovered(folder, version) for folder in folders]
    assert acknowledged == sorted(acknowledged)
    assert acknowledged[-1] == BATCHES


def recovered(folder: Path, version: int) -> int:
    """Check the history of a program that was ended, and of a run after it; return the acknowledged batches."""
    path, note = folder / "history.sqlite", folder / ACKNOWLEDGED
    acknowledged = int(note.read_text(encoding="ascii")) if note.exists() else 0
    file = HistoryFile(path, 4_000_000, limit_days=36_500)
    file.append([HistoryRow("runs", LATER_MS, 0, ("next", "v"))])
    file.close()
    assert list(folder.glob("*.damaged*")) == []
    assert is_sound(path)
    rows = {name: table(path, name) for name in TABLES}
    batches = Counter(row["at_ms"] for row in rows["audit"] if row["utc_ms"] == LATER_MS)
    assert len(batches) >= acknowledged
    assert batches == dict.fromkeys(range(len(batches)), 20), "complete batches in order"
    assert rows["runs"][-1]["program"] == "next"
    if version != NEW:
        earlier = sorted(
            int(str(row["id"])) for name in TABLES if name != "runs" for row in rows[name] if row["utc_ms"] != LATER_MS
        )
        assert earlier == EARLIER_IDS[len(EARLIER_IDS) - len(earlier) :], "deleted oldest first"
        assert not (batches and earlier), "deleted before the first rows of the run are written"
    return acknowledged
