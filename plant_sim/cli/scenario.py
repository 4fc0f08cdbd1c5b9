"""Command ``scenario``: run a scenario and check the result."""

from __future__ import annotations

import argparse
import contextlib
import json

from controller.iomap.loader import load_io_map
from plant_sim.cli.settings import warn_of_ratings
from plant_sim.machine.parameters import load_machine
from plant_sim.scenario.file import find_scenario, load_scenario
from plant_sim.scenario.run import Scenario, run_scenario
from plant_sim.twin.recording import recorded


def run(options: argparse.Namespace) -> int:
    """Run the scenario and print the report; return 0 if all checks pass, else 1.

    Raises:
        InputError: An option or a file is invalid.
    """
    scenario = scenario_of(options)
    warn_of_ratings(scenario.machine)
    with contextlib.ExitStack() as stack:
        report = run_scenario(
            scenario,
            prepare=lambda twin: stack.enter_context(recorded(twin, options.record, seed=scenario.seed)),
        )
    print(json.dumps(report.record(), default=str) if options.json else report.text())
    return 0 if report.passed else 1


def scenario_of(options: argparse.Namespace) -> Scenario:
    """Return the chosen scenario.

    Raises:
        ScenarioError: The scenario is invalid.
        IoMapError: The I/O map is invalid.
        MachineError: The machine parameters are invalid.
    """
    return load_scenario(
        find_scenario(options.scenario),
        io_map=load_io_map(options.io_map),
        machine=load_machine(options.machine),
        seed=options.seed,
    )
