"""Options of the command line for faults and scenarios."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from plant_sim.bench.scenario import Scenario
from plant_sim.bench.scenario_file import find_scenario, load_scenario
from plant_sim.faults import Fault, parse_fault
from plant_sim.parameters import DEFAULT_MACHINE, load_machine


def add_fault_arguments(parser: argparse.ArgumentParser) -> None:
    """Let a command be given faults; `faults_of` reads them."""
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND:TARGET[=SIZE][@START..[END]]",
        help="break something, as stuck_off:left.lift_up@12s..20s; may be given several times",
    )


def faults_of(options: argparse.Namespace) -> list[Fault]:
    """Return the faults that were given.

    Raises:
        FaultError: one of them cannot be read or is impossible.
    """
    return [parse_fault(text) for text in options.fault]


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Let a command be given a scenario; `scenario_of` reads it."""
    parser.add_argument("scenario", metavar="FILE|NAME", help="a scenario file, or the name of one that is included")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="the wires")
    parser.add_argument(
        "--machine", type=Path, default=DEFAULT_MACHINE, help="the machine's parameters; the scenario changes them"
    )
    parser.add_argument("--seed", type=int, default=None, help="seed in place of the scenario's")


def scenario_of(options: argparse.Namespace) -> Scenario:
    """Return the scenario that was given, read and checked.

    Raises:
        ScenarioError: it cannot be used.
        IoMapError: the wires cannot.
        MachineError: the machine cannot.
    """
    return load_scenario(
        find_scenario(options.scenario),
        io_map=load_io_map(options.io_map),
        machine=load_machine(options.machine),
        seed=options.seed,
    )
