"""History file: one SQLite database in WAL mode with limits of size and age.

Three quarters of the limit are reserved for the tables, a sixteenth for the write-ahead log (WAL), and the rest for
growth by one batch of rows and for SQLite's index of the log. The oldest rows are deleted to make room for new ones, or
because of their age, and their pages are reused.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from controller.common.files.database import PARTS, is_damage, is_empty, number, read_only
from controller.common.files.lock import FileInUseError, FileLockError, lock_file, place_problem
from controller.common.files.set_aside import set_aside
from controller.history.schema import TABLES, HistoryError, HistoryInUseError, check_schema, create_statements

MIN_LIMIT_BYTES: Final = 4_000_000
"""Smallest size limit, bytes."""
LIMIT_BYTES: Final = 200_000_000
"""Default size limit, bytes."""
LIMIT_DAYS: Final = 90
"""Default age limit, days."""
DAY_MS: Final = 86_400_000
AGE_CHECK_MS: Final = 3_600_000
"""Time between two deletions of rows because of their age, ms of the wall clock."""
BUSY_S: Final = 0.2
"""Longest wait for a reader, s; during the wait, rows are queued."""
PRIMARY: Final = 0xFF
"""Bits of an error code of SQLite that state its kind; the others tell where it arose."""
VACUUM_PAGES: Final = 64
"""Number of pages returned to the file system per vacuum step."""
_INSERT: Final = {
    table: f"INSERT INTO {table} VALUES ({', '.join('?' * len(columns))})"  # noqa: S608 - internal names
    for table, columns in TABLES.items()
}
_JOURNALS: Final = tuple(table for table in TABLES if table != "runs")

_OF_THE_ROW: Final = (sqlite3.DataError, sqlite3.IntegrityError, sqlite3.InterfaceError, sqlite3.ProgrammingError)
"""Errors of SQLite about the values of a row; all others are those of the file."""

_log = logging.getLogger(__name__)


class HistoryRow(NamedTuple):
    """Row of a table, excluding the columns `id` and `run`.

    Attributes:
        table: Name of the table in `TABLES`.
        utc_ms: Wall-clock time, ms since 1970 UTC.
        at_ms: Controller time, ms.
        values: Values of the other columns, in order.
    """

    table: str
    utc_ms: int
    at_ms: int
    values: tuple[str | int | None, ...]

    @property
    def size_bytes(self) -> int:
        """Estimated upper bound of the size in the file, bytes."""
        texts = (value for value in self.values if isinstance(value, str))
        return 64 + sum(len(text) if text.isascii() else 4 * len(text) for text in texts)


class RecordError(ValueError):
    """Raised for a row that can never be written; no row has been written.

    Attributes:
        row: The row.
    """

    def __init__(self, row: HistoryRow, why: object) -> None:
        """Create the error of a row of a table, with its reason."""
        super().__init__(f"a record of the table {row.table} can never be written: {why}")
        self.row = row


class WalBusyError(OSError):
    """Raised if the write-ahead log is full and the open transaction of a reader prevents a checkpoint."""


class HistoryFile:
    """Open history file; only one process at a time can write to it.

    Rows committed by `append` survive a crash of the process and a power failure, because every commit is
    synchronised to disk (`synchronous = FULL`).

    Attributes:
        batch_bytes: Maximum total `HistoryRow.size_bytes` of the rows of one `append`; a single row may be larger.
        record_bytes: Maximum `HistoryRow.size_bytes` of a row, for which room is kept.
    """

    def __init__(self, path: Path, limit_bytes: int, limit_days: int = LIMIT_DAYS) -> None:
        """Open or create the file for a new run; the first row appended must belong to the table `runs`.

        Args:
            path: Path of the file. A file that is damaged, incomplete or no history is renamed to ``<name>.damaged-N``
                and reported in one log line.
            limit_bytes: Maximum size of the file and its write-ahead log, bytes.
            limit_days: Maximum age of a row when another one is written, days of the wall clock.

        Raises:
            HistoryInUseError: Another controller writes to the file.
            HistoryError: The file has a newer schema or cannot be written.
        """
        if limit_bytes < MIN_LIMIT_BYTES:
            raise HistoryError(f"size limit {limit_bytes} bytes: must be at least {MIN_LIMIT_BYTES}")
        self.batch_bytes = limit_bytes // 64
        self.record_bytes = 3 * self.batch_bytes
        self._limit_ms = limit_days * DAY_MS
        self._aged_ms = -AGE_CHECK_MS
        try:
            self._lock = lock_file(path)
        except FileInUseError as error:
            raise HistoryInUseError(f"{path}: {error}") from error
        except FileLockError as error:
            raise HistoryError(f"{path}: {error}") from error
        try:
            self._db = _open(path)
        except BaseException:
            self._lock.release()
            raise
        try:
            last_ids = [number(self._db, f"SELECT coalesce(max(id), 0) FROM {table}") for table in TABLES]  # noqa: S608
            self._run = self._next_id = max(last_ids) + 1
            self._set_limits(path, limit_bytes)
        except (sqlite3.Error, WalBusyError) as error:
            self.close()
            raise HistoryError(f"{path}: {error}; free disk space or choose another file") from error

    def append(self, rows: Sequence[HistoryRow]) -> None:
        """Commit all rows or none; delete the oldest rows if necessary.

        Raises:
            sqlite3.Error: The disk is full or has failed.
            WalBusyError: The write-ahead log is full, and a reader prevents its checkpoint.
            RecordError: A row has a value that SQLite refuses, or is too large.
        """
        if rows:
            self._delete_old(rows[-1].utc_ms)
        self._make_room()
        with self._transaction():
            for id_, row in enumerate(rows, start=self._next_id):
                self._insert(id_, row)
        self._next_id += len(rows)

    def _insert(self, id_: int, row: HistoryRow) -> None:
        if row.size_bytes > self.record_bytes:
            raise RecordError(row, f"up to {row.size_bytes} bytes, limit {self.record_bytes}")
        try:
            self._db.execute(_INSERT[row.table], (id_, row.utc_ms, row.at_ms, self._run, *row.values))
        except _OF_THE_ROW as error:
            raise RecordError(row, error) from error
        except (sqlite3.Error, OSError, MemoryError):
            raise  # of the file or the computer
        except Exception as error:
            raise RecordError(row, error) from error

    def close(self) -> None:
        """Close the file and release its lock."""
        self._db.close()
        self._lock.release()

    def _set_limits(self, path: Path, limit_bytes: int) -> None:
        page_bytes = number(self._db, "PRAGMA page_size")
        self._wal = path.with_name(path.name + "-wal")
        self._max_wal_bytes = limit_bytes // 16
        self._max_pages = limit_bytes * 3 // 4 // page_bytes
        self._max_used_pages = self._max_pages - 4 * self.batch_bytes // page_bytes
        for setting, value in (
            ("synchronous", "FULL"),
            ("secure_delete", "OFF"),  # freed pages need not be overwritten
            ("journal_size_limit", self._max_wal_bytes // 2),
            ("wal_autocheckpoint", min(1_000, self._max_wal_bytes // 2 // page_bytes)),
        ):
            self._db.execute(f"PRAGMA {setting} = {value}")
        self._make_room()  # the limit may have been larger in the previous run
        self._db.execute(f"PRAGMA max_page_count = {self._max_pages}")

    def _make_room(self) -> None:
        self._empty_wal()
        while self._used_pages() > self._max_used_pages and self._delete_oldest():
            self._empty_wal()
        while number(self._db, "PRAGMA page_count") > self._max_pages and number(self._db, "PRAGMA freelist_count"):
            self._db.execute(f"PRAGMA incremental_vacuum({VACUUM_PAGES})").fetchall()
            self._empty_wal()

    def _used_pages(self) -> int:
        return number(self._db, "PRAGMA page_count") - number(self._db, "PRAGMA freelist_count")

    def _empty_wal(self) -> None:
        if self._wal_bytes() > self._max_wal_bytes:
            self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            if self._wal_bytes() > self._max_wal_bytes:
                raise WalBusyError("a reader blocks the write-ahead log; close the program that reads the history")

    def _wal_bytes(self) -> int:
        try:
            return self._wal.stat().st_size
        except FileNotFoundError:
            return 0

    def _delete_oldest(self) -> bool:
        """Delete the rows in the lowest 1/64 of the id range, and the runs that have no rows left.

        Returns:
            True if a row was deleted.
        """
        before = self._db.total_changes
        lowest, portion = self._oldest()
        self._delete_before(lowest + portion)
        return self._db.total_changes > before

    def _delete_old(self, now_ms: int) -> None:
        """Delete the rows that are older than the limit, oldest first, once an hour and at the first row of a run."""
        if abs(now_ms - self._aged_ms) < AGE_CHECK_MS:
            return
        younger = [
            self._db.execute(
                f"SELECT id FROM {table} WHERE utc_ms >= ? ORDER BY id LIMIT 1",  # noqa: S608 - internal names
                (now_ms - self._limit_ms,),
            ).fetchone()
            for table in _JOURNALS
        ]
        end = min((row[0] for row in younger if row is not None), default=self._next_id)
        lowest, portion = self._oldest()
        while lowest < end:
            lowest = min(lowest + portion, end)
            self._delete_before(lowest)
            self._empty_wal()
        self._aged_ms = now_ms

    def _oldest(self) -> tuple[int, int]:
        """Return the lowest id of a row, and 1/64 of the range of ids, which is deleted in one transaction."""
        bounds = [self._db.execute(f"SELECT min(id), max(id) FROM {table}").fetchone() for table in _JOURNALS]  # noqa: S608
        filled = [(lowest, highest) for lowest, highest in bounds if lowest is not None]
        lowest = min((low for low, _ in filled), default=self._next_id)
        highest = max((high for _, high in filled), default=self._next_id)
        return lowest, max(1, (highest - lowest) // 64)

    def _delete_before(self, id_: int) -> None:
        """Delete the rows with lower ids, and the runs that have no rows left."""
        with self._transaction():
            for table in _JOURNALS:
                self._db.execute(f"DELETE FROM {table} WHERE id < ?", (id_,))  # noqa: S608 - internal names
            self._db.execute("DELETE FROM runs WHERE id < (SELECT max(id) FROM runs WHERE id <= ?)", (id_,))

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._db.execute("COMMIT")
        except BaseException:
            if self._db.in_transaction:  # some errors roll back automatically
                self._db.execute("ROLLBACK")
            raise


def check_history(path: Path) -> None:
    """Check a history that a controller will write, without writing; report one that a start renames.

    Raises:
        HistoryError: Its place is not writable, or its schema is newer.
    """
    if problem := place_problem(path):
        raise HistoryError(f"{path}: {problem}")
    try:
        _check_unopened(path)
    except sqlite3.DatabaseError as error:
        _log.warning("%s: %s; a start renames the file", path, error)


def _open(path: Path) -> sqlite3.Connection:
    """Open or create the database; rename a file that cannot be used and create a new one."""
    try:
        try:
            _check_unopened(path)
            return _open_checked(path)
        except sqlite3.DatabaseError as error:
            if not is_damage(error):
                raise
            aside, *_ = set_aside(path, PARTS)
            _log.warning("%s: %s; renamed to %s, and a new history is created", path, error, aside)
            return _open_checked(path)
    except (sqlite3.Error, OSError) as error:
        raise HistoryError(f"{path}: {error}; choose a writable file") from error


def _check_unopened(path: Path) -> None:
    """Check the schema without changing the file or its write-ahead log.

    Raises:
        HistoryError: The schema is newer.
        sqlite3.DatabaseError: The file is damaged or no history.
    """
    if not path.exists():
        return
    try:
        with read_only(path, BUSY_S) as db:
            if not is_empty(db):
                check_schema(db, path)
    except sqlite3.OperationalError as error:
        if is_damage(error):
            raise
        # a transaction that was cut short is completed or undone by opening the file
        if error.sqlite_errorcode & PRIMARY in (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_FULL):
            _log.warning("%s: %s; the check before opening is omitted", path, error)


def _open_checked(path: Path) -> sqlite3.Connection:
    """Return the database after a check, or a new one.

    Raises:
        HistoryError: The file has a newer schema.
        sqlite3.OperationalError: The file cannot be opened or written.
        sqlite3.DatabaseError: The file is damaged or no history.
    """
    db = sqlite3.connect(path, timeout=BUSY_S, isolation_level=None, check_same_thread=False)
    try:
        if is_empty(db):
            db.execute("PRAGMA auto_vacuum = INCREMENTAL")  # possible only in an empty database
            db.execute("PRAGMA journal_mode = WAL")
            db.executescript(f"BEGIN; {'; '.join(create_statements())}; COMMIT;")
        else:
            check_schema(db, path)
            (result,) = db.execute("PRAGMA quick_check(1)").fetchone()
            if result != "ok":
                raise sqlite3.DatabaseError(" ".join(str(result).split()))
    except BaseException:
        db.close()
        raise
    return db
