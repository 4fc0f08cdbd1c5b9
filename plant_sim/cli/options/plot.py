"""Options of the command ``plot``."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``plot``."""
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="file written with --record")
    parser.add_argument(
        "--out", type=Path, default=None, help="folder for the pictures (default: the folder of the recording)"
    )
    parser.add_argument(
        "--from", dest="start", default=None, metavar="TIME", help="start of the window, e.g. 12s or 12500ms"
    )
    parser.add_argument("--to", dest="end", default=None, metavar="TIME", help="end of the window")
    parser.add_argument(
        "--arm",
        choices=("left", "right"),
        default="left",
        help="arm shown in the timing diagram; without --from and --to the window is its second complete cycle",
    )
    parser.add_argument(
        "--tags",
        nargs="+",
        default=None,
        metavar="TAG",
        help="tags to draw instead of the usual ones; patterns such as 'y.left.*' are allowed",
    )
