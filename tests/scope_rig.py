"""Recordings for the tests of the scope: a real trial of one tray, and a plant put into states by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.states import State
from plant_sim.bench.recording import recorded
from plant_sim.bench.twin import Twin
from plant_sim.faults import Fault
from plant_sim.parameters import load_machine
from plant_sim.plant import Plant
from plant_sim.scope.recorder import Recorder

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
SEED = 3


def new_plant() -> Plant:
    """Return a plant of one tray."""
    return Plant(IO_MAP, MACHINE, seed=SEED, trays=1)


def recorder(plant: Plant, path: Path, **options: Any) -> Recorder:
    """Return a recorder of a plant without a controller."""
    return Recorder(plant, path, io_map=IO_MAP, machine=MACHINE, seed=SEED, **options)


def fill(plant: Plant, path: Path, *, samples: int, **options: Any) -> None:
    """Record a plant that stands in its coils."""
    with recorder(plant, path, **options) as scope:
        for _ in range(samples):
            scope.sample()
            plant.step(10, IO_MAP.safe_outputs())


def record_trial(path: Path, *faults: Fault) -> Twin:
    """Record a twin until its tray is done; return it."""
    twin = Twin(seed=SEED, trays=1, set_points={"trays_target": 1})
    for fault in faults:
        twin.plant.faults.add(fault)
    with recorded(twin, path, seed=SEED):
        twin.home()
        twin.start()
        twin.run_until_state(State.COMPLETE, within_ms=150_000)
    return twin
