"""Command ``scenario``: run a scenario and check the result."""

from __future__ import annotations

import argparse
import contextlib
import json

from controller.iomap.loader import load_io_map
from plant_sim.cli.reproduce.origin import print_json, provenance_of
from plant_sim.cli.reproduce.result_folder import result_folder
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
    provenance = provenance_of(options, seed=scenario.seed)
    warn_of_ratings(scenario.machine)
    with result_folder(options, provenance) as files:
        with contextlib.ExitStack() as stack:
            report = run_scenario(
                scenario,
                prepare=lambda twin: stack.enter_context(
                    recorded(twin, options.record, seed=scenario.seed, provenance=provenance)
                ),
            )
        if files is not None:
            files.json("scenario.json", json.loads(json.dumps(report.record(), default=str)))
    if options.json:
        print_json(report.record(), provenance, default=str)
    else:
        print(report.text())
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
