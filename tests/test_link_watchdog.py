"""When the controller calls the field lost."""

from __future__ import annotations

import pytest

from controller.io.link import LinkWatchdog


@pytest.mark.parametrize("start_ms", [0, 12_345])
def test_the_limit_is_the_last_silence_still_in_order(start_ms: int) -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.good(start_ms)
    assert [watchdog.lost(start_ms + ms) for ms in (0, 99, 100)] == [False] * 3
    watchdog.good(start_ms + 100)
    assert not watchdog.lost(start_ms + 200)
    assert watchdog.lost(start_ms + 201)


@pytest.mark.parametrize("start_ms", [0, 12_345])
def test_without_any_exchange_the_limit_runs_from_the_first_question(start_ms: int) -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    assert not watchdog.lost(start_ms)
    assert not watchdog.lost(start_ms + 100)
    assert watchdog.lost(start_ms + 101)


def test_lost_stays_lost_until_reset_and_then_starts_anew() -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.good(0)
    assert watchdog.lost(101)
    watchdog.good(102)
    assert watchdog.lost(102)
    watchdog.reset()
    assert not watchdog.lost(500)
    assert not watchdog.lost(600)
    assert watchdog.lost(601)


def test_an_exchange_that_comes_too_late_is_a_loss() -> None:
    """Nobody asked in between; the gap was there all the same."""
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.good(0)
    watchdog.good(101)
    assert watchdog.lost(101)


def test_the_limit_must_be_positive() -> None:
    with pytest.raises(ValueError, match="at least 1 ms"):
        LinkWatchdog(limit_ms=0)
