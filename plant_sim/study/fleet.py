"""Fleets: any number of machines with their own parameters, seeds and faults, in one call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import numpy as np

from controller.common.modbus.io_map import IoMap
from plant_sim.faults import Fault
from plant_sim.machine.parameters import Machine
from plant_sim.study.engines import Progress, spread
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial

SEEDLINGS: Final = 144
"""Number of seedlings per trial in the paper: two trays."""
MOST_IN_BATCH: Final = 20
"""Largest number of machines that a process runs before it returns their reports."""

RESULT = np.dtype(
    [
        ("seed", "i8"),
        ("completed", "?"),
        ("seedlings", "i4"),
        ("in_cups", "i4"),
        ("P", "i4"),
        ("D", "i4"),
        ("T", "i4"),
        ("missed_cups", "i4"),
        ("cycles", "i4"),
        ("alarms", "i4"),
        ("cycle_time_s", "f8"),
        ("air_l_min", "f8"),
        ("simulated_s", "f8"),
    ]
)
"""Result of a machine; the names are those of `TrialReport`, and `alarms` is their number."""


@dataclass(frozen=True, slots=True)
class FleetMachine:
    """Machine of a fleet, which transplants its seedlings in one trial.

    Attributes:
        seed: Seed of the plant.
        parameters: Machine parameters; None = the defaults.
        set_points: Initial values of set-points, by name of `SetPoints`.
        faults: Faults of the plant.
        seedlings: Number of seedlings.
    """

    seed: int
    parameters: Machine | None = None
    set_points: Mapping[str, int] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()
    seedlings: int = SEEDLINGS


def run_fleet(
    machines: Sequence[FleetMachine],
    *,
    io_map: IoMap | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[TrialReport]:
    """Run the trials of a fleet in parallel processes.

    Args:
        machines: The machines.
        io_map: I/O map of all machines; None = the default map.
        workers: Number of processes; 1 = this process, None = one per core.
        progress: Callback with the number of completed trials and their total.

    Returns:
        Reports in the order of the machines; they do not depend on the number of processes, except for `wall_s`.

    Raises:
        FaultError: A fault is not possible in its plant.
        StudyError: The number of processes is invalid, or a process was killed.
    """
    size = max(1, min(MOST_IN_BATCH, len(machines) // 16))
    batches = [machines[first : first + size] for first in range(0, len(machines), size)]

    def report(done: int, _total: int) -> None:
        if progress is not None:
            progress(min(done * size, len(machines)), len(machines))

    reports = spread([partial(_run_batch, run_trial, batch, io_map) for batch in batches], workers, report)
    return [report for batch in reports for report in batch]


def load_twin(machine: Machine, io_map: IoMap) -> None:
    """Load the machine code of a twin, so that the first trial of this process starts at once."""
    Twin(parameters=machine, io_map=io_map)


def results(reports: Sequence[TrialReport]) -> np.ndarray:
    """Return the results of a fleet as an array of `RESULT` records."""
    array = np.zeros(len(reports), RESULT)
    for name in RESULT.names or ():
        values = [getattr(report, name) for report in reports]
        array[name] = [len(alarms) for alarms in values] if name == "alarms" else values
    return array


def _run_batch(
    trial: Callable[..., TrialReport], machines: Sequence[FleetMachine], io_map: IoMap | None
) -> list[TrialReport]:
    return [
        trial(
            seed=machine.seed,
            seedlings=machine.seedlings,
            parameters=machine.parameters,
            set_points=machine.set_points,
            faults=machine.faults,
            io_map=io_map,
        )
        for machine in machines
    ]
