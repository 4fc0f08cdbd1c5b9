"""Options of the command ``trial``."""

from __future__ import annotations

import argparse

from controller.common.arguments.number_type import integer
from plant_sim.cli.options.shared import (
    add_air_argument,
    add_ending_arguments,
    add_fault_arguments,
    add_frequency_argument,
    add_ladder_arguments,
    add_machine_arguments,
    add_out_argument,
    add_record_argument,
    add_set_point_argument,
)
from plant_sim.common.capacity import MOST_SEEDLINGS

MOST_TRIALS = 10_000
LONGEST_SCAN_MS = 200
"""Longest scan of an FX2N, ms: its watchdog (docs/sources/fx2n.md 1.4)."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trial``."""
    add_machine_arguments(parser)
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print one JSON object")
    output.add_argument("--csv", action="store_true", help="print a header and one line per trial")
    parser.add_argument(
        "--seedlings",
        type=integer(1, MOST_SEEDLINGS),
        default=None,
        metavar="N",
        help="number of seedlings, in as many trays as required; --trays is ignored",
    )
    parser.add_argument(
        "--repeat",
        type=integer(1, MOST_TRIALS),
        default=1,
        metavar="K",
        help="number of trials, with consecutive seeds from --seed",
    )
    add_ladder_arguments(parser)
    parser.add_argument(
        "--scan-ms",
        type=integer(1, LONGEST_SCAN_MS),
        nargs="+",
        default=None,
        metavar="MS",
        help="with --ladder: time between two scans, ms; the input filter samples the terminals between them. Several "
        "times, or --repeat, print a table",
    )
    parser.add_argument(
        "--jitter-ms",
        type=integer(0, LONGEST_SCAN_MS - 1),
        default=0,
        metavar="MS",
        help="with --scan-ms: largest deviation, ms, less than the scan time",
    )
    parser.add_argument(
        "--long-scan-ms",
        type=integer(0, LONGEST_SCAN_MS),
        default=0,
        metavar="MS",
        help="with --scan-ms: one scan in 1000 takes this time, ms",
    )
    parser.add_argument(
        "--scan-estimate", action="store_true", help="with --ladder: estimate the scan time of a real FX2N"
    )
    add_frequency_argument(parser)
    add_air_argument(parser)
    add_set_point_argument(parser)
    add_fault_arguments(parser)
    add_ending_arguments(parser)
    add_record_argument(parser)
    add_out_argument(parser, "trial.json and trials.csv")
