"""Reading the history while a controller writes it, or afterwards: rows for a panel, pages for an export.

Readers never hold a transaction for longer than one answer or one page, so the writer can always empty its
write-ahead log.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.hmi.history_schema import JSON_COLUMNS, TABLES, HistoryError, check_schema
from controller.program.tags import Side

Record = dict[str, object]

BUSY_S: Final = 1.0
MOST_ROWS: Final = 1_000
"""Most rows of one answer to a panel."""
PAGE_ROWS: Final = 1_000
_LARGEST: Final = 2**63 - 1
"""Largest number of SQLite."""


@dataclass(frozen=True, slots=True)
class Window:
    """Which rows of a table: those of a time, and of them the newest.

    Attributes:
        since_ms: Wall clock from then on, ms; None = from the first row.
        until_ms: Wall clock before then, ms; None = to the newest row.
        last: Most rows; None = all of them.
    """

    since_ms: int | None = None
    until_ms: int | None = None
    last: int | None = None

    def holds(self, utc_ms: int) -> bool:
        """Tell whether an instant of the wall clock is within the time."""
        return (self.since_ms is None or utc_ms >= self.since_ms) and (self.until_ms is None or utc_ms < self.until_ms)


@contextmanager
def opened(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a history for reading.

    Raises:
        HistoryError: It is not there, no history, a newer one, or damaged.
    """
    db = None
    try:
        if not path.is_file():
            raise HistoryError(f"{path}: no such file; name the history of a controller")
        db = _connected(path)
        yield db
    except (sqlite3.Error, OSError) as error:
        raise HistoryError(f"{path}: {error}; name a file that a controller has written") from error
    finally:
        if db is not None:
            db.close()


def _connected(path: Path) -> sqlite3.Connection:
    uri = f"{path.absolute().as_uri()}?mode=ro"
    try:
        return _checked(uri, path)
    except sqlite3.OperationalError:
        if path.with_name(path.name + "-wal").exists():
            raise
        return _checked(f"{uri}&immutable=1", path)  # in a folder that cannot be written, with no writer


def _checked(uri: str, path: Path) -> sqlite3.Connection:
    db = sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None)
    try:
        check_schema(db, path)
    except BaseException:
        db.close()
        raise
    return db


def pages(db: sqlite3.Connection, table: str, window: Window) -> Iterator[list[Record]]:
    """Yield the rows of a table in the order in which they were written, some at a time; JSON stays text.

    Rows that come meanwhile do not belong to them.
    """
    within = "utc_ms >= ifnull(:since, utc_ms) AND utc_ms < ifnull(:until, utc_ms + 1)"
    values = {"since": window.since_ms, "until": window.until_ms, "last": -1 if window.last is None else window.last}
    newest = f"SELECT id FROM {table} WHERE {within} ORDER BY id DESC LIMIT :last"  # noqa: S608 - names of our own
    first, final = db.execute(f"SELECT min(id), max(id) FROM ({newest})", values).fetchone()  # noqa: S608
    while first is not None and first <= final:
        query = f"SELECT * FROM {table} WHERE id BETWEEN :first AND :final AND {within} ORDER BY id LIMIT {PAGE_ROWS}"  # noqa: S608
        page = _records(db, table, query, values | {"first": first, "final": final})
        if not page:
            return
        yield page
        first = whole(page[-1], "id") + 1


def whole(record: Record, name: str) -> int:
    """Return the whole number in a column.

    Raises:
        sqlite3.DataError: Something else is there.
    """
    value = record[name]
    if not isinstance(value, int):
        raise sqlite3.DataError(f"{name} {value!r} is no whole number")
    return value


def _records(db: sqlite3.Connection, table: str, query: str, values: dict[str, int | None]) -> list[Record]:
    return [dict(zip(TABLES[table], row, strict=True)) for row in db.execute(query, values).fetchall()]


class HistoryReader:
    """The newest rows for a panel, newest first; from any thread.

    The file need not be there yet: then there are no rows. It is opened for every answer, so one that appears or is
    replaced is found.
    """

    def __init__(self, path: Path) -> None:
        """Read the history of this file."""
        self._path = path

    @property
    def problem(self) -> str | None:
        """Why the history cannot be read; None if it can."""
        try:
            with opened(self._path):
                return None
        except HistoryError as error:
            return str(error)

    @property
    def present(self) -> bool:
        """Whether there is a history that can be read."""
        return self.problem is None

    def runs(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest runs of the controller, newest first; for the arguments see `events`."""
        return self._newest("runs", last, before_id)

    def events(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest events, newest first; `detail` is an object.

        Args:
            last: Most rows, up to `MOST_ROWS`.
            before_id: Only rows older than the one of this id, to turn the page; None = the newest.
        """
        return self._newest("events", last, before_id)

    def alarms(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest changes of alarms, newest first; for the arguments see `events`."""
        return self._newest("alarms", last, before_id)

    def cycles(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest cycles without their edges, newest first; for the arguments see `events`."""
        return [{name: row[name] for name in row if name != "edges"} for row in self._newest("cycles", last, before_id)]

    def audit(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest orders of operators, newest first; for the arguments see `events`."""
        return self._newest("audit", last, before_id)

    def last_cycle(self, side: Side) -> Record | None:
        """Return the last cycle of an arm, `edges` as a list of [ms, device, level]; None if there is none."""
        rows = self._read("cycles", "side = :side ORDER BY id DESC LIMIT 1", {"side": side})
        return rows[0] if rows else None

    def _newest(self, table: str, last: int, before_id: int | None) -> list[Record]:
        before = _LARGEST if before_id is None else max(0, min(before_id, _LARGEST))
        where = "id < :before ORDER BY id DESC LIMIT :last"
        return self._read(table, where, {"before": before, "last": max(0, min(last, MOST_ROWS))})

    def _read(self, table: str, where: str, values: dict[str, int | str]) -> list[Record]:
        with suppress(HistoryError), opened(self._path) as db:
            found = db.execute(f"SELECT * FROM {table} WHERE {where}", values).fetchall()  # noqa: S608 - our own names
            return [unfolded(dict(zip(TABLES[table], row, strict=True))) for row in found]
        return []


def unfolded(record: Record) -> Record:
    """Return a row with its JSON as lists and objects."""
    return {
        name: json.loads(str(value)) if name in JSON_COLUMNS and value is not None else value
        for name, value in record.items()
    }
