"""Options of the command ``faults``."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from controller.common.arguments.number_type import integer, number
from plant_sim.cli.options.shared import add_machine_arguments

MOMENTS = 10
"""Default number of random moments per fault."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``faults``."""
    add_machine_arguments(parser)
    parser.add_argument("--all", action="store_true", help="inject every fault of the machine")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="KIND[:TARGET]",
        help="inject only this fault, at one target or, if the side is omitted, at both arms; may be repeated",
    )
    parser.add_argument(
        "--times",
        dest="factors",
        type=number(0.001, 1_000),
        action="append",
        default=[],
        metavar="FACTOR",
        help="multiply the sizes of the faults, and record signals and harm without judging; may be repeated",
    )
    parser.add_argument("--moments", type=integer(1, 1_000), default=MOMENTS, help="random moments per fault")
    parser.add_argument(
        "--at-rest",
        action="store_true",
        help="let position switches stick after a stop, in every rest situation of the trial, instead of during motion",
    )
    parser.add_argument(
        "--stop",
        dest="stops",
        action="append",
        default=[],
        metavar="NAME",
        help="with --at-rest: only this kind of stop, e.g. stopped; may be repeated (docs/fault-matrix.md)",
    )
    parser.add_argument(
        "--every",
        type=integer(10),
        default=None,
        metavar="MS",
        help="with --at-rest: stop at all moments of the trial with this distance, a multiple of 10 ms",
    )
    parser.add_argument(
        "--stored-air",
        action="store_true",
        help="vent slides and lifts, let them leak, and free jams, with every remedy, instead of the faults",
    )
    parser.add_argument(
        "--yield-inputs",
        action="store_true",
        help="run without and with the yield inputs, add their own faults, and compare (docs/fault-matrix.md)",
    )
    parser.add_argument("--jobs", type=integer(1, 1_000), default=os.cpu_count() or 1, help="parallel processes")
    parser.add_argument("--out", type=Path, default=None, metavar="DIR", help="folder for the table, CSV and JSON")
