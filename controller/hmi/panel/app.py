"""The panel as a web application: page, description, login, history, trends, metrics and the socket."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from controller.core.clock import Clock
from controller.hmi.history_query import HistoryReader, Record
from controller.hmi.panel.describe import describe, public
from controller.hmi.panel.guard import Guard
from controller.hmi.panel.jog import Jogging
from controller.hmi.panel.line import Line
from controller.hmi.panel.login import (
    LONGEST,
    SESSION_MS,
    SHORTEST,
    USERS,
    Level,
    Sessions,
    Tries,
    User,
    Users,
    is_loopback,
)
from controller.hmi.panel.metrics import CONTENT_TYPE, Metrics
from controller.hmi.panel.orders import Operator
from controller.hmi.panel.replies import reply_text
from controller.hmi.panel.sockets import Browser, Hub
from controller.hmi.panel.source import Mirror, Poller
from controller.hmi.panel.telemetry import Telemetry
from controller.hmi.panel.trends import Trends
from controller.hmi.panel.view import Viewer, in_both
from controller.program.machine import Transplanter
from controller.program.tags import SIDES

_log = logging.getLogger(__name__)

STATIC: Final = Path(__file__).parent / "static"
COOKIE: Final = "panel_session"
CANCEL_AGAIN_S: Final = 0.1
LONGEST_BODY: Final = 4_096
HISTORY_LOOK_S: Final = 2.0
"""How often it is looked whether there is a history."""

Answer = Callable[[Request], Awaitable[Response]]
Body = TypeVar("Body", bound=BaseModel)


class _Login(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    user: str = Field(max_length=32)
    password: str = Field(max_length=LONGEST)


class _First(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    operate: str
    maintain: str


@dataclass(frozen=True, slots=True)
class Sources:
    """Where the panel's data come from.

    Attributes:
        machine: The program, as the controller runs it.
        connect: Returns a new connection to the controller.
        telemetry: The second source, if there is one.
        history: The history, there or not.
        clock: The panel's clock.
    """

    machine: Transplanter
    connect: Callable[[], Line]
    telemetry: Telemetry | None
    history: HistoryReader | None
    clock: Clock


class Panel:
    """All of the panel but its sockets to the world. Use from one event loop.

    Attributes:
        sessions: Who is logged in.
        mirror: What is known of the controller.
        operator: Who carries out orders.
    """

    def __init__(self, sources: Sources, users: Users, *, secure: bool = False) -> None:
        """Put the panel together.

        Args:
            sources: Where its data come from.
            users: The passwords.
            secure: Whether it is served with TLS; cookies then go nowhere without.
        """
        machine, clock, telemetry = sources.machine, sources.clock, sources.telemetry
        self.sessions = Sessions(clock)
        self.mirror = Mirror(clock)
        self._sources = sources
        self._users = users
        self._tries = Tries(clock)
        self._secure = secure
        self._history_there = False
        self._one_hash_at_a_time = asyncio.Lock()
        self._jogging = Jogging(machine, self.mirror, sources.connect, clock)
        self.operator = Operator(
            machine, self.mirror, sources.connect(), self._jogging, telemetry=telemetry, clock=clock
        )
        self._trends = Trends(self.mirror, telemetry, clock)
        viewer = Viewer(machine, self.mirror, self._jogging, telemetry, lambda: self._history_there)
        self._hub = Hub(viewer, self._trends)
        self._metrics = Metrics(machine, self.mirror, self.operator, telemetry, lambda: self._hub.browsers)
        self._description = describe(machine, telemetry)

    def level(self, connection: HTTPConnection) -> Level:
        """Return what whoever sent this may do: by the session, and on this computer at least view."""
        level = self.sessions.level(connection.cookies.get(COOKIE))
        return max(level, Level.VIEW) if _is_here(connection) else level

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Poll, and make views, while the application runs."""
        poller = Poller(self._sources.connect(), self.mirror, self._sources.machine.io_map)
        works: list[Coroutine[Any, Any, None]] = [poller.run(), self._hub.run(), self.operator.run(), self._look()]
        if self._sources.telemetry is not None:
            works.append(self._sources.telemetry.run())
        tasks = [asyncio.create_task(work) for work in works]
        for task in tasks:
            task.add_done_callback(_tell_failure)
        try:
            yield
        finally:
            await self._jogging.close()
            await _end(tasks)

    async def me(self, request: Request) -> Response:
        """Tell who somebody is here."""
        return JSONResponse({"level": self.level(request).name.lower(), "first_run": self._users.first_run})

    async def login(self, request: Request) -> Response:
        """Begin a session with a user's password."""
        peer = _peer(request)
        if self._users.first_run:
            return _reply(409, "first run")
        locked_s = self._tries.locked_s(peer)
        if locked_s:
            answer = _reply(429, "too many tries", seconds=locked_s)
            answer.headers["retry-after"] = str(locked_s)
            return answer
        body = await _body(request, _Login)
        if body is None:
            return _reply(400, "malformed", what="user, password")
        self._tries.begin(peer)
        async with self._one_hash_at_a_time:
            right = await asyncio.to_thread(self._users.matches, body.user, body.password)
        user = next((user for user in USERS if user == body.user), None)
        if not right or user is None:
            return _reply(401, "wrong password")
        self._tries.right(peer)
        self.sessions.end(request.cookies.get(COOKIE))
        return self._with_session(_reply(200, "welcome"), user)

    async def logout(self, request: Request) -> Response:
        """End the session."""
        self.sessions.end(request.cookies.get(COOKIE))
        answer = _reply(200, "bye")
        answer.delete_cookie(COOKIE, path="/", secure=self._secure, httponly=True, samesite="strict")
        return answer

    async def first(self, request: Request) -> Response:
        """Take both passwords on the first run, from this computer alone."""
        if not _is_here(request):
            return _reply(403, "first only here")
        body = await _body(request, _First)
        if body is None:
            return _reply(400, "malformed", what="operate, maintain")
        passwords: dict[User, str] = {"operate": body.operate, "maintain": body.maintain}
        if not all(SHORTEST <= len(password) <= LONGEST for password in passwords.values()):
            return _reply(400, "password length", least=SHORTEST, most=LONGEST)
        if body.operate == body.maintain:
            return _reply(400, "same password")
        async with self._one_hash_at_a_time:
            if not self._users.first_run:
                return _reply(409, "first is over")
            try:
                await asyncio.to_thread(self._users.set_first, passwords)
            except OSError as error:
                return _reply(500, "not stored", why=error.strerror or error)
        return _reply(200, "set up")

    async def describe(self, request: Request) -> Response:
        """Tell what the page has to know once; to a stranger what the login dialog needs."""
        if self.level(request) is Level.NONE:
            return JSONResponse(public(), status_code=401)
        return JSONResponse(self._description)

    async def history(self, request: Request) -> Response:
        """Return rows of the history, the newest first."""
        reader = self._sources.history
        if reader is None:
            return _reply(404, "no history")
        tables: dict[str, Callable[[int, int | None], list[Record]]] = {
            "events": reader.events,
            "alarms": reader.alarms,
            "cycles": reader.cycles,
            "audit": reader.audit,
        }
        table = tables.get(request.path_params["table"])
        last, before = _whole(request, "last", "100"), _whole(request, "before", "")
        if table is None or last is None or (before is None and "before" in request.query_params):
            return _reply(400, "malformed", what="events|alarms|cycles|audit, last, before")
        if not await asyncio.to_thread(lambda: reader.present):
            return _reply(404, "no history")
        return JSONResponse(await asyncio.to_thread(table, last, before))

    async def last_cycle(self, request: Request) -> Response:
        """Return the last cycle of an arm with its edges."""
        reader = self._sources.history
        side = next((side for side in SIDES if side == request.query_params.get("side")), None)
        if side is None:
            return _reply(400, "malformed", what="side")
        if reader is None or not await asyncio.to_thread(lambda: reader.present):
            return _reply(404, "no history")
        return JSONResponse(await asyncio.to_thread(reader.last_cycle, side))

    async def trends(self, request: Request) -> Response:
        """Return samples later than a time."""
        since_ms = _whole(request, "since", "0")
        if since_ms is None:
            return _reply(400, "malformed", what="since")
        return JSONResponse(self._trends.since(since_ms))

    async def metrics(self, _: Request) -> Response:
        """Return what a Prometheus server reads."""
        return Response(self._metrics.text(), media_type=CONTENT_TYPE)

    async def socket(self, socket: WebSocket) -> None:
        """Serve a browser's socket."""
        if self.level(socket) is Level.NONE:
            await socket.close(1008)
            return
        await Browser(socket, self._hub, self.operator, lambda: self.level(socket)).serve()

    def seen_by_viewers(self, answer: Answer) -> Answer:
        """Return an endpoint that answers those only who may at least view."""

        async def checked(request: Request) -> Response:
            if self.level(request) is Level.NONE:
                return _reply(401, "level", level=Level.OPERATE.name.lower())
            return await answer(request)

        return checked

    async def _look(self) -> None:
        """Look now and again whether there is a history."""
        reader = self._sources.history
        while reader is not None:
            self._history_there = await asyncio.to_thread(lambda: reader.present)
            await asyncio.sleep(HISTORY_LOOK_S)

    def _with_session(self, answer: Response, user: User) -> Response:
        answer.set_cookie(COOKIE, self.sessions.begin(user), max_age=SESSION_MS // 1_000, path="/",
                          secure=self._secure, httponly=True, samesite="strict")  # fmt: skip
        return answer


def application(panel: Panel, names: Iterable[str]) -> ASGIApp:
    """Return the panel as an ASGI application.

    Args:
        panel: The panel.
        names: Names under which it is served, without port; this computer's own and the reached address are added.
    """

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        async with panel.running():
            yield

    async def page(_: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    view = panel.seen_by_viewers
    routes = [
        Route("/", page),
        Mount("/static", StaticFiles(directory=STATIC)),
        Route("/api/me", panel.me),
        Route("/api/describe", panel.describe),
        Route("/api/login", panel.login, methods=["POST"]),
        Route("/api/logout", panel.logout, methods=["POST"]),
        Route("/api/first", panel.first, methods=["POST"]),
        Route("/api/history/last_cycle", view(panel.last_cycle)),
        Route("/api/history/{table}", view(panel.history)),
        Route("/api/trends", view(panel.trends)),
        Route("/metrics", view(panel.metrics)),
        WebSocketRoute("/ws", panel.socket),
    ]
    return Guard(Starlette(routes=routes, lifespan=lifespan), names)


def _peer(connection: HTTPConnection) -> str:
    return connection.client.host if connection.client else ""


def _is_here(connection: HTTPConnection) -> bool:
    return is_loopback(_peer(connection))


def _reply(status: int, key: str, **values: object) -> Response:
    return JSONResponse({"ok": status == 200, "text": in_both(reply_text(key, **values))}, status_code=status)


async def _body(request: Request, model: type[Body]) -> Body | None:
    """Read a small JSON body; None = it is none, or not what is wanted."""
    read = b""
    async for chunk in request.stream():
        read += chunk
        if len(read) > LONGEST_BODY:
            return None
    try:
        return model.model_validate_json(read)
    except ValidationError:
        return None


def _whole(request: Request, name: str, otherwise: str) -> int | None:
    """Return a whole number of the query; None = it is none."""
    text = request.query_params.get(name, otherwise)
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= 18 else None


async def _end(tasks: Iterable[asyncio.Task[None]]) -> None:
    """Cancel tasks until they have ended: one that waits for an answer may miss a cancellation that comes with it."""
    running = {task for task in tasks if not task.done()}
    while running:
        for task in running:
            task.cancel()
        _, running = await asyncio.wait(running, timeout=CANCEL_AGAIN_S)


def _tell_failure(task: asyncio.Task[None]) -> None:
    error = None if task.cancelled() else task.exception()
    if error is not None:
        _log.critical("a task of the panel failed", exc_info=error)
