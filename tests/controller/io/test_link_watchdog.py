"""Link watchdog: timeout, latching and reset."""

from __future__ import annotations

import pytest

from controller.io.link import LinkWatchdog


@pytest.mark.parametrize("start_ms", [0, 12_345])
def test_the_watchdog_expires_at_the_limit_and_not_before(start_ms: int) -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.feed(start_ms)
    assert [watchdog.expired(start_ms + ms) for ms in (0, 98, 99)] == [False] * 3
    watchdog.feed(start_ms + 99)
    assert not watchdog.expired(start_ms + 198)
    assert watchdog.expired(start_ms + 199)


@pytest.mark.parametrize("start_ms", [0, 12_345])
def test_without_any_exchange_the_limit_runs_from_the_first_call(start_ms: int) -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    assert not watchdog.expired(start_ms)
    assert not watchdog.expired(start_ms + 99)
    assert watchdog.expired(start_ms + 100)


def test_an_expired_watchdog_stays_expired_until_it_is_reset_and_then_restarts() -> None:
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.feed(0)
    assert watchdog.expired(100)
    watchdog.feed(101)
    assert watchdog.expired(101)
    watchdog.reset()
    assert not watchdog.expired(500)
    assert not watchdog.expired(599)
    assert watchdog.expired(600)


def test_a_late_exchange_expires_the_watchdog() -> None:
    """The watchdog expires even if it was not queried between the exchanges."""
    watchdog = LinkWatchdog(limit_ms=100)
    watchdog.feed(0)
    watchdog.feed(100)
    assert watchdog.expired(100)


def test_the_limit_must_be_positive() -> None:
    with pytest.raises(ValueError, match="at least 1, not 0"):
        LinkWatchdog(limit_ms=0)
