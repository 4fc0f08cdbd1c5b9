"""I/O map option and machine program for the commands that use them."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import Transplanter, build


def add_io_map(parser: argparse.ArgumentParser) -> None:
    """Add the option for the I/O map."""
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="I/O map of the machine")


def machine_of(options: argparse.Namespace, *, without: Collection[str] = ()) -> Transplanter:
    """Return the machine's program for the chosen I/O map.

    Args:
        options: Parsed options, including ``io_map``.
        without: Interlock rules to omit.

    Raises:
        IoMapError: The I/O map is invalid.
        RuleError: A rule in `without` is unknown.
    """
    return build(load_io_map(options.io_map), without=without)
