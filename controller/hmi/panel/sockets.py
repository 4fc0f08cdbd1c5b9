"""The browsers: each with a socket on which it is shown the view and gives orders."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from controller.hmi.panel.hand import Hand
from controller.hmi.panel.login import Level
from controller.hmi.panel.messages import JogOrder, MessageError, Order, read_order
from controller.hmi.panel.orders import Operator, Reply
from controller.hmi.panel.replies import reply_text
from controller.hmi.panel.trends import PERIOD_MS, Trends
from controller.hmi.panel.view import Json, Viewer, delta, in_both

_log = logging.getLogger(__name__)

VIEW_MS: Final = 100
MOST_BROWSERS: Final = 32
MOST_AT_ONCE: Final = 16
"""Orders of one browser that wait for their answers."""

_GONE: Final = (WebSocketDisconnect, RuntimeError, OSError)
"""What a send raises to a browser that has gone."""

SESSION_ENDED: Final = 4401
TOO_MANY: Final = 1013
NO_TEXT: Final = 1003


class Hub:
    """Makes the view ten times a second and knows who looks at it.

    Attributes:
        browsers: Sockets that are open.
    """

    def __init__(self, viewer: Viewer, trends: Trends) -> None:
        """Show what the viewer makes."""
        self.browsers = 0
        self._viewer = viewer
        self._trends = trends
        self._view: Json = viewer.view()
        self._next = asyncio.Event()

    @property
    def view(self) -> Json:
        """The view as it was made last."""
        return self._view

    async def next_view(self) -> None:
        """Wait for the next view."""
        await self._next.wait()

    async def run(self) -> None:
        """Make views and samples until cancelled."""
        ticks = 0
        while True:
            self._view = self._viewer.view()
            shown, self._next = self._next, asyncio.Event()
            shown.set()
            if ticks % (PERIOD_MS // VIEW_MS) == 0:
                self._trends.sample()
            ticks += 1
            await asyncio.sleep(VIEW_MS / 1_000)


class Browser:
    """One socket, from its opening to its end; then all that it held is let go."""

    def __init__(self, socket: WebSocket, hub: Hub, operator: Operator, level: Callable[[], Level]) -> None:
        """Serve a socket.

        Args:
            socket: The socket, not yet accepted.
            hub: Where the view comes from.
            operator: Who carries out its orders.
            level: Returns the level of its session now.
        """
        self._socket = socket
        self._hub = hub
        self._operator = operator
        self._level = level
        self._hand = Hand()
        self._orders: set[asyncio.Task[None]] = set()
        self._one_at_a_time = asyncio.Lock()

    async def serve(self) -> None:
        """Serve until the socket or the session ends."""
        await self._socket.accept()
        if self._hub.browsers >= MOST_BROWSERS:
            await self._socket.close(TOO_MANY)
            return
        self._hub.browsers += 1
        showing = asyncio.create_task(self._show())
        hearing = asyncio.create_task(self._hear())
        try:
            await asyncio.wait([showing, hearing], return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._hub.browsers -= 1
            showing.cancel()
            hearing.cancel()
            ended = await asyncio.gather(showing, hearing, *self._orders, return_exceptions=True)
            await self._operator.let_go(self._hand)
            for error in ended:
                if isinstance(error, Exception) and not isinstance(error, _GONE):
                    _log.error("a browser was dropped", exc_info=error)

    async def _show(self) -> None:
        shown: Json = {}
        number = 0
        while (level := self._level()) is not Level.NONE:
            view = self._hub.view | {"me": {"level": level.name.lower()}}
            if number == 0:
                await self._send({"type": "full", "seq": number, "view": view})
            else:
                await self._send({"type": "delta", "seq": number, "view": delta(shown, view)})
            shown, number = view, number + 1
            await self._hub.next_view()
        await self._close(SESSION_ENDED)

    async def _hear(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            text = message.get("text")
            if not isinstance(text, str):
                await self._close(NO_TEXT)
                return
            await self._take(text)

    async def _take(self, text: str) -> None:
        try:
            order = read_order(text)
        except MessageError as error:
            self._operator.refused += 1
            await self._answer(error.id, Reply(False, reply_text("malformed", what=error)))
            return
        if isinstance(order, JogOrder):  # in the order in which they came, and waiting for nothing else
            await self._carry_out(order)
        elif len(self._orders) >= MOST_AT_ONCE:
            self._operator.refused += 1
            await self._answer(order.id, Reply(False, reply_text("busy")))
        else:
            task = asyncio.create_task(self._carry_out(order))
            self._orders.add(task)
            task.add_done_callback(self._orders.discard)

    async def _carry_out(self, order: Order) -> None:
        await self._answer(order.id, await self._operator.carry_out(order, self._hand, self._level()))

    async def _answer(self, id_: int | str | None, reply: Reply) -> None:
        await self._send({"type": "reply", "id": id_, "ok": reply.ok, "text": in_both(reply.text)})

    async def _send(self, message: dict[str, Any]) -> None:
        async with self._one_at_a_time:
            await self._socket.send_json(message)

    async def _close(self, code: int) -> None:
        if self._socket.application_state is WebSocketState.CONNECTED:
            try:
                await self._socket.close(code)
            except (RuntimeError, WebSocketDisconnect):  # it has closed meanwhile
                _log.debug("a socket closed before it could be closed")
