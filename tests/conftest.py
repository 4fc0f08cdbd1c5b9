"""Before anything else: the plant is compiled once, not by every worker at the same time."""

import pytest

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from plant_sim.parameters import load_machine
from plant_sim.plant import Plant


def pytest_configure(config: pytest.Config) -> None:
    """Compile the plant, or load its machine code, in the process that starts the workers."""
    if not hasattr(config, "workerinput"):
        plant = Plant(load_io_map(DEFAULT_IO_MAP), load_machine(), seed=1)
        assert plant.x
