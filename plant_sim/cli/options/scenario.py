"""Options of the command ``scenario``."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.cli.options.shared import SEED, add_out_argument, add_record_argument
from plant_sim.common.defaults import DEFAULT_MACHINE


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``scenario``."""
    parser.add_argument("scenario", metavar="FILE|NAME", help="scenario file, or name of an included scenario")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="I/O map of the machine")
    parser.add_argument(
        "--machine", type=Path, default=DEFAULT_MACHINE, help="parameters of the machine; the scenario may change them"
    )
    parser.add_argument("--seed", type=SEED, default=None, help="seed to use instead of the scenario's seed")
    add_record_argument(parser)
    add_out_argument(parser, "scenario.json")
