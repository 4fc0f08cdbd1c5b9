"""The real-time scan loop: absolute deadlines, figures of its own timing, safe outputs on every way out."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from controller.core.clock import Clock
from controller.io.runtime import Runtime


@dataclass
class LoopFigures:
    """How well the loop kept its period.

    Attributes:
        scans: Scans done.
        overruns: Scans that ended after the next one was due; whole periods lost are not made good.
        made_safe: Whether the field has taken the safe outputs at the end.
        longest_ms: Longest time from when a scan was due to its last output, ms.
    """

    scans: int = 0
    overruns: int = 0
    longest_ms: int = 0
    made_safe: bool = False


def run_real_time(runtime: Runtime, clock: Clock, *, scan_ms: int, stop: threading.Event) -> LoopFigures:
    """Scan once a period until told to stop; then write every output safe.

    A scan's time is the instant it was due, not the few ms later at which it ran: timers and filters then
    see the same even steps as in simulated time, and no drift builds up.

    Args:
        runtime: The PLC on its link.
        clock: Time of the scans.
        scan_ms: Period, ms.
        stop: Set to end the loop.

    Returns:
        Figures of the loop.
    """
    figures = LoopFigures()
    try:
        due_ms = clock.now_ms()
        while not stop.is_set():
            runtime.tick(due_ms, clock.now_ms())
            now_ms = clock.now_ms()
            figures.scans += 1
            figures.longest_ms = max(figures.longest_ms, now_ms - due_ms)
            due_ms += scan_ms
            if now_ms > due_ms:
                figures.overruns += 1
                due_ms += (now_ms - due_ms) // scan_ms * scan_ms
            stop.wait(max(0, due_ms - now_ms) / 1000)
    finally:
        figures.made_safe = runtime.make_safe()
    return figures
