"""Plant time that follows the wall clock in ticks of 1 ms, and the lateness of the ticks."""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable
from typing import Final

from plant_sim.links.pacing import Pacer
from plant_sim.links.write_timing import LinkTiming

MOST_TICKS_AT_A_REQUEST: Final = 5
"""Ticks made up before a request is answered (assumed). A longer delay is made up between the requests, so that those
that arrived during the delay take effect in the course of it."""


def precise_loop() -> asyncio.AbstractEventLoop:
    """Return an event loop whose timers are accurate to microseconds; epoll and poll round them up to 1 ms."""
    return asyncio.SelectorEventLoop(selectors.SelectSelector())


class RealTime:
    """Ticks of plant time by the clock of the event loop.

    Attributes:
        pacer: Schedule of the ticks, including `dropped_ms`.
    """

    def __init__(self, advance: Callable[[int], bool], timing: LinkTiming) -> None:
        """Create a time base that has not been started.

        Args:
            advance: Function that advances plant time by some milliseconds and returns False after a failure.
            timing: Receives the time from the deadline of each tick to its execution, and the dropped time.
        """
        self.pacer = Pacer()
        self._timing = timing
        self._advance = advance
        self._elapsed_s: Callable[[], float] | None = None

    async def run(self) -> None:
        """Advance plant time until it fails or the task is cancelled."""
        loop = asyncio.get_running_loop()
        start_s = loop.time()

        def clock() -> float:
            return loop.time() - start_s

        self._elapsed_s = clock
        while True:
            for deadline_ms in self._release(clock()):
                if not self._tick(deadline_ms, clock):
                    return
                await asyncio.sleep(0)  # serves clients while making up a delay
            await asyncio.sleep(max(0.0, self.pacer.next_deadline_ms / 1_000 - clock()))

    def catch_up(self) -> None:
        """Execute the ticks that are due, unless they are many; called before a request is answered."""
        clock = self._elapsed_s
        if clock is None:
            return
        elapsed_s = clock()
        if 0 <= elapsed_s * 1_000 - self.pacer.next_deadline_ms < MOST_TICKS_AT_A_REQUEST:
            for deadline_ms in self._release(elapsed_s):
                self._tick(deadline_ms, clock)

    def _release(self, elapsed_s: float) -> range:
        """Return the deadlines of the ticks that are due, ms."""
        first_ms = self.pacer.next_deadline_ms
        ticks = self.pacer.ticks_due(int(elapsed_s * 1_000))
        self._timing.dropped_ms = self.pacer.dropped_ms
        return range(first_ms, first_ms + ticks * self.pacer.tick_ms, self.pacer.tick_ms)

    def _tick(self, deadline_ms: int, clock: Callable[[], float]) -> bool:
        """Execute a tick and record its lateness; return False after a failure."""
        self._timing.lateness.add(clock() - deadline_ms / 1_000)
        return self._advance(self.pacer.tick_ms)
