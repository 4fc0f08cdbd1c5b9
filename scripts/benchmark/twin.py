"""Speed of the twin: start, trial in machine code and step by step, its parts, snapshots and fleets."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from controller.core.expr import TRUE
from controller.core.machine_code import MachineExecution, machine_condition_of
from controller.program.states import State
from plant_sim.machine.kernel import advance
from plant_sim.study.fleet import FleetMachine, run_fleet
from plant_sim.twin import compiled_run
from plant_sim.twin.lock_step import SCAN_MS, Twin

ROUNDS: Final = 3
FLEET_TRIALS: Final = 120
SNAPSHOTS: Final = 2_000
WORKERS: Final = 2
_START: Final = """
import time
began_s = time.perf_counter()
from plant_sim.twin.lock_step import Twin
Twin().scan()
print(time.perf_counter() - began_s)
"""


def measure_trial(seed: int) -> dict[str, float]:
    """Measure the trial in machine code and step by step, and the parts of the trial in machine code."""
    _trial(seed, step_by_step=False)  # loads the machine code
    times_s = {}
    for step_by_step in (False, True):
        began_s = time.process_time()
        twin = _trial(seed, step_by_step=step_by_step)
        times_s[step_by_step] = time.process_time() - began_s
    ticks, simulated_s = twin.now_ms // SCAN_MS, twin.now_ms / 1000
    kernel_s, calls = _in_kernel(seed)
    program_s, plant_s = ticks * _scan_s(twin_at_work(seed)), _plant_s(seed, ticks)
    trial_s = times_s[False]
    shares_s = {
        "program": program_s,
        "plant": plant_s,
        "rest": max(0.0, kernel_s - program_s - plant_s),
        "python": max(0.0, trial_s - kernel_s),
    }
    return {
        "step_by_step": simulated_s / times_s[True],
        "machine_code": simulated_s / trial_s,
        "ratio": times_s[True] / trial_s,
        **{f"{name}_share": 100 * part_s / trial_s for name, part_s in shares_s.items()},
        "plant_alone": trial_s / plant_s,
        "simulated": simulated_s,
        "ticks": ticks,
        "calls": calls,
    }


def measure_snapshot(seed: int) -> dict[str, float]:
    """Measure the CPU times of a snapshot and of a restoration of a twin at work."""
    twin = twin_at_work(seed)
    snapshot = twin.snapshot()
    return {
        "snapshot": 1e6 * _least_s(twin.snapshot, SNAPSHOTS),
        "restoration": 1e6 * _least_s(lambda: twin.restore(snapshot), SNAPSHOTS),
    }


def measure_fleet(_seed: int) -> dict[str, float]:
    """Measure a fleet with the seeds from 0 on, in one process and in two."""
    machines = [FleetMachine(seed=number) for number in range(FLEET_TRIALS)]
    one, two = _fleet_ratio(machines, 1), _fleet_ratio(machines, WORKERS)
    return {"one": one, "two": two, "ratio": two / one}


def measure_start(_seed: int) -> dict[str, float]:
    """Measure the time from the first import of a new process to the end of the first scan of a twin."""
    command = [sys.executable, "-c", _START]
    printed = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603 - our own code
    return {"start": float(printed.stdout)}


def twin_at_work(seed: int) -> Twin:
    """Return a twin in Execute that has picked its first row."""
    twin = Twin(seed=seed, set_points={"trays_target": 2})
    twin.home()
    twin.start()
    twin.run_for(12_000)
    return twin


def _trial(seed: int, *, step_by_step: bool) -> Twin:
    twin = Twin(seed=seed, set_points={"trays_target": 2}, step_by_step=step_by_step)
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=600_000)
    return twin


def _in_kernel(seed: int) -> tuple[float, int]:
    """Return the CPU time of a trial spent in the kernel, s, and the number of returns to Python."""
    kernel = vars(compiled_run)["run"]
    spent_s, calls = 0.0, 0

    def timed(*arguments: Any) -> int:
        nonlocal spent_s, calls
        began_s = time.process_time()
        reason: int = kernel(*arguments)
        spent_s += time.process_time() - began_s
        calls += 1
        return reason

    vars(compiled_run)["run"] = timed
    try:
        _trial(seed, step_by_step=False)
    finally:
        vars(compiled_run)["run"] = kernel
    return spent_s, calls


def _scan_s(twin: Twin) -> float:
    """Return the CPU time of a scan of the machine at work as machine code, without the call from Python, s."""
    execution = twin.plc.execution
    assert isinstance(execution, MachineExecution)  # noqa: S101 - the twin does not run step by step
    scan, nothing = execution.code.scan, machine_condition_of(TRUE, execution.layout).holds
    memory, now_ms = execution.region_address, twin.now_ms
    call_s = _least_s(lambda: nothing(memory, 0, 0), SNAPSHOTS)
    return _least_s(lambda: scan(memory, now_ms, 0), SNAPSHOTS) - call_s


def _plant_s(seed: int, ticks: int) -> float:
    """Return the CPU time of the plant alone for the outputs of a trial, without the calls from Python, s."""
    twin = Twin(seed=seed, set_points={"trays_target": 2})
    outputs: list[np.ndarray] = []
    twin.home()
    twin.start()
    while twin.state is not State.COMPLETE and len(outputs) < ticks:
        twin.scan()
        outputs.append(twin.plant.coils.copy())
    plant = Twin(seed=seed).plant
    spent_s = []
    for steps in (SCAN_MS, 0):
        began_s = time.process_time()
        for number, coils in enumerate(outputs):
            advance(plant.state, plant.params, coils, True, SCAN_MS * number, steps, plant.positions)
        spent_s.append(time.process_time() - began_s)
    return (spent_s[0] - spent_s[1]) * ticks / len(outputs)


def _least_s(action: Callable[[], object], times: int) -> float:
    """Return the CPU time of an action, s: the minimum of several rounds."""
    least_s = float("inf")
    for _ in range(ROUNDS):
        began_s = time.process_time()
        for _ in range(times):
            action()
        least_s = min(least_s, (time.process_time() - began_s) / times)
    return least_s


def _fleet_ratio(machines: list[FleetMachine], workers: int) -> float:
    """Return the ratio of simulated time to wall time, with the processes already started."""
    run_fleet([FleetMachine(seed=0, seedlings=12)] * (16 * workers), workers=workers)
    began_s = time.perf_counter()
    reports = run_fleet(machines, workers=workers)
    return sum(report.simulated_s for report in reports) / (time.perf_counter() - began_s)
