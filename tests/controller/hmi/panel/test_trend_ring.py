"""Ring buffer of trend periods: the same periods as a deque, in memory that does not grow."""

from __future__ import annotations

import random
import sys
from collections import deque

from controller.hmi.panel.view.trend_periods import Spread, TrendPeriod
from controller.hmi.panel.view.trend_ring import TrendRing

SERIES, MOST = 3, 7


def period(number: int, drawn: random.Random) -> TrendPeriod:
    low = drawn.uniform(-1e6, 1e6)
    spread = Spread(low, low + drawn.random(), low + 2)
    values = tuple(drawn.choice([spread, None]) for _ in range(SERIES))
    return TrendPeriod(1_795_000_000_000 + number, drawn.randrange(10_000), values)


def test_it_has_the_periods_of_a_deque_after_any_changes() -> None:
    drawn = random.Random(1)
    ring, expected = TrendRing(SERIES, MOST), deque[TrendPeriod](maxlen=MOST)
    copies = []
    for number in range(2_000):
        change = drawn.random()
        if expected and change < 0.3:
            ring.drop_newest()
            expected.pop()
        elif change < 0.35:
            count = drawn.randint(0, len(expected))
            ring.drop_oldest(count)
            expected = deque([*expected][count:], MOST)
        else:
            ring.append(added := period(number, drawn))
            expected.append(added)
        assert [*ring] == [*expected]
        assert len(ring) == len(expected)
        ends = (expected[0].utc_ms, expected[-1].utc_ms) if expected else (None, None)
        assert (ring.oldest_ms, ring.newest_ms) == ends
        if number % 100 == 0:
            copies.append((ring.copy(), [*expected]))
    assert all([*copied] == periods for copied, periods in copies)


def test_its_memory_is_that_of_an_empty_one() -> None:
    drawn = random.Random(2)
    ring = TrendRing(SERIES, MOST)
    sizes = set()
    for number in range(3 * MOST):
        sizes.add(sys.getsizeof(ring._times) + sys.getsizeof(ring._values))
        ring.append(period(number, drawn))
    assert len(sizes) == 1
