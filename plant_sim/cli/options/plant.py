"""Options of the commands that serve a plant."""

from __future__ import annotations

import argparse
from typing import Final

from controller.common.arguments.number_type import integer
from controller.common.real_time import add_real_time_arguments
from plant_sim.cli.options.shared import (
    add_air_argument,
    add_fault_arguments,
    add_frequency_argument,
    add_machine_arguments,
    add_record_argument,
)

LONGEST_MS: Final = 600_000
"""Longest time of an option, ms."""


def add_plant_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the plant, its output watchdog and its time."""
    add_machine_arguments(parser)
    parser.add_argument(
        "--watchdog-ms",
        type=integer(1, LONGEST_MS),
        default=100,
        help="time without a write after which outputs go to safe levels",
    )
    parser.add_argument(
        "--gap-limit-ms",
        type=integer(1, LONGEST_MS),
        default=None,
        help="time without a write that is reported as a gap; default: half of --watchdog-ms",
    )
    parser.add_argument(
        "--allow-remote",
        action="store_true",
        help="permit an address to listen on that other computers can reach; Modbus has no password",
    )
    add_frequency_argument(parser)
    add_real_time_arguments(parser)
    add_air_argument(parser)
    add_fault_arguments(parser)
    add_record_argument(parser)
