"""Clocks of the core; no other core module reads the system time. Times are integers in ms."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from typing import Protocol

from controller.common.saved import Saved


class Clock(Protocol):
    """Monotonic clock: time elapsed since a fixed instant."""

    def now_ms(self) -> int:
        """Return the time in ms."""
        ...


class MonotonicClock:
    """Monotonic system clock that starts at 0 when created."""

    def __init__(self) -> None:
        self._start_ns = time.monotonic_ns()

    def now_ms(self) -> int:
        """Return the time since creation in ms."""
        return (time.monotonic_ns() - self._start_ns) // 1_000_000


def utc_ms() -> int:
    """Return the wall-clock time in ms since 1970-01-01 UTC, for timestamps in records; the program never uses it."""
    return time.time_ns() // 1_000_000


def utc_text(at_ms: int) -> str:
    """Return a wall-clock time as text.

    >>> utc_text(0)
    '1970-01-01T00:00:00Z'
    """
    return datetime.fromtimestamp(at_ms / 1000, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


class SimulatedClock(Saved):
    """Clock that changes only when it is advanced."""

    SAVED = ("_now_ms",)

    def __init__(self) -> None:
        self._now_ms = 0

    def now_ms(self) -> int:
        """Return the simulated time in ms."""
        return self._now_ms

    def advance(self, for_ms: int) -> None:
        """Advance the clock.

        Args:
            for_ms: Duration, ms.

        Raises:
            ValueError: The duration is negative.
        """
        if for_ms < 0:
            raise ValueError(f"cannot advance a clock by {for_ms} ms: the duration must not be negative")
        self._now_ms += for_ms
