"""Ends of communication lines that a server listens on."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from controller.common.connections import ConnectionServer, FrameSession, Traffic
from controller.common.errors import InputError
from controller.common.extras import install_hint
from controller.common.modbus.address import checked_host, listening_remedy
from controller.common.serial_server import SerialServer

HANDSHAKE_S: Final = 5.0
"""TLS handshake timeout, s; a client still in the handshake does not count as a connection."""


class ServerError(InputError):
    """Raised for invalid server options or an unavailable port; the message is one line with the remedy."""


class Endpoint(Protocol):
    """TCP port or serial line."""

    async def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start to listen.

        Raises:
            ServerError: The port or the line is not available.
        """

    async def stop(self) -> None:
        """Close all connections and stop listening."""

    @property
    def traffic(self) -> Traffic:
        """Traffic counters since the start."""

    @property
    def connections(self) -> int:
        """Number of connected clients."""


@dataclass(frozen=True, slots=True)
class TcpSettings:
    """Settings of a TCP port.

    Attributes:
        host: Address to listen on.
        port: TCP port; 0 selects a free port.
        allow_remote: True to permit listening on an address that other computers can reach.
        max_connections: Number of slots of all clients but the operator panel.
        idle_timeout_s: Time without a request after which a connection is closed, s.
        reserved: Number of slots of the operator panel.
    """

    host: str
    port: int
    allow_remote: bool = False
    max_connections: int = 16
    idle_timeout_s: float = 60.0
    reserved: int = 0


@dataclass(frozen=True, slots=True)
class EndpointNames:
    """Names of an endpoint in error messages.

    Attributes:
        server: Name of the server.
        protocol: Name of the protocol.
        host: Command-line option of the address.
        port: Command-line option of the port.
        allow_remote: Command-line option that permits remote access.
        omitted: What to do in order not to start the server.
    """

    server: str
    protocol: str
    host: str
    port: str
    allow_remote: str
    omitted: str


class TcpEndpoint:
    """TCP port, optionally with TLS."""

    def __init__(
        self,
        session_for: Callable[[str], FrameSession],
        settings: TcpSettings,
        names: EndpointNames,
        tls: ssl.SSLContext | None = None,
    ) -> None:
        """Initialise without listening.

        Args:
            session_for: Function that returns the session of a new client, given the client's address.
            settings: Address and limits.
            names: Names in error messages.
            tls: TLS context; None = plain TCP.

        Raises:
            ServerError: The address is invalid.
        """
        self._names = names
        try:
            self._host = checked_host(
                settings.host,
                allow_remote=settings.allow_remote,
                option=names.allow_remote,
                protocol=names.protocol,
            )
        except ValueError as error:
            raise ServerError(f"{names.server}: {error}") from error
        self._tls = tls
        self._frontend = ConnectionServer(
            session_for, settings.max_connections, settings.idle_timeout_s, settings.reserved
        )
        self._port = settings.port
        self._listener: asyncio.Server | None = None

    @property
    def port(self) -> int:
        """Configured TCP port; the actual port once the endpoint is listening."""
        return self._port

    @property
    def traffic(self) -> Traffic:
        """Traffic counters of the connections since the start."""
        return self._frontend.traffic

    @property
    def connections(self) -> int:
        """Number of connected clients."""
        return len(self._frontend.connections)

    async def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start to listen.

        Raises:
            ServerError: The port is not available.
        """
        handshake_s = None if self._tls is None else HANDSHAKE_S
        try:
            self._listener = await loop.create_server(
                self._frontend, self._host, self._port, ssl=self._tls, ssl_handshake_timeout=handshake_s
            )
        except OSError as error:
            names = self._names
            remedy = listening_remedy(error, host=names.host, port=names.port)
            raise ServerError(f"{names.server}: {error}; {remedy}, or {names.omitted}") from error
        self._port = self._listener.sockets[0].getsockname()[1]

    async def stop(self) -> None:
        """Close all connections and stop listening."""
        if self._listener is not None:
            self._listener.close()
            self._frontend.close()
            await self._listener.wait_closed()


class SerialEndpoint:
    """Serial line."""

    def __init__(self, server: SerialServer, option: str) -> None:
        """Initialise without opening the line.

        Args:
            server: Server of the line.
            option: Command-line option of the line, for error messages.
        """
        self.traffic = Traffic()
        self.connections = 0
        self._server = server
        self._option = option

    async def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Open the line.

        Raises:
            ServerError: The line is not available, or pyserial is not installed.
        """
        try:
            self._server.start(loop)
        except ModuleNotFoundError as error:
            raise ServerError(f"{self._option}: {install_hint(error)}") from error
        except (OSError, ValueError, OverflowError) as error:
            raise ServerError(
                f"serial line {self._server.path}: {error}; specify another {self._option}, or omit it"
            ) from error

    async def stop(self) -> None:
        """Close the line."""
        self._server.stop()
