"""WebSocket connections of the browsers, which receive the live view and send orders."""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, Final

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from controller.common.client_slots import ClientSlot, ClientSlots, Quota, address_group
from controller.common.supervision.tasks import supervised_task
from controller.hmi.panel.orders.login import HALTING, AccessLevel
from controller.hmi.panel.orders.messages import BoxOrder, CommandOrder, JogOrder, MessageError, Order, read_order
from controller.hmi.panel.orders.operator import OrderHandler, Reply
from controller.hmi.panel.orders.replies import reply_text
from controller.hmi.panel.orders.session import BrowserSession
from controller.hmi.panel.view.facts import Json
from controller.hmi.panel.view.state import ViewBuilder, delta, in_both, in_both_or_none
from controller.hmi.panel.view.trends import SAMPLE_MS, Trends

_log = logging.getLogger(__name__)

VIEW_MS: Final = 100
QUOTA: Final = Quota(most=32, reserved=16, of_address=16)
"""Browsers; without a login there are only those of the panel computer."""
MAX_PENDING: Final = 16
"""Maximum number of pending orders of one browser."""
LATEST_VIEWS: Final = 30
"""Number of views after which an order is too old to be executed (3 s): its user may have left after *no reply*."""

SESSION_ENDED: Final = 4401
FAILURE: Final = 1011
TOO_MANY: Final = 1013
"""Close code of a browser without a slot: all are taken by others, or another one got that of this browser."""
NO_TEXT: Final = 1003


class ViewBroadcaster:
    """Source of the live view for all browsers, updated ten times a second.

    Attributes:
        slots: Slots of the browsers.
    """

    def __init__(self, viewer: ViewBuilder, trends: Trends) -> None:
        """Initialise the broadcaster for a view builder and a trend recorder."""
        self.slots = ClientSlots(QUOTA)
        self._viewer = viewer
        self._trends = trends
        self._view: Json = viewer.view()
        self._next = asyncio.Event()

    @property
    def browsers(self) -> int:
        """Number of open sockets."""
        return len(self.slots.taken)

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
        self,
        socket: WebSocket,
        broadcaster: ViewBroadcaster,
        operator: OrderHandler,
        level: Callable[[], AccessLevel],
        peer: str,
    ) -> None:
        """Initialise the handler of a socket.

        Args:
            socket: The socket, not yet accepted.
            broadcaster: Source of the view.
            operator: Executor of the orders.
            level: Function that returns the current access level of the session.
            peer: Address of the browser.
        """
        self._socket = socket
        self._broadcaster = broadcaster
        self._operator = operator
        self._level = level
        self._session = BrowserSession()
        self._orders: set[asyncio.Task[None]] = set()
        self._send_lock = asyncio.Lock()
        self._views = 0
        self._sent_ms: deque[int] = deque(maxlen=LATEST_VIEWS)
        self._displaced = asyncio.Event()
        self._slot = ClientSlot(address_group(peer), self._displaced.set, _now_ms())

    async def serve(self) -> None:
        """Serve until the socket closes, the session ends, or another browser gets the slot."""
        await self._socket.accept()
        slots = self._broadcaster.slots
        self._slot.is_known = self._level() > AccessLevel.VIEW
        if not slots.take(self._slot):
            await self._socket.close(TOO_MANY)
            return
        tasks = [
            supervised_task("browser views", partial(self._while_connected, self._send_views)),
            supervised_task("browser orders", partial(self._while_connected, self._receive)),
            supervised_task("browser slot", partial(self._while_connected, self._lose_slot)),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            slots.leave(self._slot)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, *self._orders, return_exceptions=True)
            await self._operator.release_all(self._session)
            await self._close(FAILURE)

    async def _while_connected(self, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Work until the browser disconnects, which is no error."""
        try:
            await work()
        except (WebSocketDisconnect, OSError):
            _log.debug("the browser disconnected")
        except RuntimeError:  # raised by a closed socket, among others
            if self._is_connected:
                raise

    @property
    def _is_connected(self) -> bool:
        states = (self._socket.application_state, self._socket.client_state)
        return all(state is WebSocketState.CONNECTED for state in states)

    async def _send_views(self) -> None:
        sent: Json = {}
        number = 0
        while (level := self._level()) is not AccessLevel.NONE:
            self._slot.is_known = level > AccessLevel.VIEW
            view = self._broadcaster.view | {"me": {"level": level.name.lower()}}
            if number == 0:
                await self._send({"type": "full", "seq": number, "view": view})
            else:
                await self._send({"type": "delta", "seq": number, "view": delta(sent, view)})
            self._sent_ms.append(_now_ms())
            sent, number = view, number + 1
            self._views = number
            await self._broadcaster.next_view()
        await self._close(SESSION_ENDED)

    async def _receive(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            self._slot.has_asked, self._slot.active_ms = True, _now_ms()
            text = message.get("text")
            if not isinstance(text, str):
                await self._close(NO_TEXT)
                return
            await self._handle(text)

    async def _lose_slot(self) -> None:
        """Wait until another browser gets the slot, and tell this one."""
        await self._displaced.wait()
        await self._close(TOO_MANY)

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
            self._session.view_age_ms = self._age_ms(order.seen)
            await self._execute(order)
        elif len(self._orders) >= MAX_PENDING and not _halts(order):
            self._operator.refused += 1
            await self._reply(order.id, Reply(False, reply_text("busy")))
        else:
            task = supervised_task("order", partial(self._while_connected, partial(self._execute, order)))
            self._orders.add(task)
            task.add_done_callback(self._orders.discard)

    def _age_ms(self, seen: int | None) -> int:
        """Return the age of a view, ms; 0 if a client does not tell which it has seen."""
        newer = 0 if seen is None else self._views - seen
        return _now_ms() - self._sent_ms[-min(newer, len(self._sent_ms))] if newer > 0 and self._sent_ms else 0

    async def _execute(self, order: Order) -> None:
        await self._reply(order.id, await self._operator.execute(order, self._session, self._level()))

    async def _reply(self, id_: int | str | None, reply: Reply) -> None:
        why = in_both_or_none(reply.why)
        await self._send({"type": "reply", "id": id_, "ok": reply.ok, "text": in_both(reply.text), "why": why})

    async def _send(self, message: dict[str, Any]) -> None:
        async with self._send_lock:
            await self._socket.send_json(message)

    async def _close(self, code: int) -> None:
        if self._is_connected:
            try:
                await self._socket.close(code)
            except (RuntimeError, WebSocketDisconnect):  # closed by the browser meanwhile
                _log.debug("the browser closed the socket first")


def _now_ms() -> int:
    return int(asyncio.get_running_loop().time() * 1_000)
