"""Command ``serve``: the plant as a Modbus TCP device, and as a Modbus RTU device on a serial line."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from controller.common.errors import InputError
from controller.common.modbus.rtu import SerialLine
from plant_sim.cli.serving import build, operate
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.machine.parameters import Machine


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
        InputError: An option has no effect.
    """
    if options.wire_time and options.serial is None:
        raise InputError("--wire-time: requires --serial; add it, or omit --wire-time")
