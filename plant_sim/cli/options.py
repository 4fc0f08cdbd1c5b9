"""Options shared by several commands: machine, faults, recording."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from controller.common.errors import InputError
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.faults import Fault, parse_fault
from plant_sim.machine.parameters import DEFAULT_MACHINE, Machine, load_machine

MOST_TRAYS = 1_000
"""Capacity of the magazine."""


def add_machine_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for I/O map, machine parameters, seed and trays."""
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="I/O map of the machine")
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="parameters of the machine")
    parser.add_argument("--seed", type=int, default=1, help="seed of all random numbers")
    parser.add_argument("--trays", type=int, default=2, help="number of trays in the magazine, 72 seedlings each")


def check_machine_arguments(options: argparse.Namespace) -> None:
    """Raise `InputError` if seed or trays are out of range."""
    if not 1 <= options.trays <= MOST_TRAYS:
        raise InputError(f"--trays {options.trays}: must be 1 to {MOST_TRAYS}")
    check_seed(options)


def check_seed(options: argparse.Namespace) -> None:
    """Raise `InputError` if the seed is negative."""
    if (options.seed or 0) < 0:
        raise InputError(f"--seed {options.seed}: must be 0 or more")


def machine_of(options: argparse.Namespace) -> Machine:
    """Return the parameters of the machine; print a warning for each that is outside the ratings of its component.

    Raises:
        MachineError: The file is invalid.
    """
    return warn_of_ratings(load_machine(options.machine))


def warn_of_ratings(machine: Machine) -> Machine:
    """Print a warning for each parameter outside the ratings; return the machine."""
    for warning in machine.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return machine


def add_fault_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option for faults; `faults_of` parses it."""
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND:TARGET[=SIZE][@START..[END]]",
        help="fault to inject, e.g. stuck_off:left.lift_up@12s..20s; may be repeated",
    )


def faults_of(options: argparse.Namespace) -> list[Fault]:
    """Return the faults to inject.

    Raises:
        FaultError: A fault is malformed or impossible.
    """
    return [parse_fault(text) for text in options.fault]


def add_record_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for a recording: ``options.record`` is the file, or None."""
    parser.add_argument(
        "--record",
        type=Path,
        default=None,
        metavar="FILE",
        help="record all tags, positions, pressures and seedlings to a Parquet file (docs/scope.md)",
    )
