"""Options of the command ``line``."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.common.arguments.number_type import integer, number
from plant_sim.cli.options.shared import SEED, add_picture_arguments
from plant_sim.common.defaults import DEFAULT_MACHINE, DEFAULT_PASSES

MOST_METRES = 100_000.0
DEFAULT_METRES = 100.0
MOST_PASSES = 1_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``line``."""
    parser.add_argument("line", metavar="NAME|FILE", help="cabbage, pepper, combined, or a line file")
    parser.add_argument(
        "--profile", type=Path, default=None, metavar="FILE", help="ground file that replaces the ground of the line"
    )
    parser.add_argument(
        "--metres", type=number(1, MOST_METRES), default=DEFAULT_METRES, metavar="N", help="length of each row, m"
    )
    parser.add_argument("--seed", type=SEED, default=1, help="seed of all random numbers")
    parser.add_argument(
        "--repeat",
        type=integer(1, MOST_PASSES),
        default=DEFAULT_PASSES,
        metavar="K",
        help="number of passes by which the rows are judged, with consecutive seeds from --seed; the files are of the "
        "first",
    )
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="parameters of the machine")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--out", type=Path, default=None, metavar="DIR", help="folder for the plants as CSV and Parquet and a picture"
    )
    add_picture_arguments(parser)
