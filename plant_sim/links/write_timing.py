"""Timing of the output writes, by client, and the state of the link to a PLC."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from typing import Final

from plant_sim.links.durations import Durations

MOST_CLIENTS: Final = 8
"""Number of clients whose timing is kept; a client that connects again has another port, and counts as another one."""


@dataclass(slots=True)
class ClientTiming:
    """Output writes of one client.

    A client may write its outputs in several requests. Its period is therefore the time between two writes of the
    output that it has written first.

    Attributes:
        first_output: Lowest output of the first write.
        writes: Number of writes.
        periods: Times between two writes of the first output.
        longest_gap_s: Longest time between two writes of any output, s.
    """

    first_output: int
    writes: int = 0
    periods: Durations = field(default_factory=Durations)
    longest_gap_s: float = 0.0
    _period_from_s: float | None = None
    _last_s: float | None = None

    def add(self, first: int, last: int, now_s: float) -> None:
        """Add a write of the outputs `first` to `last`, or of some of them, at a time, s."""
        self.writes += 1
        if self._last_s is not None:
            self.longest_gap_s = max(self.longest_gap_s, now_s - self._last_s)
        self._last_s = now_s
        if first <= self.first_output <= last:
            if self._period_from_s is not None:
                self.periods.add(now_s - self._period_from_s)
            self._period_from_s = now_s

    def text(self) -> str:
        """Return the figures in one line, without the client."""
        periods = self.periods
        half_s, most_s = periods.percentile_s(50), periods.percentile_s(99)
        if half_s is None or most_s is None:
            return f"{self.writes} writes"
        return (
            f"{self.writes} writes, period {1e3 * half_s:.2f} ms (p50), {1e3 * most_s:.2f} ms (p99), "
            f"jitter {1e3 * periods.deviation_s:.2f} ms, longest gap {1e3 * self.longest_gap_s:.1f} ms"
        )


class PlcState(enum.IntEnum):
    """State of the link to a PLC of which the plant is a client, in the telemetry."""

    NONE = 0
    CONNECTED = 1
    LOST = 2


@dataclass(slots=True)
class LinkTiming:
    """Measured timing of the links of a module.

    Attributes:
        clients: Timing of the clients that have written outputs, the latest last.
        lateness: Lateness of the ticks of real time; empty in lock step.
        dropped_ms: Plant time dropped because the computer was late by more than is made up, ms.
        longest_gap_ms: Longest plant time between two writes of outputs by any client, ms.
        gaps: Number of gaps beyond the limit.
        seedlings_lost_after_gaps: Seedlings lost from the beginning of a gap to the end of the following cycle.
        plc_state: State of the link to a PLC.
        plc_losses: Number of times that the link to the PLC has been lost.
    """

    clients: dict[str, ClientTiming] = field(default_factory=dict)
    lateness: Durations = field(default_factory=Durations)
    dropped_ms: int = 0
    longest_gap_ms: int = 0
    gaps: int = 0
    seedlings_lost_after_gaps: int = 0
    plc_state: PlcState = PlcState.NONE
    plc_losses: int = 0

    def add(self, client: str, first: int, last: int, now_s: float) -> None:
        """Add a write of the outputs `first` to `last`, or of some of them, by a client at a time, s."""
        timing = self.clients.pop(client, None) or ClientTiming(first)
        timing.add(first, last, now_s)
        self.clients[client] = timing
        if len(self.clients) > MOST_CLIENTS:
            del self.clients[next(iter(self.clients))]

    @property
    def latest(self) -> ClientTiming | None:
        """Timing of the client that wrote last; None before the first write."""
        return next(reversed(self.clients.values()), None)

    def lines(self) -> list[str]:
        """Return the measured timing, one line for the ticks, for each client and for the gaps."""
        lines = []
        half_s, most_s = self.lateness.percentile_s(50), self.lateness.percentile_s(99)
        if half_s is not None and most_s is not None:
            lines.append(
                f"ticks of 1 ms: {self.lateness.count}, late by {1e3 * half_s:.2f} ms (p50), {1e3 * most_s:.2f} ms "
                f"(p99), {1e3 * self.lateness.longest_s:.1f} ms (longest); {self.dropped_ms} ms dropped"
            )
        lines += [f"outputs from {client}: {timing.text()}" for client, timing in self.clients.items()]
        if self.gaps:
            lines.append(
                f"gaps between output writes: {self.gaps}, the longest {self.longest_gap_ms} ms; "
                f"{self.seedlings_lost_after_gaps} seedlings lost from a gap to the end of the following cycle"
            )
        return lines
