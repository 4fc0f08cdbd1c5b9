"""File of the trends: the periods of the last hours in a SQLite database, so that a restart of the panel keeps them.

The file is a convenience: while it is locked or cannot be written, the panel records in memory and tries again at the
next write. A file that is damaged or a database of another program is renamed; one of a newer program is not changed.
"""

from __future__ import annotations

import json
import logging
import sqlite3
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, TypeVar

from controller.common.errors import InputError
from controller.common.files.database import PARTS, check_tables, is_damage, is_empty, number, read_only
from controller.common.files.set_aside import set_aside
from controller.hmi.panel.view.trend_periods import Spread, TrendPeriod

APPLICATION: Final = 0x54505452
"""`PRAGMA application_id`: "TPTR", which distinguishes the file from databases of other programs."""
SCHEMA: Final = 0
"""`PRAGMA user_version`: incremented whenever the table changes."""
BUSY_S: Final = 1.0
"""Longest wait for a lock of the database, s."""

_TABLES: Final = {"periods": {"id": "INTEGER", "utc_ms": "INTEGER", "for_ms": "INTEGER", "spreads": "TEXT"}}
_CREATE: Final = f"""
BEGIN;
CREATE TABLE periods (id INTEGER PRIMARY KEY, utc_ms INTEGER, for_ms INTEGER, spreads TEXT);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {SCHEMA};
COMMIT;
"""

_REMEDY: Final = "choose a writable file that no other panel uses"

_log = logging.getLogger(__name__)

Result = TypeVar("Result")


class NewerTrendsError(InputError):
    """Raised for a file of a newer program, which is not changed; the message is one line with the remedy."""


class TrendFile:
    """File with a limited number of periods; used by one thread at a time. No method raises an error of the file.

    The values of a period are stored by the name of their series, so that another list of telemetry tags can be used.
    """

    def __init__(self, path: Path, most_rows: int) -> None:
        """Create an object for a file, which is created by the first write.

        Args:
            path: Path of the file.
            most_rows: Number of periods that are kept; older ones are deleted.
        """
        self._path = path
        self._most_rows = most_rows
        self._db: sqlite3.Connection | None = None
        self._problem = ""

    def check(self) -> None:
        """Check at the start of the panel that the file is not one of a newer program.

        Raises:
            NewerTrendsError: Its schema is newer.
        """
        with suppress(sqlite3.Error, OSError):  # reported when the file is used
            _check_unopened(self._path)

    def load(self, names: Sequence[str], since_ms: int, until_ms: int) -> list[TrendPeriod]:
        """Return the periods of an interval in chronological order; none if the file cannot be read.

        Args:
            names: Names of the series, in the order of the values of a row.
            since_ms: Start of the interval, ms since 1970 UTC, inclusive.
            until_ms: End of the interval, ms since 1970 UTC, exclusive.
        """

        def read(db: sqlite3.Connection) -> list[TrendPeriod]:
            query = "SELECT utc_ms, for_ms, spreads FROM periods WHERE utc_ms >= ? AND utc_ms < ? ORDER BY utc_ms"
            return [_row(names, *columns) for columns in db.execute(query, (since_ms, until_ms))]

        return (self._attempt(read) if self._path.exists() else None) or []

    def append(self, names: Sequence[str], rows: Iterable[TrendPeriod]) -> bool:
        """Add periods and delete the oldest ones; return whether they have been written."""

        def write(db: sqlite3.Connection) -> bool:
            lines = ((row.utc_ms, row.for_ms, _spreads(names, row)) for row in rows)
            with db:
                db.executemany("INSERT INTO periods (utc_ms, for_ms, spreads) VALUES (?, ?, ?)", lines)
                db.execute("DELETE FROM periods WHERE id <= (SELECT max(id) FROM periods) - ?", (self._most_rows,))
            return True

        return self._attempt(write) is True

    def close(self) -> None:
        """Close the file."""
        if self._db is not None:
            self._db.close()
            self._db = None

    def _attempt(self, use: Callable[[sqlite3.Connection], Result]) -> Result | None:
        """Use the database; on an error, close it, report the first such error, and return None."""
        try:
            self._db = self._db or _open(self._path)
            result = use(self._db)
        except NewerTrendsError as error:
            self._fail(str(error).removeprefix(f"{self._path}: "))
        except (sqlite3.Error, ValueError, TypeError, RecursionError) as error:
            self.close()
            damaged = not isinstance(error, sqlite3.Error) or is_damage(error)
            self._fail(f"{error}; {self._set_aside() if damaged else _REMEDY}")
        except OSError as error:
            self._fail(f"{error}; {_REMEDY}")
        else:
            self._problem = ""
            return result
        return None

    def _fail(self, problem: str) -> None:
        self.close()
        if problem != self._problem:
            _log.warning("%s: %s; the trends are kept in memory until the file can be written", self._path, problem)
        self._problem = problem

    def _set_aside(self) -> str:
        """Rename a file that cannot be used; return the result as text."""
        try:
            aside, *_ = set_aside(self._path, PARTS)
        except OSError as error:
            return f"cannot be renamed ({error.strerror}), delete it"
        return f"renamed to {aside.name}"


def _open(path: Path) -> sqlite3.Connection:
    """Open or create the database, for this process alone.

    Raises:
        NewerTrendsError: The file is one of a newer program.
        sqlite3.OperationalError: The file cannot be opened or is in use.
        sqlite3.DatabaseError: The file is damaged or a database of another program.
        OSError: The folder cannot be created.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    _check_unopened(path)
    db = sqlite3.connect(path, timeout=BUSY_S, check_same_thread=False)
    try:
        db.execute("PRAGMA locking_mode = EXCLUSIVE")
        db.execute("PRAGMA synchronous = NORMAL")
        if is_empty(db):
            db.executescript(_CREATE)
    except BaseException:
        db.close()
        raise
    return db


def _check_unopened(path: Path) -> None:
    """Check a file, if there is one, without changing it; see `_open` for the errors."""
    if not path.exists():
        return
    with read_only(path, BUSY_S) as db:
        if is_empty(db):
            return
        if number(db, "PRAGMA application_id") != APPLICATION:
            raise sqlite3.DatabaseError("is a database of another program")
        version = number(db, "PRAGMA user_version")
        if version > SCHEMA:
            raise NewerTrendsError(
                f"{path}: schema {version} is newer than schema {SCHEMA} of this program; use the program version that "
                "wrote the file, or choose another file"
            )
        check_tables(db, _TABLES)


def _spreads(names: Sequence[str], row: TrendPeriod) -> str:
    known = {name: spread for name, spread in zip(names, row.values, strict=True) if spread is not None}
    return json.dumps(known, separators=(",", ":"))


def _row(names: Sequence[str], utc_ms: int, for_ms: int, spreads: str) -> TrendPeriod:
    """Return a stored period.

    Raises:
        ValueError: The values are not those of a period.
        TypeError: As for ValueError.
    """
    found = json.loads(spreads)
    if not isinstance(found, Mapping):
        raise TypeError(f"period {utc_ms} has no values by name")
    values = (Spread(*map(float, found[name])) if name in found else None for name in names)
    return TrendPeriod(int(utc_ms), int(for_ms), tuple(values))
