"""Gaps between output writes, and the seedlings that are lost with them.

A gap is a time between two output writes that exceeds a limit. Its seedlings are those lost (P, D and T) from the
beginning of the gap, which is the last write before it, to the end of the following cycle. An arm ends a cycle when its
slide leaves the feed position; the window of a gap ends when both arms have ended the cycle in which the gap began and
the next one, or when neither has ended a cycle for 20 s. Further gaps in the window belong to it. A machine without
gaps loses seedlings as well: the number that is usual in the same number of cycles, from the cycles outside windows so
far, is reported beside the number lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from plant_sim.links.io_module import IoModule

CYCLES: Final = 2
"""Cycles of a window: the one in which the gap began, and the following one."""
STANDSTILL_MS: Final = 20_000
"""Time without a cycle that ends a window, ms (assumed): twelve cups at 45 cups/min take 16 s."""
_LEFT_FEED_M: Final = 0.05
_AT_FEED_M: Final = 0.02
"""Positions at which a slide has left the feed position, and has returned to it (assumed; pick 1 is farther)."""


@dataclass(slots=True)
class Losses:
    """Seedlings lost so far, and incidents.

    Attributes:
        P: Seedlings lost while picking.
        D: Seedlings lost while carrying.
        T: Seedlings fallen outside the cups.
        incidents: Number of incidents.
    """

    P: int
    D: int
    T: int
    incidents: int

    def __sub__(self, before: Losses) -> Losses:
        return Losses(self.P - before.P, self.D - before.D, self.T - before.T, self.incidents - before.incidents)

    @property
    def seedlings(self) -> int:
        """Number of seedlings."""
        return self.P + self.D + self.T

    def text(self) -> str:
        """Return the number of seedlings by cause, and the incidents if there are any."""
        noun = "seedling" if self.seedlings == 1 else "seedlings"
        incidents = f", {self.incidents} incidents" if self.incidents else ""
        return f"{self.seedlings} {noun} lost (P {self.P}, D {self.D}, T {self.T}){incidents}"


@dataclass(slots=True)
class _Window:
    """Gap or gaps, and the time in which losses are attributed to them.

    Attributes:
        began_ms: Plant time of the last write before the first gap, ms.
        client: Client that made this write.
        before: Losses at this time.
        longest_ms: Longest gap so far, ms.
        gaps: Number of gaps.
        cycles: Cycles that each arm had ended when the first gap began.
        ended_ms: Plant time at which the latest gap ended, ms.
    """

    began_ms: int
    client: str
    before: Losses
    longest_ms: int
    gaps: int
    cycles: tuple[int, ...]
    ended_ms: int = 0

    def text(self) -> str:
        if self.gaps == 1:
            return f"gap of {self.longest_ms} ms between output writes of {self.client} at {self.began_ms} ms"
        return (
            f"{self.gaps} gaps of up to {self.longest_ms} ms between output writes of {self.client} from "
            f"{self.began_ms} ms"
        )


class GapWatch:
    """Watch for gaps of a module; it is called after every write and every advance of plant time."""

    def __init__(self, module: IoModule, *, limit_ms: int, tell: Callable[[str], None]) -> None:
        """Start to watch a module.

        Args:
            module: Module to watch.
            limit_ms: Longest time between two writes that is not a gap, ms.
            tell: Function that reports a line.

        Raises:
            ValueError: The limit is not positive.
        """
        if limit_ms <= 0:
            raise ValueError(f"gap limit {limit_ms} ms: must be 1 ms or more")
        self._module = module
        self._limit_ms = limit_ms
        self._tell = tell
        self._arms = tuple(module.plant.arms.values())
        self._is_away = [False] * len(self._arms)
        self._moved_ms = 0
        self._cycles = [0] * len(self._arms)
        self._seen: tuple[int, int] | None = None
        self._losses = self._count()
        self._last_ms: int | None = None
        self._client = ""
        self._before = self._losses
        self._cycles_before: tuple[int, ...] = tuple(self._cycles)
        self._in_gap = False
        self._was_tripped = False
        self._window: _Window | None = None
        self._window_cycles = self._window_losses = 0
        self._told_second: int | None = None
        module.observers.append(self._advanced)
        module.write_observers.append(self._written)

    def finish(self) -> None:
        """Report the window and the gap that have not ended; called at the end of the process."""
        if self._in_gap:
            timing, gap_ms = self._module.timing, self._module.plant.time_ms - (self._last_ms or 0)
            timing.longest_gap_ms = max(timing.longest_gap_ms, gap_ms)
        self._end_window("the end of the run")

    def _written(self, client: str, _levels: object) -> None:
        now_ms = self._module.plant.time_ms
        if self._last_ms is not None:
            timing = self._module.timing
            timing.longest_gap_ms = max(timing.longest_gap_ms, now_ms - self._last_ms)
        if self._in_gap:
            self._end_gap(now_ms)
        self._in_gap = False
        self._last_ms, self._client = now_ms, client
        self._before, self._cycles_before = self._count(), tuple(self._cycles)

    def _advanced(self) -> None:
        for number, arm in enumerate(self._arms):
            slide_m = arm.slide.x_m
            if not self._is_away[number] and slide_m > _LEFT_FEED_M:
                self._is_away[number] = True
                self._cycles[number] += 1
                self._moved_ms = self._module.plant.time_ms
            elif self._is_away[number] and slide_m < _AT_FEED_M:
                self._is_away[number] = False
        now_ms = self._module.plant.time_ms
        if self._last_ms is not None and not self._in_gap and now_ms - self._last_ms > self._limit_ms:
            self._begin_gap()
        if self._module.tripped and not self._was_tripped:
            self._tell(
                f"output watchdog tripped at {self._module.tripped_at_ms} ms: outputs safe; "
                f"last write by {self._client or 'no client'} at {self._last_ms} ms"
            )
        self._was_tripped = self._module.tripped
        if self._window is not None and not self._in_gap:
            self._check_window(self._window, now_ms)

    def _check_window(self, window: _Window, now_ms: int) -> None:
        """End the window if both arms have ended their cycles, or the machine stands still."""
        ended = (cycles - before for cycles, before in zip(self._cycles, window.cycles, strict=True))
        if min(ended) >= CYCLES:
            self._end_window("the end of the following cycle")
        elif now_ms - max(self._moved_ms, window.ended_ms) >= STANDSTILL_MS:
            self._end_window(f"a standstill of {STANDSTILL_MS // 1_000} s")

    def _begin_gap(self) -> None:
        self._in_gap = True
        self._module.timing.gaps += 1
        if self._window is None:
            began_ms = self._last_ms or 0
            self._window = _Window(began_ms, self._client, self._before, 0, 0, self._cycles_before)
        self._window.gaps += 1

    def _end_gap(self, now_ms: int) -> None:
        window = self._window
        length_ms = now_ms - (self._last_ms or 0)
        if window is not None:
            window.longest_ms, window.ended_ms = max(window.longest_ms, length_ms), now_ms
        if self._told_second != now_ms // 1_000:  # at most one line per second; every gap is counted
            self._told_second = now_ms // 1_000
            lost = self._count() - self._before
            suffix = f"; {lost.text()} so far" if lost.seedlings else ""
            self._tell(
                f"gap of {length_ms} ms between output writes of {self._client} at {self._last_ms} ms "
                f"(limit {self._limit_ms} ms){suffix}"
            )

    def _end_window(self, end: str) -> None:
        window, self._window = self._window, None
        if window is None:
            return
        if self._in_gap:
            window.longest_ms = max(window.longest_ms, self._module.plant.time_ms - (self._last_ms or 0))
        lost = self._count() - window.before
        cycles = sum(self._cycles) - sum(window.cycles)
        self._window_cycles += cycles
        self._window_losses += lost.seedlings
        self._module.timing.seedlings_lost_after_gaps += lost.seedlings
        if lost.seedlings:
            self._tell(f"{window.text()}: {lost.text()} from the gap to {end}; {self._usual(cycles)}")

    def _usual(self, cycles: int) -> str:
        """Return the number of seedlings that is lost in some cycles of one arm without a gap."""
        quiet = sum(self._cycles) - self._window_cycles
        if not quiet:
            return "no cycle without a gap to compare with"
        losses = self._count().seedlings - self._window_losses
        return f"usual without a gap: {losses / quiet * cycles:.1f}"

    def _count(self) -> Losses:
        """Return the losses so far, counted again only if a seedling has moved or an incident has occurred."""
        plant = self._module.plant
        if plant.happenings != self._seen:
            self._seen = plant.happenings
            counts = plant.counts()
            self._losses = Losses(counts.P, counts.D, counts.T, len(plant.events))
        return self._losses
