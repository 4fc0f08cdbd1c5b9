"""Options of the command ``docs``."""

from __future__ import annotations

import argparse
from pathlib import Path

from plant_sim.cli.options.shared import add_machine_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``docs``."""
    add_machine_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, help="output folder")
