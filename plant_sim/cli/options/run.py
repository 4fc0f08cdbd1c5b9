"""Options of the command ``run``."""

from __future__ import annotations

import argparse

from controller.common.arguments.number_type import PORT, integer
from controller.io.pace import FASTEST, FLAT_OUT, PAUSED
from plant_sim.cli.options.shared import (
    add_ending_arguments,
    add_fault_arguments,
    add_frequency_argument,
    add_machine_arguments,
    add_network_arguments,
    add_out_argument,
    add_record_argument,
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``run``."""
    add_machine_arguments(parser)
    add_network_arguments(parser)
    parser.add_argument("--fast", action="store_true", help="run in lock step in simulated time, without Modbus")
    parser.add_argument(
        "--real-time",
        action="store_true",
        help="follow the wall clock, like a real machine; the run cannot be paused or sped up",
    )
    parser.add_argument(
        "--pace",
        type=integer(PAUSED, FASTEST, also=FLAT_OUT),
        default=100,
        metavar="PERCENT",
        help="initial speed of simulated time; a panel can change it (65535 = as fast as possible)",
    )
    parser.add_argument(
        "--by-hand", action="store_true", help="do not press buttons automatically; start and stop at the panel"
    )
    parser.add_argument("--hmi-port", type=PORT, default=5021, help="port for operator panels; 0 = any free port")
    parser.add_argument("--panel-port", type=PORT, default=8080, help="port of the web panel; 0 = any free port")
    parser.add_argument("--no-panel", action="store_true", help="do not start the web panel")
    parser.add_argument("--keep", action="store_true", help="continue to serve after the report, until Ctrl-C")
    parser.add_argument(
        "--language",
        choices=("en", "zh"),
        default=None,
        help="language of the controller's texts and of the panel's page (default: en, and on the page that of the "
        "browser)",
    )
    add_frequency_argument(parser)
    add_fault_arguments(parser)
    add_ending_arguments(parser)
    add_record_argument(parser)
    add_out_argument(parser, "trial.json and trials.csv")
