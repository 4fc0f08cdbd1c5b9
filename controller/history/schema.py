"""History tables and identification of a history file."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Final

from controller.common.errors import InputError
from controller.common.files.database import check_tables, number

APPLICATION: Final = 0x54504C54
"""`PRAGMA application_id`: "TPLT", which distinguishes a history from databases of other programs."""
SCHEMA: Final = 1
"""`PRAGMA user_version`: incremented whenever the tables change."""

COMMON: Final = ("id", "utc_ms", "at_ms", "run")
"""First columns of every table: `id` increases across all tables, `utc_ms` is the wall-clock time, `at_ms` the time
since the start of the controller, `run` the id of the run in `runs`."""

_SPECIFIC: Final = {
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
    table: dict.fromkeys(COMMON, "INTEGER") | columns for table, columns in _SPECIFIC.items()
}
"""Columns of every table in order, with their types."""

JSON_COLUMNS: Final = ("detail", "edges")
"""Columns that contain JSON text."""


class HistoryError(InputError):
    """Raised for a history that cannot be opened or exported; the message is one line with the remedy."""


class HistoryInUseError(HistoryError):
    """Raised for a history to which another controller writes."""


def create_statements() -> list[str]:
    """Return the SQL statements that create an empty history."""
    statements = []
    for table, columns in TABLES.items():
        definitions = ", ".join(f'"{name}" {kind}' for name, kind in columns.items() if name != "id")
        statements.append(f"CREATE TABLE {table} (id INTEGER PRIMARY KEY, {definitions})")
    return [*statements, f"PRAGMA application_id = {APPLICATION}", f"PRAGMA user_version = {SCHEMA}"]


def check_schema(db: sqlite3.Connection, path: Path) -> None:
    """Check that a database is a history with a supported schema.

    Raises:
        HistoryError: Its schema is newer.
        sqlite3.DatabaseError: The file is not a history, is damaged, or lacks a table.
    """
    version = number(db, "PRAGMA user_version")
    if number(db, "PRAGMA application_id") != APPLICATION or version < 1:
        raise sqlite3.DatabaseError("is not a history")
    if version > SCHEMA:
        raise HistoryError(
            f"{path}: schema {version} is newer than schema {SCHEMA} of this program; use the program version that "
            "wrote the file, or choose another file"
        )
    check_tables(db, TABLES)
