"""Options of the plant's Modbus TCP server."""

from __future__ import annotations

import argparse

from controller.common.errors import InputError
from plant_sim.links.modbus_server import DEFAULT_PORT


def add_network_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options for the address and port of the plant's Modbus TCP server."""
    parser.add_argument("--host", default="127.0.0.1", help="address of the Modbus TCP server")
    parser.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help="port of the Modbus TCP server; 0 = any free port"
    )


def check_port(options: argparse.Namespace) -> None:
    """Raise `InputError` if the port is out of range."""
    if not 0 <= options.port <= 65_535:
        raise InputError(f"--port {options.port}: must be 0 to 65535")
