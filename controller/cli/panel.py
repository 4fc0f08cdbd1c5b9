"""Command ``panel``: serve the operator's web page for a running controller."""

from __future__ import annotations

import argparse
import logging
import socket
import ssl
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Final

import uvicorn
from starlette.types import ASGIApp

from controller.cli.machine import machine_of
from controller.common.client_slots import is_loopback
from controller.common.errors import InputError
from controller.common.files.trust import secret_exposure
from controller.common.modbus.address import listening_remedy
from controller.common.supervision.tasks import run_supervised
from controller.core.clock import MonotonicClock
from controller.history.query import HistoryReader
from controller.hmi.panel.modbus.connection import ModbusConnection
from controller.hmi.panel.modbus.telemetry import Telemetry, load_tags
from controller.hmi.panel.orders.login import Users
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trends import MOST_PERIODS
from controller.hmi.panel.web.app import PanelApplication, Sources, application
from controller.hmi.panel.web.listener import PanelListener

LONGEST_MESSAGE: Final = 4_096
PING_S: Final = 5.0
"""Ping interval and timeout of a WebSocket, s; a socket that does not answer is closed and its jog ends."""
CLOSING_S: Final = 2


def run(options: argparse.Namespace) -> int:
    """Serve until the request to stop and return the exit code.

    Raises:
        InputError: An option or a file is invalid.
    """
    _check_reach(options)
    _check_tls(options)
    machine = machine_of(options)
    users = Users(options.users)
    tags = None if options.telemetry_tags is None else load_tags(options.telemetry_tags)
    if (options.telemetry is None) != (tags is None):
        raise InputError("--telemetry and --telemetry-tags must be used together")
    clock = MonotonicClock()
    connect = _connection("--controller", options.controller, is_named=True)
    telemetry = None
    if tags is not None:
        telemetry = Telemetry(_connection("--telemetry", options.telemetry)(), tags, clock)
    history = HistoryReader(options.history)
    trends = TrendFile(options.trends, MOST_PERIODS)
    trends.check()
    sources = Sources(machine, connect, telemetry, history, clock, options.language, trends)
    with _listening(options.host, options.port) as listener:
        run_supervised(_serve(sources, users, listener, options))
    return 0


class _Server(uvicorn.Server):
    """Web server that prints its URL once it is listening."""

    def __init__(self, config: uvicorn.Config, url: str) -> None:
        super().__init__(config)
        self._url = url

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:  # noqa: ARG002 - the signature of the base class
        """Stop the server; a second signal does not cut its closing short, which lasts `CLOSING_S` at most."""
        self.should_exit = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        sys.stdout.write(f"panel at {self._url}\n")
        sys.stdout.flush()


def server_config(app: ASGIApp, certificate: Path | None = None, key: Path | None = None) -> uvicorn.Config:
    """Return the server settings; they limit the message size, set the ping timeout and ignore forwarded headers."""
    return uvicorn.Config(
        app,
        log_config=None,
        access_log=False,
        lifespan="on",
        proxy_headers=False,
        server_header=False,
        ws="websockets-sansio",
        ws_max_size=LONGEST_MESSAGE,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PING_S,
        timeout_graceful_shutdown=CLOSING_S,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )


async def _serve(sources: Sources, users: Users, listener: socket.socket, options: argparse.Namespace) -> None:
    secure = options.certificate is not None
    listener = PanelListener(listener, sources.clock)
    panel = PanelApplication(sources, users, listener, secure=secure)
    config = server_config(application(panel, [options.host, *options.names]), options.certificate, options.key)
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    host, port = listener.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    server = _Server(config, f"{'https' if secure else 'http'}://{shown}:{port}")
    # For a signal before the server installs its own handlers.
    with options.stop.calling(lambda: setattr(server, "should_exit", True)):
        await server.serve(sockets=[listener])


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise InputError(f"--host {host} --port {port}: {error.strerror}; {listening_remedy(error)}") from error


def _check_reach(options: argparse.Namespace) -> None:
    if is_loopback("127.0.0.1" if options.host == "localhost" else options.host):
        return
    if not options.allow_remote:
        raise InputError(
            f"--host {options.host}: other computers could reach the panel; use --allow-remote to permit this"
        )
    if options.certificate is None:
        sys.stderr.write("warning: no TLS: passwords are sent unencrypted; use --certificate and --key\n")


def _check_tls(options: argparse.Namespace) -> None:
    if (options.certificate is None) != (options.key is None):
        raise InputError("--certificate and --key must be used together")
    if options.certificate is None:
        return
    if problem := secret_exposure(options.key):
        raise InputError(f"--key {problem}")
    try:
        # Without password="", an encrypted key would cause a password prompt on the terminal.
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(options.certificate, options.key, password="")
    except OSError as error:
        raise InputError(
            f"--certificate {options.certificate}, --key {options.key}: {error}; specify a matching pair of PEM files"
        ) from error


def _connection(option: str, where: str, *, is_named: bool = False) -> Callable[[], ModbusConnection]:
    """Return a factory for connections to HOST:PORT."""
    host, _, port = where.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdecimal() or not 1 <= int(port[:6]) <= 65_535:
        raise InputError(f"{option} {where}: must be HOST:PORT, for example 127.0.0.1:5021")
    return lambda: ModbusConnection(host, int(port), is_named=is_named)
