"""Command ``bench``: measure the speeds that the documentation states."""

from __future__ import annotations

import argparse
import json
import sys

from controller.common.errors import InputError
from controller.common.real_time import DEFAULT_PRIORITY
from plant_sim.cli.options import add_machine_arguments, check_machine_arguments


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``bench``."""
    add_machine_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--busy-host",
        type=int,
        nargs="?",
        const=60,
        default=None,
        metavar="SECONDS",
        help="measure only the lateness of the scans on a busy computer, in four runs of this duration, 60 s by "
        "default: with normal and with real-time priority, which must be permitted",
    )


def run(options: argparse.Namespace) -> int:
    """Measure and print the figures."""
    check_machine_arguments(options)
    if options.busy_host is not None:
        return _busy_host(options.busy_host)
    from plant_sim.benchmark.run import measure  # noqa: PLC0415

    figures = measure(seed=options.seed)
    print(json.dumps(figures.record()) if options.json else figures.text())
    return 0


def _busy_host(for_s: int) -> int:
    if not 1 <= for_s <= 600:
        raise InputError(f"--busy-host {for_s}: must be 1 to 600")
    from plant_sim.benchmark.busy_host import measure_busy_host  # noqa: PLC0415
    from plant_sim.benchmark.hmi_load import SilentServerError  # noqa: PLC0415
    from plant_sim.twin.process import LiveError  # noqa: PLC0415

    try:
        for row in measure_busy_host(for_s, DEFAULT_PRIORITY):
            print(row.text(), flush=True)
    except (LiveError, SilentServerError) as error:
        print(error, file=sys.stderr)
        return 1
    return 0
