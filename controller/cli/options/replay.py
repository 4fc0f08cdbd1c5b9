"""Options of the command ``replay``."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.cli.machine import add_io_map


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``replay``."""
    parser.add_argument("trace", type=Path, help="trace file")
    add_io_map(parser)
    parser.add_argument(
        "--without",
        action="append",
        default=[],
        metavar="RULE",
        help="interlock rule omitted in the proof; may be repeated",
    )
