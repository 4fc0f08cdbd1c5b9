"""Options of the command ``connect``."""

from __future__ import annotations

import argparse

from controller.common.arguments.number_type import PORT, REMOTE_PORT, integer
from plant_sim.cli.options.plant import LONGEST_MS, add_plant_arguments
from plant_sim.common.defaults import DEFAULT_PORT
from plant_sim.links.plc.profile import profile_names


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``connect``."""
    names = ", ".join(profile_names())
    parser.add_argument("profile", help=f"profile of the PLC: {names}; or the path of a YAML file")
    parser.add_argument("--host", default=None, help="name or address of the PLC")
    parser.add_argument(
        "--port", type=REMOTE_PORT, default=None, help="TCP port of the PLC; default: that of the profile"
    )
    parser.add_argument("--unit", type=integer(0, 255), default=1, help="Modbus unit of the PLC on TCP")
    parser.add_argument(
        "--serial",
        default=None,
        metavar="DEVICE:BAUD:FRAME:UNIT",
        help="serial line to a PLC that is a Modbus RTU slave, instead of --host, e.g. /dev/ttyUSB0:115200:8N1:1",
    )
    parser.add_argument(
        "--period-ms", type=integer(1, 10_000), default=10, help="time between the starts of two exchanges"
    )
    parser.add_argument(
        "--timeout-ms",
        type=integer(1, 60_000),
        default=50,
        help="longest time for an answer, without the time on a serial line",
    )
    parser.add_argument(
        "--lock-step-ms",
        type=integer(1, LONGEST_MS),
        default=None,
        help="milliseconds of plant time per exchange, instead of real time; for a PLC that scans once per exchange",
    )
    parser.add_argument(
        "--listen-port",
        type=PORT,
        default=DEFAULT_PORT,
        help="port of the plant's own Modbus TCP server, for telemetry and push buttons; 0 = any free port",
    )
    parser.add_argument("--listen-host", default="127.0.0.1", help="address of this server")
    add_plant_arguments(parser)
