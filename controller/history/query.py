"""History queries: rows for a panel, pages for an export. Queries also work while a controller is writing the history.

A reader holds a transaction only for one answer or one page, so that the writer can always checkpoint its write-ahead
log.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Final, NamedTuple

from controller.history.schema import JSON_COLUMNS, TABLES, HistoryError, check_schema
from controller.program.tags import Side

Record = dict[str, object]

BUSY_S: Final = 1.0
"""Longest wait for a lock of the database, s."""
MAX_ROWS: Final = 1_000
"""Maximum number of rows in one answer to a panel."""
PAGE_ROWS: Final = 1_000
"""Number of rows per page of an export."""
MAX_CYCLES: Final = 20_000
"""Maximum number of cycles in one answer with the times of cycles."""
_LARGEST: Final = 2**63 - 1
"""Largest integer in SQLite."""
ALARM: Final = "alarm"
CYCLE: Final = "cycle"
_RECORD: Final = (
    "id",
    "utc_ms",
    "kind",
    "number",
    "text",
    "detail",
    "before",
    "after",
    "by_whom",
    "side",
    "cycle_ms",
    "waiting_ms",
    "missed_cups",
)
"""Columns of a record of events, alarms or cycles; `number` of a cycle is its row."""
_OF_TABLES: Final[dict[str, dict[str, str]]] = {
    "events": {},
    "alarms": {"kind": f"'{ALARM}'"},
    "cycles": {"kind": f"'{CYCLE}'", "number": "row", "text": "''"},
}
"""Values of a record that are not in a column of this name, by table; other columns that a table lacks are NULL."""


@dataclass(frozen=True, slots=True)
class RowSelection:
    """Selection of rows by time and maximum number.

    Attributes:
        since_ms: Start of the wall-clock interval, ms, inclusive; None = from the first row.
        until_ms: End of the wall-clock interval, ms, exclusive; None = to the newest row.
        last: Maximum number of rows, counted from the newest; None = all rows.
    """

    since_ms: int | None = None
    until_ms: int | None = None
    last: int | None = None

    def contains(self, utc_ms: int) -> bool:
        """Return True if a wall-clock time is within the interval."""
        return (self.since_ms is None or utc_ms >= self.since_ms) and (self.until_ms is None or utc_ms < self.until_ms)


@dataclass(frozen=True, slots=True)
class RecordFilter:
    """Selection of events, alarm changes and cycles for a panel.

    Attributes:
        since_ms: Start of the wall-clock interval, ms, inclusive.
        until_ms: End of the wall-clock interval, ms, exclusive.
        kind: Kind of an event, `ALARM` or `CYCLE`; empty = all.
        number: Number of an alarm, which selects its changes; None = all.
        text: Part of the text, regardless of ASCII upper and lower case; empty = all.
    """

    since_ms: int = 0
    until_ms: int = _LARGEST
    kind: str = ""
    number: int | None = None
    text: str = ""


class CycleTimes(NamedTuple):
    """Times of a cycle.

    Attributes:
        utc_ms: End of the cycle, ms since 1970 UTC.
        side: Arm.
        cycle_ms: Time of the cycle, ms.
        waiting_ms: Part of this time spent waiting for cups, ms.
    """

    utc_ms: int
    side: str
    cycle_ms: int
    waiting_ms: int


@contextmanager
def open_history(path: Path) -> Iterator[sqlite3.Connection]:
    """Open a history for reading.

    Raises:
        HistoryError: The file is missing, not a history, damaged, incomplete or has a newer schema.
    """
    db = None
    try:
        if not path.is_file():
            raise HistoryError(f"{path}: no such file; specify a history written by a controller")
        db = _connect(path)
        yield db
    except (sqlite3.Error, OSError, UnicodeDecodeError) as error:
        raise HistoryError(f"{path}: {error}; specify a file written by a controller") from error
    finally:
        if db is not None:
            db.close()


def _connect(path: Path) -> sqlite3.Connection:
    uri = f"{path.absolute().as_uri()}?mode=ro"
    try:
        return _connect_checked(uri, path)
    except sqlite3.OperationalError:
        if path.with_name(path.name + "-wal").exists():
            raise
        return _connect_checked(f"{uri}&immutable=1", path)  # read-only folder without a writer


def _connect_checked(uri: str, path: Path) -> sqlite3.Connection:
    db = sqlite3.connect(uri, uri=True, timeout=BUSY_S, isolation_level=None)
    try:
        check_schema(db, path)
    except BaseException:
        db.close()
        raise
    return db


def pages(db: sqlite3.Connection, table: str, window: RowSelection) -> Iterator[list[Record]]:
    """Yield the rows of a table in chronological order, page by page; JSON columns are returned as text.

    Rows written after the first page has been read are not included.
    """
    within = "utc_ms >= ifnull(:since, utc_ms) AND utc_ms < ifnull(:until, utc_ms + 1)"
    values = {"since": window.since_ms, "until": window.until_ms, "last": -1 if window.last is None else window.last}
    newest = f"SELECT id FROM {table} WHERE {within} ORDER BY id DESC LIMIT :last"  # noqa: S608 - internal names
    first, final = db.execute(f"SELECT min(id), max(id) FROM ({newest})", values).fetchone()  # noqa: S608
    while first is not None and first <= final:
        query = f"SELECT * FROM {table} WHERE id BETWEEN :first AND :final AND {within} ORDER BY id LIMIT {PAGE_ROWS}"  # noqa: S608
        page = _records(db, table, query, values | {"first": first, "final": final})
        if not page:
            return
        yield page
        first = integer(page[-1], "id") + 1


def integer(record: Record, name: str) -> int:
    """Return the integer in a column.

    Raises:
        sqlite3.DataError: The value is not an integer.
    """
    value = record[name]
    if not isinstance(value, int):
        raise sqlite3.DataError(f"{name} {value!r} is not an integer")
    return value


def _records(db: sqlite3.Connection, table: str, query: str, values: dict[str, int | None]) -> list[Record]:
    return [dict(zip(TABLES[table], row, strict=True)) for row in db.execute(query, values).fetchall()]


class HistoryReader:
    """Reader of the newest rows for a panel, newest first; thread-safe.

    A missing file yields no rows. The file is opened for every answer, so that a new or replaced file is detected.
    """

    def __init__(self, path: Path) -> None:
        """Create a reader of this file."""
        self._path = path

    @property
    def problem(self) -> str | None:
        """Error that prevents reading the history; None if it can be read."""
        try:
            with open_history(self._path):
                return None
        except HistoryError as error:
            return str(error)

    @property
    def present(self) -> bool:
        """True if the history exists and can be read."""
        return self.problem is None

    def runs(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest runs of the controller, newest first; see `events` for the arguments."""
        return self._newest("runs", last, before_id)

    def events(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest events, newest first, with `detail` as a dict.

        Args:
            last: Maximum number of rows, up to `MAX_ROWS`.
            before_id: Only rows before the row with this id, for paging; None = from the newest row.
        """
        return self._newest("events", last, before_id)

    def alarms(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest changes of alarms, newest first; see `events` for the arguments."""
        return self._newest("alarms", last, before_id)

    def newest_alarm(self) -> int | None:
        """Return the `id` of the newest change of an alarm; 0 if there is none yet, None without a history."""
        if not self.present:
            return None
        rows = self.alarms(last=1)
        return int(str(rows[0]["id"])) if rows else 0

    def cycles(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest cycles without their edges, newest first; see `events` for the arguments."""
        return [{name: row[name] for name in row if name != "edges"} for row in self._newest("cycles", last, before_id)]

    def audit(self, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest operator actions, newest first; see `events` for the arguments."""
        return self._newest("audit", last, before_id)

    def records(self, chosen: RecordFilter, last: int = 100, before_id: int | None = None) -> list[Record]:
        """Return the newest events, alarm changes and cycles of a selection, newest first; see `events` for paging."""
        query = " UNION ALL ".join(f"SELECT * FROM ({_newest_of(table)})" for table in _OF_TABLES)  # noqa: S608
        query += " ORDER BY id DESC LIMIT :last"
        values = _window(last, before_id) | {
            "since": chosen.since_ms,
            "until": chosen.until_ms,
            "kind": chosen.kind,
            "number": chosen.number,
            "text": chosen.text,
        }
        with suppress(HistoryError), open_history(self._path) as db:
            return [decoded(dict(zip(_RECORD, row, strict=True))) for row in db.execute(query, values)]
        return []

    def last_cycle(self, side: Side) -> Record | None:
        """Return the last cycle of an arm with `edges` as a list of [ms, device, level]; None if there is none."""
        rows = self._read("cycles", "side = :side ORDER BY id DESC LIMIT 1", {"side": side})
        return rows[0] if rows else None

    def cycle_times(self, since_ms: int, until_ms: int) -> list[CycleTimes]:
        """Return the times of the cycles that ended within an interval, in chronological order.

        The newest rows are read until one is older than the interval, because the tables have no index of times. Rows
        that were written before the wall clock was set back end the answer.

        Args:
            since_ms: Start of the interval, ms since 1970 UTC, inclusive.
            until_ms: End of the interval, ms since 1970 UTC, exclusive.
        """
        query = "SELECT utc_ms, side, cycle_ms, waiting_ms FROM cycles ORDER BY id DESC LIMIT ?"
        with suppress(HistoryError), open_history(self._path) as db:
            newest = (CycleTimes(*row) for row in db.execute(query, (MAX_CYCLES,)))
            cycles = [row for row in takewhile(lambda row: row.utc_ms >= since_ms, newest) if row.utc_ms < until_ms]
            return sorted(cycles, key=lambda row: row.utc_ms)
        return []

    def _newest(self, table: str, last: int, before_id: int | None) -> list[Record]:
        return self._read(table, "id < :before ORDER BY id DESC LIMIT :last", _window(last, before_id))

    def _read(self, table: str, where: str, values: dict[str, int | str | None]) -> list[Record]:
        with suppress(HistoryError), open_history(self._path) as db:
            rows = db.execute(f"SELECT * FROM {table} WHERE {where}", values).fetchall()  # noqa: S608 - internal names
            return [decoded(dict(zip(TABLES[table], row, strict=True))) for row in rows]
        return []


def _newest_of(table: str) -> str:
    """Return the query for the newest records of a table; each table is read only as far as necessary."""
    columns = ", ".join(
        f"{_OF_TABLES[table].get(name) or (name if name in TABLES[table] else 'NULL')} AS {name}" for name in _RECORD
    )
    return f"""
        SELECT * FROM (SELECT {columns} FROM {table})
        WHERE id < :before AND utc_ms >= :since AND utc_ms < :until AND (:kind = '' OR kind = :kind)
        AND (:number IS NULL OR (kind = '{ALARM}' AND number = :number))
        AND (:text = '' OR instr(lower(text), lower(:text))) ORDER BY id DESC LIMIT :last
        """  # noqa: S608 - internal names


def _window(last: int, before_id: int | None) -> dict[str, int | str | None]:
    """Return the values of a page of rows."""
    before = _LARGEST if before_id is None else max(0, min(before_id, _LARGEST))
    return {"before": before, "last": max(0, min(last, MAX_ROWS))}


def decoded(record: Record) -> Record:
    """Return a row with its JSON columns decoded to lists and dicts; a damaged one is None."""
    return {name: _json(value) if name in JSON_COLUMNS else value for name, value in record.items()}


def _json(value: object) -> object:
    with suppress(ValueError, RecursionError):
        return None if value is None else json.loads(str(value))
    return None
