"""How much plant time is due: whole ticks that follow a clock by absolute deadlines."""

from __future__ import annotations


class Pacer:
    """Hands out ticks so that plant time follows elapsed time. Pure logic: time is passed in.

    Being late is made good, but never by more than `catch_up_ms` at once: what exceeds it is
    dropped and counted, so that a machine that was asleep does not race through the gap.

    >>> pacer = Pacer(tick_ms=5, catch_up_ms=200)
    >>> pacer.ticks_due(4), pacer.ticks_due(5), pacer.ticks_due(17)
    (0, 1, 2)
    >>> pacer.ticks_due(1_015), pacer.dropped_ms
    (40, 800)

    Attributes:
        tick_ms: Length of a tick, ms.
        dropped_ms: Time that will never be made good, ms.
    """

    def __init__(self, *, tick_ms: int = 5, catch_up_ms: int = 200) -> None:
        """Start at elapsed time 0.

        Args:
            tick_ms: Length of a tick, ms.
            catch_up_ms: Most plant time handed out at once, ms.

        Raises:
            ValueError: no whole tick fits.
        """
        if not 0 < tick_ms <= catch_up_ms:
            raise ValueError(f"tick_ms {tick_ms} must be positive and within {catch_up_ms}")
        self.tick_ms = tick_ms
        self.dropped_ms = 0
        self._most_ticks = catch_up_ms // tick_ms
        self._settled_ms = 0  # handed out or dropped

    def ticks_due(self, elapsed_ms: int) -> int:
        """Take the ticks due by `elapsed_ms`."""
        behind = (elapsed_ms - self._settled_ms) // self.tick_ms
        ticks = min(behind, self._most_ticks)
        self.dropped_ms += (behind - ticks) * self.tick_ms
        self._settled_ms += behind * self.tick_ms
        return ticks

    @property
    def next_deadline_ms(self) -> int:
        """Elapsed time at which the next tick is due, ms."""
        return self._settled_ms + self.tick_ms
