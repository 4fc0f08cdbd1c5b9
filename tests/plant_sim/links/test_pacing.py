"""Pacing with a simulated clock."""

from __future__ import annotations

import pytest

from plant_sim.links.pacing import Pacer


class TestPacer:
    """Ticks of a pacer with a simulated clock."""

    def test_ticks_come_at_their_deadlines_not_before(self) -> None:
        pacer = Pacer(tick_ms=5, catch_up_ms=200)
        assert [pacer.ticks_due(ms) for ms in (0, 4, 5, 9, 10, 11, 15)] == [0, 0, 1, 0, 1, 0, 1]
        assert pacer.next_deadline_ms == 20

    def test_delays_up_to_the_limit_are_caught_up(self) -> None:
        pacer = Pacer(tick_ms=5, catch_up_ms=200)
        assert pacer.ticks_due(204) == 40
        assert pacer.dropped_ms == 0
        assert pacer.next_deadline_ms == 205

    def test_delays_beyond_the_limit_are_dropped_and_counted(self) -> None:
        pacer = Pacer(tick_ms=5, catch_up_ms=200)
        assert pacer.ticks_due(205) == 40
        assert pacer.dropped_ms == 5
        assert pacer.ticks_due(1_213) == 40
        assert pacer.dropped_ms == 810
        assert pacer.next_deadline_ms == 1_215

    def test_irregular_steps_lose_no_time(self) -> None:
        pacer = Pacer(tick_ms=5, catch_up_ms=200)
        assert sum(pacer.ticks_due(ms) for ms in range(0, 10_001, 7)) == 9_996 // 5

    @pytest.mark.parametrize(("tick_ms", "catch_up_ms"), [(0, 200), (-5, 200), (5, 4)])
    def test_invalid_times_are_rejected(self, tick_ms: int, catch_up_ms: int) -> None:
        with pytest.raises(ValueError, match="tick_ms"):
            Pacer(tick_ms=tick_ms, catch_up_ms=catch_up_ms)
