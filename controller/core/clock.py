"""Clocks: the only place of the core that reads one. Times are integer ms."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Gives the time since some fixed instant, never going back."""

    def now_ms(self) -> int:
        """Return the time in ms."""
        ...


class MonotonicClock:
    """The machine's own clock, starting at 0 when created."""

    def __init__(self) -> None:
        self._start_ns = time.monotonic_ns()

    def now_ms(self) -> int:
        """Return the time since creation in ms."""
        return (time.monotonic_ns() - self._start_ns) // 1_000_000


def utc_ms() -> int:
    """Return the wall clock, ms since 1970 UTC: for records that people read, never for the program."""
    return time.time_ns() // 1_000_000


class SimulatedClock:
    """A clock that stands until it is advanced."""

    def __init__(self) -> None:
        self._now_ms = 0

    def now_ms(self) -> int:
        """Return the simulated time in ms."""
        return self._now_ms

    def advance(self, for_ms: int) -> None:
        """Let time pass.

        Raises:
            ValueError: A clock does not go back.
        """
        if for_ms < 0:
            raise ValueError(f"a clock does not go back: {for_ms} ms")
        self._now_ms += for_ms
