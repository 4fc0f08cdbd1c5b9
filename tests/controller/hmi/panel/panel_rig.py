"""Panel on a controller: a twin with real-time scans, its Modbus server, and browsers."""

from __future__ import annotations

import asyncio
import itertools
import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import httpx
import pytest
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send
from websockets.sync.client import ClientConnection, connect

from controller.common.client_slots import Quota
from controller.core.clock import MonotonicClock
from controller.history.query import HistoryReader
from controller.hmi.access.server import HmiServer
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.panel.modbus import mirror
from controller.hmi.panel.modbus.naming import INTRODUCTION
from controller.hmi.panel.modbus.telemetry import Telemetry
from controller.hmi.panel.orders import operator
from controller.hmi.panel.orders.login import Cost, Users
from controller.hmi.panel.view.trend_file import TrendFile
from controller.hmi.panel.view.trends import MOST_PERIODS
from controller.hmi.panel.web.app import PanelApplication, Sources, application
from controller.hmi.panel.web.listener import QUOTA, REQUEST_MS, PanelListener
from controller.hmi.web.server import server_config
from controller.io.pace import Pace
from controller.io.scan_writes import ScanWrite
from plant_sim.twin.lock_step import Twin
from tests.controller.hmi.hmi_rig import HmiRig

ELSEWHERE = "192.0.2.7"
PEER = "x-test-peer"
PASSWORDS = {"operate": "seedling-1", "maintain": "seedling-2"}
CHEAP = Cost(n=2, r=1, p=1)
MAX_MESSAGES = 300
KEEPALIVE_S = None
"""Period of the keep-alive messages: none, because they draw from the generator that Hypothesis watches."""
TIMEOUT_S = 60.0


class Browser:
    """Socket client that maintains the view as the page does."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.view: dict[str, Any] = {}
        self._replies: dict[Any, dict[str, Any]] = {}
        self._number = itertools.count(1)
        self._expected = 0

    def read(self) -> dict[str, Any]:
        """Read one message and check that no view update is missing."""
        message: dict[str, Any] = json.loads(self.socket.recv(timeout=TIMEOUT_S))
        if message["type"] == "reply":
            self._replies[message["id"]] = message
            return message
        assert message["seq"] == self._expected
        assert message["type"] == ("delta" if self._expected else "full")
        self._expected += 1
        apply(self.view, message["view"])
        return message

    @property
    def view_number(self) -> int:
        """Number of the latest view."""
        return self._expected - 1

    def until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Read until a condition on the view holds."""
        for _ in range(MAX_MESSAGES):
            if self.view and condition(self.view):
                return self.view
            self.read()
        raise AssertionError(f"condition not met after {MAX_MESSAGES} messages: {self.view}")

    def send(self, **order: Any) -> int:
        """Send an order; return its id."""
        number = next(self._number)
        self.socket.send(json.dumps({"id": number, **order}))
        return number

    def reply(self, id_: Any) -> dict[str, Any]:
        """Read until the reply to an order arrives, and return it."""
        for _ in range(MAX_MESSAGES):
            if id_ in self._replies:
                return self._replies.pop(id_)
            self.read()
        raise AssertionError(f"no reply to {id_}")

    def is_answered(self, id_: Any) -> bool:
        """Return whether the reply to an order is among the messages that have been read."""
        return id_ in self._replies

    def order(self, **order: Any) -> dict[str, Any]:
        """Send an order and return its reply."""
        return self.reply(self.send(**order))


def apply(view: dict[str, Any], changes: dict[str, Any]) -> None:
    """Apply a delta to a view."""
    for section, change in changes.items():
        if not isinstance(change, dict) or not isinstance(view.get(section), dict):
            view[section] = change
            continue
        for key, value in change.items():
            if section == "steps" and value is None:
                del view[section][key]
            else:
                view[section][key] = value


class PanelRig:
    """Running panel; the controller scans in real time between `__enter__` and `__exit__`.

    A busy computer may delay a scan and an answer by any time: until `__exit__`, writes wait for a scan, and the panel
    for an answer (`answer_s`) and for the outcome of a command, for up to `TIMEOUT_S`; values are outdated as late.
    """

    def __init__(
        self,
        folder: Path,
        twin: Twin | None = None,
        *,
        pace: Pace | None = None,
        allow_forcing: bool = False,
        telemetry: Callable[[MonotonicClock], Telemetry] | None = None,
        first_run: bool = False,
        quota: Quota = QUOTA,
        request_ms: int = REQUEST_MS,
        answer_s: float = TIMEOUT_S,
    ) -> None:
        self.hmi = HmiRig(twin, pace=pace, allow_forcing=allow_forcing)
        self.hmi.scans_for_writes = False
        self.twin = self.hmi.twin
        self.users_file = folder / "users.json"
        users = Users(self.users_file, CHEAP)
        if not first_run:
            users.set_first({"operate": PASSWORDS["operate"], "maintain": PASSWORDS["maintain"]})
        self._stack = ExitStack()
        patch = self._stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr(ScanWrite, "limit_s", TIMEOUT_S)
        patch.setattr(operator, "OUTCOME_MS", round(1_000 * TIMEOUT_S))
        patch.setattr(mirror, "STALE_MS", round(1_000 * TIMEOUT_S))
        self._stack.enter_context(self.hmi)
        self.port = self.hmi.server.port
        clock = MonotonicClock()
        sources = Sources(
            self.twin.machine,
            lambda: ModbusConnection("127.0.0.1", self.port, timeout_s=answer_s, introduction=INTRODUCTION),
            None if telemetry is None else telemetry(clock),
            HistoryReader(folder / "history.sqlite"),
            clock,
            trends=TrendFile(folder / "trends.sqlite", MOST_PERIODS),
        )
        self._listener = PanelListener(socket.create_server(("127.0.0.1", 0)), clock, quota, request_ms)
        self.panel = PanelApplication(sources, users, self._listener)
        self.host = "127.0.0.1:{1}".format(*self._listener.getsockname())
        self.origin = f"http://{self.host}"
        app = _with_peer_header(application(self.panel, ["panel.test"]))
        config = server_config(app)
        config.ws_ping_interval = KEEPALIVE_S
        self._web = uvicorn.Server(config)
        self._web_thread = threading.Thread(target=self._serve, name="panel")
        self._scanned = threading.Condition()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._scan, name="scans")

    def __enter__(self) -> Self:
        self._thread.start()
        self._stack.callback(self._end)
        self._web_thread.start()
        self._stack.callback(self._end_web)
        self.here = self.client()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()

    def client(self, peer: str | None = None) -> httpx.Client:
        """Return a client with its own cookies; it is local unless a peer address is given."""
        headers = {"origin": self.origin} | ({} if peer is None else {PEER: peer})
        return self._stack.enter_context(httpx.Client(base_url=self.origin, headers=headers, timeout=TIMEOUT_S))

    def log_in(self, user: str) -> None:
        """Log in the local client; sockets opened afterwards have the access level of this user."""
        answer = self.here.post("/api/login", json={"user": user, "password": PASSWORDS[user]})
        assert answer.status_code == 200, answer.text

    def socket(
        self, client: httpx.Client | None = None, sock: socket.socket | None = None, **headers: str
    ) -> ClientConnection:
        """Open a socket with the cookies of a client, over a given connection; an empty header is omitted."""
        client = client or self.here
        cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        sent = {"Origin": self.origin, "Cookie": cookie} | headers
        if PEER in client.headers:
            sent[PEER] = client.headers[PEER]
        sent = {name: value for name, value in sent.items() if value}
        return connect(
            f"ws://{self.host}/ws",
            additional_headers=sent,
            proxy=None,
            sock=sock,
            open_timeout=TIMEOUT_S,
            close_timeout=2,
            max_queue=None,
            ping_interval=KEEPALIVE_S,
        )

    @contextmanager
    def browser(self, user: str | None = None) -> Iterator[Browser]:
        """Open a socket and wait until its view shows a connected controller."""
        if user is not None:
            self.log_in(user)
        with self.socket() as socket:
            browser = Browser(socket)
            browser.until(lambda view: bool(view["link"]["controller"]))
            yield browser

    def until(self, condition: Callable[[], bool], *, scans: int = 500) -> int:
        """Wait until a condition holds after a scan; return the number of scans."""
        with self._scanned:
            for scan in range(scans):
                if condition():
                    return scan
                assert self._scanned.wait(TIMEOUT_S), "no scan"
        raise AssertionError(f"condition not met after {scans} scans; {self.twin.situation()}")

    @contextmanager
    def without_scans(self) -> Iterator[None]:
        """Let no scan take place."""
        with self._scanned:
            yield

    def for_scans(self, scans: int) -> None:
        """Wait for a number of scans."""
        end = self.twin.plc.scans + scans
        self.until(lambda: self.twin.plc.scans >= end, scans=scans + 1)

    def stop_server(self) -> None:
        """Stop the Modbus server of the controller; the machine keeps running."""
        self.hmi.server.__exit__(None, None, None)

    def restart_server(self) -> None:
        """Start the Modbus server again on the same port."""
        server = HmiServer(self.twin.runtime, self.hmi.alarms, HmiOptions(port=self.port))
        self._stack.enter_context(server)

    def _scan(self) -> None:
        while not self._stop.wait(0.01):
            with self._scanned:
                self.twin.scan()
                self._scanned.notify_all()

    def _end(self) -> None:
        self._stop.set()
        self._thread.join()

    def _serve(self) -> None:
        asyncio.run(self._web.serve(sockets=[self._listener]))

    def _end_web(self) -> None:
        self._web.should_exit = True
        self._web_thread.join()


def _with_peer_header(app: ASGIApp) -> ASGIApp:
    """Return an application that takes the peer address of a request from a header."""

    async def wrapped(scope: Scope, receive: Receive, send: Send) -> None:
        for name, value in scope.get("headers", ()):
            if name == PEER.encode():
                scope["client"] = (value.decode(), 50_000)
        await app(scope, receive, send)

    return wrapped
