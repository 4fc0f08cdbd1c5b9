"""Check of a SQLite database before it is opened for writing."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

PARTS: Final = ("", "-wal", "-shm", "-journal")
"""Endings of the files of one database."""

_LOGGED: Final = b"\2\2"
"""Formats of a database with a write-ahead log; without one, they are 1."""

Columns = Mapping[str, str]
"""Type of each column of a table, by its name; the first column is the primary key."""


@contextmanager
def read_only(path: Path, busy_s: float) -> Iterator[sqlite3.Connection]:
    """Open an existing database for reading; its files are not changed.

    Args:
        path: Path of the file.
        busy_s: Longest wait for a lock, s.

    Raises:
        sqlite3.OperationalError: The file is in use, or a transaction was cut short.
        sqlite3.DatabaseError: The file is not a database, or is damaged.
        OSError: The file cannot be read.
    """
    formats = _formats(path)
    # Even a reader creates a missing write-ahead log. A database that is in use has one, or locks its file, which
    # "immutable" ignores.
    unused = formats == _LOGGED and not path.with_name(path.name + "-wal").exists()
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if unused else ''}"
    with closing(sqlite3.connect(uri, uri=True, timeout=busy_s, isolation_level=None)) as db:
        try:
            db.execute("SELECT count(*) FROM sqlite_master")
        except UnicodeDecodeError as error:  # the message of SQLite quotes the damaged text
            raise sqlite3.DatabaseError("malformed database schema") from error
        if max(formats, default=1) > max(_LOGGED):
            raise sqlite3.DatabaseError("unknown file format")
        yield db


def _formats(path: Path) -> bytes:
    """Return the formats for writing and for reading in the header of a database; empty for an empty file."""
    with path.open("rb") as file:
        return file.read(20)[18:]


def check_tables(db: sqlite3.Connection, tables: Mapping[str, Columns]) -> None:
    """Check that a database contains these tables, which a migration that was cut short may have left incomplete.

    Raises:
        sqlite3.DatabaseError: A table is missing or has other columns.
    """
    for table, columns in tables.items():
        found = [
            (name, kind, key)
            for _, name, kind, _, _, key in db.execute("SELECT * FROM pragma_table_info(?)", (table,)).fetchall()
        ]
        if not found:
            raise sqlite3.DatabaseError(f"table {table} is missing")
        if found != [(name, kind, int(n == 0)) for n, (name, kind) in enumerate(columns.items())]:
            raise sqlite3.DatabaseError(f"table {table} has other columns")


def is_damage(error: sqlite3.Error) -> bool:
    """Return True if an error is one of the content of a file, not one of its place, its rights or its users."""
    if not isinstance(error, sqlite3.OperationalError):
        return True
    # an error without a code is one of Python, about a text that is no UTF-8
    return getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) == sqlite3.SQLITE_ERROR


def is_empty(db: sqlite3.Connection) -> bool:
    """Return True if a database contains no tables.

    Raises:
        sqlite3.DatabaseError: The file is not a database, or is damaged.
    """
    return number(db, "SELECT count(*) FROM sqlite_master") == 0


def number(db: sqlite3.Connection, query: str) -> int:
    """Return the single integer result of a query."""
    return int(db.execute(query).fetchone()[0])
