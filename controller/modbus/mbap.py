"""Modbus TCP connections: framing, limits and bookkeeping, but no idea what a request means.

pymodbus' own server loses pipelined requests and gets stuck on a bad header, so frames are cut
here and only whole requests reach the device. Trouble made by a client is counted, never logged: a
client that sends rubbish must not be able to fill a log. Source: Modbus Messaging on TCP/IP
Implementation Guide V1.0b, section 3.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import cast

from controller.modbus.requests import Device, answer

HEADER = struct.Struct(">HHHB")  # transaction, protocol, length of what follows it, unit
HEADER_BEFORE_LENGTH_ENDS = 6
MIN_LENGTH = 2  # unit and function code
MAX_LENGTH = 254  # unit and the largest PDU, 253 bytes
RECEIVE_BYTES = 4_096  # work done for one client before the others get their turn


@dataclass(slots=True)
class Traffic:
    """What the connections have seen since the start.

    Attributes:
        requests: Whole requests answered, exceptions included.
        bad_frames: Connections closed for a wrong protocol identifier or length.
        refused: Connections closed at once because there were too many.
        timed_out: Connections closed for idling.
    """

    requests: int = 0
    bad_frames: int = 0
    refused: int = 0
    timed_out: int = 0


@dataclass(slots=True)
class Frontend:
    """All connections of a server; calling it makes the protocol of the next one.

    Attributes:
        device_for: Gives a new client, named by its address, the device it talks to.
        max_connections: Connections beyond this many are closed at once.
        idle_timeout_s: A connection without a whole request for so long is closed, s.
    """

    device_for: Callable[[str], Device]
    max_connections: int = 8
    idle_timeout_s: float = 60.0
    traffic: Traffic = field(default_factory=Traffic)
    connections: set[MbapConnection] = field(default_factory=set)

    def __call__(self) -> MbapConnection:
        """Make the protocol for a new connection, as `loop.create_server` asks."""
        return MbapConnection(self)

    def close(self) -> None:
        """Drop every connection and let nobody in any more."""
        self.max_connections = 0
        for connection in tuple(self.connections):
            connection.abort()


class MbapConnection(asyncio.BufferedProtocol):
    """One client: cuts whole requests out of the byte stream and answers them in order."""

    def __init__(self, frontend: Frontend) -> None:
        """Create the protocol of a connection that is about to be made."""
        self._frontend = frontend
        self._buffer = memoryview(bytearray(RECEIVE_BYTES))
        self._filled = 0
        self._transport: asyncio.Transport | None = None
        self._loop = asyncio.get_running_loop()
        self._last_request_s = self._loop.time()
        self._idle_check: asyncio.TimerHandle | None = None
        self._device: Device | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Take a place among the connections, or close when none is left."""
        self._transport = cast(asyncio.Transport, transport)
        if len(self._frontend.connections) >= self._frontend.max_connections:
            self._frontend.traffic.refused += 1
            self._transport.close()
            return
        self._frontend.connections.add(self)
        address = self._transport.get_extra_info("peername")
        self._device = self._frontend.device_for(f"{address[0]}:{address[1]}")
        self._watch_idling()

    def connection_lost(self, _exc: Exception | None) -> None:
        """Give the place back."""
        self._frontend.connections.discard(self)
        if self._device is not None:
            self._device.end()
        if self._idle_check is not None:
            self._idle_check.cancel()

    def get_buffer(self, _sizehint: int) -> memoryview:
        """Offer the free end of the buffer; an incomplete frame never fills all of it."""
        return self._buffer[self._filled :]

    def buffer_updated(self, nbytes: int) -> None:
        """Answer the whole requests received so far and keep the rest."""
        self._filled += nbytes
        transport = self._transport
        if transport is None or self._device is None or transport.is_closing():
            return
        used, answers, is_sound = self._answer_whole_frames(self._device)
        if used:
            self._last_request_s = self._loop.time()
            rest = bytes(self._buffer[used : self._filled])
            self._buffer[: len(rest)] = rest
            self._filled = len(rest)
            transport.write(answers)
        if not is_sound:
            self._frontend.traffic.bad_frames += 1
            transport.close()  # after the answers to what came before

    def pause_writing(self) -> None:
        """Stop listening to a client that does not read its answers."""
        if self._transport is not None:
            self._transport.pause_reading()

    def resume_writing(self) -> None:
        """Listen again."""
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()

    def abort(self) -> None:
        """Close now, whatever has not been sent."""
        if self._transport is not None:
            self._transport.abort()

    def _answer_whole_frames(self, device: Device) -> tuple[int, bytes, bool]:
        """Answer every whole frame in the buffer.

        Returns:
            Bytes used, the answers, and False when a header is not one of Modbus TCP.
        """
        used = 0
        answers: list[bytes] = []
        while self._filled - used >= HEADER.size:
            transaction, protocol, length, unit = HEADER.unpack_from(self._buffer, used)
            if protocol != 0 or not MIN_LENGTH <= length <= MAX_LENGTH:
                return used, b"".join(answers), False
            end = used + HEADER_BEFORE_LENGTH_ENDS + length
            if end > self._filled:
                break
            pdu = answer(device, bytes(self._buffer[used + HEADER.size : end]))
            answers.append(HEADER.pack(transaction, 0, len(pdu) + 1, unit) + pdu)
            self._frontend.traffic.requests += 1
            used = end
        return used, b"".join(answers), True

    def _watch_idling(self) -> None:
        """Close the connection when its time is up, else look again when it would be."""
        left_s = self._last_request_s + self._frontend.idle_timeout_s - self._loop.time()
        if left_s > 0:
            self._idle_check = self._loop.call_later(left_s, self._watch_idling)
        else:
            self._frontend.traffic.timed_out += 1
            self.abort()
