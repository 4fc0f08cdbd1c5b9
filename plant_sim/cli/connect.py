"""Command ``connect``: the plant as the terminals of a PLC that is a Modbus slave or an MC protocol server."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from controller.common.errors import InputError
from controller.common.modbus.async_client import AsyncModbusClient, AsyncRtuClient, AsyncTcpClient
from controller.common.modbus.rtu import SerialLine
from plant_sim.cli.serving import build, operate, tell
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.plc.client import PlcClient
from plant_sim.links.plc.mc import McPlc
from plant_sim.links.plc.modbus import ModbusPlc
from plant_sim.links.plc.port import PlcPort
from plant_sim.links.plc.profile import PlcProfile, PlcProtocol, load_profile
from plant_sim.machine.parameters import Machine


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
        InputError: An option is missing.
    """
    if (options.host is None) == (options.serial is None):
        raise InputError("specify either --host, the address of the PLC, or --serial, the line to it")
