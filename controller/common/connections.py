"""TCP connections of a server for request frames: connection limit, idle timeout and statistics.

What a frame is and how it is answered is decided by the session of the connection. Client errors are counted, not
logged: a client that sends invalid data must not be able to fill a log.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, cast

RECEIVE_BYTES = 4_096
"""Receive buffer of a connection, bytes; limits the work done for one client before the others are served. No valid
frame is longer."""


@dataclass(slots=True)
class Traffic:
    """Connection counters since the start.

    Attributes:
        requests: Complete requests answered, including refusals.
        bad_frames: Connections closed because of data that is not a frame.
        refused: Connections closed immediately because the limit was reached.
        timed_out: Connections closed by the idle timeout.
    """

    requests: int = 0
    bad_frames: int = 0
    refused: int = 0
    timed_out: int = 0


@dataclass(frozen=True, slots=True)
class Answered:
    """Result of the frames in a receive buffer.

    Attributes:
        used: Number of bytes of the complete frames.
        answers: Data to send.
        requests: Number of requests answered.
        is_valid: False if the data is not a frame; the connection is closed after the answers.
    """

    used: int
    answers: bytes
    requests: int
    is_valid: bool = True


class FrameSession(Protocol):
    """Session of one client."""

    def answer(self, received: memoryview) -> Answered:
        """Answer every complete frame at the start of the received data."""

    def on_disconnect(self) -> None:
        """Notice that the client is gone."""


@dataclass(slots=True)
class ConnectionServer:
    """Connections of a server; calling the object returns the protocol object of a new connection.

    Attributes:
        session_for: Function that returns the session of a new client, given the client's address.
        max_connections: Maximum number of connections; further ones are closed immediately.
        idle_timeout_s: Time without a complete request after which a connection is closed, s.
        traffic: Connection counters.
        connections: Open connections.
    """

    session_for: Callable[[str], FrameSession]
    max_connections: int = 8
    idle_timeout_s: float = 60.0
    traffic: Traffic = field(default_factory=Traffic)
    connections: set[FrameConnection] = field(default_factory=set)

    def __call__(self) -> FrameConnection:
        """Return the protocol object of a new connection, as required by `loop.create_server`."""
        return FrameConnection(self)

    def close(self) -> None:
        """Close all connections and refuse new ones."""
        self.max_connections = 0
        for connection in tuple(self.connections):
            connection.abort()


class FrameConnection(asyncio.BufferedProtocol):
    """Connection of one client: passes received data to its session and sends the answers in order."""

    def __init__(self, server: ConnectionServer) -> None:
        """Create the protocol object of a connection that is not yet established."""
        self._server = server
        self._buffer = memoryview(bytearray(RECEIVE_BYTES))
        self._filled = 0
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._last_request_s = self._loop.time()
        self._idle_check: asyncio.TimerHandle | None = None
        self._session: FrameSession | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Register the connection, or close it if the limit is reached."""
        self._transport = cast(asyncio.Transport, transport)
        if len(self._server.connections) >= self._server.max_connections:
            self._server.traffic.refused += 1
            self._transport.close()
            return
        self._server.connections.add(self)
        address = self._transport.get_extra_info("peername")
        self._session = self._server.session_for(f"{address[0]}:{address[1]}")
        self._check_idle()

    def connection_lost(self, _exc: Exception | None) -> None:
        """Unregister the connection."""
        self._server.connections.discard(self)
        if self._session is not None:
            self._session.on_disconnect()
        if self._idle_check is not None:
            self._idle_check.cancel()

    def get_buffer(self, _sizehint: int) -> memoryview:
        """Return the free part of the buffer; an incomplete frame never fills it completely."""
        return self._buffer[self._filled :]

    def buffer_updated(self, nbytes: int) -> None:
        """Answer the complete requests in the buffer and store the remaining bytes."""
        self._filled += nbytes
        transport = self._transport
        if transport is None or self._session is None or transport.is_closing():
            return
        result = self._session.answer(self._buffer[: self._filled])
        self._server.traffic.requests += result.requests
        if result.used:
            self._last_request_s = self._loop.time()
            rest = bytes(self._buffer[result.used : self._filled])
            self._buffer[: len(rest)] = rest
            self._filled = len(rest)
        if result.answers:
            transport.write(result.answers)
        if not result.is_valid or self._filled == RECEIVE_BYTES:
            self._server.traffic.bad_frames += 1
            transport.close()  # after the answers to the preceding requests are sent

    def pause_writing(self) -> None:
        """Stop reading from a client that does not read its answers."""
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_writing(self) -> None:
        """Resume reading."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()

    def abort(self) -> None:
        """Close immediately and discard unsent data."""
        if self._transport is not None:
            self._transport.abort()

    def _check_idle(self) -> None:
        """Close the connection if the idle timeout has elapsed, otherwise schedule the next check."""
        left_s = self._last_request_s + self._server.idle_timeout_s - self._loop.time()
        if left_s > 0:
            self._idle_check = self._loop.call_later(left_s, self._check_idle)
        else:
            self._server.traffic.timed_out += 1
            self.abort()
