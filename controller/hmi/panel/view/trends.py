"""Trends over hours: telemetry recorded by the panel, and cycle times and rows per hour from the history."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Final

from controller.common.supervision.failures import drop
from controller.common.supervision.threads import in_thread
from controller.history.query import CycleTimes, HistoryReader
from controller.hmi.panel.modbus.telemetry import Telemetry
from controller.hmi.panel.view.facts import Json
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trend_periods import Spread, TrendPeriod, decimated, merged, single, table, with_gaps
from controller.hmi.panel.view.trend_ring import TrendRing
from controller.program.tags import SIDES

SAMPLE_MS: Final = 200
SAMPLED_MS: Final = 600_000
"""Time for which every sample is kept, ms."""
PERIOD_MS: Final = 10_000
"""Length of a period, of which the lowest, mean and highest values are kept, ms."""
KEPT_MS: Final = 24 * 3_600_000
"""Time for which the periods are kept, ms."""
MOST_PERIODS: Final = KEPT_MS // PERIOD_MS
WRITE_MS: Final = 60_000
"""Time between two writes of the file, ms; flash memory wears with each write."""
LEAST_SPAN_MS: Final = 1_000
MOST_POINTS: Final = 1_000
"""Largest number of steps in an answer; gaps and the clock may add a point each."""
HOUR_MS: Final = 3_600_000
TREND_UNITS: Final = ("mm", "°", "N", "kPa", "%")
"""Units of the telemetry tags that are recorded."""

CYCLES: Final = (*(f"{side}.cycle_ms" for side in SIDES), *(f"{side}.waiting_ms" for side in SIDES))
ROWS: Final = tuple(f"{side}.rows_per_h" for side in SIDES)


class Trends:
    """Recorder of the telemetry and reader of the cycles; all times are those of the wall clock.

    Every sample of the last `SAMPLED_MS` is kept in memory, and every period of the last `KEPT_MS` in memory and in a
    file. The cycles are those of the history.
    """

    def __init__(
        self,
        telemetry: Telemetry | None,
        history: HistoryReader | None,
        file: TrendFile | None,
        wall_ms: Callable[[], int],
    ) -> None:
        """Load the periods of the file.

        Args:
            telemetry: Source of the samples.
            history: Source of the cycles.
            file: File of the periods; None = they are kept in memory only.
            wall_ms: Wall clock, ms since 1970 UTC.
        """
        self._telemetry = telemetry
        self._history = history
        self._file = file
        self._wall_ms = wall_ms
        self._names = [tag.name for tag in (telemetry.tags if telemetry else ()) if tag.unit in TREND_UNITS]
        self._samples = TrendRing(len(self._names), SAMPLED_MS // SAMPLE_MS)
        self._open: list[TrendPeriod] = []
        """Samples of the period that has not ended."""
        now_ms = wall_ms()
        stored = file.load(self._names, now_ms - KEPT_MS, now_ms) if file and self._names else []
        self._periods = TrendRing(len(self._names), MOST_PERIODS)
        for period in stored:
            self._periods.append(period)
        self._unwritten = TrendRing(len(self._names), MOST_PERIODS if file else 0)
        """Periods that are not yet in the file; while it cannot be written, the oldest ones are lost after a day."""
        self._writing = asyncio.Lock()

    def sample(self) -> None:
        """Record one sample, and end the period if its time has passed."""
        if self._telemetry is None or not self._names:
            return
        now_ms, values = self._wall_ms(), self._telemetry.values
        self._drop_from(now_ms)
        if self._open and self._open[0].utc_ms // PERIOD_MS != now_ms // PERIOD_MS:
            self._end_period()
        row = TrendPeriod(now_ms, SAMPLE_MS, tuple(single(values.get(name)) for name in self._names))
        self._samples.append(row)
        self._open.append(row)

    async def run(self) -> None:
        """Write the ended periods once a minute until cancelled."""
        while True:
            await asyncio.sleep(WRITE_MS / 1_000)
            await self.write()

    async def write(self) -> None:
        """Write the periods that are not yet in the file."""
        async with self._writing:
            rows = self._unwritten.copy()
            if rows and self._file is not None and await in_thread("trend file", self._file.append, self._names, rows):
                self._unwritten.drop_oldest(len(rows))

    async def close(self) -> None:
        """End the period, write it and close the file; what is recorded afterwards is not written."""
        self._end_period()
        await self.write()
        if self._file is not None:
            self._file.close()
            self._file = None

    async def answer(self, span_ms: int, end_ms: int | None, points: int) -> Json:
        """Return the trends of a time span.

        Args:
            span_ms: Length of the span, ms, from `LEAST_SPAN_MS` to `KEPT_MS`.
            end_ms: End of the span, ms since 1970 UTC; None = now.
            points: Number of points of a series, up to `MOST_POINTS`; a point has the extremes of its time.
        """
        now_ms = self._wall_ms()
        to_ms = now_ms if end_ms is None else min(end_ms, now_ms)
        from_ms = max(to_ms - span_ms, now_ms - KEPT_MS)
        step_ms = max(SAMPLE_MS, -(-span_ms // points))
        recorded = self._recorded(from_ms, to_ms, step_ms)
        tables = await in_thread("trends of the panel", self._tables, recorded, from_ms, to_ms, step_ms)
        return {
            "now_ms": now_ms,
            "from_ms": from_ms,
            "to_ms": to_ms,
            "step_ms": step_ms,
            "kept_ms": KEPT_MS,
            "tables": tables,
        }

    def _recorded(self, from_ms: int, to_ms: int, step_ms: int) -> Iterator[TrendPeriod]:
        """Return an iterator of another thread over the samples and periods of an interval, in chronological order.

        If a step has several periods, they are sufficient. They are copied at once, but become objects one by one, so
        that an answer takes no more memory the more has been recorded.
        """
        periods = self._periods.part(from_ms, to_ms)
        if step_ms >= PERIOD_MS:
            return chain(periods, [merged(self._open)] if self._open else [])
        first_ms = self._wall_ms() if self._samples.oldest_ms is None else self._samples.oldest_ms
        samples = self._samples.part(from_ms, to_ms)
        return chain((row for row in periods if row.end_ms <= first_ms), samples)

    def _tables(self, recorded: Iterable[TrendPeriod], from_ms: int, to_ms: int, step_ms: int) -> list[Json]:
        """Return a table of points for the telemetry, one for the cycles and one for the hours."""
        within = (row for row in recorded if from_ms <= row.end_ms and row.utc_ms < to_ms)
        hours = range(from_ms // HOUR_MS, -(-to_ms // HOUR_MS))
        cycles = []
        if self._history is not None:
            cycles = self._history.cycle_times(hours.start * HOUR_MS, hours.stop * HOUR_MS)
        timed = [TrendPeriod(cycle.utc_ms, 0, _values(cycle)) for cycle in cycles if from_ms <= cycle.utc_ms < to_ms]
        counts = Counter((cycle.utc_ms // HOUR_MS, cycle.side) for cycle in cycles)
        hourly = [
            TrendPeriod(max(hour * HOUR_MS, from_ms), 0, tuple(single(counts[hour, side]) for side in SIDES))
            for hour in (hours if cycles else ())
        ]
        hourly += [hourly[-1]._replace(utc_ms=to_ms)] if hourly else []
        return [
            table(self._names, list(with_gaps(decimated(within, step_ms)))),
            table(CYCLES, decimated(timed, step_ms)),
            table(ROWS, hourly),
        ]

    def _end_period(self) -> None:
        if self._open:
            period = merged(self._open)
            self._open.clear()
            self._periods.append(period)
            if self._file is not None:
                if len(self._unwritten) == MOST_PERIODS:
                    drop("trends")
                self._unwritten.append(period)

    def _drop_from(self, now_ms: int) -> None:
        """Drop what was recorded at or after a time: the wall clock has been set back, and times must ascend."""
        if self._is_reached(self._samples, now_ms):
            self._open.clear()
            for rows in (self._samples, self._periods):
                while self._is_reached(rows, now_ms):
                    rows.drop_newest()

    @staticmethod
    def _is_reached(rows: TrendRing, now_ms: int) -> bool:
        return rows.newest_ms is not None and rows.newest_ms >= now_ms


def _values(cycle: CycleTimes) -> tuple[Spread | None, ...]:
    """Return the times of a cycle in the order of `CYCLES`."""
    times = (cycle.cycle_ms, cycle.waiting_ms)
    return tuple(single(time if side == cycle.side else None) for time in times for side in SIDES)
