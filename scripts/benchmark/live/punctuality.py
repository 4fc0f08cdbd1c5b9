"""Lateness of scans: statistics of a histogram, and the lateness and steal time in each second of a run."""

from __future__ import annotations

import socket
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from controller.hmi.access import status_registers as own
from controller.hmi.modbus.fx3u_map import register_address
from controller.io.loop import BOUNDS_US
from plant_sim.twin.process import LiveError
from scripts.benchmark import host
from scripts.benchmark.live.hmi_load import percentile_ms, read_registers

_R_OVERRUNS: Final = 10


@dataclass(frozen=True, slots=True)
class Punctuality:
    """Lateness statistics of a loop with a period of 10 ms.

    Attributes:
        p99_ms: Upper bound of the histogram bucket that contains the 99th percentile of the lateness, ms.
        latest_ms: Upper bound of the bucket that contains the maximum lateness, ms.
        missed: Number of scans that ended after the next one was due.
    """

    p99_ms: float
    latest_ms: float
    missed: int

    @classmethod
    def of(cls, counts: Sequence[int], missed: int) -> Punctuality:
        """Return the statistics of a lateness histogram.

        Raises:
            LiveError: The histogram is empty.
        """
        if not any(counts):
            raise LiveError("no scans were counted")
        return cls(percentile_ms(list(counts), 99), percentile_ms(list(counts), 100), missed)

    def figures(self) -> dict[str, float]:
        """Return the statistics by key."""
        return {"p99": self.p99_ms, "latest": self.latest_ms, "missed": self.missed}


@dataclass(frozen=True, slots=True)
class Second:
    """Lateness of the scans in one second, and the steal time in that second, s."""

    late: list[int]
    missed: int
    stolen_s: float


def measured_seconds(line: socket.socket, for_s: int) -> list[Second]:
    """Return the lateness of the scans in each of the next `for_s` seconds, read from the controller."""
    seconds = []
    before_late, before_missed = read_counts(line)
    before_stolen_s = host.stolen_s()
    for _ in range(for_s):
        threading.Event().wait(1)
        late, missed = read_counts(line)
        stolen_s = host.stolen_s()
        counted = [now - then for now, then in zip(late, before_late, strict=True)]
        seconds.append(Second(counted, missed - before_missed, stolen_s - before_stolen_s))
        before_late, before_missed, before_stolen_s = late, missed, stolen_s
    return seconds


def total(seconds: Sequence[Second]) -> Punctuality:
    """Return the combined statistics of several seconds."""
    counts = [sum(buckets) for buckets in zip(*(second.late for second in seconds), strict=True)]
    return Punctuality.of(counts, sum(second.missed for second in seconds))


def read_counts(line: socket.socket) -> tuple[list[int], int]:
    """Return the lateness histogram and the number of missed scans since the start."""
    buckets = len(BOUNDS_US) + 1
    words = read_registers(line, register_address("R", own.R_LATENESS), 2 * buckets)
    late = [low | high << 16 for low, high in zip(words[::2], words[1::2], strict=True)]
    low, high = read_registers(line, register_address("R", _R_OVERRUNS), 2)
    return late, low | high << 16
