"""Speed of the twin: a trial in machine code and step by step, its parts, snapshots and fleets."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from controller.core.expr import TRUE
from controller.core.machine_code import MachineExecution, machine_condition_of
from controller.program.states import State
from plant_sim.machine.kernel import advance
from plant_sim.study.fleet import FleetMachine, run_fleet
from plant_sim.twin import compiled_run
from plant_sim.twin.lock_step import SCAN_MS, Twin

TRIAL_GOAL: Final = 7.0
FLEET_GOAL: Final = 1.8
SNAPSHOT_GOAL_US: Final = 100.0
ROUNDS: Final = 3
FLEET_TRIALS: Final = 120
SNAPSHOTS: Final = 2_000
WORKERS: Final = 2


@dataclass(frozen=True)
class TwinFigures:
    """Figures of the twin; a trial is that of the paper with 144 seedlings, from power-up to Complete.

    Attributes:
        simulated_s: Simulated time of the trial, s.
        trial_s: CPU time of a trial in machine code, set-up included, s.
        step_by_step_s: CPU time of the same trial step by step, s.
        kernel_s: Part of `trial_s` spent in machine code, s.
        kernel_scan_s: Part of `kernel_s` spent in the program, s.
        kernel_plant_s: Part of `kernel_s` spent in the plant, s.
        calls: Number of calls of Python during the trial.
        ticks: Number of ticks of the trial.
        snapshot_us: CPU time of a snapshot, us.
        restore_us: CPU time of a restoration, us.
        fleet_ratio: Ratio of simulated time to wall time of a fleet on one core.
        fleet_two_ratio: The same on two cores.
    """

    simulated_s: float
    trial_s: float
    step_by_step_s: float
    kernel_s: float
    kernel_scan_s: float
    kernel_plant_s: float
    calls: int
    ticks: int
    snapshot_us: float
    restore_us: float
    fleet_ratio: float
    fleet_two_ratio: float

    def twin_text(self) -> str:
        """Return the figures with their goals as text."""
        machine, steps = self.simulated_s / self.trial_s, self.simulated_s / self.step_by_step_s
        rest_s = max(0.0, self.kernel_s - self.kernel_scan_s - self.kernel_plant_s)
        shares = {
            "program": self.kernel_scan_s,
            "plant": self.kernel_plant_s,
            "sensors, filter, limits": rest_s,
            "Python": self.trial_s - self.kernel_s,
        }
        listed = ", ".join(f"{name} {100 * part_s / self.trial_s:.0f} %" for name, part_s in shares.items())
        return "\n".join(
            [
                f"trial, step by step        {steps:7.0f} x real time over {self.simulated_s:.1f} s",
                f"  in machine code          {machine:7.0f} x real time, ratio {machine / steps:.1f} "
                f"(goal: at least {TRIAL_GOAL:.0f})",
                f"  of which                 {listed}",
                f"  calls of Python          {self.calls:7d} in {self.ticks} ticks",
                f"snapshot                   {self.snapshot_us:7.0f} us CPU, restored in {self.restore_us:.0f} us "
                f"(goal: at most {SNAPSHOT_GOAL_US:.0f})",
                f"fleet on one core          {self.fleet_ratio:7.0f} x real time",
                f"  on two cores             {self.fleet_two_ratio:7.0f} x real time, ratio "
                f"{self.fleet_two_ratio / self.fleet_ratio:.2f} (goal: at least {FLEET_GOAL})",
            ]
        )


def measure_twin(*, seed: int = 1) -> TwinFigures:
    """Measure the trial, alternately in machine code and step by step, then snapshots and fleets.

    Args:
        seed: Seed of the trial.
    """
    _trial(seed, step_by_step=False)
    times_s: dict[bool, list[float]] = {False: [], True: []}
    for _ in range(ROUNDS):
        for step_by_step, taken_s in times_s.items():
            began_s = time.process_time()
            twin = _trial(seed, step_by_step=step_by_step)
            taken_s.append(time.process_time() - began_s)
    kernel_s, calls = _in_kernel(seed)
    snapshot_us, restore_us = _snapshots(seed)
    machines = [FleetMachine(seed=number) for number in range(FLEET_TRIALS)]
    ticks = twin.now_ms // SCAN_MS
    return TwinFigures(
        simulated_s=twin.now_ms / 1000,
        trial_s=min(times_s[False]),
        step_by_step_s=min(times_s[True]),
        kernel_s=kernel_s,
        kernel_scan_s=ticks * _scan_s(twin_at_work(seed)),
        kernel_plant_s=_plant_s(seed, ticks),
        calls=calls,
        ticks=ticks,
        snapshot_us=snapshot_us,
        restore_us=restore_us,
        fleet_ratio=_fleet_ratio(machines, 1),
        fleet_two_ratio=_fleet_ratio(machines, WORKERS),
    )


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


def _snapshots(seed: int) -> tuple[float, float]:
    """Return the CPU times of a snapshot and of a restoration, us."""
    twin = twin_at_work(seed)
    snapshot = twin.snapshot()
    return 1e6 * _least_s(twin.snapshot, SNAPSHOTS), 1e6 * _least_s(lambda: twin.restore(snapshot), SNAPSHOTS)


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
