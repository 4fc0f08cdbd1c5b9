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
        if expected:
            from_ms = expected[0].utc_ms + drawn.randint(-3, number)
            to_ms = from_ms + drawn.randint(0, MOST)
            inside = [each for each in expected if from_ms <= each.utc_ms < to_ms]
            before = [each for each in expected if each.utc_ms < from_ms][-1:]
            assert [*ring.part(from_ms, to_ms)] == [*before, *inside]
    assert all([*copied] == periods for copied, periods in copies)


def test_a_copy_takes_only_the_memory_of_its_periods() -> None:
    drawn = random.Random(3)
    ring = TrendRing(SERIES, 1_000)
    for number in range(1_010):
        ring.append(period(number, drawn))
    two = TrendRing(SERIES, 2)
    part = ring.part(ring.oldest_ms + 990, ring.oldest_ms + 992) if ring.oldest_ms is not None else ring
    assert len(part) == 3  # with the one before
    assert sys.getsizeof(part._values) < 2 * sys.getsizeof(two._values)


def test_its_memory_is_that_of_an_empty_one() -> None:
    drawn = random.Random(2)
    ring = TrendRing(SERIES, MOST)
    sizes = set()
    for number in range(3 * MOST):
        sizes.add(sys.getsizeof(ring._times) + sys.getsizeof(ring._values))
        ring.append(period(number, drawn))
    assert len(sizes) == 1
