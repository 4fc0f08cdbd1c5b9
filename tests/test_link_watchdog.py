"""When the controller calls the field lost."""

from __future__ import annotations

import pytest

from controller.io.link import LinkWatchdog


@pytest.mark.parametrize("start_ms", [0, 12_345])
def test_the_field_is_lost_at_the_limit_and_not_before(start_ms: int) -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.good(start_ms)
    assert [watchdog.lost(start_ms + ms) for ms in (0, 98, 99)] == [False] * 3
    watchdog.good(start_ms + 99)
    assert not watchdog.lost(start_ms + 198)
    assert watchdog.lost(start_ms + 199)


@pytest.mark.parametrize("start_ms", [0, 12_345])
def test_without_any_exchange_the_limit_runs_from_the_first_question(start_ms: int) -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    assert not watchdog.lost(start_ms)
    assert not watchdog.lost(start_ms + 99)
    assert watchdog.lost(start_ms + 100)


def test_lost_stays_lost_until_reset_and_then_starts_anew() -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.good(0)
    assert watchdog.lost(100)
    watchdog.good(101)
    assert watchdog.lost(101)
    watchdog.reset()
    assert not watchdog.lost(500)
    assert not watchdog.lost(599)
    assert watchdog.lost(600)


def test_an_exchange_that_comes_too_late_is_a_loss() -> None:
    """Nobody asked in between; the gap was there all the same."""
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.good(0)
    watchdog.good(100)
    assert watchdog.lost(100)


def test_the_limit_must_be_positive() -> None:
    with pytest.raises(ValueError, match="at least 1 ms"):
        LinkWatchdog(limit_ms=0)
