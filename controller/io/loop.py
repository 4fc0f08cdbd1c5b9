"""Scan loops with absolute deadlines, timing statistics and safe outputs on every exit."""

from __future__ import annotations

import time
from bisect import bisect_left
from dataclasses import dataclass, field
from typing import Final

from controller.common.stop_request import Stop
from controller.core.clock import Clock
from controller.io.pace import Pace
from controller.io.runtime import Runtime

BOUNDS_US: Final = (100, 200, 500, 1_000, 2_000, 3_000, 5_000, 8_000, 10_000, 15_000, 20_000, 50_000, 100_000)
"""Upper bounds of the histogram buckets, us; one more bucket counts longer times."""


@dataclass(slots=True)
class Histogram:
    """Histogram of times with the bucket bounds `BOUNDS_US`.

    Attributes:
        counts: Number of measured times in each bucket, not cumulative.
        sum_us: Sum of all measured times, us.
    """

    counts: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS_US) + 1))
    sum_us: int = 0

    def add(self, time_us: int) -> None:
        """Add one time."""
        self.counts[bisect_left(BOUNDS_US, time_us)] += 1
        self.sum_us += time_us


@dataclass
class LoopFigures:
    """Timing statistics of a scan loop.

    Attributes:
        scans: Number of scans.
        overruns: Number of scans that ended after the next one was due; complete missed periods are skipped.
        longest_ms: Longest time from the due time of a scan to its last output, ms.
        latest_us: Longest time from the due time of a scan to its start, us; zero in simulated time.
        outputs_safe: True if the safe outputs were written to the field when the loop ended.
        durations: Times from the start of a scan to its last output.
        lateness: Times from the due time of a scan to its start; zero in simulated time.
    """

    scans: int = 0
    overruns: int = 0
    longest_ms: int = 0
    latest_us: int = 0
    outputs_safe: bool = False
    durations: Histogram = field(default_factory=Histogram)
    lateness: Histogram = field(default_factory=Histogram)


def run_real_time(
    runtime: Runtime, clock: Clock, *, scan_ms: int, stop: Stop, figures: LoopFigures | None = None
) -> LoopFigures:
    """Scan once per period until `stop` is set; then write the safe outputs.

    The time of a scan is its due time, not its actual start, which may be a few ms later. Timers and filters
    therefore run in the same even steps as in simulated time, without drift.

    Args:
        runtime: PLC on its link.
        clock: Clock that times the scans.
        scan_ms: Scan period, ms.
        stop: Event that ends the loop.
        figures: Statistics to update while the loop runs, readable from other threads; None = new ones.

    Returns:
        Statistics of the loop.
    """
    figures = LoopFigures() if figures is None else figures
    try:
        due_ms = clock.now_ms()
        due_ns = time.perf_counter_ns()
        while not stop.is_set():
            start_ns = time.perf_counter_ns()
            runtime.tick(due_ms, clock.now_ms())
            now_ms = clock.now_ms()
            figures.scans += 1
            figures.longest_ms = max(figures.longest_ms, now_ms - due_ms)
            late_us = max(0, start_ns - due_ns) // 1_000
            figures.latest_us = max(figures.latest_us, late_us)
            figures.lateness.add(late_us)
            figures.durations.add((time.perf_counter_ns() - start_ns) // 1_000)
            periods = 1
            if now_ms > due_ms + scan_ms:
                figures.overruns += 1
                periods += (now_ms - due_ms - scan_ms) // scan_ms
            due_ms += periods * scan_ms
            due_ns += periods * scan_ms * 1_000_000
            stop.wait(max(0, due_ns - time.perf_counter_ns()) / 1e9)
    finally:
        figures.outputs_safe = runtime.write_safe_outputs()
    return figures


def run_simulated_time(
    runtime: Runtime, pace: Pace, *, scan_ms: int, stop: Stop, figures: LoopFigures | None = None
) -> LoopFigures:
    """Scan in simulated time, one period per scan, until `stop` is set; then write the safe outputs.

    This loop is for a simulated plant in lock step: each scan advances the plant's time. Scans are never late here;
    only `run_real_time` measures the timing of the controller on a real machine.

    Args:
        runtime: PLC on its link.
        pace: Speed limit of simulated time; it can be paused.
        scan_ms: Scan period in simulated time, ms.
        stop: Event that ends the loop.
        figures: Statistics to update while the loop runs, readable from other threads; None = new ones.

    Returns:
        Statistics of the loop.
    """
    figures = LoopFigures() if figures is None else figures
    now_ms = 0
    try:
        while pace.wait(scan_ms, stop):
            start_ns = time.perf_counter_ns()
            runtime.tick(now_ms)
            now_ms += scan_ms
            figures.scans += 1
            duration_us = (time.perf_counter_ns() - start_ns) // 1_000
            figures.longest_ms = max(figures.longest_ms, duration_us // 1_000)
            figures.durations.add(duration_us)
    finally:
        figures.outputs_safe = runtime.write_safe_outputs()
    return figures
