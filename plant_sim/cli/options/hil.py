"""Options of the command ``hil``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from controller.common.arguments.number_type import integer
from plant_sim.cli.options import connect, serve
from plant_sim.cli.options.shared import (
    SEED,
    add_air_argument,
    add_fault_arguments,
    add_frequency_argument,
    add_machine_arguments,
)
from plant_sim.hil.selection import FIRST_GROUPS, GROUPS, SHORT_GROUPS, BenchLimits

TRAYS: Final = 60
"""Trays in the magazine, enough for all cases with the reference program."""
SCAN_MS: Final = 10
"""Plant time per scan of the program in this process, ms."""
MOST_MS: Final = 10_000
"""Largest limit that can be given, ms."""
NO_LINK: Final = {"watchdog_ms": 100, "real_time_priority": None, "real_time_cpu": None}
"""Options that have no effect on a controller in the same process."""
MOST_RANDOM_S: Final = 1_000_000
"""Longest duration of the random operator that can be given, s."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the ways to the controller with their options."""
    ways = parser.add_subparsers(required=True, metavar="WAY")
    server = ways.add_parser("serve", help="the controller is a Modbus client of the plant, as with 'serve'")
    serve.add_arguments(server)
    _add_judge(server)
    server.set_defaults(way="serve")
    client = ways.add_parser("connect", help="the plant is a client of the PLC, as with 'connect'")
    connect.add_arguments(client)
    _add_judge(client)
    client.set_defaults(way="connect")
    own = ways.add_parser("program", help="the controller is the machine's own program, in this process")
    add_machine_arguments(own)
    add_frequency_argument(own)
    add_air_argument(own)
    add_fault_arguments(own)
    _add_judge(own)
    own.set_defaults(way="program", lock_step_ms=SCAN_MS, **NO_LINK)


def _add_judge(parser: argparse.ArgumentParser) -> None:
    """Add the options of the judgement."""
    limits = BenchLimits()
    judge = parser.add_argument_group("judgement")
    judge.add_argument(
        "--cases",
        action="append",
        choices=GROUPS,
        default=None,
        metavar="GROUP",
        help=f"group of cases to run: {', '.join(GROUPS)}; may be repeated (default: all); {', '.join(FIRST_GROUPS)} "
        "always run",
    )
    judge.add_argument(
        "--short", action="store_true", help=f"the same as --cases for {', '.join(SHORT_GROUPS)}: 35 minutes at most"
    )
    judge.add_argument(
        "--random-operator",
        type=integer(0, MOST_RANDOM_S),
        default=0,
        metavar="SECONDS",
        help="let an operator press at random for this time after all cases; in lock step only",
    )
    judge.add_argument("--random-seed", type=SEED, default=1, help="seed of the random operator")
    judge.add_argument(
        "--wait-s",
        type=integer(1, MOST_MS),
        default=60,
        help="in lock step: longest time without a write of the outputs, by the clock, after which the run ends",
    )
    judge.add_argument("--only", default="", metavar="TEXT", help="run the further cases whose names contain this text")
    judge.add_argument(
        "--stop-ms",
        type=integer(0, MOST_MS),
        default=limits.stop_ms,
        help="longest time from emergency stop to outputs off",
    )
    judge.add_argument(
        "--margin-ms",
        type=integer(0, MOST_MS),
        default=limits.margin_ms,
        help="least increase of the scan time to be tolerated",
    )
    judge.add_argument(
        "--no-reference",
        action="store_true",
        help="do not compare losses, missed cups, duration and switching of the trial with the machine's own program",
    )
    judge.add_argument("--out", type=Path, required=True, help="folder for hil.xml (JUnit) and hil.html")
    parser.set_defaults(trays=TRAYS)
