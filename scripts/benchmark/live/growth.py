"""Growth of memory and of open files of plant, controller and panel; and a visitor: ``python -m ... URL SECONDS``.

The memory of a process is what it has written itself: heap, stacks and other anonymous memory. Files in memory, such as
libraries, are left out, because the system loads and drops parts of them as it likes.
"""

from __future__ import annotations

import http.client
import json
import math
import queue
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Final
from urllib.parse import urlsplit

import numpy as np
import statsmodels.api as sm

from plant_sim.twin.process import LiveError, Process
from scripts.benchmark.live.hmi import (
    LOAD,
    START_LIMIT_S,
    Attendant,
    MeasuredProcess,
    read_record,
    running_machine,
    running_panel,
)

SETTLING_S: Final = 1_200
"""Time after the start in which a process may fill its buffers, s. The panel keeps 3,000 samples, which it takes in
600 s, and on a busy computer in up to 1,100 s."""
MEASURED_S: Final = 1_800
CLIENTS: Final = 4
TRAYS: Final = 1_000
"""Trays in the magazine, enough to work until the end."""
PERIOD_S: Final = 1.0
ACT_AGAIN_S: Final = 15
"""Time after which a press that had no effect, as during another loss of the link, is repeated, s."""
BLOCK_S: Final = 60
"""Time whose lowest value is one value of the fit, s."""
LAGS: Final = 4
"""Number of following values with which the error of a value may be correlated: memory grows in steps."""
HOUR_S: Final = 3_600
VISIT_PERIOD_S: Final = 5.0
VISITS: Final = (
    "/",
    "/api/me",
    "/api/describe",
    "/api/history/records?last=100",
    "/api/history/alarms?last=100",
    "/api/history/last_cycle?side=left",
    "/api/trends?span=600000&points=600",
    "/metrics",
)
_MB: Final = 1_000_000


@dataclass(frozen=True, slots=True)
class Slope:
    """Slope of a straight line through measured values, with the limits of its 95 % interval."""

    mean: float
    lowest: float
    highest: float


@dataclass
class Samples:
    """Memory and open files of one process, sampled periodically.

    Attributes:
        at_s: Times since the first sample, s.
        memory_mb: Memory that the process has written itself, MB.
        files: Number of open files.
    """

    at_s: list[float] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)
    files: list[int] = field(default_factory=list)

    def add(self, at_s: float, process: MeasuredProcess) -> None:
        """Take a sample."""
        self.at_s.append(at_s)
        self.memory_mb.append(process.written_mb)
        self.files.append(process.open_files)

    @property
    def memory_mb_per_h(self) -> Slope:
        """Slope of the memory, MB/h."""
        return slope(self.at_s, self.memory_mb)

    @property
    def more_files(self) -> int:
        """Median of the open files in the last third of the time, less that in the first third."""
        third = len(self.files) // 3
        return round(median(self.files[-third:]) - median(self.files[:third]))


def slope(at_s: Sequence[float], values: Sequence[float]) -> Slope:
    """Return the slope per hour of a straight line through the lowest values of blocks of `BLOCK_S`.

    The lowest value is what remains between requests, whose answers take memory for a moment. The interval takes into
    account that the errors of `LAGS` following blocks are correlated (Newey and West).
    """
    lowest: dict[int, tuple[float, float]] = {}
    for second, value in zip(at_s, values, strict=True):
        block = int(second // BLOCK_S)
        lowest[block] = min((value, second), lowest.get(block, (math.inf, second)))
    y, x_s = np.array([lowest[block] for block in sorted(lowest)]).T
    fit = sm.OLS(y, sm.add_constant(x_s / HOUR_S)).fit(cov_type="HAC", cov_kwds={"maxlags": LAGS}, use_t=True)
    low, high = fit.conf_int()[1]
    return Slope(float(fit.params[1]), float(low), float(high))


def measure_growth(_seed: int, *, settling_s: int = SETTLING_S, measured_s: int = MEASURED_S) -> dict[str, float]:
    """Measure the growth of plant, controller and panel with a machine at work and clients.

    Args:
        settling_s: Time before the first sample, s.
        measured_s: Time of the samples, s.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
    """
    measured, at_work_s = sampled(settling_s, measured_s)
    figures: dict[str, float] = {"at_work": 100 * at_work_s / measured_s}
    for name, samples in measured.items():
        grown = samples.memory_mb_per_h
        figures |= {
            f"{name}_memory": samples.memory_mb[-1],
            f"{name}_slope": grown.mean,
            f"{name}_slope_lowest": grown.lowest,
            f"{name}_slope_highest": grown.highest,
            f"{name}_files": samples.more_files,
        }
    return figures


def sampled(settling_s: int, measured_s: int) -> tuple[Mapping[str, Samples], int]:
    """Run the processes with clients; return the samples of plant, controller and panel, and the time at work, s.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        machine = stack.enter_context(running_machine(folder, at_work=True, trays=TRAYS, is_patient=True))
        panel, url = running_panel(stack, folder, machine)
        for_s = settling_s + measured_s
        load = [
            Process("clients", [LOAD, "clients", str(machine.hmi_port), str(CLIENTS), str(for_s)]),
            Process("browser", [LOAD, "browsers", url, "1", str(for_s)]),
            Process("visitor", ["scripts.benchmark.live.growth", url, str(for_s)]),
        ]
        for each in load:
            stack.enter_context(each)
        for each in load[:2]:
            read_record(each, START_LIMIT_S)
        processes = {"plant": machine.plant, "controller": machine.controller, "panel": panel}
        samples = {name: Samples() for name in processes}
        at_work_s = 0
        begun_s = time.perf_counter() + settling_s
        for number in range(-settling_s, measured_s):
            threading.Event().wait(max(0.0, begun_s + number * PERIOD_S - time.perf_counter()))
            machine.attendant.operator.telemetry()  # the plant closes an idle connection
            _attend(machine.attendant, machine.controller)
            if not machine.attendant.is_at_work and number % ACT_AGAIN_S == 0:
                machine.attendant.act()
            if number >= 0:
                at_work_s += machine.attendant.is_at_work
                for name, process in processes.items():
                    samples[name].add(time.perf_counter() - begun_s, process)
    return samples, at_work_s


def _attend(attendant: Attendant, controller: Process) -> None:
    """React to the events that the controller has reported."""
    while True:
        try:
            line = controller.lines.get_nowait()
        except queue.Empty:
            return
        if line is None:
            raise LiveError(f"the controller ended with exit code {controller.stop()}")
        attendant.attend(json.loads(line))


def visit(url: str, for_s: float) -> int:
    """Open the pages of a panel repeatedly, each over a connection of its own; return the number of answers.

    Raises:
        LiveError: A page is refused.
    """
    begun_s, answers = time.perf_counter(), 0
    while time.perf_counter() - begun_s < for_s:
        for page in VISITS:
            connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=START_LIMIT_S)
            try:
                connection.request("GET", page)
                answer = connection.getresponse()
                answer.read()
            finally:
                connection.close()
            if answer.status not in (http.client.OK, http.client.NOT_FOUND):
                raise LiveError(f"{page}: {answer.status}")
            answers += 1
        threading.Event().wait(VISIT_PERIOD_S)
    return answers


if __name__ == "__main__":
    sys.stdout.write(f"{visit(sys.argv[1], float(sys.argv[2]))}\n")
