"""Options shared by several commands: machine, faults, recording."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from controller.common.errors import InputError
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.faults import Fault, parse_fault
from plant_sim.links.modbus_server import DEFAULT_PORT
from plant_sim.machine.parameters import DEFAULT_MACHINE, Machine, load_machine
from plant_sim.machine.stored_air import parse_share

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
        InputError: The file is invalid, or ``--air`` is.
    """
    machine = load_machine(options.machine)
    air: str | None = getattr(options, "air", None)
    if air is not None:
        try:
            machine = machine.with_values({"start.chamber_share": parse_share(air)})
        except ValueError as error:
            raise InputError(f"--air {error}") from None
    return warn_of_ratings(machine)


def warn_of_ratings(machine: Machine) -> Machine:
    """Print a warning for each parameter outside the ratings; return the machine."""
    for warning in machine.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return machine


def add_air_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for the air in slides and lifts at the start; `machine_of` applies it."""
    parser.add_argument(
        "--air",
        default=None,
        metavar="vented|full|SHARE",
        help="air in slides and lifts at the start, as a share of the main pressure, e.g. 30%%; replaces "
        "start.chamber_share of the machine",
    )


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


def add_network_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for the address and port of the plant's Modbus TCP server."""
    parser.add_argument("--host", default="127.0.0.1", help="address of the Modbus TCP server")
    parser.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help="port of the Modbus TCP server; 0 = any free port"
    )


def check_port(options: argparse.Namespace) -> None:
    """Raise `InputError` if the port is out of range."""
    if not 0 <= options.port <= 65_535:
        raise InputError(f"--port {options.port}: must be 0 to 65535")
