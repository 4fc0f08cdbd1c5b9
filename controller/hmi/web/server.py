"""Web server: its settings, its socket, and the connections to a controller."""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Final

import uvicorn
from starlette.types import ASGIApp

from controller.common.errors import InputError
from controller.common.modbus.address import listening_remedy
from controller.common.modbus.client_requests import ModbusRequest
from controller.hmi.modbus.connection import ModbusConnection

LONGEST_MESSAGE: Final = 4_096
PING_S: Final = 5.0
"""Ping interval and timeout of a WebSocket, s; a socket that does not answer is closed and its jog ends."""
CLOSING_S: Final = 2


class WebServer(uvicorn.Server):
    """Web server that prints its URL once it is listening."""

    def __init__(self, config: uvicorn.Config, name: str, url: str) -> None:
        super().__init__(config)
        self._name = name
        self._url = url

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:  # noqa: ARG002 - the signature of the base class
        """Stop the server; a second signal does not cut its closing short, which lasts `CLOSING_S` at most."""
        self.should_exit = True

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the server and print its URL."""
        await super().startup(sockets)
        sys.stdout.write(f"{self._name} at {self._url}\n")
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


def listening(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises:
        InputError: The address cannot be listened on.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise InputError(f"--host {host} --port {port}: {error.strerror}; {listening_remedy(error)}") from error


def connections(option: str, where: str, introduction: ModbusRequest | None = None) -> Callable[[], ModbusConnection]:
    """Return a factory for connections to HOST:PORT.

    Raises:
        InputError: It is not an address.
    """
    host, _, port = where.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isascii() or not port.isdecimal() or not 1 <= int(port[:6]) <= 65_535:
        raise InputError(f"{option} {where}: must be HOST:PORT, for example 127.0.0.1:5021")
    return lambda: ModbusConnection(host, int(port), introduction=introduction)
