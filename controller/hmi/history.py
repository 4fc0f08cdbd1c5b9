"""The history of the machine: what production, alarms and operators did, written to a file beside the scan.

Whoever reports something waits for no disk: it goes into a queue, and a thread of its own writes it. A queue that is
full because the disk is slow, full or gone takes nothing more; what is lost is counted, and the history says so as
soon as it can be written again.
"""

from __future__ import annotations

import json
import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Final

from controller.hmi.alarm_list import AlarmChange
from controller.hmi.cycle_edges import Edge
from controller.hmi.history_file import HistoryFile, Row
from controller.hmi.production import (
    AlarmEvent,
    CycleEvent,
    Event,
    ModeEvent,
    QuestionEvent,
    RefusalEvent,
    StateEvent,
    TrayEvent,
)
from controller.program.texts import Language, Text

DEFAULT_HISTORY: Final = Path("var/history.sqlite")
"""Beside the retentive memory."""
LIMIT_BYTES: Final = 200_000_000
COMMIT_S: Final = 0.5
"""Nothing waits longer to be written, s; alarms and the audit do not wait at all."""
BATCH_ROWS: Final = 500
CLOSE_S: Final = 5.0
"""Longest wait at the end for a disk that does not answer, s."""
LONGEST_TEXT: Final = 1_000
LOST: Final = Text(
    "{count} records are lost: the history could not be written ({why})",
    "丢失 {count} 条记录：历史文件无法写入（{why}）",
)

SLOW: Final = Text("the disk is too slow", "磁盘太慢")

_log = logging.getLogger(__name__)

EdgesOf = Callable[[CycleEvent], Sequence[Edge]]


class History:
    """Takes what happens, from any thread, and writes it in a thread of its own; nothing here raises once it is made.

    Attributes:
        path: The file.
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
        most_waiting: int = 20_000,
    ) -> None:
        """Open the file and begin a run.

        Args:
            path: The file; it is made if it is not there.
            wall_ms: Wall clock, ms since 1970 UTC.
            program: Name of the machine's program.
            version: Version of the controller.
            edges_of: Gives the edges of a cycle in the scan that ends it, as `CycleEdges.of`.
            language: Language of the history's own texts; the others come with what is told.
            limit_bytes: Most that the file may take, its write-ahead log included, bytes.
            most_waiting: Rows that may wait for the disk; what comes beyond is lost and counted.

        Raises:
            HistoryError: The file belongs to another controller, is no history or a newer one, or cannot be written.
        """
        self.path = path
        self._file = HistoryFile(path, limit_bytes)
        self._wall_ms = wall_ms
        self._edges_of = edges_of
        self._language: Language = language
        self._most_waiting = most_waiting
        self._wake = threading.Condition()
        self._waiting: deque[Row] = deque()
        self._urgent = self._closing = False
        self._dropped = self._untold = 0
        self._error: str | None = None
        self._last_error = ""
        self._put(Row("runs", wall_ms(), 0, (program, version)), urgent=True)
        self._thread = threading.Thread(target=self._work, name="history", daemon=True)
        self._thread.start()

    @property
    def error(self) -> str | None:
        """Why the file could not be written last; None once it can be again."""
        with self._wake:
            return self._error

    @property
    def dropped(self) -> int:
        """Rows lost so far."""
        with self._wake:
            return self._dropped

    def tell(self, event: Event | AlarmChange) -> None:
        """Take an event of production or a change of the alarm list.

        An `AlarmEvent` is passed over: the alarm list tells the same coming and going as changes, with who did what.
        """
        if not isinstance(event, AlarmEvent):
            table, values = self._values(event)
            self._put(Row(table, self._wall_ms(), event.at_ms, values), urgent=table == "alarms")

    def audit(self, peer: str, who: str, what: str, value: str, result: str, at_ms: int) -> None:  # noqa: PLR0917
        """Take note of what somebody ordered.

        Args:
            peer: Where from, as "127.0.0.1:40312".
            who: Name given; it is not proved.
            what: What was ordered.
            value: The value written.
            result: "done", or "refused: " and why.
            at_ms: Controller time, ms.
        """
        texts = tuple(_clean(text) for text in (peer, who, what, value, result))
        self._put(Row("audit", self._wall_ms(), at_ms, texts), urgent=True)

    def close(self) -> None:
        """Write what is left, if the disk takes it, and close the file."""
        with self._wake:
            self._closing = True
            self._wake.notify_all()
        self._thread.join(CLOSE_S)

    def _values(self, event: Event | AlarmChange) -> tuple[str, tuple[str | int | None, ...]]:
        """Return the table of an event and its own columns there."""
        number: int
        told: tuple[str, ...] = ()
        match event:
            case AlarmChange():
                by = None if event.by is None else _clean(event.by)
                return "alarms", (event.number, event.key, event.before.value, event.after.value, by, event.text,
                                  event.shelved_until_ms)  # fmt: skip
            case CycleEvent():
                edges = json.dumps(self._edges_of(event), separators=(",", ":"))
                return "cycles", (event.side, event.row, event.cycle_ms, event.waiting_ms, event.missed_cups,
                                  event.gap_cause, edges)  # fmt: skip
            case StateEvent():
                number, told = event.state, ("reason",)
            case RefusalEvent():
                number, told = event.reason, ("command",)
            case QuestionEvent():
                number, told = int(event.active), ("question", "active")
            case ModeEvent():
                number = event.mode
            case TrayEvent():
                number = event.trays_done
            case _:
                raise TypeError(f"{event} has no place in the history")
        record = asdict(event)
        detail = {name: record[name] for name in told if record[name] != ""}
        return "events", (event.event, number, record.get("text", ""), _json(detail))

    def _put(self, row: Row, *, urgent: bool) -> None:
        with self._wake:
            if len(self._waiting) >= self._most_waiting or self._closing:
                self._dropped += 1
                self._untold += 1
                return
            self._waiting.append(row)
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
            if self._waiting:
                _log.error("%s: %d records could not be written at the end", self.path, len(self._waiting))
        self._file.close()

    def _write_batch(self) -> bool:
        """Write what waits, as far as it makes one batch; return whether anything was written."""
        with self._wake:
            rows = self._batch()
            untold = self._untold if len(rows) == len(self._waiting) else 0
        if not rows and not untold:
            return False
        try:
            self._file.append([*rows, self._lost_row(untold, rows)] if untold else rows)
        except Exception as error:  # noqa: BLE001 - whatever it is, the rows wait and are tried again
            self._fail(error)
            return False
        with self._wake:
            for _ in rows:
                self._waiting.popleft()
            self._untold -= untold
            self._error = None
        return True

    def _batch(self) -> list[Row]:
        rows: list[Row] = []
        size_bytes = 0
        for row in islice(self._waiting, BATCH_ROWS):
            size_bytes += row.size_bytes
            if rows and size_bytes > self._file.batch_bytes:
                break
            rows.append(row)
        return rows

    def _lost_row(self, count: int, rows: Sequence[Row]) -> Row:
        """Return the event that says what is lost."""
        at_ms = rows[-1].at_ms if rows else 0
        why = self._last_error or getattr(SLOW, self._language)
        text = getattr(LOST, self._language).format(count=count, why=why)
        detail = _json({"lost": count, "why": why})
        return Row("events", self._wall_ms(), at_ms, ("history", count, text, detail))

    def _fail(self, error: Exception) -> None:
        with self._wake:
            first = self._error is None
            self._error = self._last_error = str(error)
        if first:
            _log.error("%s: %s; what happens meanwhile waits, up to %d records", self.path, error, self._most_waiting)


def _clean(text: str) -> str:
    """Return a text from outside as the file can hold it."""
    return text[:LONGEST_TEXT].encode(errors="replace").decode()


def _json(detail: dict[str, object]) -> str:
    return json.dumps(detail, ensure_ascii=False, separators=(",", ":"))
