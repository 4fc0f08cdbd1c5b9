"""The command ``panel``: serve the operator's page beside a controller."""

from __future__ import annotations

import argparse
import asyncio
import logging
import signal
import socket
import ssl
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import uvicorn
from starlette.types import ASGIApp

from controller.core.clock import MonotonicClock
from controller.hmi.history_query import HistoryReader
from controller.hmi.panel.app import Panel, Sources, application
from controller.hmi.panel.line import Line
from controller.hmi.panel.login import Users, UsersFileError, is_loopback
from controller.hmi.panel.telemetry import TagFileError, Telemetry, load_tags
from controller.io_map import load_io_map
from controller.modbus.address import listening_remedy
from controller.program.machine import build

LONGEST_MESSAGE: Final = 4_096
PING_S: Final = 5.0
"""A socket that does not answer for so long twice is closed, and what it holds is let go."""
CLOSING_S: Final = 2


class PanelError(ValueError):
    """An option the panel cannot be started with; one line with the remedy."""


class PanelCommand:
    """The command and its options; `run` raises `PanelError` and `IoMapError` with one line each."""

    def add_to(self, parser: argparse.ArgumentParser, default_io_map: Path) -> None:
        """Add the options to the parser of ``panel``; the action is `run`."""
        parser.set_defaults(action=self.run)
        parser.add_argument("--controller", default="127.0.0.1:5021", metavar="HOST:PORT",
                            help="Modbus server of the controller")  # fmt: skip
        parser.add_argument("--telemetry", default=None, metavar="HOST:PORT",
                            help="second Modbus source, of what the controller cannot know")  # fmt: skip
        parser.add_argument("--telemetry-tags", type=Path, default=None, metavar="FILE.csv", help="its tags")
        parser.add_argument("--history", type=Path, default=Path("var/history.sqlite"),
                            help="history that the controller writes; it need not be there yet")  # fmt: skip
        parser.add_argument("--host", default="127.0.0.1", help="address to serve the page on")
        parser.add_argument("--port", type=int, default=8080, help="its port; 0 = a free one")
        parser.add_argument("--name", action="append", default=[], dest="names",
                            help="further name by which browsers reach the panel; may be repeated")  # fmt: skip
        parser.add_argument("--users", type=Path, default=Path("var/panel-users.json"), help="file of the passwords")
        parser.add_argument("--io-map", type=Path, default=default_io_map, help="the wires, as the controller has them")
        parser.add_argument("--allow-remote", action="store_true", help="permit an address other computers can reach")
        parser.add_argument("--certificate", type=Path, default=None, help="certificate (PEM) for TLS")
        parser.add_argument("--key", type=Path, default=None, help="its key (PEM)")

    def run(self, options: argparse.Namespace) -> int:
        """Serve until SIGINT or SIGTERM; return the exit code.

        Raises:
            PanelError: It cannot be started so.
            IoMapError: The I/O map cannot be used.
        """
        _check_reach(options)
        _check_tls(options)
        machine = build(load_io_map(options.io_map))
        try:
            users = Users(options.users)
            tags = None if options.telemetry_tags is None else load_tags(options.telemetry_tags)
        except (UsersFileError, TagFileError) as error:
            raise PanelError(str(error)) from error
        if (options.telemetry is None) != (tags is None):
            raise PanelError("--telemetry and --telemetry-tags belong together; give both or neither")
        clock = MonotonicClock()
        connect = _connection("--controller", options.controller)
        telemetry = None
        if tags is not None:
            telemetry = Telemetry(_connection("--telemetry", options.telemetry)(), tags, clock)
        sources = Sources(machine, connect, telemetry, HistoryReader(options.history), clock)
        with _listening(options.host, options.port) as listener:
            asyncio.run(_serve(sources, users, listener, options))
        return 0


class _Server(uvicorn.Server):
    """Tells where it listens once it does."""

    def __init__(self, config: uvicorn.Config, url: str) -> None:
        super().__init__(config)
        self._url = url

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        sys.stdout.write(f"panel at {self._url}\n")
        sys.stdout.flush()


def server_config(app: ASGIApp, certificate: Path | None = None, key: Path | None = None) -> uvicorn.Config:
    """Return how the application is served: small messages, sockets that must answer, no trust in forwarded headers."""
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
    panel = Panel(sources, users, secure=secure)
    config = server_config(application(panel, [options.host, *options.names]), options.certificate, options.key)
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    host, port = listener.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    server = _Server(config, f"{'https' if secure else 'http'}://{shown}:{port}")
    for number in (signal.SIGINT, signal.SIGTERM):
        # the server passes a signal on to the handler it found, once it has ended: the end is clean
        signal.signal(number, lambda *_: None)
    await server.serve(sockets=[listener])


def _listening(host: str, port: int) -> socket.socket:
    if not 0 <= port <= 65_535:
        raise PanelError(f"--port {port}: give 0 to 65535")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise PanelError(f"--host {host} --port {port}: {error.strerror}; {listening_remedy(error)}") from error


def _check_reach(options: argparse.Namespace) -> None:
    if is_loopback("127.0.0.1" if options.host == "localhost" else options.host):
        return
    if not options.allow_remote:
        raise PanelError(f"--host {options.host}: other computers could reach the panel; --allow-remote permits them")
    if options.certificate is None:
        sys.stderr.write("warning: no TLS: passwords can be read on the way; give --certificate and --key\n")


def _check_tls(options: argparse.Namespace) -> None:
    if (options.certificate is None) != (options.key is None):
        raise PanelError("--certificate and --key belong together; give both or neither")
    if options.certificate is None:
        return
    try:
        # a key with a password of its own would be asked for at a terminal that nobody watches
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(options.certificate, options.key, password="")
    except OSError as error:
        raise PanelError(f"--certificate {options.certificate}, --key {options.key}: {error}; give PEM files that "
                         "belong together") from error  # fmt: skip


def _connection(option: str, where: str) -> Callable[[], Line]:
    """Return what makes connections to HOST:PORT."""
    host, _, port = where.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdecimal() or not 1 <= int(port[:6]) <= 65_535:
        raise PanelError(f"{option} {where}: give HOST:PORT, as 127.0.0.1:5021")
    return lambda: Line(host, int(port))
