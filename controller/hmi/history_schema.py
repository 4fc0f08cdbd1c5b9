"""Tables of the history: what each row holds, and how a file is known to be a history."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Final

APPLICATION: Final = 0x54504C54
"""`PRAGMA application_id`: "TPLT", so that nobody takes another program's database for a history."""
SCHEMA: Final = 1
"""`PRAGMA user_version`: goes up with every change of the tables."""

COMMON: Final = ("id", "utc_ms", "at_ms", "run")
"""First columns of every table: ids are given out in one order over all tables, `utc_ms` is the wall clock, `at_ms`
the controller's own time since its start, `run` the id of the run's row in `runs`."""

_OWN: Final = {
    "runs": {"program": "TEXT", "version": "TEXT"},
    "events": {"kind": "TEXT", "number": "INTEGER", "text": "TEXT", "detail": "TEXT"},
    "alarms": {
        "number": "INTEGER",
        "key": "TEXT",
        "before": "TEXT",
        "after": "TEXT",
        "by_whom": "TEXT",
        "text": "TEXT",
        "shelved_until_ms": "INTEGER",
    },
    "cycles": {
        "side": "TEXT",
        "row": "INTEGER",
        "cycle_ms": "INTEGER",
        "waiting_ms": "INTEGER",
        "missed_cups": "INTEGER",
        "gap_cause": "TEXT",
        "edges": "TEXT",
    },
    "audit": {"peer": "TEXT", "who": "TEXT", "what": "TEXT", "value": "TEXT", "result": "TEXT"},
}

TABLES: Final[dict[str, dict[str, str]]] = {
    table: dict.fromkeys(COMMON, "INTEGER") | columns for table, columns in _OWN.items()
}
"""Every table with its columns and their types, in order."""

JSON_COLUMNS: Final = ("detail", "edges")
"""Columns whose text is JSON."""


class HistoryError(ValueError):
    """A history that cannot be had; one line with the remedy."""


def create_statements() -> list[str]:
    """Return the statements that make an empty history."""
    made = []
    for table, columns in TABLES.items():
        own = ", ".join(f'"{name}" {kind}' for name, kind in columns.items() if name != "id")
        made.append(f"CREATE TABLE {table} (id INTEGER PRIMARY KEY, {own})")
    return [*made, f"PRAGMA application_id = {APPLICATION}", f"PRAGMA user_version = {SCHEMA}"]


def is_empty(db: sqlite3.Connection) -> bool:
    """Tell whether a database holds nothing at all, not even tables.

    Raises:
        sqlite3.DatabaseError: It is no database, or damaged.
    """
    return number(db, "SELECT count(*) FROM sqlite_master") == 0


def check_schema(db: sqlite3.Connection, path: Path) -> None:
    """Make sure that a database is a history that this program knows.

    Raises:
        HistoryError: It is not.
        sqlite3.DatabaseError: It is no database, or damaged.
    """
    version = number(db, "PRAGMA user_version")
    if number(db, "PRAGMA application_id") != APPLICATION or version < 1:
        raise HistoryError(f"{path}: is no history; name a file that a controller has written")
    if version > SCHEMA:
        raise HistoryError(
            f"{path}: history of schema {version}, newer than the {SCHEMA} of this program; use the program that has "
            "written it, or name another file"
        )


def number(db: sqlite3.Connection, query: str) -> int:
    """Return the one number that a query gives."""
    return int(db.execute(query).fetchone()[0])
