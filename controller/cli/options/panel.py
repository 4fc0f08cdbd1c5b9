"""Options of the command ``panel``."""

from __future__ import annotations

import argparse
from pathlib import Path

from controller.cli.machine import add_io_map
from controller.common.arguments.number_type import PORT
from controller.common.files.state_folder import state_folder
from controller.history.writer import HISTORY_NAME
from controller.program.texts.operator import LANGUAGES


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``panel``."""
    parser.add_argument(
        "--controller", default="127.0.0.1:5021", metavar="HOST:PORT", help="Modbus server of the controller"
    )
    parser.add_argument(
        "--telemetry",
        default=None,
        metavar="HOST:PORT",
        help="second Modbus server for values that the controller does not provide",
    )
    parser.add_argument(
        "--telemetry-tags", type=Path, default=None, metavar="FILE.csv", help="tags of the second Modbus server"
    )
    parser.add_argument(
        "--history",
        type=Path,
        default=state_folder() / HISTORY_NAME,
        help="history written by the controller; the file may be missing",
    )
    parser.add_argument(
        "--trends",
        type=Path,
        default=state_folder() / "panel-trends.sqlite",
        help="file of the trends of the last 24 h, written once a minute",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address of the web server")
    parser.add_argument("--port", type=PORT, default=8080, help="port of the web server; 0 = any free port")
    parser.add_argument(
        "--name",
        action="append",
        default=[],
        dest="names",
        help="additional host name of the panel in browsers; may be repeated",
    )
    parser.add_argument(
        "--language",
        choices=LANGUAGES,
        default=None,
        help="language of the page until its user selects one (default: the language of the browser)",
    )
    parser.add_argument("--users", type=Path, default=state_folder() / "panel-users.json", help="password file")
    add_io_map(parser)
    parser.add_argument("--allow-remote", action="store_true", help="permit an address that other computers can reach")
    parser.add_argument("--certificate", type=Path, default=None, help="certificate (PEM) for TLS")
    parser.add_argument("--key", type=Path, default=None, help="private key of the certificate (PEM)")
