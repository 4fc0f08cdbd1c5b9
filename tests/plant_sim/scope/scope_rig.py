"""Recordings for the scope tests: a real trial with one tray, and a plant whose states the test sets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.states import State
from plant_sim.faults import Fault
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.scope.recorder import Recorder
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recording import recorded

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
SEED = 3


def new_plant() -> Plant:
    """Return a plant with one tray."""
    return Plant(IO_MAP, MACHINE, seed=SEED, trays=1)


def recorder(plant: Plant, path: Path, **options: Any) -> Recorder:
    """Return a recorder for a plant that has no controller."""
    return Recorder(plant, path, io_map=IO_MAP, machine=MACHINE, seed=SEED, **options)


def fill(plant: Plant, path: Path, *, samples: int, **options: Any) -> None:
    """Record a plant at rest."""
    with recorder(plant, path, **options) as scope:
        for _ in range(samples):
            scope.sample()
            plant.step(10, IO_MAP.safe_outputs())


def record_trial(path: Path, *faults: Fault) -> Twin:
    """Record a twin until its tray is empty; return the twin."""
    twin = Twin(seed=SEED, trays=1, set_points={"trays_target": 1})
    for fault in faults:
        twin.plant.faults.add(fault)
    with recorded(twin, path, seed=SEED):
        twin.home()
        twin.start()
        twin.run_until_state(State.COMPLETE, within_ms=150_000)
    return twin
