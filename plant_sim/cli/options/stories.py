"""Options of the command ``stories``."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.common.arguments.number_type import integer
from controller.iomap.loader import DEFAULT_IO_MAP
from plant_sim.cli.options.shared import SEED, add_out_argument
from plant_sim.common.defaults import DEFAULT_MACHINE

MOST_STORIES = 100_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``stories``."""
    parser.add_argument("--io-map", type=Path, default=DEFAULT_IO_MAP, help="I/O map of the machine")
    parser.add_argument("--machine", type=Path, default=DEFAULT_MACHINE, help="parameters of the machine")
    parser.add_argument(
        "--random",
        type=integer(1, MOST_STORIES),
        default=None,
        metavar="N",
        help="play N random stories of faults and actions instead, and report harm and coverage",
    )
    parser.add_argument("--seed", type=SEED, default=1, help="with --random: seed of all stories")
    parser.add_argument(
        "--undirected",
        action="store_true",
        help="with --random: draw every action uniformly, without regard to the coverage, for comparison",
    )
    parser.add_argument("--replay", default=None, metavar="STORY", help="play one random story, as a report prints it")
    add_out_argument(parser, "stories.json, with --random and --replay")
