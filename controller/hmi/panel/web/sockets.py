"""WebSocket connections of the browsers, which receive the live view and send orders."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from controller.hmi.panel.orders.login import HALTING, AccessLevel
from controller.hmi.panel.orders.messages import BoxOrder, CommandOrder, JogOrder, MessageError, Order, read_order
from controller.hmi.panel.orders.operator import OrderHandler, Reply
from controller.hmi.panel.orders.replies import reply_text
from controller.hmi.panel.orders.session import BrowserSession
from controller.hmi.panel.view.state import Json, ViewBuilder, delta, in_both, in_both_or_none
from controller.hmi.panel.view.trends import SAMPLE_MS, Trends

_log = logging.getLogger(__name__)

VIEW_MS: Final = 100
MAX_BROWSERS: Final = 32
MAX_PENDING: Final = 16
"""Maximum number of pending orders of one browser."""
LATEST_VIEWS: Final = 30
"""Number of views after which an order is too old to be executed (3 s): its user may have left after *no reply*."""

_DISCONNECTED: Final = (WebSocketDisconnect, RuntimeError, OSError)
"""Errors raised when sending to a disconnected browser."""

SESSION_ENDED: Final = 4401
TOO_MANY: Final = 1013
NO_TEXT: Final = 1003


class ViewBroadcaster:
    """Source of the live view for all browsers, updated ten times a second.

    Attributes:
        browsers: Number of open sockets.
    """

    def __init__(self, viewer: ViewBuilder, trends: Trends) -> None:
        """Initialise the broadcaster for a view builder and a trend recorder."""
        self.browsers = 0
        self._viewer = viewer
        self._trends = trends
        self._view: Json = viewer.view()
        self._next = asyncio.Event()

    @property
    def view(self) -> Json:
        """Latest view."""
        return self._view

    async def next_view(self) -> None:
        """Wait for the next view."""
        await self._next.wait()

    async def run(self) -> None:
        """Build views and record trend samples until cancelled."""
        ticks = 0
        while True:
            self._view = self._viewer.view()
            ready, self._next = self._next, asyncio.Event()
            ready.set()
            if ticks % (SAMPLE_MS // VIEW_MS) == 0:
                self._trends.sample()
            ticks += 1
            await asyncio.sleep(VIEW_MS / 1_000)


def _halts(order: Order) -> bool:
    """Return whether an order halts the machine."""
    match order:
        case CommandOrder(command=command):
            return command in HALTING
        case BoxOrder(button="emergency_stop", pressed=True):
            return True
        case _:
            return False


class BrowserSocket:
    """One browser socket; when it closes, the jog, the buttons and the forced inputs of the browser are released."""

    def __init__(
        self, socket: WebSocket, broadcaster: ViewBroadcaster, operator: OrderHandler, level: Callable[[], AccessLevel]
    ) -> None:
        """Initialise the handler of a socket.

        Args:
            socket: The socket, not yet accepted.
            broadcaster: Source of the view.
            operator: Executor of the orders.
            level: Function that returns the current access level of the session.
        """
        self._socket = socket
        self._broadcaster = broadcaster
        self._operator = operator
        self._level = level
        self._session = BrowserSession()
        self._orders: set[asyncio.Task[None]] = set()
        self._send_lock = asyncio.Lock()
        self._views = 0

    async def serve(self) -> None:
        """Serve until the socket closes or the session ends."""
        await self._socket.accept()
        if self._broadcaster.browsers >= MAX_BROWSERS:
            await self._socket.close(TOO_MANY)
            return
        self._broadcaster.browsers += 1
        sender = asyncio.create_task(self._send_views())
        receiver = asyncio.create_task(self._receive())
        try:
            await asyncio.wait([sender, receiver], return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._broadcaster.browsers -= 1
            sender.cancel()
            receiver.cancel()
            results = await asyncio.gather(sender, receiver, *self._orders, return_exceptions=True)
            await self._operator.release_all(self._session)
            for error in results:
                if isinstance(error, Exception) and not isinstance(error, _DISCONNECTED):
                    _log.error("browser socket failed", exc_info=error)

    async def _send_views(self) -> None:
        sent: Json = {}
        number = 0
        while (level := self._level()) is not AccessLevel.NONE:
            view = self._broadcaster.view | {"me": {"level": level.name.lower()}}
            if number == 0:
                await self._send({"type": "full", "seq": number, "view": view})
            else:
                await self._send({"type": "delta", "seq": number, "view": delta(sent, view)})
            sent, number = view, number + 1
            self._views = number
            await self._broadcaster.next_view()
        await self._close(SESSION_ENDED)

    async def _receive(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if not isinstance(text, str):
                await self._close(NO_TEXT)
                return
            await self._handle(text)

    async def _handle(self, text: str) -> None:
        try:
            order = read_order(text)
        except MessageError as error:
            self._operator.refused += 1
            await self._reply(error.id, Reply(False, reply_text("malformed", what=error)))
            return
        # a jog that arrives late ends without its renewal
        if (
            order.seen is not None
            and self._views - order.seen > LATEST_VIEWS
            and not (_halts(order) or isinstance(order, JogOrder))
        ):
            self._operator.refused += 1
            await self._reply(order.id, Reply(False, reply_text("too late")))
        elif isinstance(order, JogOrder):  # in order of arrival, without waiting for other orders
            await self._execute(order)
        elif len(self._orders) >= MAX_PENDING and not _halts(order):
            self._operator.refused += 1
            await self._reply(order.id, Reply(False, reply_text("busy")))
        else:
            task = asyncio.create_task(self._execute(order))
            self._orders.add(task)
            task.add_done_callback(self._orders.discard)

    async def _execute(self, order: Order) -> None:
        await self._reply(order.id, await self._operator.execute(order, self._session, self._level()))

    async def _reply(self, id_: int | str | None, reply: Reply) -> None:
        why = in_both_or_none(reply.why)
        await self._send({"type": "reply", "id": id_, "ok": reply.ok, "text": in_both(reply.text), "why": why})

    async def _send(self, message: dict[str, Any]) -> None:
        async with self._send_lock:
            await self._socket.send_json(message)

    async def _close(self, code: int) -> None:
        if self._socket.application_state is WebSocketState.CONNECTED:
            try:
                await self._socket.close(code)
            except (RuntimeError, WebSocketDisconnect):  # closed by the browser meanwhile
                _log.debug("the browser closed the socket first")
