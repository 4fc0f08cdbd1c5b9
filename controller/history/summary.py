"""Summary of the history per run and day: trays, rows, missed cups and alarms, with the alarm rate."""

from __future__ import annotations

import sqlite3
from dataclasses import asdict, dataclass, field
from datetime import UTC, date, datetime, timedelta
from typing import Final

from controller.events.alarm_load import ACTIVE, STANDING_MS, AlarmLoad, is_activation
from controller.events.alarm_states import AlarmState
from controller.history.export import printable
from controller.history.query import Record, RowSelection, integer, pages

MIN_RATE_MS: Final = 600_000
"""Shortest recorded time for which an alarm rate is calculated, ms: the 10-minute interval of ISA-18.2."""


@dataclass(slots=True)
class AlarmTotal:
    """Totals of one alarm for one run and day.

    Attributes:
        number: Number of the annunciator.
        text: Message of the alarm.
        count: Number of activations.
        active_ms: Total time for which the alarm was set and not shelved, counted from its activations on this day, ms.
        chattering: Number of times at which it has begun to chatter.
        standing: Number of activations that have lasted so long that it was a standing alarm.
    """

    number: int
    text: str
    count: int = 0
    active_ms: int = 0
    chattering: int = 0
    standing: int = 0


@dataclass(slots=True)
class DayTotal:
    """Totals of one run on one day in local time.

    Attributes:
        run: Id of the run.
        day: Date.
        program: Name of the machine's program.
        version: Version of the controller.
        recorded_ms: Part of the time from the first to the last record of the run that falls on this day, ms.
        trays: Number of trays emptied.
        rows: Number of rows released over the cups by both arms, as on panel and console.
        timed: Number of completed cycles; a row whose cycle was interrupted after its release is not timed.
        cycle_ms: Sum of the times of the completed cycles, ms.
        missed_cups: Number of cups missed, attributed to the next cycle of the arm; 0 for the first recorded cycle.
        alarms: Totals of the alarms by annunciator number.
        most_in_ten_minutes: Largest number of activations within ten minutes.
    """

    run: int
    day: str
    program: str
    version: str
    recorded_ms: int
    trays: int = 0
    rows: int = 0
    timed: int = 0
    cycle_ms: int = 0
    missed_cups: int = 0
    alarms: dict[int, AlarmTotal] = field(default_factory=dict)
    most_in_ten_minutes: int = 0

    @property
    def mean_cycle_ms(self) -> int | None:
        """Mean time of the completed cycles, ms; None if there are none."""
        return round(self.cycle_ms / self.timed) if self.timed else None

    @property
    def alarms_per_hour(self) -> float | None:
        """Alarm rate, 1/h; None if the recorded time is too short."""
        count = sum(alarm.count for alarm in self.alarms.values())
        return round(count * 3_600_000 / self.recorded_ms, 2) if self.recorded_ms >= MIN_RATE_MS else None

    def record(self) -> Record:
        """Return the totals as a JSON object."""
        alarms = [asdict(alarm) for _, alarm in sorted(self.alarms.items())]
        totals: Record = {
            name: value for name, value in asdict(self).items() if name not in {"timed", "cycle_ms", "alarms"}
        }
        means: Record = {"mean_cycle_ms": self.mean_cycle_ms, "alarms_per_hour": self.alarms_per_hour}
        return totals | means | {"alarms": alarms}

    def lines(self) -> list[str]:
        """Return the totals as lines of text."""
        mean = "" if self.mean_cycle_ms is None else f", mean cycle {self.mean_cycle_ms / 1000:.2f} s"
        rate = "" if self.alarms_per_hour is None else f", {self.alarms_per_hour:.2f} per hour"
        count = sum(alarm.count for alarm in self.alarms.values())
        return [
            f"{self.day}  run {self.run}, {printable(self.program)} {printable(self.version)}",
            f"  recorded {self.recorded_ms / 3_600_000:.2f} h",
            f"  trays {self.trays}, rows {self.rows}{mean}, missed cups {self.missed_cups}",
            f"  alarms {count}{rate}, at most {self.most_in_ten_minutes} in 10 minutes",
            *(
                f"    {alarm.number}  {alarm.count:>4} x  {alarm.active_ms / 1000:>9.1f} s  {printable(alarm.text)}"
                f"{_load(alarm)}"
                for _, alarm in sorted(self.alarms.items())
            ),
        ]


def _load(alarm: AlarmTotal) -> str:
    """Return how often an alarm chattered and stood, or "" if it did neither."""
    counts = {"chattering": alarm.chattering, "standing": alarm.standing}
    return "".join(f", {name} {count} x" for name, count in counts.items() if count)


def summary(db: sqlite3.Connection, window: RowSelection) -> list[DayTotal]:
    """Return the totals for every run and day with records in the interval.

    `RowSelection.last` is ignored. Runs without records are omitted.
    """
    db.execute("BEGIN")  # consistent snapshot of all tables
    try:
        return _Summary(db, window).totals()
    finally:
        db.execute("ROLLBACK")


class _Summary:
    """Calculation of the totals in one pass over the tables."""

    def __init__(self, db: sqlite3.Connection, window: RowSelection) -> None:
        self._db = db
        self._window = window
        self._totals: dict[tuple[int, str], DayTotal] = {}
        self._runs = {integer(row, "id"): row for page in pages(db, "runs", RowSelection()) for row in page}
        self._spans = self._recorded()
        self._last_at_ms: dict[int, int] = {}

    def totals(self) -> list[DayTotal]:
        self._production()
        self._alarms()
        return [self._totals[key] for key in sorted(self._totals)]

    def _recorded(self) -> dict[int, tuple[int, int]]:
        """Return the wall-clock times of the first and the last row of every run, ms."""
        query = " UNION ALL ".join(
            f"SELECT run, min(utc_ms), max(utc_ms) FROM {table} GROUP BY run"  # noqa: S608 - internal names
            for table in ("runs", "events", "alarms", "cycles", "audit")
        )
        spans: dict[int, tuple[int, int]] = {}
        for run, first, last in self._db.execute(query).fetchall():
            low, high = spans.get(run, (first, last))
            spans[run] = (min(low, first), max(high, last))
        return spans

    def _total(self, row: Record) -> DayTotal:
        """Return the totals to which a row belongs."""
        run, day = integer(row, "run"), datetime.fromtimestamp(integer(row, "utc_ms") / 1000, UTC).astimezone().date()
        key = (run, day.isoformat())
        if key not in self._totals:
            record = self._runs.get(run, {})
            program, version = str(record.get("program", "")), str(record.get("version", ""))
            self._totals[key] = DayTotal(run, day.isoformat(), program, version, self._recorded_on(run, day))
        return self._totals[key]

    def _recorded_on(self, run: int, day: date) -> int:
        """Return the recorded time of a run within a day and the selected interval, ms."""
        first, last = self._spans[run]
        bounds = [_midnight_ms(day), _midnight_ms(day + timedelta(days=1))]
        since, until = self._window.since_ms, self._window.until_ms
        low = max(first, bounds[0], first if since is None else since)
        high = min(last, bounds[1], last if until is None else until)
        return max(0, high - low)

    def _production(self) -> None:
        for page in pages(self._db, "events", self._window):
            for row in page:
                total = self._total(row)
                total.trays += row["kind"] == "tray"
                total.rows += row["kind"] == "row"
        missed: dict[object, int] = {}
        for page in pages(self._db, "cycles", RowSelection()):
            for row in page:
                now = integer(row, "missed_cups")
                before = missed.get(row["side"], now)
                missed[row["side"]] = now
                if self._window.contains(integer(row, "utc_ms")):
                    total = self._total(row)
                    total.timed += 1
                    total.cycle_ms += integer(row, "cycle_ms")
                    total.missed_cups += now - before if now >= before else now  # the count was reset in between

    def _alarms(self) -> None:
        """Count activations and sum the times until they end; the end of a run ends all active alarms."""
        active: dict[tuple[int, int], tuple[int, AlarmTotal]] = {}
        loads: dict[int, AlarmLoad] = {}
        for page in pages(self._db, "alarms", RowSelection()):
            for row in page:
                before, after = AlarmState(str(row["before"])), AlarmState(str(row["after"]))
                number, at_ms = integer(row, "number"), integer(row, "at_ms")
                key = (integer(row, "run"), number)
                if after not in ACTIVE and key in active:
                    since_ms, alarm = active.pop(key)
                    _add_active(alarm, at_ms - since_ms)
                is_new, becomes_active = is_activation(before, after), after in ACTIVE and before not in ACTIVE
                load = loads.setdefault(key[0], AlarmLoad())
                chattered = load.chattered[number]
                if is_new:
                    load.announce(number, at_ms)
                if (is_new or becomes_active) and self._window.contains(integer(row, "utc_ms")):
                    total = self._total(row)
                    alarm = total.alarms.setdefault(number, AlarmTotal(number, str(row["text"])))
                    alarm.count += is_new
                    alarm.chattering += load.chattered[number] - chattered
                    total.most_in_ten_minutes = max(total.most_in_ten_minutes, load.recent(at_ms))
                    if becomes_active:
                        active[key] = (at_ms, alarm)
        for (run, _), (since_ms, alarm) in active.items():
            _add_active(alarm, self._end_ms(run) - since_ms)

    def _end_ms(self, run: int) -> int:
        """Return the controller time of the last row of a run, ms."""
        if run not in self._last_at_ms:
            query = " UNION ALL ".join(
                f"SELECT max(at_ms) FROM {table} WHERE run = :run"  # noqa: S608 - internal names
                for table in ("events", "alarms", "cycles", "audit")
            )
            rows = self._db.execute(query, {"run": run}).fetchall()
            self._last_at_ms[run] = max(at_ms for (at_ms,) in rows if at_ms is not None)
        return self._last_at_ms[run]


def _add_active(alarm: AlarmTotal, for_ms: int) -> None:
    """Add a time for which an alarm was active."""
    alarm.active_ms += for_ms
    alarm.standing += for_ms >= STANDING_MS


def _midnight_ms(day: date) -> int:
    """Return the start of a day in local time, ms since 1970 UTC."""
    return round(datetime(day.year, day.month, day.day).astimezone().timestamp() * 1000)
