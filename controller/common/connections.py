"""TCP connections of a server for request frames: slots, idle timeout and statistics.

What a frame is and how it is answered is decided by the session of the connection. Client errors are counted, not
logged: a client that sends invalid data must not be able to fill a log.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Protocol, cast

from controller.common.client_slots import ClientSlot, ClientSlots, Quota, address_group, is_loopback

RECEIVE_BYTES = 4_096
"""Receive buffer of a connection, bytes; limits the work done for one client before the others are served. No valid
frame is longer."""
KEEPS_MS = 5_000
"""Time after its last request in which a client keeps its slot, ms."""


@dataclass(slots=True)
class Traffic:
    """Connection counters since the start.

    Attributes:
        requests: Complete requests answered, including refusals.
        bad_frames: Connections closed because of data that is not a frame.
        refused: Connections closed because all slots were taken by clients that work.
        displaced: Connections closed because another client needed the slot of the least active one.
        timed_out: Connections closed by the idle timeout.
    """

    requests: int = 0
    bad_frames: int = 0
    refused: int = 0
    displaced: int = 0
    timed_out: int = 0


class Pending(Protocol):
    """Write that an answer waits for.

    Attributes:
        limit_s: Longest wait, s.
    """

    limit_s: float

    def when_settled(self, call: Callable[[], None]) -> None:
        """Call a function as soon as the write is settled, in any thread."""

    def withdraw(self) -> None:
        """Settle the write with an error, unless it is already being carried out."""


class LateAnswer:
    """Answer to a request that waits; its coroutine needs no task and always runs to its end."""

    def __init__(self, answering: Coroutine[Pending, None, bytes], pending: Pending) -> None:
        """Take over a coroutine; see `begun`.

        Args:
            answering: Coroutine that returns the answer.
            pending: What it waits for.
        """
        self._answering = answering
        self._pending = pending
        self._use: Callable[[bytes | None], None]
        self._loop: asyncio.AbstractEventLoop
        self._limit: asyncio.TimerHandle

    def when_ready(self, loop: asyncio.AbstractEventLoop, use: Callable[[bytes | None], None]) -> None:
        """Call a function with the answer in the thread of the event loop; None = the server has failed to answer."""
        self._loop, self._use = loop, use
        self._wait()

    def abandon(self) -> None:
        """Withdraw the write if that is still possible, and discard the answer: the client is gone."""
        self._use = _discard
        self._pending.withdraw()

    def _wait(self) -> None:
        self._limit = self._loop.call_later(self._pending.limit_s, self._pending.withdraw)
        self._pending.when_settled(self._settled)

    def _settled(self) -> None:
        with suppress(RuntimeError):  # the loop has ended: nobody waits
            self._loop.call_soon_threadsafe(self._proceed)

    def _proceed(self) -> None:
        self._limit.cancel()
        try:
            self._pending = self._answering.send(None)
        except StopIteration as end:
            self._use(end.value)
        except Exception:
            self._use(None)
            raise
        else:
            self._wait()


def begun(answering: Coroutine[Pending, None, bytes]) -> bytes | LateAnswer:
    """Return the answer of a coroutine, or the late answer if it has to wait.

    A request that does not wait, such as every read, costs no turn of the event loop.
    """
    try:
        pending = answering.send(None)
    except StopIteration as end:
        answer: bytes = end.value
        return answer
    return LateAnswer(answering, pending)


def _discard(_answer: bytes | None) -> None:
    pass


@dataclass(frozen=True, slots=True)
class Answered:
    """Result of the frames in a receive buffer.

    Attributes:
        used: Number of bytes of the complete frames.
        answers: Data to send.
        requests: Number of requests answered.
        is_valid: False if the data is not a frame; the connection is closed after the answers.
        late: Answer to the last of the requests, if it has to wait; the requests after it wait for it.
    """

    used: int
    answers: bytes
    requests: int
    is_valid: bool = True
    late: LateAnswer | None = None


class FrameSession(Protocol):
    """Session of one client."""

    @property
    def has_name(self) -> bool:
        """True if the client has told the name of its operator, as the operator panel does first of all."""

    def answer(self, received: memoryview) -> Answered:
        """Answer the complete frames at the start of the received data, up to one whose answer has to wait."""

    def on_disconnect(self) -> None:
        """Notice that the client is gone."""


@dataclass(slots=True)
class ConnectionServer:
    """Connections of a server; calling the object returns the protocol object of a new connection.

    The operator panel on this computer, which tells its name with its first request, has reserved slots. Any other
    client keeps its slot as long as it sends requests; half of these slots are for clients of one other computer.

    Attributes:
        session_for: Function that returns the session of a new client, given the client's address.
        max_connections: Number of slots of all clients but the operator panel.
        idle_timeout_s: Time without a complete request after which a connection is closed, s.
        reserved: Number of slots of the operator panel.
        traffic: Connection counters.
        connections: Open connections.
        slots: Their slots.
    """

    session_for: Callable[[str], FrameSession]
    max_connections: int = 8
    idle_timeout_s: float = 60.0
    reserved: int = 0
    traffic: Traffic = field(default_factory=Traffic)
    connections: set[FrameConnection] = field(default_factory=set)
    slots: ClientSlots = field(init=False)
    is_closed: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        of_address = max(1, self.max_connections // 2)
        self.slots = ClientSlots(Quota(self.max_connections + self.reserved, self.reserved, of_address, KEEPS_MS))

    def __call__(self) -> FrameConnection:
        """Return the protocol object of a new connection, as required by `loop.create_server`."""
        return FrameConnection(self)

    def close(self) -> None:
        """Close all connections and refuse new ones."""
        self.is_closed = True
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
        self._slot: ClientSlot | None = None
        self._late: LateAnswer | None = None
        self._is_congested = False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Register the connection, or close it if there is no slot."""
        self._transport = cast(asyncio.Transport, transport)
        server = self._server
        host, port = self._transport.get_extra_info("peername")[:2]
        slot = ClientSlot(address_group(host), self._give_way, self._now_ms, is_candidate=is_loopback(host))
        if server.is_closed or not self._has_slot(server.slots.take(slot)):
            self._transport.close()
            return
        self._slot = slot
        server.connections.add(self)
        self._session = server.session_for(f"{host}:{port}")
        self._check_idle()

    def connection_lost(self, _exc: Exception | None) -> None:
        """Unregister the connection."""
        if self._slot is not None:
            self._server.slots.leave(self._slot)
            self._slot = None  # it refers to this connection: without a cycle, all is released at once
        self._server.connections.discard(self)
        if self._late is not None:
            self._late.abandon()
            self._late = None
        if self._session is not None:
            self._session.on_disconnect()
        if self._idle_check is not None:
            self._idle_check.cancel()

    def get_buffer(self, _sizehint: int) -> memoryview:
        """Return the free part of the buffer.

        An incomplete frame never fills it completely, and it is not read into while it is full of waiting requests.
        """
        return self._buffer[self._filled :]

    def buffer_updated(self, nbytes: int) -> None:
        """Answer the complete requests in the buffer and store the remaining bytes."""
        self._filled += nbytes
        self._serve()
        self._read_or_pause()

    def _serve(self) -> None:
        """Answer requests in their order, up to one whose answer has to wait."""
        transport = self._transport
        if transport is None or self._session is None or self._late is not None or transport.is_closing():
            return
        result = self._session.answer(self._buffer[: self._filled])
        self._server.traffic.requests += result.requests
        if result.used:
            self._last_request_s = self._loop.time()
            if not self._settled(self._session):
                self.abort()
                return
            rest = bytes(self._buffer[result.used : self._filled])
            self._buffer[: len(rest)] = rest
            self._filled = len(rest)
        if result.answers:
            transport.write(result.answers)
        if result.late is not None:
            self._late = result.late
            self._late.when_ready(self._loop, self._send_late)
        elif not result.is_valid or self._filled == RECEIVE_BYTES:
            self._server.traffic.bad_frames += 1
            transport.close()  # after the answers to the preceding requests are sent

    def _send_late(self, answer: bytes | None) -> None:
        """Send the answer that had to wait, and serve the requests that have arrived in the meantime."""
        self._late = None
        if answer is None:
            self.abort()
        elif self._transport is not None and not self._transport.is_closing():
            self._transport.write(answer)
        self._serve()
        self._read_or_pause()

    def pause_writing(self) -> None:
        """Stop reading from a client that does not read its answers."""
        self._is_congested = True
        self._read_or_pause()

    def resume_writing(self) -> None:
        """Resume reading."""
        self._is_congested = False
        self._read_or_pause()

    def _read_or_pause(self) -> None:
        """Read as long as there is room for requests and for answers."""
        if self._transport is None or self._transport.is_closing():
            return
        if self._is_congested or self._filled == RECEIVE_BYTES:
            self._transport.pause_reading()
        else:
            self._transport.resume_reading()

    def abort(self) -> None:
        """Close immediately and discard unsent data."""
        if self._transport is not None:
            self._transport.abort()

    @property
    def _now_ms(self) -> int:
        return int(self._loop.time() * 1_000)

    def _settled(self, session: FrameSession) -> bool:
        """Notice a request; return whether the connection has a slot for it."""
        slot = self._slot
        if slot is None:
            return False
        slot.active_ms = self._now_ms
        if slot.has_asked:
            return True
        slot.has_asked = True
        is_panel = slot.is_candidate and session.has_name
        return self._has_slot(self._server.slots.settle(slot, is_known=is_panel))

    def _has_slot(self, has_slot: bool) -> bool:
        self._server.traffic.refused += not has_slot
        return has_slot

    def _give_way(self) -> None:
        self._server.traffic.displaced += 1
        self._slot = None
        self.abort()

    def _check_idle(self) -> None:
        """Close the connection if the idle timeout has elapsed, otherwise schedule the next check."""
        left_s = self._last_request_s + self._server.idle_timeout_s - self._loop.time()
        if left_s > 0:
            self._idle_check = self._loop.call_later(left_s, self._check_idle)
        else:
            self._server.traffic.timed_out += 1
            self.abort()
