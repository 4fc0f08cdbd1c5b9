"""Options of the command ``replay``."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.common.arguments.number_type import integer
from plant_sim.cli.options.shared import add_fault_arguments, add_machine_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``replay``."""
    parser.add_argument("file", type=Path, help="capture of 'controller run --capture' or 'controller capture record'")
    add_machine_arguments(parser)
    add_fault_arguments(parser)
    parser.add_argument(
        "--tolerance-ms",
        type=integer(0, 60_000),
        default=0,
        help="permitted difference of the times of an edge, ms; 0 for a capture in simulated time",
    )
    parser.add_argument(
        "--ignore",
        action="append",
        default=[],
        metavar="INPUT",
        help="input that is not compared, by tag or address, such as the cup counters X22 and X23, whose phase at the "
        "begin of a capture in real time is not known; may be repeated",
    )
