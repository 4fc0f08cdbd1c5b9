"""Options of the command ``reproduce``."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``reproduce``."""
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="folder of a result, with its provenance.json")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="new folder for the reproduced result")
