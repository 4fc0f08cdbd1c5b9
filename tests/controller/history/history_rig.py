"""Test helpers: a history in a temporary file, and its tables."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import count
from pathlib import Path

from controller.history.query import open_history
from controller.history.schema import TABLES
from controller.history.writer import HistoryWriter

WALL_MS = 1_790_000_000_000
"""Wall-clock time at the start of a history, ms."""


@contextmanager
def history(path: Path, **options: object) -> Iterator[HistoryWriter]:
    """Open a history for the duration of the context; its wall clock advances by 1 ms per row."""
    wall = count(WALL_MS)
    writer = HistoryWriter(path, wall_ms=lambda: next(wall), program="transplanter", version="0.1.0", **options)  # type: ignore[arg-type]
    try:
        yield writer
    finally:
        writer.close()


def table(path: Path, name: str) -> list[dict[str, object]]:
    """Return all rows of a table, oldest first."""
    with open_history(path) as db:
        return [dict(zip(TABLES[name], row, strict=True)) for row in db.execute(f"SELECT * FROM {name} ORDER BY id")]  # noqa: S608


def is_sound(path: Path) -> bool:
    """Return True if a file passes the full integrity check."""
    with closing(sqlite3.connect(path)) as db:
        return db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
