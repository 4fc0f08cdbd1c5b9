"""Ring buffer of trend periods; its memory is allocated at once, so that a panel does not grow while it records."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Iterator
from itertools import chain
from typing import Final

from controller.hmi.panel.view.trend_periods import Spread, TrendPeriod

_PARTS: Final = len(Spread._fields)
_UNKNOWN: Final = Spread(math.nan, math.nan, math.nan)


class TrendRing:
    """The latest periods, oldest first; a new one takes the place of the oldest if the ring is full."""

    def __init__(self, series: int, most: int) -> None:
        """Allocate an empty ring.

        Args:
            series: Number of series of a period.
            most: Number of periods that are kept.
        """
        self._width, self._most = _PARTS * series, most
        self._times = array("q", bytes(2 * most * 8))
        self._values = array("d", bytes(self._width * most * 8))
        self._first = self._count = 0

    def __len__(self) -> int:
        """Return the number of periods."""
        return self._count

    def __iter__(self) -> Iterator[TrendPeriod]:
        """Yield the periods, the oldest first."""
        return (self._period(number) for number in range(self._count))

    @property
    def oldest_ms(self) -> int | None:
        """Start of the oldest period, ms since 1970 UTC; None = there is none."""
        return self._utc_ms(0) if self._count else None

    @property
    def newest_ms(self) -> int | None:
        """Start of the newest period, ms since 1970 UTC; None = there is none."""
        return self._utc_ms(self._count - 1) if self._count else None

    def append(self, period: TrendPeriod) -> None:
        """Add a period that follows the newest one."""
        at = self._slot(self._count)
        if self._count < self._most:
            self._count += 1
        else:
            self._first = self._slot(1)
        self._times[2 * at], self._times[2 * at + 1] = period.utc_ms, period.for_ms
        values = array("d", chain.from_iterable(spread or _UNKNOWN for spread in period.values))
        self._values[self._width * at : self._width * (at + 1)] = values

    def drop_newest(self) -> None:
        """Drop the newest period."""
        self._count -= 1

    def drop_oldest(self, count: int) -> None:
        """Drop the oldest periods, as many as stated."""
        self._first = self._slot(count)
        self._count -= count

    def copy(self) -> TrendRing:
        """Return a full ring with the same periods, which another thread can read."""
        return self._copied(0, self._count)

    def part(self, from_ms: int, to_ms: int) -> TrendRing:
        """Return a full ring with the periods that have a time in an interval, which another thread can read.

        The first period may end before the interval.

        Args:
            from_ms: Start of the interval, ms since 1970 UTC.
            to_ms: End of the interval, ms since 1970 UTC, exclusive.
        """
        begin, end = (bisect_left(range(self._count), at_ms, key=self._utc_ms) for at_ms in (from_ms, to_ms))
        return self._copied(max(0, begin - 1), end)

    def _copied(self, begin: int, end: int) -> TrendRing:
        """Return a full ring with consecutive periods; it takes no more memory than they need."""
        count = max(0, end - begin)
        copied = TrendRing(0, 0)
        copied._width, copied._most, copied._count = self._width, count, count
        at = self._slot(begin) if count else 0
        for slots in (slice(at, at + count), slice(0, max(0, at + count - self._most))):
            copied._times += self._times[2 * slots.start : 2 * slots.stop]
            copied._values += self._values[self._width * slots.start : self._width * slots.stop]
        return copied

    def _utc_ms(self, number: int) -> int:
        return self._times[2 * self._slot(number)]

    def _slot(self, number: int) -> int:
        return (self._first + number) % self._most

    def _period(self, number: int) -> TrendPeriod:
        at = self._slot(number)
        parts = iter(self._values[self._width * at : self._width * (at + 1)])
        spreads = (Spread(*each) for each in zip(parts, parts, parts, strict=True))
        values = tuple(None if math.isnan(spread.mean) else spread for spread in spreads)
        return TrendPeriod(self._times[2 * at], self._times[2 * at + 1], values)
