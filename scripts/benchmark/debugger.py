"""Costs of a recorded run of the machine: memory, recording, return to a scan, search."""

from __future__ import annotations

import gc
import random
import time
import tracemalloc
from collections.abc import Callable
from typing import Final, TypeVar

import numpy as np

from controller.debug.condition import parse_condition
from controller.debug.machine import RunPosition
from controller.debug.search import condition_changes, device_changes, last
from controller.debug.stepping import Stepper, StepUnit
from controller.debug.timeline import LENGTH
from plant_sim.twin.debug.recorder import TwinRecorder
from plant_sim.twin.lock_step import SCAN_MS, Twin

_Argument = TypeVar("_Argument")

TRAYS: Final = 10
"""Trays in the magazine, more than the run takes."""
SEEKS: Final = 2_000
SCANS_ENTERED: Final = 100
_UNUSED: Final = "M3071"
"""Relay that the program does not use."""
_NEVER: Final = "left.lift.position_m < -1"


def measure_debugger(seed: int, *, scans: int = LENGTH) -> dict[str, float]:
    """Record a run of the working machine, return to random scans, and search all of it in vain.

    Args:
        seed: Seed of the plant's random numbers and of the scans.
        scans: Length of the run.
    """
    _working(seed).run_for(1_000)  # loads the machine code
    plain_s = _cpu_s(lambda twin: twin.run_for(scans * SCAN_MS), _working(seed))
    recorded = TwinRecorder(_working(seed), length=scans)
    recorded_s = _cpu_s(lambda twin: twin.run_for(scans * SCAN_MS), recorded.twin)
    line = recorded.close()
    chance = random.Random(seed)
    seeks_s = [_cpu_s(line.seek, chance.randint(line.first, line.last)) for _ in range(SEEKS)]
    median_s, p99_s = np.percentile(seeks_s, [50, 99])
    end, signal = line.last + 1, line.machine.signal
    device = device_changes(line, [signal(_UNUSED)])
    condition = condition_changes(line, parse_condition(_NEVER, signal))
    condition(line.last - 1, line.last)  # compiles the condition
    stepper = Stepper(line.machine.observer)
    entered = (RunPosition(chance.randint(line.first, line.last - 1)) for _ in range(SCANS_ENTERED))
    steps_s = [_cpu_s(lambda at: stepper.forward(line, at, StepUnit.RUNG), position) for position in entered]
    return {
        "memory": _memory_mb(seed, scans),
        "recording": recorded_s,
        "overhead": recorded_s / plain_s,
        "seek": median_s * 1_000,
        "seek_p99": p99_s * 1_000,
        "seek_longest": max(seeks_s) * 1_000,
        "device": _cpu_s(lambda before: last(line, device, before), end),
        "condition": _cpu_s(lambda before: last(line, condition, before), end),
        "rung": float(np.median(steps_s)) * 1_000,
    }


def _memory_mb(seed: int, scans: int) -> float:
    """Return the memory that Python has allocated for a recorded run, MB."""
    twin = _working(seed)
    tracemalloc.start()
    try:
        recorder = TwinRecorder(twin, length=scans)
        twin.run_for(scans * SCAN_MS)
        recorder.close()
        gc.collect()
        allocated, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return allocated / 1e6


def _working(seed: int) -> Twin:
    """Return a twin that has started to plant, with more trays than it needs."""
    twin = Twin(seed=seed, trays=TRAYS, set_points={"trays_target": TRAYS})
    twin.home()
    twin.start()
    return twin


def _cpu_s(function: Callable[[_Argument], object], argument: _Argument) -> float:
    began_s = time.process_time()
    function(argument)
    return time.process_time() - began_s
