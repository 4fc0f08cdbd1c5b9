"""Command ``connect``: the plant as the terminals of a PLC that is a Modbus slave or an MC protocol server."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from controller.common.errors import InputError
from controller.common.modbus.async_client import AsyncModbusClient, AsyncRtuClient, AsyncTcpClient
from controller.common.modbus.rtu import SerialLine
from plant_sim.cli.serving import add_plant_arguments, build, operate, tell
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import DEFAULT_PORT, PlantServer
from plant_sim.links.plc.client import PlcClient
from plant_sim.links.plc.mc import McPlc
from plant_sim.links.plc.modbus import ModbusPlc
from plant_sim.links.plc.port import PlcPort
from plant_sim.links.plc.profile import PlcProfile, PlcProtocol, load_profile, profile_names
from plant_sim.machine.parameters import Machine


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``connect``."""
    names = ", ".join(profile_names())
    parser.add_argument("profile", help=f"profile of the PLC: {names}; or the path of a YAML file")
    parser.add_argument("--host", default=None, help="name or address of the PLC")
    parser.add_argument("--port", type=int, default=None, help="TCP port of the PLC; default: that of the profile")
    parser.add_argument("--unit", type=int, default=1, help="Modbus unit of the PLC on TCP")
    parser.add_argument(
        "--serial",
        default=None,
        metavar="DEVICE:BAUD:FRAME:UNIT",
        help="serial line to a PLC that is a Modbus RTU slave, instead of --host, e.g. /dev/ttyUSB0:115200:8N1:1",
    )
    parser.add_argument("--period-ms", type=int, default=10, help="time between the starts of two exchanges")
    parser.add_argument(
        "--timeout-ms", type=int, default=50, help="longest time for an answer, without the time on a serial line"
    )
    parser.add_argument(
        "--lock-step-ms",
        type=int,
        default=None,
        help="milliseconds of plant time per exchange, instead of real time; for a PLC that scans once per exchange",
    )
    parser.add_argument(
        "--listen-port",
        type=int,
        default=DEFAULT_PORT,
        help="port of the plant's own Modbus TCP server, for telemetry and push buttons; 0 = any free port",
    )
    parser.add_argument("--listen-host", default="127.0.0.1", help="address of this server")
    add_plant_arguments(parser)


def run(options: argparse.Namespace) -> int:
    """Exchange with the PLC until the request to stop.

    Raises:
        InputError: An option or a file is invalid, or the port cannot be opened.
    """
    check(options)
    module, machine = build(options)
    return operate_client(options, module, machine)


def operate_client(
    options: argparse.Namespace,
    module: IoModule,
    machine: Machine,
    begin: Callable[[PlantServer], None] | None = None,
) -> int:
    """Exchange the terminals of a plant with the PLC until the request to stop; see `operate`.

    Raises:
        InputError: An option or a file is invalid, or the port cannot be opened.
    """
    io_map = module.io_map
    if io_map.registers:
        tags = ", ".join(register.tag for register in io_map.registers)
        raise InputError(f"{io_map.path}: {tags}: a PLC profile has no output registers; write wired: false")
    profile = load_profile(options.profile, input_count=io_map.input_count, output_count=io_map.output_count)
    client = PlcClient(
        _port(options, profile, module),
        module,
        input_bits=profile.input_bits(io_map.input_count),
        ok_bit=profile.ok_bit,
        period_s=0 if options.lock_step_ms is not None else options.period_ms / 1_000,
        tell=tell,
    )
    host, port = options.listen_host, options.listen_port
    return operate(options, module, machine, host=host, port=port, plc=client, begin=begin)


def _port(options: argparse.Namespace, profile: PlcProfile, module: IoModule) -> PlcPort:
    """Return the closed port of the PLC."""
    timeout_s, output_count = options.timeout_ms / 1_000, module.io_map.output_count
    port = profile.port if options.port is None else options.port
    if profile.protocol is not PlcProtocol.MODBUS:
        if options.serial is not None:
            raise InputError(f"--serial: profile {options.profile} is for TCP; specify --host instead")
        return McPlc(profile, options.host, port, output_count=output_count, timeout_s=timeout_s)
    client: AsyncModbusClient
    if options.serial is not None:
        client = AsyncRtuClient(SerialLine.parsed(options.serial), timeout_s=timeout_s)
    else:
        client = AsyncTcpClient(options.host, port, unit=options.unit, timeout_s=timeout_s)
    return ModbusPlc(profile, client, output_count=output_count)


def check(options: argparse.Namespace) -> None:
    """Check the options of the PLC.

    Raises:
        InputError: An option is missing or out of range.
    """
    if (options.host is None) == (options.serial is None):
        raise InputError("specify either --host, the address of the PLC, or --serial, the line to it")
    for name, least, most in (
        ("port", 1, 65_535),
        ("listen_port", 0, 65_535),
        ("unit", 0, 255),
        ("period_ms", 1, 10_000),
        ("timeout_ms", 1, 60_000),
    ):
        value = getattr(options, name)
        if value is not None and not least <= value <= most:
            raise InputError(f"--{name.replace('_', '-')} {value}: must be {least} to {most}")
