"""Lateness of the scans on a busy computer, with normal and with real-time priority."""

from __future__ import annotations

import json
import os
import queue
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from controller.common.real_time import DEFAULT_PRIORITY
from controller.program.states import State
from plant_sim.twin.process import Process
from scripts.benchmark.live.hmi import LOAD, running_machine
from scripts.benchmark.live.hmi_load import connect
from scripts.benchmark.live.punctuality import Punctuality, read_counts

BUSY_PER_PROCESSOR: Final = 8
"""Computing processes per processor (assumed)."""
CLIENTS: Final = 4
FOR_S: Final = 60
"""Duration of a run, s."""
_SPARE_S: Final = 60
"""Time by which the load outlasts the measurement, s: starting and homing on a busy computer."""


def measure_busy_host(_seed: int, *, for_s: int = FOR_S) -> dict[str, float]:
    """Measure the lateness of a machine at work on a busy computer: both priorities, without and with clients.

    Args:
        for_s: Duration of each run, s; it ends earlier if the machine aborts.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
        SilentServerError: The controller did not answer.
    """
    real_time = ["--real-time-priority", str(DEFAULT_PRIORITY)]
    figures: dict[str, float] = {}
    for clients in (False, True):
        for priority, options in (("normal", []), ("real_time", real_time)):
            row = _run(for_s, options, clients=clients)
            name = f"{priority}_{'clients' if clients else 'alone'}"
            figures |= {f"{name}_{key}": value for key, value in row.items()}
    return figures


def _run(for_s: int, options: Sequence[str], *, clients: bool) -> dict[str, float]:
    """Return the figures of one run; the time of the loss is missing if the machine did not abort."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        machine = stack.enter_context(running_machine(folder, at_work=True, real_time=options))
        controller, port = machine.controller, machine.hmi_port
        if clients:
            stack.enter_context(
                Process("clients", [LOAD, "clients", str(port), str(CLIENTS), str(for_s + _SPARE_S)])
            ).next_line(_SPARE_S)
        for _ in range(BUSY_PER_PROCESSOR * (os.cpu_count() or 1)):
            stack.enter_context(Process("busy", [LOAD, "busy", str(for_s + _SPARE_S)])).next_line(_SPARE_S)
        before, before_missed = _read(port)
        lost_s = _aborted_after_s(controller.lines, for_s)
        counts, missed = _read(port)
    late = [after - first for after, first in zip(counts, before, strict=True)]
    figures = {"scans": float(sum(late)), **Punctuality.of(late, missed - before_missed).figures()}
    return figures if lost_s is None else figures | {"aborted": lost_s}


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
