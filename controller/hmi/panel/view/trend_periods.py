"""Periods of trends: the lowest, mean and highest value of each series in a time, reduced to a number of points."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, pairwise
from typing import Final, NamedTuple

from controller.hmi.panel.view.facts import Json

GAP_MS: Final = 2_000
"""Shortest time without a period that is shown as a gap, ms: samples of a busy computer are up to a second late."""


class Spread(NamedTuple):
    """Lowest, mean and highest value of a series in a period, in the unit of the series."""

    low: float
    mean: float
    high: float


class TrendPeriod(NamedTuple):
    """Values of all series in a period.

    Attributes:
        utc_ms: Start of the period, ms since 1970 UTC.
        for_ms: Length of the period, ms.
        values: Values in the order of the series; None if a series has no value in the period.
    """

    utc_ms: int
    for_ms: int
    values: tuple[Spread | None, ...]

    @property
    def end_ms(self) -> int:
        """End of the period, ms since 1970 UTC."""
        return self.utc_ms + self.for_ms


def single(value: float | None) -> Spread | None:
    """Return a single value as a spread."""
    return None if value is None else Spread(value, value, value)


def merged(periods: Sequence[TrendPeriod]) -> TrendPeriod:
    """Return consecutive periods as one period, which has their lowest and highest values.

    Examples:
        >>> dip = TrendPeriod(200, 200, (single(310.0),))
        >>> merged([TrendPeriod(0, 200, (single(390.0),)), dip, TrendPeriod(400, 200, (None,))])
        TrendPeriod(utc_ms=0, for_ms=600, values=(Spread(low=310.0, mean=350.0, high=390.0),))
    """
    if len(periods) == 1:
        return periods[0]
    columns = zip(*(period.values for period in periods), strict=True)
    return TrendPeriod(periods[0].utc_ms, periods[-1].end_ms - periods[0].utc_ms, tuple(map(_merged, columns)))


def _merged(column: Iterable[Spread | None]) -> Spread | None:
    known = [spread for spread in column if spread is not None]
    if not known:
        return None
    mean = sum(spread.mean for spread in known) / len(known)
    return Spread(min(spread.low for spread in known), round(mean, 3), max(spread.high for spread in known))


def decimated(periods: Iterable[TrendPeriod], step_ms: int) -> list[TrendPeriod]:
    """Return the periods of each step of the wall clock as one period.

    Args:
        periods: Periods in chronological order.
        step_ms: Length of a step, ms.
    """
    return [merged(list(group)) for _, group in groupby(periods, lambda period: period.utc_ms // step_ms)]


def with_gaps(periods: Sequence[TrendPeriod]) -> Iterator[TrendPeriod]:
    """Yield the periods, with a period without values in each gap."""
    for period, following in pairwise(periods):
        yield period
        if following.utc_ms - period.end_ms >= GAP_MS:
            yield TrendPeriod(period.end_ms, 0, (None,) * len(period.values))
    yield from periods[-1:]


def table(names: Sequence[str], periods: Sequence[TrendPeriod]) -> Json:
    """Return periods as columns for the page: the time of each point, ms since 1970 UTC, and the values by series."""
    return {
        "times": [period.utc_ms + period.for_ms // 2 for period in periods],
        "series": {name: _parts([period.values[n] for period in periods]) for n, name in enumerate(names)},
    }


def _parts(values: Sequence[Spread | None]) -> Json:
    """Return the lowest, mean and highest values as one list each."""
    return {part: [None if spread is None else getattr(spread, part) for spread in values] for part in Spread._fields}
