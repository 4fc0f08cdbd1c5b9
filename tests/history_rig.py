"""A history in a file of a test, and its tables as they are."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import count
from pathlib import Path

from controller.hmi.history import History
from controller.hmi.history_query import opened
from controller.hmi.history_schema import TABLES

WALL_MS = 1_790_000_000_000
"""Wall clock at the begin of a history."""


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
    """Tell whether a file passes the full check of its integrity."""
    with closing(sqlite3.connect(path)) as db:
        return db.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
