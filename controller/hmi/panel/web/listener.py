"""Listening socket of the panel with a limited number of connections.

The web server limits neither the number of connections nor the time that a client takes to send a request, and with TLS
it does not see a client before the end of the handshake. Therefore each accepted connection takes a slot here, before
the web server sees it, and loses it if it sends no complete request in time, or if all slots are taken and it is the
least active one without a login.
"""

from __future__ import annotations

import asyncio
import select
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Final

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from controller.common.client_slots import ClientSlot, ClientSlots, Quota, address_group
from controller.core.clock import Clock

QUOTA: Final = Quota(most=192, reserved=64, of_address=64)
"""Connections of all browsers: far fewer than the 1,024 open files of a process."""
REQUEST_MS: Final = 10_000
"""Time in which a header must arrive, counted from the connection or the last activity, ms."""
CHECK_S: Final = 1.0
BURST: Final = 4
"""Connections accepted in a row. Before the next ones, the event loop reads what the former ones have sent, so that
they have asked before they could be displaced, and closes those that have lost their slots."""
PAUSE_S: Final = 0.02
"""Pause after a burst in which connections were displaced or refused, s. Otherwise whoever replaces closed connections
at once would keep the event loop busy, and the orders of browsers waiting; new pages wait in the queue."""


class Gate:
    """Descriptor that is readable when a listening socket is, except for pauses; without effect if there is no epoll.

    The event loop would ask a listening socket with waiting connections again and again.
    """

    def __init__(self, fileno: int) -> None:
        """Open the gate of a listening socket."""
        self._listening = fileno
        self._epoll = select.epoll() if hasattr(select, "epoll") else None
        self._opening: asyncio.TimerHandle | None = None
        self._open()

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._listening if self._epoll is None else self._epoll.fileno()

    def shut(self, for_s: float) -> None:
        """Begin a pause."""
        if self._epoll is not None and self._opening is None:
            self._epoll.unregister(self._listening)
            self._opening = asyncio.get_running_loop().call_later(for_s, self._open)

    def close(self) -> None:
        """Close the descriptor; no effect on a closed one."""
        if self._opening is not None:
            self._opening.cancel()
        if self._epoll is not None:
            self._epoll.close()

    def _open(self) -> None:
        self._opening = None
        if self._epoll is not None:
            self._epoll.register(self._listening, select.EPOLLIN)


class PanelListener(socket.socket):
    """Listening socket whose connections have slots.

    Attributes:
        slots: Slots of all connections.
    """

    def __init__(
        self, listener: socket.socket, clock: Clock, quota: Quota = QUOTA, request_ms: int = REQUEST_MS
    ) -> None:
        """Take over a listening socket.

        Args:
            listener: Socket that listens; closed afterwards.
            clock: Clock of the panel.
            quota: Number of slots.
            request_ms: Time in which a header must arrive, ms.
        """
        super().__init__(listener.family, listener.type, listener.proto, fileno=listener.detach())
        self.slots = ClientSlots(quota)
        self._clock = clock
        self._request_ms = request_ms
        self._accepted = 0
        self._rejected = 0
        self._gate = Gate(super().fileno())
        self._connections: dict[tuple[str, int], tuple[socket.socket, ClientSlot]] = {}

    def fileno(self) -> int:
        """Return the descriptor that is readable when a connection can be accepted."""
        return self._gate.fileno() if super().fileno() >= 0 else -1

    def close(self) -> None:
        """Close the socket."""
        self._gate.close()
        super().close()

    def accept(self) -> tuple[socket.socket, Any]:
        """Accept the next connection for which there is a slot.

        Raises:
            BlockingIOError: There is none now, or the event loop shall first do its other work.
        """
        while True:
            self._accepted = (self._accepted + 1) % (BURST + 1)
            if self._accepted == 0:
                closed = self.slots.displaced + self.slots.refused
                if closed != self._rejected:
                    self._rejected = closed
                    self._gate.shut(PAUSE_S)
                raise BlockingIOError
            if self._accepted == 1:
                self._free_closed()
            connection, peer = super().accept()
            slot = ClientSlot(address_group(peer[0]), _closing(connection), self._clock.now_ms())
            if self.slots.take(slot):
                self._connections[peer[0], peer[1]] = (connection, slot)
                return connection, peer
            connection.close()

    def slot_of(self, client: tuple[str, int] | None) -> ClientSlot | None:
        """Return the slot of a client by its address and port; None if it has none."""
        _, slot = self._connections.get(client or ("", 0), (None, None))
        return slot

    def touch(self, slot: ClientSlot) -> None:
        """Notice activity of a client."""
        slot.active_ms = self._clock.now_ms()

    async def watch(self) -> None:
        """Look for unfinished requests until cancelled."""
        while True:
            await asyncio.sleep(CHECK_S)
            self.look()

    def look(self) -> None:
        """Close the connections whose request does not arrive in time."""
        self._free_closed()
        limit_ms = self._clock.now_ms() - self._request_ms
        for _, slot in self._connections.values():
            if not slot.running and slot.active_ms <= limit_ms:
                slot.close()

    def _free_closed(self) -> None:
        for peer, (connection, slot) in tuple(self._connections.items()):
            if connection.fileno() < 0:
                del self._connections[peer]
                self.slots.leave(slot)


class Attendance:
    """ASGI middleware that tells the listener which requests are answered, and whether their clients are logged in."""

    def __init__(self, app: ASGIApp, listener: PanelListener, is_known: Callable[[HTTPConnection], bool]) -> None:
        """Initialise the middleware.

        Args:
            app: Application that receives the requests.
            listener: Listener of the connections.
            is_known: Function that returns whether the client of a request is logged in.
        """
        self._app = app
        self._listener = listener
        self._is_known = is_known

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application; each message of its answer, and each of a socket, is activity."""
        slot = None if scope["type"] == "lifespan" else self._listener.slot_of(scope.get("client"))
        if slot is None:
            await self._app(scope, receive, send)
            return
        listener = self._listener

        async def received() -> Message:
            message = await receive()
            listener.touch(slot)
            return message

        async def sent(message: Message) -> None:
            await send(message)
            listener.touch(slot)

        slot.is_known = self._is_known(HTTPConnection(scope))
        slot.has_asked = True
        slot.running += 1
        listener.touch(slot)
        try:
            await self._app(scope, received, sent)
        finally:
            slot.running -= 1
            listener.touch(slot)


def _closing(connection: socket.socket) -> Callable[[], None]:
    """Return a function that ends a connection; the web server then closes the socket, also during a TLS handshake."""

    def close() -> None:
        with suppress(OSError):  # the client or the web server has closed it
            connection.shutdown(socket.SHUT_RDWR)

    return close
