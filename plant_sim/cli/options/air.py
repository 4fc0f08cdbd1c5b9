"""Options of the command ``air``."""

from __future__ import annotations

import argparse
from pathlib import Path

from plant_sim.cli.options.shared import add_machine_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``air``."""
    parser.add_argument(
        "recording",
        type=Path,
        nargs="?",
        default=None,
        metavar="RECORDING",
        help="file written with --record (default: run the paper's trial)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_machine_arguments(parser)
