"""The file of the history: one SQLite database in WAL mode that never grows beyond its limit.

Its place is divided. Three quarters belong to the tables, a sixteenth to the write-ahead log (WAL); the rest is for
what one batch of rows and SQLite's own index of the log may add. The oldest rows make room for new ones, and their
pages are used again.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from controller.core.claim import ClaimError, claim
from controller.hmi.history_schema import TABLES, HistoryError, check_schema, create_statements, is_empty, number

LEAST_LIMIT_BYTES: Final = 4_000_000
BUSY_S: Final = 0.2
"""Longest wait for a reader, s: nobody waits for the writer but its own queue."""
VACUUM_PAGES: Final = 64
_INSERT: Final = {
    table: f"INSERT INTO {table} VALUES ({', '.join('?' * len(columns))})"  # noqa: S608 - names of our own
    for table, columns in TABLES.items()
}
_JOURNALS: Final = tuple(table for table in TABLES if table != "runs")

_log = logging.getLogger(__name__)


class Row(NamedTuple):
    """A row still without id and run.

    Attributes:
        table: Table of `TABLES`.
        utc_ms: Wall clock, ms since 1970.
        at_ms: Controller time, ms.
        values: The other columns, in their order.
    """

    table: str
    utc_ms: int
    at_ms: int
    values: tuple[str | int | None, ...]

    @property
    def size_bytes(self) -> int:
        """What it takes in the file, roughly and not less."""
        texts = (value for value in self.values if isinstance(value, str))
        return 64 + sum(len(text) if text.isascii() else 4 * len(text) for text in texts)


class HeldError(OSError):
    """A reader that does not end its transaction keeps the write-ahead log from being emptied."""


class HistoryFile:
    """The open file; one writer at a time, over all processes.

    What `append` has committed survives the end of the process and, as every commit is forced to the disk
    (`synchronous = FULL`), the loss of power.

    Attributes:
        batch_bytes: Most that one `append` may bring, by `Row.size_bytes`; a single row may be larger.
    """

    def __init__(self, path: Path, limit_bytes: int) -> None:
        """Open or create the file for a new run; the first row appended has to be the run's.

        Args:
            path: The file. What is damaged is moved to ``<name>.damaged-N``, with one line in the log.
            limit_bytes: Most that the file and its write-ahead log may take, bytes.

        Raises:
            HistoryError: The file belongs to another controller, is no history or a newer one, or cannot be written.
        """
        if limit_bytes < LEAST_LIMIT_BYTES:
            raise HistoryError(f"limit of the history {limit_bytes} bytes: give at least {LEAST_LIMIT_BYTES}")
        self.batch_bytes = limit_bytes // 64
        try:
            self._claim = claim(path)
        except ClaimError as error:
            raise HistoryError(f"{path}: {error}") from error
        try:
            self._db = _open(path)
        except BaseException:
            self._claim.close()
            raise
        newest = [number(self._db, f"SELECT coalesce(max(id), 0) FROM {table}") for table in TABLES]  # noqa: S608
        self._run = self._next_id = max(newest) + 1
        try:
            self._set_limits(path, limit_bytes)
        except (sqlite3.Error, HeldError) as error:
            self.close()
            raise HistoryError(f"{path}: {error}; make room on the disk or name another file") from error

    def append(self, rows: Sequence[Row]) -> None:
        """Commit rows, all or none; the oldest ones make room.

        Raises:
            sqlite3.Error: The disk is full, or refuses.
            HeldError: A reader holds the write-ahead log, and it is as long as it may be.
        """
        self._make_room()
        with self._transaction():
            for id_, row in enumerate(rows, start=self._next_id):
                self._db.execute(_INSERT[row.table], (id_, row.utc_ms, row.at_ms, self._run, *row.values))
        self._next_id += len(rows)

    def close(self) -> None:
        """Close the file and let others have it."""
        self._db.close()
        self._claim.close()

    def _set_limits(self, path: Path, limit_bytes: int) -> None:
        page_bytes = number(self._db, "PRAGMA page_size")
        self._wal = path.with_name(path.name + "-wal")
        self._most_wal_bytes = limit_bytes // 16
        self._most_pages = limit_bytes * 3 // 4 // page_bytes
        self._most_used_pages = self._most_pages - 4 * self.batch_bytes // page_bytes
        for setting, value in (
            ("synchronous", "FULL"),
            ("secure_delete", "OFF"),  # a freed page need not be written
            ("journal_size_limit", self._most_wal_bytes // 2),
            ("wal_autocheckpoint", min(1_000, self._most_wal_bytes // 2 // page_bytes)),
        ):
            self._db.execute(f"PRAGMA {setting} = {value}")
        self._make_room()  # the limit may have been larger in the last run
        self._db.execute(f"PRAGMA max_page_count = {self._most_pages}")

    def _make_room(self) -> None:
        self._empty_wal()
        while self._used_pages() > self._most_used_pages and self._delete_oldest():
            self._empty_wal()
        while number(self._db, "PRAGMA page_count") > self._most_pages and number(self._db, "PRAGMA freelist_count"):
            self._db.execute(f"PRAGMA incremental_vacuum({VACUUM_PAGES})").fetchall()
            self._empty_wal()

    def _used_pages(self) -> int:
        return number(self._db, "PRAGMA page_count") - number(self._db, "PRAGMA freelist_count")

    def _empty_wal(self) -> None:
        if self._wal_bytes() > self._most_wal_bytes:
            self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            if self._wal_bytes() > self._most_wal_bytes:
                raise HeldError("a reader holds the write-ahead log; end the program that reads the history")

    def _wal_bytes(self) -> int:
        try:
            return self._wal.stat().st_size
        except FileNotFoundError:
            return 0

    def _delete_oldest(self) -> bool:
        """Delete the first sixty-fourth of all ids, with the runs of which no row is left; tell if there was any."""
        before = self._db.total_changes
        bounds = [self._db.execute(f"SELECT min(id), max(id) FROM {table}").fetchone() for table in _JOURNALS]  # noqa: S608
        filled = [(lowest, highest) for lowest, highest in bounds if lowest is not None]
        lowest = min((low for low, _ in filled), default=self._next_id)
        highest = max((high for _, high in filled), default=self._next_id)
        cut = lowest + max(1, (highest - lowest) // 64)
        with self._transaction():
            for table in _JOURNALS:
                self._db.execute(f"DELETE FROM {table} WHERE id < ?", (cut,))  # noqa: S608 - names of our own
            self._db.execute("DELETE FROM runs WHERE id < (SELECT max(id) FROM runs WHERE id <= ?)", (cut,))
        return self._db.total_changes > before

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:  # some errors have rolled back already
                self._db.execute("ROLLBACK")
            raise


def _open(path: Path) -> sqlite3.Connection:
    """Open or create the database; one that is damaged is set aside."""
    try:
        try:
            return _sound(path)
        except sqlite3.OperationalError:
            raise
        except sqlite3.DatabaseError as error:
            _log.warning("%s: %s; moved to %s, and a new history is begun", path, error, _set_aside(path))
            return _sound(path)
    except (sqlite3.Error, OSError) as error:
        raise HistoryError(f"{path}: {error}; name a file that can be written") from error


def _sound(path: Path) -> sqlite3.Connection:
    """Return the database, checked or new.

    Raises:
        HistoryError: It is no history, or a newer one.
        sqlite3.OperationalError: It cannot be opened or written.
        sqlite3.DatabaseError: It is damaged.
    """
    db = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None, check_same_thread=False)
    try:
        if is_empty(db):
            db.execute("PRAGMA auto_vacuum = INCREMENTAL")  # only an empty database takes it
            db.execute("PRAGMA journal_mode = WAL")
            db.executescript(f"BEGIN; {'; '.join(create_statements())}; COMMIT;")
        else:
            check_schema(db, path)
            (found,) = db.execute("PRAGMA quick_check(1)").fetchone()
            if found != "ok":
                raise sqlite3.DatabaseError(" ".join(str(found).split()))
    except BaseException:
        db.close()
        raise
    return db


def _set_aside(path: Path) -> Path:
    """Move a damaged file out of the way, its write-ahead log with it, and return its new name."""
    count = 1
    while (aside := path.with_name(f"{path.name}.damaged-{count}")).exists():
        count += 1
    for suffix in ("", "-wal", "-shm"):
        part = path.with_name(path.name + suffix)
        if part.exists():
            part.replace(aside.with_name(aside.name + suffix))
    return aside
