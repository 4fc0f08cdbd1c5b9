"""History writer: production events, alarm changes and operator actions, written to a file without delaying the scan.

Records are queued without waiting for the disk and written by a background thread. If the queue is full because the
disk is slow, full or missing, further records are dropped. Dropped records are counted, and the loss is recorded as
soon as the history can be written again. A record that can never be written, because SQLite refuses a value or it is
larger than the limit, is dropped in the same way and does not block those behind it.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import Final

from controller.common.supervision.failures import drop, is_reported
from controller.common.supervision.threads import supervised
from controller.events.alarm_list import AlarmChange
from controller.events.kinds import AlarmEvent, Event
from controller.history.file import LIMIT_BYTES, LIMIT_DAYS, HistoryFile, HistoryRow, RecordError
from controller.history.records import EdgesOf, external_text, json_text, values_of
from controller.program.texts.operator import Language, Text

HISTORY_NAME: Final = "history.sqlite"
"""Default name of the file, in the folder of the retentive memory."""
COMMIT_S: Final = 0.5
"""Longest time between a record and its commit, s; alarms and audit records are committed immediately."""
BATCH_ROWS: Final = 500
"""Maximum number of rows per commit."""
CLOSE_S: Final = 5.0
"""Timeout of the final write, s."""
LOST: Final = Text(
    "{count} records lost: the history could not be written ({why})",
    "丢失 {count} 条记录：历史文件无法写入（{why}）",
)
SLOW: Final = Text("the disk is too slow", "磁盘太慢")

_log = logging.getLogger(__name__)


class HistoryWriter:
    """Writer of the history in a background thread; thread-safe. No method raises an exception after initialisation.

    Attributes:
        path: Path of the file.
    """

    def __init__(
        self,
        path: Path,
        *,
        wall_ms: Callable[[], int],
        program: str,
        version: str,
        edges_of: EdgesOf = lambda _: (),
        language: Language = "en",
        limit_bytes: int = LIMIT_BYTES,
        limit_days: int = LIMIT_DAYS,
        max_pending: int = 20_000,
    ) -> None:
        """Open the file and start a run.

        Args:
            path: Path of the file; a missing file is created.
            wall_ms: Wall clock, ms since 1970 UTC.
            program: Name of the machine's program.
            version: Version of the controller.
            edges_of: Function that returns the edges of a cycle in the scan that ends it, such as `CycleEdges.of`.
            language: Language of the texts.
            limit_bytes: Maximum size of the file including its write-ahead log, bytes.
            limit_days: Maximum age of a row when another one is written, days of the wall clock.
            max_pending: Maximum number of queued rows; further rows are dropped and counted.

        Raises:
            HistoryInUseError: Another controller writes to the file.
            HistoryError: The file has a newer schema or cannot be written.
        """
        self.path = path
        self._file = HistoryFile(path, limit_bytes, limit_days)
        self._wall_ms = wall_ms
        self._edges_of = edges_of
        self._language: Language = language
        self._max_pending = max_pending
        self._wake = threading.Condition()
        self._pending: deque[HistoryRow] = deque()
        self._urgent = self._closing = False
        self._dropped = self._unreported = self._refused = 0
        self._error: str | None = None
        self._last_error = ""
        self._put(HistoryRow("runs", wall_ms(), 0, (program, version)), urgent=True)
        self._thread = supervised("history", self._work)
        self._thread.start()

    @property
    def error(self) -> str | None:
        """Error of the last attempt to write; None if it succeeded."""
        with self._wake:
            return self._error

    @property
    def dropped(self) -> int:
        """Number of dropped rows."""
        with self._wake:
            return self._dropped

    def write(self, event: Event | AlarmChange) -> None:
        """Queue a production event or a change of the alarm list.

        An `AlarmEvent` is ignored: the alarm list reports the same transitions, including operator actions.
        """
        if not isinstance(event, AlarmEvent):
            table, values = values_of(event, self._edges_of, self._language)
            self._put(HistoryRow(table, self._wall_ms(), event.at_ms, values), urgent=table == "alarms")

    def audit(self, peer: str, who: str, what: str, value: str, result: str, at_ms: int) -> None:  # noqa: PLR0917
        """Queue an audit record of an operator action.

        Args:
            peer: Address of the client, such as "127.0.0.1:40312".
            who: Name stated by the operator; not authenticated.
            what: Requested action.
            value: Written value.
            result: "done", or "refused: " followed by the reason.
            at_ms: Controller time, ms.
        """
        texts = tuple(external_text(text) for text in (peer, who, what, value, result))
        self._put(HistoryRow("audit", self._wall_ms(), at_ms, texts), urgent=True)

    def close(self) -> None:
        """Write the pending rows and close the file; give up after `CLOSE_S` seconds."""
        with self._wake:
            self._closing = True
            self._wake.notify_all()
        self._thread.join(CLOSE_S)

    def _put(self, row: HistoryRow, *, urgent: bool) -> None:
        with self._wake:
            if len(self._pending) >= self._max_pending or self._closing:
                self._drop()
                return
            self._pending.append(row)
            if urgent:
                self._urgent = True
                self._wake.notify_all()

    def _work(self) -> None:
        closing = False
        while not closing:
            with self._wake:
                self._wake.wait_for(lambda: self._urgent or self._closing, timeout=COMMIT_S)
                self._urgent = False
                closing = self._closing
            while self._write_batch():
                pass
        with self._wake:
            if self._pending:
                _log.error("%s: %d records could not be written before closing", self.path, len(self._pending))
                drop("history", len(self._pending))
        self._file.close()

    def _write_batch(self) -> bool:
        """Write one batch of pending rows and return True if any were written, or dropped for ever."""
        with self._wake:
            rows = self._batch()
            unreported = self._unreported if len(rows) == len(self._pending) else 0
        if not rows and not unreported:
            return False
        try:
            self._file.append([*rows, self._lost_row(unreported, rows)] if unreported else rows)
        except RecordError as error:
            self._refuse(error)
            return True
        except Exception as error:  # noqa: BLE001 - after any error the rows remain queued and are retried
            self._fail(error)
            return False
        with self._wake:
            for _ in rows:
                self._pending.popleft()
            self._unreported -= unreported
            self._error = None
        return True

    def _batch(self) -> list[HistoryRow]:
        rows: list[HistoryRow] = []
        size_bytes = 0
        for row in islice(self._pending, BATCH_ROWS):
            size_bytes += row.size_bytes
            if rows and size_bytes > self._file.batch_bytes:
                break
            rows.append(row)
        return rows

    def _lost_row(self, count: int, rows: Sequence[HistoryRow]) -> HistoryRow:
        """Return the event row that records the number of lost rows."""
        at_ms = rows[-1].at_ms if rows else 0
        why = self._last_error or getattr(SLOW, self._language)
        text = getattr(LOST, self._language).format(count=count, why=why)
        detail = json_text({"lost": count, "why": why})
        return HistoryRow("events", self._wall_ms(), at_ms, ("history", count, text, detail))

    def _drop(self) -> None:
        self._dropped += 1
        self._unreported += 1
        drop("history")

    def _refuse(self, error: RecordError) -> None:
        """Drop a row that would block the others behind it."""
        with self._wake:
            self._pending.remove(error.row)
            self._refused += 1
            self._last_error = external_text(str(error))
            self._drop()
        if is_reported(self._refused):
            _log.error("%s: %s; it is dropped (%d since the start)", self.path, error, self._refused)

    def _fail(self, error: Exception) -> None:
        with self._wake:
            first = self._error is None
            self._error = self._last_error = external_text(str(error))
        if first:
            _log.error(
                "%s: %s; up to %d records are queued until it can be written", self.path, error, self._max_pending
            )
