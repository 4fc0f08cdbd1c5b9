"""How fast simulated time goes against the clock on the wall."""

from __future__ import annotations

import threading
import time
from typing import Final

PAUSED: Final = 0
REAL_TIME: Final = 100
FASTEST: Final = 5_000
FLAT_OUT: Final = 65_535
"""No waiting at all: as fast as the computer can."""

_NEVER_MADE_GOOD_S: Final = 0.2
"""A computer that was busy for longer than this goes on from there and does not race."""


class PaceError(ValueError):
    """A pace that cannot be; one line with the remedy."""


class Pace:
    """Speed of simulated time in percent of real time; changed from any thread.

    Attributes:
        percent: 0 = paused, 100 = as on the wall, `FLAT_OUT` = without waiting.
    """

    def __init__(self, percent: int = REAL_TIME) -> None:
        """Begin at a pace.

        Raises:
            PaceError: There is no such pace.
        """
        self.percent = _checked(percent)
        self._changed = threading.Condition()
        self._due_s = time.perf_counter()

    def set(self, percent: int) -> None:
        """Go on at another pace.

        Raises:
            PaceError: There is no such pace; nothing happens.
        """
        _checked(percent)
        with self._changed:
            self.percent = percent
            self._due_s = time.perf_counter()
            self._changed.notify_all()

    def wait(self, for_ms: int, stop: threading.Event) -> bool:
        """Wait until another `for_ms` of simulated time are due; False when told to stop.

        A pause is left by `set`, or by `stop` within a tenth of a second.
        """
        with self._changed:
            self._due_s = max(self._due_s + self._span_s(for_ms), time.perf_counter() - _NEVER_MADE_GOOD_S)
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
        raise PaceError(f"pace {percent} %: give 0 (paused) to {FASTEST}, or {FLAT_OUT} for as fast as it can")
    return percent
