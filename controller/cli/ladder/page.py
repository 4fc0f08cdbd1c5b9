"""Command ``ladder page``: a running program as a ladder with power flow, in a browser."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from controller.cli.fx_options import PROGRAM_FILE, add_cpu
from controller.cli.machine import add_io_map
from controller.common.arguments.number_type import PORT

DEFAULT_PORT: Final = 8081


def add_page(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand ``page`` with its options."""
    page = commands.add_parser("page", help="show a running program as a ladder with power flow, in a browser")
    page.set_defaults(action=_page)
    page.add_argument("file", type=Path, nargs="?", help=f"{PROGRAM_FILE}; omitted with --machine")
    page.add_argument("--machine", action="store_true", help="the program of the machine, which the controller runs")
    page.add_argument(
        "--connect",
        default="127.0.0.1:5021",
        metavar="HOST:PORT",
        help="Modbus server of the controller, or of ladder run --serve-modbus",
    )
    page.add_argument("--host", default="127.0.0.1", help="address of the web server, on this computer only")
    page.add_argument("--port", type=PORT, default=DEFAULT_PORT, help="port of the web server; 0 = any free port")
    add_cpu(page)
    add_io_map(page)


def _page(options: argparse.Namespace) -> int:
    from controller.cli.ladder.page_server import serve_live_page  # noqa: PLC0415 - the web server loads slowly

    return serve_live_page(options)
