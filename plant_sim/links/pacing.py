"""Real-time pacing: the number of ticks due, computed from absolute deadlines."""

from __future__ import annotations


class Pacer:
    """Schedule of ticks that makes plant time follow the elapsed time supplied by the caller.

    Delays are made up, at most `catch_up_ms` at a time. The excess is dropped and counted, so that plant time does
    not run too fast after the computer has been suspended.

    >>> pacer = Pacer(tick_ms=5, catch_up_ms=200)
    >>> pacer.ticks_due(4), pacer.ticks_due(5), pacer.ticks_due(17)
    (0, 1, 2)
    >>> pacer.ticks_due(1_015), pacer.dropped_ms
    (40, 800)

    Attributes:
        tick_ms: Length of a tick, ms.
        dropped_ms: Time that was dropped, ms.
    """

    def __init__(self, *, tick_ms: int = 1, catch_up_ms: int = 200) -> None:
        """Initialise at elapsed time 0.

        Args:
            tick_ms: Length of a tick, ms.
            catch_up_ms: Maximum plant time released at a time, ms.

        Raises:
            ValueError: `tick_ms` is not positive, or exceeds `catch_up_ms`.
        """
        if not 0 < tick_ms <= catch_up_ms:
            raise ValueError(f"tick_ms is {tick_ms}: must be 1 to {catch_up_ms} (catch_up_ms)")
        self.tick_ms = tick_ms
        self.dropped_ms = 0
        self._most_ticks = catch_up_ms // tick_ms
        self._settled_ms = 0  # released or dropped

    def ticks_due(self, elapsed_ms: int) -> int:
        """Return the number of ticks due by `elapsed_ms`, and mark them as released."""
        behind = (elapsed_ms - self._settled_ms) // self.tick_ms
        ticks = min(behind, self._most_ticks)
        self.dropped_ms += (behind - ticks) * self.tick_ms
        self._settled_ms += behind * self.tick_ms
        return ticks

    @property
    def next_deadline_ms(self) -> int:
        """Elapsed time at which the next tick is due, ms."""
        return self._settled_ms + self.tick_ms
