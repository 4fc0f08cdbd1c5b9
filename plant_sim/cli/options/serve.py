"""Options of the command ``serve``."""

from __future__ import annotations

import argparse

from controller.common.arguments.number_type import integer
from plant_sim.cli.options.plant import LONGEST_MS, add_plant_arguments
from plant_sim.cli.options.shared import add_network_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``serve``."""
    add_plant_arguments(parser)
    add_network_arguments(parser)
    parser.add_argument(
        "--serial",
        default=None,
        metavar="DEVICE:BAUD:FRAME:UNIT",
        help="serial line on which the plant is a Modbus RTU device as well, e.g. /dev/ttyUSB0:19200:8E1:1",
    )
    parser.add_argument(
        "--wire-time",
        action="store_true",
        help="model the transmission time of --serial, for a pseudo-terminal, which transmits at once",
    )
    parser.add_argument(
        "--lock-step-ms",
        type=integer(1, LONGEST_MS),
        default=None,
        help="milliseconds of plant time per write of the outputs, instead of real time",
    )
