"""Web application of the panel: page, description, login, history, trends, metrics and socket."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field
from starlette.applications import Starlette
from starlette.requests import HTTPConnection, Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from controller.common.supervision.tasks import supervised_task
from controller.common.supervision.threads import in_thread
from controller.core.clock import Clock, utc_ms
from controller.history.query import HistoryReader, Record, RecordFilter
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.panel.modbus.mirror import Mirror, Poller
from controller.hmi.panel.modbus.telemetry import Telemetry
from controller.hmi.panel.orders.jog import Jogging
from controller.hmi.panel.orders.login import (
    PASSWORD_MAX,
    PASSWORD_MIN,
    SESSION_MS,
    USERS,
    AccessLevel,
    LoginSessions,
    LoginThrottle,
    User,
    Users,
)
from controller.hmi.panel.orders.operator import OrderHandler
from controller.hmi.panel.orders.replies import level_text, reply_text
from controller.hmi.panel.view.describe import describe, public
from controller.hmi.panel.view.metrics import CONTENT_TYPE, Metrics
from controller.hmi.panel.view.state import ViewBuilder
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trends import KEPT_MS, LEAST_SPAN_MS, MOST_POINTS, Trends
from controller.hmi.panel.web.answers import body_of, reply, response, whole_number
from controller.hmi.panel.web.listener import Attendance, PanelListener
from controller.hmi.panel.web.sockets import BrowserSocket, ViewBroadcaster
from controller.hmi.web.failures import counting
from controller.hmi.web.files import static_routes
from controller.hmi.web.guard import Guard, is_local, peer_of
from controller.program.machine import Transplanter
from controller.program.tags import SIDES
from controller.program.texts.operator import Language

STATIC: Final = Path(__file__).parents[1] / "static"
_PACKAGED_PICTURE: Final = STATIC.with_name("machine.svg")
PICTURE: Final = _PACKAGED_PICTURE if _PACKAGED_PICTURE.exists() else STATIC.parents[3] / "docs" / "machine.svg"
"""Picture of the machine, in the installed package or in the documentation of a checkout."""
COOKIE: Final = "panel_session"
CANCEL_PERIOD_S: Final = 0.1
LONGEST_FILTER: Final = 100
"""Maximum length of a text by which records are selected, characters."""
HISTORY_CHECK_S: Final = 2.0
"""Period of the look for a history and its newest change of an alarm, s."""

Endpoint = Callable[[Request], Awaitable[Response]]


class _Login(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    user: str = Field(max_length=32)
    password: str = Field(max_length=PASSWORD_MAX)


class _FirstPasswords(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)

    operate: str
    maintain: str


@dataclass(frozen=True, slots=True)
class Sources:
    """Data sources of the panel.

    Attributes:
        machine: The program that the controller runs.
        connect: Function that returns a new connection to the controller.
        telemetry: Telemetry source, if configured.
        history: Reader of the history; the file may not exist yet.
        clock: Clock of the panel.
        language: Language of the page until its user selects one; None = that of the browser.
        trends: File of the trends; None = they are kept in memory only.
        wall_ms: Wall clock, ms since 1970 UTC.
    """

    machine: Transplanter
    connect: Callable[[], ModbusConnection]
    telemetry: Telemetry | None
    history: HistoryReader | None
    clock: Clock
    language: Language | None = None
    trends: TrendFile | None = None
    wall_ms: Callable[[], int] = utc_ms


class PanelApplication:
    """Panel without its network listener; for use in one event loop.

    Attributes:
        sessions: Active login sessions.
        mirror: Mirror of the controller.
        operator: Executor of orders.
        listener: Listener of the connections.
    """

    def __init__(
        self, sources: Sources, users: Users, listener: PanelListener | None = None, *, secure: bool = False
    ) -> None:
        """Assemble the panel.

        Args:
            sources: Data sources.
            users: Passwords.
            listener: Listener of the connections; None if they have no slots.
            secure: True if TLS is used; the session cookie is then sent over TLS only.
        """
        self.listener = listener
        machine, clock, telemetry = sources.machine, sources.clock, sources.telemetry
        self.sessions = LoginSessions(clock)
        self.mirror = Mirror(clock)
        self._sources = sources
        self._users = users
        self._throttle = LoginThrottle(clock)
        self._secure = secure
        self._newest_alarm: int | None = None
        self._hash_lock = asyncio.Lock()
        self._jogging = Jogging(machine, self.mirror, sources.connect, clock)
        self.operator = OrderHandler(
            machine, self.mirror, sources.connect(), self._jogging, telemetry=telemetry, clock=clock
        )
        self._trends = Trends(telemetry, sources.history, sources.trends, sources.wall_ms)
        viewer = ViewBuilder(machine, self.mirror, self._jogging, telemetry, lambda: self._newest_alarm)
        self._broadcaster = ViewBroadcaster(viewer, self._trends)
        self._metrics = Metrics(machine, self.mirror, self.operator, telemetry, lambda: self._broadcaster.browsers)
        self._description = describe(machine, telemetry, sources.language)

    def level(self, connection: HTTPConnection) -> AccessLevel:
        """Return the access level of a client: that of its session, and at least VIEW on the local computer."""
        level = self.sessions.level(connection.cookies.get(COOKIE))
        return max(level, AccessLevel.VIEW) if is_local(connection) else level

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run the background tasks (polling, views, orders) while the application runs."""
        poller = Poller(self._sources.connect(), self.mirror, self._sources.machine.io_map)
        tasks = [
            supervised_task("panel poll", poller.run),
            supervised_task("panel view", self._broadcaster.run),
            supervised_task("forced inputs", self.operator.run),
            supervised_task("newest alarm", self._watch_history),
            supervised_task("trend writer", self._trends.run),
        ]
        if self._sources.telemetry is not None:
            tasks.append(supervised_task("telemetry poll", self._sources.telemetry.run))
        if self.listener is not None:
            tasks.append(supervised_task("panel connections", self.listener.watch))
        try:
            yield
        finally:
            await self._jogging.close()
            await self._trends.close()
            await _cancel(tasks)

    async def me(self, request: Request) -> Response:
        """Return the access level of the client and whether the passwords have yet to be set."""
        return JSONResponse({"level": self.level(request).name.lower(), "first_run": self._users.first_run})

    async def login(self, request: Request) -> Response:
        """Start a session with a user name and a password."""
        peer = peer_of(request)
        if self._users.first_run:
            return reply(409, "first run")
        body = await body_of(request, _Login, "user, password")
        if isinstance(body, Response):
            return body
        locked_s = self._throttle.locked_s(body.user, peer)
        if locked_s:
            locked = reply(429, "too many tries", seconds=locked_s)
            locked.headers["retry-after"] = str(locked_s)
            return locked
        self._throttle.begin(body.user, peer)
        async with self._hash_lock:
            correct = await in_thread("password check", self._users.matches, body.user, body.password)
        user = next((user for user in USERS if user == body.user), None)
        if not correct or user is None:
            return reply(401, "wrong password")
        self._throttle.succeed(user, peer)
        self.sessions.end(request.cookies.get(COOKIE))
        return self._with_session(reply(200, "welcome"), user)

    async def logout(self, request: Request) -> Response:
        """End the session."""
        self.sessions.end(request.cookies.get(COOKIE))
        answer = reply(200, "bye")
        answer.delete_cookie(COOKIE, path="/", secure=self._secure, httponly=True, samesite="strict")
        return answer

    async def first(self, request: Request) -> Response:
        """Set both passwords on the first run; permitted from the local computer only."""
        if not is_local(request):
            return reply(403, "first only here")
        body = await body_of(request, _FirstPasswords, "operate, maintain")
        if isinstance(body, Response):
            return body
        passwords: dict[User, str] = {"operate": body.operate, "maintain": body.maintain}
        if not all(PASSWORD_MIN <= len(password) <= PASSWORD_MAX for password in passwords.values()):
            return reply(400, "password length", least=PASSWORD_MIN, most=PASSWORD_MAX)
        if body.operate == body.maintain:
            return reply(400, "same password")
        async with self._hash_lock:
            if not self._users.first_run:
                return reply(409, "first is over")
            try:
                await in_thread("password file", self._users.set_first, passwords)
            except OSError as error:
                return reply(500, "not stored", why=error.strerror or error)
        return reply(200, "set up")

    async def describe(self, request: Request) -> Response:
        """Return the description for the page; before login, only the part that the login dialog needs."""
        if self.level(request) is AccessLevel.NONE:
            return JSONResponse(public(self._sources.language), status_code=401)
        return JSONResponse(self._description)

    async def history(self, request: Request) -> Response:
        """Return rows of the history, newest first."""
        reader = self._sources.history
        if reader is None:
            return reply(404, "no history")
        tables: dict[str, Callable[[int, int | None], list[Record]]] = {
            "events": reader.events,
            "alarms": reader.alarms,
            "cycles": reader.cycles,
            "audit": reader.audit,
        }
        table = tables.get(request.path_params["table"])
        last, before = whole_number(request, "last", "100"), whole_number(request, "before", "")
        if table is None or last is None or (before is None and "before" in request.query_params):
            return reply(400, "malformed", what="events|alarms|cycles|audit, last, before")
        if not await in_thread("history of the panel", lambda: reader.present):
            return reply(404, "no history")
        return JSONResponse(await in_thread("history of the panel", table, last, before))

    async def records(self, request: Request) -> Response:
        """Return events, alarm changes and cycles of the history by time, kind, alarm and text, newest first."""
        reader = self._sources.history
        query = request.query_params
        given = {name: whole_number(request, name, "0") for name in ("last", "before", "since", "until", "number")}
        kind, text = query.get("kind", ""), query.get("text", "")
        if None in given.values() or max(len(kind), len(text)) > LONGEST_FILTER:
            return reply(400, "malformed", what="last, before, since, until, kind, number, text")
        if reader is None or not await in_thread("history of the panel", lambda: reader.present):
            return reply(404, "no history")
        named = {name: value for name, value in given.items() if name in query and value is not None}
        chosen = RecordFilter(
            kind=kind,
            text=text,
            number=named.get("number"),
            **{f"{name}_ms": named[name] for name in ("since", "until") if name in named},
        )
        last, before = named.get("last", 100), named.get("before")
        return JSONResponse(await in_thread("history of the panel", reader.records, chosen, last, before))

    async def last_cycle(self, request: Request) -> Response:
        """Return the last cycle of an arm with its edges."""
        reader = self._sources.history
        side = next((side for side in SIDES if side == request.query_params.get("side")), None)
        if side is None:
            return reply(400, "malformed", what="side")
        if reader is None or not await in_thread("history of the panel", lambda: reader.present):
            return reply(404, "no history")
        return JSONResponse(await in_thread("history of the panel", reader.last_cycle, side))

    async def trends(self, request: Request) -> Response:
        """Return the trends of a time span, as many points as the page can show."""
        span_ms, points = whole_number(request, "span", "0"), whole_number(request, "points", "0")
        end_ms = whole_number(request, "end", "")
        if span_ms is None or points is None or (end_ms is None and "end" in request.query_params):
            return reply(400, "malformed", what="span, points, end")
        if not (LEAST_SPAN_MS <= span_ms <= KEPT_MS and 1 <= points <= MOST_POINTS):
            return reply(400, "malformed", what=f"span {LEAST_SPAN_MS}-{KEPT_MS}, points 1-{MOST_POINTS}, end")
        return JSONResponse(await self._trends.answer(span_ms, end_ms, points))

    async def metrics(self, _: Request) -> Response:
        """Return the Prometheus metrics."""
        return Response(self._metrics.text(), media_type=CONTENT_TYPE)

    async def socket(self, socket: WebSocket) -> None:
        """Serve the socket of a browser."""
        if self.level(socket) is AccessLevel.NONE:
            await socket.close(1008)
            return
        await BrowserSocket(
            socket, self._broadcaster, self.operator, lambda: self.level(socket), peer_of(socket)
        ).serve()

    def requires_view(self, endpoint: Endpoint) -> Endpoint:
        """Return an endpoint that requires at least the VIEW level."""

        async def checked(request: Request) -> Response:
            if self.level(request) is AccessLevel.NONE:
                return response(401, level_text(AccessLevel.OPERATE))
            return await endpoint(request)

        return checked

    async def _watch_history(self) -> None:
        """Look periodically for the history and its newest change of an alarm."""
        reader = self._sources.history
        while reader is not None:
            self._newest_alarm = await in_thread("history of the panel", reader.newest_alarm)
            await asyncio.sleep(HISTORY_CHECK_S)

    def _with_session(self, answer: Response, user: User) -> Response:
        answer.set_cookie(
            COOKIE,
            self.sessions.begin(user),
            max_age=SESSION_MS // 1_000,
            path="/",
            secure=self._secure,
            httponly=True,
            samesite="strict",
        )
        return answer


def application(panel: PanelApplication, names: Iterable[str]) -> ASGIApp:
    """Return the panel as an ASGI application.

    Args:
        panel: The panel.
        names: Host names of the panel, without port, in addition to the local host name and the listening address.
    """

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        async with panel.running():
            yield

    async def page(_: Request) -> Response:
        return FileResponse(STATIC / "index.html")

    async def picture(_: Request) -> Response:
        return FileResponse(PICTURE, media_type="image/svg+xml")

    view = panel.requires_view
    routes = [
        Route("/", page),
        Route("/machine.svg", picture),
        *static_routes(STATIC),
        Route("/api/me", panel.me),
        Route("/api/describe", panel.describe),
        Route("/api/login", panel.login, methods=["POST"]),
        Route("/api/logout", panel.logout, methods=["POST"]),
        Route("/api/first", panel.first, methods=["POST"]),
        Route("/api/history/last_cycle", view(panel.last_cycle)),
        Route("/api/history/records", view(panel.records)),
        Route("/api/history/{table}", view(panel.history)),
        Route("/api/trends", view(panel.trends)),
        Route("/metrics", view(panel.metrics)),
        WebSocketRoute("/ws", panel.socket),
    ]
    guarded = Guard(counting(Starlette(routes=routes, lifespan=lifespan)), names, reply_text("not served"))
    if panel.listener is None:
        return guarded
    return Attendance(guarded, panel.listener, lambda connection: panel.level(connection) > AccessLevel.VIEW)


async def _cancel(tasks: Iterable[asyncio.Task[None]]) -> None:
    """Cancel tasks repeatedly until all have ended: a cancellation that coincides with a response can be lost."""
    running = {task for task in tasks if not task.done()}
    while running:
        for task in running:
            task.cancel()
        _, running = await asyncio.wait(running, timeout=CANCEL_PERIOD_S)
