"""Pace of simulated time relative to real time."""

from __future__ import annotations

import threading
import time
from typing import Final

from controller.common.stop_request import Stop

PAUSED: Final = 0
REAL_TIME: Final = 100
FASTEST: Final = 5_000
"""Highest pace with a speed limit, percent."""
FLAT_OUT: Final = 65_535
"""Unlimited pace: as fast as the computer permits."""

_MAX_BACKLOG_S: Final = 0.2
"""Longest delay that is caught up, s; the rest of a longer delay, as on a busy computer, is ignored."""


class PaceError(ValueError):
    """Raised for an invalid pace; the message is one line with the remedy."""


class Pace:
    """Speed of simulated time as a percentage of real time; thread-safe.

    Attributes:
        percent: 0 = paused, 100 = real time, `FLAT_OUT` = unlimited.
    """

    def __init__(self, percent: int = REAL_TIME) -> None:
        """Create a pace.

        Raises:
            PaceError: The pace is invalid.
        """
        self.percent = _checked(percent)
        self._changed = threading.Condition()
        self._due_s = time.perf_counter()

    def set(self, percent: int) -> None:
        """Change the pace.

        Raises:
            PaceError: The pace is invalid; nothing is changed.
        """
        _checked(percent)
        with self._changed:
            self.percent = percent
            self._due_s = time.perf_counter()
            self._changed.notify_all()

    def wait(self, for_ms: int, stop: Stop) -> bool:
        """Wait until the next `for_ms` of simulated time has elapsed; return False if `stop` is set.

        A pause ends with `set`, or within 0.1 s after `stop` is set.
        """
        with self._changed:
            self._due_s = max(self._due_s + self._span_s(for_ms), time.perf_counter() - _MAX_BACKLOG_S)
            while not stop.is_set():
                left_s = self._due_s - time.perf_counter()
                if self.percent != PAUSED and left_s <= 0:
                    return True
                self._changed.wait(0.1 if self.percent == PAUSED else min(left_s, 0.1))
        return False

    def _span_s(self, for_ms: int) -> float:
        return 0.0 if self.percent in (PAUSED, FLAT_OUT) else for_ms / (10.0 * self.percent)


def _checked(percent: int) -> int:
    if percent != FLAT_OUT and not PAUSED <= percent <= FASTEST:
        raise PaceError(f"pace {percent} %: must be 0 (paused) to {FASTEST}, or {FLAT_OUT} (unlimited)")
    return percent
