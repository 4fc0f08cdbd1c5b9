"""Lateness of the scans on a busy computer, with normal and with real-time priority."""

from __future__ import annotations

import json
import os
import queue
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.program.states import State
from plant_sim.benchmark.hmi import running_controller
from plant_sim.benchmark.hmi_load import connect
from plant_sim.benchmark.punctuality import Punctuality, read_counts
from plant_sim.twin.process import Process

BUSY_PER_PROCESSOR: Final = 8
"""Computing processes per processor (assumed)."""
CLIENTS: Final = 4
_LOAD: Final = "plant_sim.benchmark.hmi_load"
_SPARE_S: Final = 60
"""Time by which the load outlasts the measurement, s: starting and homing on a busy computer."""


@dataclass(frozen=True, slots=True)
class BusyHostRow:
    """Lateness of one run.

    Attributes:
        name: Conditions.
        lateness: Statistics.
        scans: Number of scans.
        lost_s: Time from the start of the load until the machine was in Aborted, s; None = never.
    """

    name: str
    lateness: Punctuality
    scans: int
    lost_s: float | None

    def text(self) -> str:
        """Return the row as a line of text."""
        end = "field link held" if self.lost_s is None else f"Aborted after {self.lost_s:.1f} s"
        late = self.lateness
        return (
            f"{self.name:34s} {self.scans:6d} scans, {late.missed:4d} missed, {late.p99_ms:6.1f} ms late in "
            f"99 % of cases, at most {late.latest_ms:6.1f} ms; {end}"
        )


def measure_busy_host(for_s: int, priority: int) -> Iterator[BusyHostRow]:
    """Yield the lateness of a machine at work on a busy computer: both priorities, without and with panel clients.

    Args:
        for_s: Duration of each run, s; it ends earlier if the machine aborts.
        priority: Real-time priority.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
        SilentServerError: The controller did not answer.
    """
    real_time = ["--real-time-priority", str(priority)]
    for clients in (False, True):
        for name, options in (("normal priority", []), (f"real-time priority {priority}", real_time)):
            yield _run(f"{name}, {'clients' if clients else 'no clients'}", for_s, options, clients=clients)


def _run(name: str, for_s: int, options: Sequence[str], *, clients: bool) -> BusyHostRow:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        _, controller, port = stack.enter_context(running_controller(folder, at_work=True, real_time=options))
        if clients:
            stack.enter_context(
                Process("clients", [_LOAD, "clients", str(port), str(CLIENTS), str(for_s + _SPARE_S)])
            ).next_line(_SPARE_S)
        for _ in range(BUSY_PER_PROCESSOR * (os.cpu_count() or 1)):
            stack.enter_context(Process("busy", [_LOAD, "busy", str(for_s + _SPARE_S)])).next_line(_SPARE_S)
        before, before_missed = _read(port)
        lost_s = _aborted_after_s(controller.lines, for_s)
        counts, missed = _read(port)
    late = [after - first for after, first in zip(counts, before, strict=True)]
    return BusyHostRow(name, Punctuality.of(late, missed - before_missed), sum(late), lost_s)


def _read(port: int) -> tuple[list[int], int]:
    """Read the counts over a new connection: the server closes an idle one after a minute."""
    with connect(port) as line:
        return read_counts(line)


def _aborted_after_s(lines: queue.SimpleQueue[str | None], for_s: int) -> float | None:
    """Return the time until the machine is in Aborting or Aborted, s, or None after `for_s`."""
    start_s = time.perf_counter()
    while (left_s := start_s + for_s - time.perf_counter()) > 0:
        try:
            line = lines.get(timeout=left_s)
        except queue.Empty:
            break
        if line is not None and json.loads(line).get("state") in (State.ABORTING, State.ABORTED):
            return time.perf_counter() - start_s
    return None
