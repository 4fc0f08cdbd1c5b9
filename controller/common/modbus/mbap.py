"""Modbus TCP connections: framing, connection limits and statistics, independent of the request contents.

The pymodbus server loses pipelined requests and blocks on an invalid header. Therefore frames are split
here and only complete requests reach the device. Client errors are counted, not logged: a client that sends
invalid data must not be able to fill a log. Source: Modbus Messaging on TCP/IP Implementation Guide V1.0b,
section 3.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

from controller.common.modbus.requests import ModbusDevice, answer

HEADER = struct.Struct(">HHHB")
"""Header: transaction, protocol, length of the following data, unit."""
UNCOUNTED_BYTES = 6
"""Number of header bytes that the length field does not count: those up to and including the length field."""
MIN_LENGTH = 2
"""Smallest valid length: unit and function code."""
MAX_LENGTH = 254
"""Largest valid length: unit and the largest PDU of 253 bytes."""
RECEIVE_BYTES = 4_096
"""Receive buffer of a connection, bytes; limits the work done for one client before the others are served."""


@dataclass(slots=True)
class Traffic:
    """Connection counters since the start.

    Attributes:
        requests: Complete requests answered, including exceptions.
        bad_frames: Connections closed because of an invalid protocol identifier or length.
        refused: Connections closed immediately because the limit was reached.
        timed_out: Connections closed by the idle timeout.
    """

    requests: int = 0
    bad_frames: int = 0
    refused: int = 0
    timed_out: int = 0


@dataclass(slots=True)
class MbapServer:
    """Connections of a server; calling the object returns the protocol object of a new connection.

    Attributes:
        device_for: Function that returns the device of a new client, given the client's address.
        max_connections: Maximum number of connections; further ones are closed immediately.
        idle_timeout_s: Time without a complete request after which a connection is closed, s.
        traffic: Connection counters.
        connections: Open connections.
    """

    device_for: Callable[[str], ModbusDevice]
    max_connections: int = 8
    idle_timeout_s: float = 60.0
    traffic: Traffic = field(default_factory=Traffic)
    connections: set[MbapConnection] = field(default_factory=set)

    def __call__(self) -> MbapConnection:
        """Return the protocol object of a new connection, as required by `loop.create_server`."""
        return MbapConnection(self)

    def close(self) -> None:
        """Close all connections and refuse new ones."""
        self.max_connections = 0
        for connection in tuple(self.connections):
            connection.abort()


class MbapConnection(asyncio.BufferedProtocol):
    """Connection of one client: splits the byte stream into complete requests and answers them in order."""

    def __init__(self, server: MbapServer) -> None:
        """Create the protocol object of a connection that is not yet established."""
        self._server = server
        self._buffer = memoryview(bytearray(RECEIVE_BYTES))
        self._filled = 0
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._last_request_s = self._loop.time()
        self._idle_check: asyncio.TimerHandle | None = None
        self._device: ModbusDevice | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Register the connection, or close it if the limit is reached."""
        self._transport = cast(asyncio.Transport, transport)
        if len(self._server.connections) >= self._server.max_connections:
            self._server.traffic.refused += 1
            self._transport.close()
            return
        self._server.connections.add(self)
        address = self._transport.get_extra_info("peername")
        self._device = self._server.device_for(f"{address[0]}:{address[1]}")
        self._check_idle()

    def connection_lost(self, _exc: Exception | None) -> None:
        """Unregister the connection."""
        self._server.connections.discard(self)
        if self._device is not None:
            self._device.on_disconnect()
        if self._idle_check is not None:
            self._idle_check.cancel()

    def get_buffer(self, _sizehint: int) -> memoryview:
        """Return the free part of the buffer; an incomplete frame never fills it completely."""
        return self._buffer[self._filled :]

    def buffer_updated(self, nbytes: int) -> None:
        """Answer the complete requests in the buffer and store the remaining bytes."""
        self._filled += nbytes
        transport = self._transport
        if transport is None or self._device is None or transport.is_closing():
            return
        used, answers, is_valid = self._answer_complete_frames(self._device)
        if used:
            self._last_request_s = self._loop.time()
            rest = bytes(self._buffer[used : self._filled])
            self._buffer[: len(rest)] = rest
            self._filled = len(rest)
            transport.write(answers)
        if not is_valid:
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

    def _answer_complete_frames(self, device: ModbusDevice) -> tuple[int, bytes, bool]:
        """Answer every complete frame in the buffer.

        Returns:
            The number of bytes consumed, the answers, and True if all headers are valid Modbus TCP headers.
        """
        used = 0
        answers: list[bytes] = []
        while self._filled - used >= HEADER.size:
            transaction, protocol, length, unit = HEADER.unpack_from(self._buffer, used)
            if protocol != 0 or not MIN_LENGTH <= length <= MAX_LENGTH:
                return used, b"".join(answers), False
            end = used + UNCOUNTED_BYTES + length
            if end > self._filled:
                break
            pdu = answer(device, bytes(self._buffer[used + HEADER.size : end]))
            answers.append(HEADER.pack(transaction, 0, len(pdu) + 1, unit) + pdu)
            self._server.traffic.requests += 1
            used = end
        return used, b"".join(answers), True

    def _check_idle(self) -> None:
        """Close the connection if the idle timeout has elapsed, otherwise schedule the next check."""
        left_s = self._last_request_s + self._server.idle_timeout_s - self._loop.time()
        if left_s > 0:
            self._idle_check = self._loop.call_later(left_s, self._check_idle)
        else:
            self._server.traffic.timed_out += 1
            self.abort()
