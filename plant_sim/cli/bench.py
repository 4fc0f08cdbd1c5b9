"""Command ``bench``: measure the speeds that the documentation states."""

from __future__ import annotations

import argparse
import json

from plant_sim.cli.options import add_machine_arguments, check_machine_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``bench``."""
    add_machine_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(options: argparse.Namespace) -> int:
    """Measure and print the figures."""
    from plant_sim.benchmark.run import measure  # noqa: PLC0415

    check_machine_arguments(options)
    figures = measure(seed=options.seed)
    print(json.dumps(figures.record()) if options.json else figures.text())
    return 0
