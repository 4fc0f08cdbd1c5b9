"""Options shared by several commands."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from controller.cli.fx_options import PROGRAM_FILE, add_cpu, add_modules
from controller.cli.machine import add_set_points
from controller.common.arguments.number_type import PORT, integer, number
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.common.capacity import MOST_TRAYS
from plant_sim.common.defaults import DEFAULT_MACHINE, DEFAULT_PORT
from plant_sim.common.picture_form import DPI, LEAST_DPI, MOST_DPI, formats_of

LONGEST_TRIAL_S: Final = 1_000_000
"""Longest machine time of a trial, s."""
MOST_CUPS_PER_MIN: Final = 300.0
"""Highest planting frequency, cups per minute per row."""
SEED: Final = integer(0)
"""Type of a seed."""


def add_machine_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for I/O map, machine parameters, seed and trays."""
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="I/O map of the machine")
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="parameters of the machine")
    parser.add_argument("--seed", type=SEED, default=1, help="seed of all random numbers")
    parser.add_argument(
        "--trays", type=integer(1, MOST_TRAYS), default=2, help="number of trays in the magazine, 72 seedlings each"
    )


def add_frequency_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for the planting frequency; `machine_of` applies it."""
    parser.add_argument(
        "--planting-frequency",
        type=number(0, MOST_CUPS_PER_MIN),
        default=None,
        metavar="PER_MIN",
        help="cups per minute per row, 0 = tractor stationary; replaces cups.planting_frequency_per_min of the machine",
    )


def add_air_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for the air in slides and lifts at the start; `machine_of` applies it."""
    parser.add_argument(
        "--air",
        default=None,
        metavar="vented|full|SHARE",
        help="air in slides and lifts at the start, as a share of the main pressure, e.g. 30%%; replaces "
        "start.chamber_share of the machine",
    )


def add_ladder_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for an FX program in place of the controller; `check_program` checks them."""
    parser.add_argument(
        "--ladder",
        type=Path,
        default=None,
        metavar="FILE",
        help=f"{PROGRAM_FILE}, that replaces the controller",
    )
    add_cpu(parser)
    add_modules(parser)


def add_set_point_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for initial values of set-points; `start_values_of` reads it."""
    add_set_points(parser, example="settle=30")


def add_fault_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option for faults; `faults_of` parses it."""
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND:TARGET[=SIZE][@START..[END]]",
        help="fault to inject, e.g. stuck_off:left.lift_up@12s..20s; may be repeated",
    )


def add_ending_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for the end of a trial; `rule_of` makes its rule."""
    parser.add_argument(
        "--max-s",
        type=integer(1, LONGEST_TRIAL_S),
        default=None,
        metavar="S",
        help="machine time after which the trial ends, s (default: 60 s, and 600 s for each tray)",
    )
    parser.add_argument(
        "--wait",
        action="store_true",
        help="do not end the trial after 10 s of rest, as with an alarm or a question, but wait for an operator",
    )


def add_record_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option for a recording: ``options.record`` is the file, or None."""
    parser.add_argument(
        "--record",
        type=Path,
        default=None,
        metavar="FILE",
        help="record all tags, positions, pressures and seedlings to a Parquet file (docs/scope.md)",
    )


def add_out_argument(parser: argparse.ArgumentParser, files: str) -> None:
    """Add the option for the folder of a result, which `results_of` opens."""
    parser.add_argument(
        "--out", type=Path, default=None, metavar="DIR", help=f"folder for {files}, with their provenance"
    )


def add_picture_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for the form of the pictures in ``--out``; `picture_form` makes it."""
    parser.add_argument(
        "--format",
        type=formats_of,
        metavar="LIST",
        help="with --out: file formats of the pictures, pdf, png and svg, e.g. pdf,svg (default: png,svg)",
    )
    parser.add_argument(
        "--dpi",
        type=integer(LEAST_DPI, MOST_DPI),
        metavar="N",
        help=f"with --out: resolution of PNG pictures, dots per inch (default: {DPI})",
    )


def add_network_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for the address and port of the plant's Modbus TCP server."""
    parser.add_argument("--host", default="127.0.0.1", help="address of the Modbus TCP server")
    parser.add_argument(
        "--port", type=PORT, default=DEFAULT_PORT, help="port of the Modbus TCP server; 0 = any free port"
    )
