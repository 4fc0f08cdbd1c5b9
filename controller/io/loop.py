"""The scan loops: absolute deadlines, figures of their own timing, safe outputs on every way out."""

from __future__ import annotations

import threading
import time
from bisect import bisect_left
from dataclasses import dataclass, field
from typing import Final

from controller.core.clock import Clock
from controller.io.pace import Pace
from controller.io.runtime import Runtime

BOUNDS_US: Final = (100, 200, 500, 1_000, 2_000, 3_000, 5_000, 8_000, 10_000, 15_000, 20_000, 50_000, 100_000)
"""Upper bounds of the histograms' buckets, us; one more bucket holds what is longer."""


@dataclass(slots=True)
class Histogram:
    """How often a time fell into which bucket of `BOUNDS_US`.

    Attributes:
        counts: One count a bucket; each time is counted once.
        sum_us: Sum of all times, us.
    """

    counts: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS_US) + 1))
    sum_us: int = 0

    def add(self, time_us: int) -> None:
        """Count one time."""
        self.counts[bisect_left(BOUNDS_US, time_us)] += 1
        self.sum_us += time_us


@dataclass
class LoopFigures:
    """How well the loop kept its period.

    Attributes:
        scans: Scans done.
        overruns: Scans that ended after the next one was due; whole periods lost are not made good.
        made_safe: Whether the field has taken the safe outputs at the end.
        longest_ms: Longest time from when a scan was due to its last output, ms.
        durations: Time from a scan's begin to its last output.
        lateness: Time from when a scan was due to its begin; zero in simulated time.
    """

    scans: int = 0
    overruns: int = 0
    longest_ms: int = 0
    made_safe: bool = False
    durations: Histogram = field(default_factory=Histogram)
    lateness: Histogram = field(default_factory=Histogram)


def run_real_time(
    runtime: Runtime, clock: Clock, *, scan_ms: int, stop: threading.Event, figures: LoopFigures | None = None
) -> LoopFigures:
    """Scan once a period until told to stop; then write every output safe.

    A scan's time is the instant it was due, not the few ms later at which it ran: timers and filters then
    see the same even steps as in simulated time, and no drift builds up.

    Args:
        runtime: The PLC on its link.
        clock: Time of the scans.
        scan_ms: Period, ms.
        stop: Set to end the loop.
        figures: Filled while the loop runs, for others to read.

    Returns:
        Figures of the loop.
    """
    figures = LoopFigures() if figures is None else figures
    try:
        due_ms = clock.now_ms()
        due_ns = time.perf_counter_ns()
        while not stop.is_set():
            began_ns = time.perf_counter_ns()
            runtime.tick(due_ms, clock.now_ms())
            now_ms = clock.now_ms()
            figures.scans += 1
            figures.longest_ms = max(figures.longest_ms, now_ms - due_ms)
            figures.lateness.add(max(0, began_ns - due_ns) // 1_000)
            figures.durations.add((time.perf_counter_ns() - began_ns) // 1_000)
            periods = 1
            if now_ms > due_ms + scan_ms:
                figures.overruns += 1
                periods += (now_ms - due_ms - scan_ms) // scan_ms
            due_ms += periods * scan_ms
            due_ns += periods * scan_ms * 1_000_000
            stop.wait(max(0, due_ns - time.perf_counter_ns()) / 1e9)
    finally:
        figures.made_safe = runtime.make_safe()
    return figures


def run_simulated_time(
    runtime: Runtime, pace: Pace, *, scan_ms: int, stop: threading.Event, figures: LoopFigures | None = None
) -> LoopFigures:
    """Scan until told to stop, each scan one period after the last whatever the wall says; then write outputs safe.

    For a simulated plant in lock step, whose time is that of the scans. No scan is ever late here; how well the
    controller keeps its period on a real machine is told by `run_real_time` alone.

    Args:
        runtime: The PLC on its link.
        pace: How fast simulated time may go; it can be paused.
        scan_ms: Period in simulated time, ms.
        stop: Set to end the loop.
        figures: Filled while the loop runs, for others to read.

    Returns:
        Figures of the loop.
    """
    figures = LoopFigures() if figures is None else figures
    now_ms = 0
    try:
        while pace.wait(scan_ms, stop):
            began_ns = time.perf_counter_ns()
            runtime.tick(now_ms)
            now_ms += scan_ms
            figures.scans += 1
            duration_us = (time.perf_counter_ns() - began_ns) // 1_000
            figures.longest_ms = max(figures.longest_ms, duration_us // 1_000)
            figures.durations.add(duration_us)
    finally:
        figures.made_safe = runtime.make_safe()
    return figures
