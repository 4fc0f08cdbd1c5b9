"""What the history comes to, per run and day: trays, cycles, missed cups, and alarms with their rate."""

from __future__ import annotations

import sqlite3
from dataclasses import asdict, dataclass, field
from datetime import UTC, date, datetime, timedelta
from typing import Final

from controller.hmi.alarm_list import AlarmState
from controller.hmi.history_export import printable
from controller.hmi.history_query import Record, Window, pages, whole

LEAST_RATE_MS: Final = 600_000
"""Shortest time for which a rate says something, ms: the interval of ISA-18.2."""

_NEW: Final = (AlarmState.UNACKNOWLEDGED, AlarmState.LATCHED_UNACKNOWLEDGED)
_LATCHED: Final = (AlarmState.LATCHED_UNACKNOWLEDGED, AlarmState.LATCHED_ACKNOWLEDGED)
_GONE: Final = (AlarmState.NORMAL, AlarmState.RETURNED_UNACKNOWLEDGED)
_ACTIVE: Final = (*_NEW, AlarmState.ACKNOWLEDGED, AlarmState.LATCHED_ACKNOWLEDGED)


@dataclass(slots=True)
class AlarmTotal:
    """One alarm of a run and day.

    Attributes:
        number: Number of its annunciator.
        text: Its message.
        count: How often it came.
        active_ms: How long it was set and not shelved, from the comings of this day, ms.
    """

    number: int
    text: str
    count: int = 0
    active_ms: int = 0


@dataclass(slots=True)
class DayTotal:
    """One run on one day, local time.

    Attributes:
        run: Id of the run.
        day: Date.
        program: Name of the machine's program.
        version: Version of the controller.
        recorded_ms: From the first to the last thing the run recorded, as far as it falls on the day, ms.
        trays: Trays emptied.
        cycles: Cycles completed, both arms.
        cycle_ms: Their times together, ms.
        missed_cups: Cups missed since the cycle of that arm before; none are counted for the first on record.
        alarms: By number.
    """

    run: int
    day: str
    program: str
    version: str
    recorded_ms: int
    trays: int = 0
    cycles: int = 0
    cycle_ms: int = 0
    missed_cups: int = 0
    alarms: dict[int, AlarmTotal] = field(default_factory=dict)

    @property
    def mean_cycle_ms(self) -> int | None:
        """Mean time of a cycle, ms; None without any."""
        return round(self.cycle_ms / self.cycles) if self.cycles else None

    @property
    def alarms_per_hour(self) -> float | None:
        """Rate of alarms; None where the time is too short for one."""
        count = sum(alarm.count for alarm in self.alarms.values())
        return round(count * 3_600_000 / self.recorded_ms, 2) if self.recorded_ms >= LEAST_RATE_MS else None

    def record(self) -> Record:
        """Return it as an object of JSON."""
        alarms = [asdict(alarm) for _, alarm in sorted(self.alarms.items())]
        told: Record = {name: value for name, value in asdict(self).items() if name not in {"cycle_ms", "alarms"}}
        means: Record = {"mean_cycle_ms": self.mean_cycle_ms, "alarms_per_hour": self.alarms_per_hour}
        return told | means | {"alarms": alarms}

    def lines(self) -> list[str]:
        """Return it as text."""
        mean = "" if self.mean_cycle_ms is None else f", mean {self.mean_cycle_ms / 1000:.2f} s"
        rate = "" if self.alarms_per_hour is None else f", {self.alarms_per_hour:.2f} an hour"
        count = sum(alarm.count for alarm in self.alarms.values())
        return [
            f"{self.day}  run {self.run}, {printable(self.program)} {printable(self.version)}",
            f"  recorded {self.recorded_ms / 3_600_000:.2f} h",
            f"  trays {self.trays}, cycles {self.cycles}{mean}, missed cups {self.missed_cups}",
            f"  alarms {count}{rate}",
            *(
                f"    {alarm.number}  {alarm.count:>4} x  {alarm.active_ms / 1000:>9.1f} s  {printable(alarm.text)}"
                for _, alarm in sorted(self.alarms.items())
            ),
        ]


def summary(db: sqlite3.Connection, window: Window) -> list[DayTotal]:
    """Return the totals of every run and day of which something lies within the time.

    `Window.last` does not matter. Nothing is told of a run that has left no row but its own.
    """
    db.execute("BEGIN")  # all tables as of one instant
    try:
        return _Summary(db, window).made()
    finally:
        db.execute("ROLLBACK")


class _Summary:
    """One pass over the tables."""

    def __init__(self, db: sqlite3.Connection, window: Window) -> None:
        self._db = db
        self._window = window
        self._totals: dict[tuple[int, str], DayTotal] = {}
        self._runs = {whole(row, "id"): row for page in pages(db, "runs", Window()) for row in page}
        self._spans = self._recorded()
        self._last_at_ms: dict[int, int] = {}

    def made(self) -> list[DayTotal]:
        self._production()
        self._alarms()
        return [self._totals[key] for key in sorted(self._totals)]

    def _recorded(self) -> dict[int, tuple[int, int]]:
        """Return the wall clock of the first and the last row of every run, ms."""
        query = " UNION ALL ".join(
            f"SELECT run, min(utc_ms), max(utc_ms) FROM {table} GROUP BY run"  # noqa: S608 - names of our own
            for table in ("runs", "events", "alarms", "cycles", "audit")
        )
        spans: dict[int, tuple[int, int]] = {}
        for run, first, last in self._db.execute(query).fetchall():
            low, high = spans.get(run, (first, last))
            spans[run] = (min(low, first), max(high, last))
        return spans

    def _total(self, row: Record) -> DayTotal:
        """Return the total that a row belongs to."""
        run, day = whole(row, "run"), datetime.fromtimestamp(whole(row, "utc_ms") / 1000, UTC).astimezone().date()
        key = (run, day.isoformat())
        if key not in self._totals:
            about = self._runs.get(run, {})
            program, version = str(about.get("program", "")), str(about.get("version", ""))
            self._totals[key] = DayTotal(run, day.isoformat(), program, version, self._recorded_on(run, day))
        return self._totals[key]

    def _recorded_on(self, run: int, day: date) -> int:
        """Return how much of a run falls on a day, and into the time asked for, ms."""
        first, last = self._spans[run]
        bounds = [_midnight_ms(day), _midnight_ms(day + timedelta(days=1))]
        since, until = self._window.since_ms, self._window.until_ms
        low = max(first, bounds[0], first if since is None else since)
        high = min(last, bounds[1], last if until is None else until)
        return max(0, high - low)

    def _production(self) -> None:
        for page in pages(self._db, "events", self._window):
            for row in page:
                self._total(row).trays += row["kind"] == "tray"
        missed: dict[object, int] = {}
        for page in pages(self._db, "cycles", Window()):
            for row in page:
                now = whole(row, "missed_cups")
                before = missed.get(row["side"], now)
                missed[row["side"]] = now
                if self._window.holds(whole(row, "utc_ms")):
                    total = self._total(row)
                    total.cycles += 1
                    total.cycle_ms += whole(row, "cycle_ms")
                    total.missed_cups += now - before if now >= before else now  # the count was reset in between

    def _alarms(self) -> None:
        """Count comings and add up the times between them and the goings; a run ends what is still set."""
        active: dict[tuple[int, int], tuple[int, AlarmTotal]] = {}
        for page in pages(self._db, "alarms", Window()):
            for row in page:
                before, after = AlarmState(str(row["before"])), AlarmState(str(row["after"]))
                number, at_ms = whole(row, "number"), whole(row, "at_ms")
                key = (whole(row, "run"), number)
                if after not in _ACTIVE and key in active:
                    since_ms, alarm = active.pop(key)
                    alarm.active_ms += at_ms - since_ms
                comes, begins = _is_new(before, after), after in _ACTIVE and before not in _ACTIVE
                if (comes or begins) and self._window.holds(whole(row, "utc_ms")):
                    alarm = self._total(row).alarms.setdefault(number, AlarmTotal(number, str(row["text"])))
                    alarm.count += comes
                    if begins:
                        active[key] = (at_ms, alarm)
        for (run, _), (since_ms, alarm) in active.items():
            alarm.active_ms += self._end_ms(run) - since_ms

    def _end_ms(self, run: int) -> int:
        """Return the controller time of the last row of a run, ms."""
        if run not in self._last_at_ms:
            query = " UNION ALL ".join(
                f"SELECT max(at_ms) FROM {table} WHERE run = :run"  # noqa: S608 - names of our own
                for table in ("events", "alarms", "cycles", "audit")
            )
            found = self._db.execute(query, {"run": run}).fetchall()
            self._last_at_ms[run] = max(at_ms for (at_ms,) in found if at_ms is not None)
        return self._last_at_ms[run]


def _is_new(before: AlarmState, after: AlarmState) -> bool:
    """Tell whether a change announces an alarm; the end of a shelf does not."""
    return after in _NEW and (before in _GONE or (before in _LATCHED and after is AlarmState.UNACKNOWLEDGED))


def _midnight_ms(day: date) -> int:
    """Return the begin of a day of local time, ms."""
    return round(datetime(day.year, day.month, day.day).astimezone().timestamp() * 1000)
