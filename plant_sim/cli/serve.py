"""Command ``serve``: the plant as a Modbus TCP device, and as a Modbus RTU device on a serial line."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from controller.common.errors import InputError
from controller.common.modbus.rtu import SerialLine
from plant_sim.cli.options import add_network_arguments, check_port
from plant_sim.cli.serving import add_plant_arguments, build, operate
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.machine.parameters import Machine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``serve``."""
    add_plant_arguments(parser)
    add_network_arguments(parser)
    parser.add_argument(
        "--serial",
        default=None,
        metavar="DEVICE:BAUD:FRAME:UNIT",
        help="serial line on which the plant is a Modbus RTU device as well, e.g. /dev/ttyUSB0:19200:8E1:1",
    )
    parser.add_argument(
        "--wire-time",
        action="store_true",
        help="model the transmission time of --serial, for a pseudo-terminal, which transmits at once",
    )
    parser.add_argument(
        "--lock-step-ms",
        type=int,
        default=None,
        help="milliseconds of plant time per write of the outputs, instead of real time",
    )


def run(options: argparse.Namespace) -> int:
    """Serve until the request to stop.

    Raises:
        InputError: An option or a file is invalid, or the port or the serial line cannot be opened.
    """
    check(options)
    module, machine = build(options)
    return operate_server(options, module, machine)


def operate_server(
    options: argparse.Namespace,
    module: IoModule,
    machine: Machine,
    begin: Callable[[PlantServer], None] | None = None,
) -> int:
    """Serve a plant until the request to stop; see `operate`.

    Raises:
        InputError: An option is invalid, or the port or the serial line cannot be opened.
    """
    serial = None if options.serial is None else SerialLine.parsed(options.serial)
    return operate(options, module, machine, host=options.host, port=options.port, serial=serial, begin=begin)


def check(options: argparse.Namespace) -> None:
    """Check the options of the servers.

    Raises:
        InputError: An option is out of range, or has no effect.
    """
    check_port(options)
    if options.wire_time and options.serial is None:
        raise InputError("--wire-time: requires --serial; add it, or omit --wire-time")
