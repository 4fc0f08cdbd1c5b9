"""Options of the command ``debug``."""

from __future__ import annotations

import argparse

from controller.cli.debugger import add_debugger_arguments
from controller.common.arguments.number_type import integer
from controller.debug.timeline import LENGTH
from plant_sim.cli.options.shared import (
    add_air_argument,
    add_ending_arguments,
    add_fault_arguments,
    add_frequency_argument,
    add_ladder_arguments,
    add_machine_arguments,
    add_set_point_argument,
)

LONGEST = 1_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``debug``."""
    add_machine_arguments(parser)
    add_ladder_arguments(parser)
    add_debugger_arguments(parser)
    parser.add_argument(
        "--length",
        type=integer(1, LONGEST),
        default=LENGTH,
        metavar="SCANS",
        help="number of scans to keep; the oldest are dropped",
    )
    add_frequency_argument(parser)
    add_air_argument(parser)
    add_set_point_argument(parser)
    add_fault_arguments(parser)
    add_ending_arguments(parser)
