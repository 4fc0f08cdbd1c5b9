"""Connections of the panel: slots, unfinished requests, and browsers without a login in front of those with one."""

from __future__ import annotations

import asyncio
import select
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest
from starlette.types import Message, Receive, Scope, Send
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection

from controller.common.client_slots import Quota
from controller.core.clock import SimulatedClock
from controller.hmi.panel.web import answers
from controller.hmi.panel.web.listener import BURST, Attendance, PanelListener
from controller.hmi.panel.web.sockets import QUOTA, TOO_MANY
from tests.controller.hmi.panel.panel_rig import PASSWORDS, Browser, PanelRig
from tests.real_time import WAIT_S

FEW = Quota(most=12, reserved=4, of_address=8)
HALF_OPEN = b"GET /api/me HTTP/1.1\r\nHost: "
SHORT_MS = 200


@contextmanager
def connections(rig: PanelRig, count: int, sent: bytes = HALF_OPEN) -> Iterator[list[socket.socket]]:
    host, _, port = rig.host.rpartition(":")
    with ExitStack() as stack:
        opened = []
        for _ in range(count):
            opened.append(stack.enter_context(socket.create_connection((host, int(port)), WAIT_S)))
            opened[-1].sendall(sent)
        yield opened


def ends(connection: socket.socket) -> bytes:
    """Return what a connection receives until it ends."""
    received = b""
    try:
        while data := connection.recv(4_096):
            received += data
    except ConnectionError:
        pass
    return received


def close_code(connection: ClientConnection) -> int | None:
    with suppress(ConnectionClosed):
        for _ in range(300):
            connection.recv(timeout=WAIT_S)
    return connection.close_code


def test_half_open_requests_displace_each_other_and_not_a_browser(tmp_path: Path) -> None:
    with PanelRig(tmp_path, quota=FEW) as rig, rig.browser() as browser, connections(rig, 40) as half_open:
        assert ends(half_open[0]) == b""
        assert rig.client().get("/api/me").status_code == 200
        assert rig.panel.listener is not None
        assert len(rig.panel.listener.slots.taken) <= FEW.most - FEW.reserved
        assert browser.order(type="jog", output="left.lift_extend", hold=False)["ok"]


def test_connections_of_users_are_not_displaced_and_fill_all_slots(tmp_path: Path) -> None:
    with PanelRig(tmp_path, quota=Quota(most=3, reserved=1, of_address=2)) as rig, ExitStack() as stack:
        rig.log_in("maintain")
        users = [Browser(stack.enter_context(rig.socket())) for _ in range(2)]
        rig.here.get("/api/me")
        with connections(rig, 2, f"GET /api/me HTTP/1.1\r\nHost: {rig.host}\r\n\r\n".encode()) as refused:
            assert [ends(connection) for connection in refused] == [b"", b""]
        for user in users:
            assert user.order(type="jog", output="left.lift_extend", hold=False)["ok"]


def test_the_listener_pauses_between_the_connections_that_it_displaces() -> None:
    """Waiting connections are accepted in bursts, between which the event loop is not asked about them."""
    waiting = 40

    async def accepted(listening: PanelListener, stack: ExitStack) -> list[int]:
        counts: list[int] = []
        while sum(counts) < waiting and len(counts) < waiting:
            readable = asyncio.Event()
            loop = asyncio.get_running_loop()
            loop.add_reader(listening.fileno(), readable.set)
            async with asyncio.timeout(WAIT_S):
                await readable.wait()
            loop.remove_reader(listening.fileno())
            counts.append(0)
            while select.select([listening], [], [], 0)[0]:
                with suppress(BlockingIOError):
                    stack.enter_context(listening.accept()[0])
                    counts[-1] += 1
        return counts

    with ExitStack() as stack:
        listening = PanelListener(socket.create_server(("127.0.0.1", 0), backlog=waiting), SimulatedClock(), FEW)
        stack.enter_context(listening)
        for _ in range(waiting):
            stack.enter_context(socket.create_connection(listening.getsockname(), WAIT_S))
        counts = asyncio.run(accepted(listening, stack))
    assert sum(counts) == waiting
    assert counts[0] <= FEW.of_address + BURST
    assert max(counts[1:]) <= BURST


class Answering:
    """Application that answers one request as it is told, with a listener that has one connection."""

    def __init__(self, stack: ExitStack) -> None:
        self.clock = SimulatedClock()
        self.listener = PanelListener(socket.create_server(("127.0.0.1", 0)), self.clock, FEW, SHORT_MS)
        stack.enter_context(self.listener)
        address = self.listener.getsockname()
        self.client = stack.enter_context(socket.create_connection(address, WAIT_S))
        accepted, self.peer = self.listener.accept()
        self.accepted = stack.enter_context(accepted)
        slot = self.listener.slot_of(self.peer)
        assert slot is not None
        self.slot = slot
        self.activity_ms: list[int] = []

    async def app(self, _: Scope, receive: Receive, send: Send) -> None:
        """Receive, answer and end, each after 1 s."""
        for step in (receive, lambda: send({"type": "http.response.body"})):
            self.clock.advance(1_000)
            self.listener.look()
            self.activity_ms.append(self.slot.active_ms)
            await step()
        self.activity_ms.append(self.slot.active_ms)
        self.clock.advance(1_000)

    async def answer(self) -> None:
        """Answer one request."""

        async def receive() -> Message:
            return {"type": "http.request"}

        async def send(_: Message) -> None:
            pass

        scope = {"type": "http", "client": self.peer, "headers": []}
        await Attendance(self.app, self.listener, lambda _: False)(scope, receive, send)


def test_a_request_that_is_answered_slowly_keeps_its_connection() -> None:
    with ExitStack() as stack:
        rig = Answering(stack)
        asyncio.run(rig.answer())
        assert rig.activity_ms == [0, 1_000, 2_000]
        assert (rig.slot.active_ms, rig.slot.running, rig.slot.has_asked) == (3_000, 0, True)
        rig.accepted.sendall(b"still open")
        assert rig.client.recv(99) == b"still open"
        rig.clock.advance(SHORT_MS)
        rig.listener.look()
        assert ends(rig.client) == b""


@pytest.mark.parametrize("sent", [b"", HALF_OPEN, b"GET /api/me HTTP/1.1\r\nHost: x\r\n\r\nGET /"])
def test_a_request_that_does_not_arrive_in_time_ends_its_connection(tmp_path: Path, sent: bytes) -> None:
    with PanelRig(tmp_path, request_ms=SHORT_MS) as rig, connections(rig, 1, sent) as (connection,):
        answer = ends(connection)
        assert answer.startswith(b"HTTP/1.1 403 " if sent.endswith(b"GET /") else b"")
        assert answer or not sent.endswith(b"GET /")


def test_a_socket_that_only_watches_is_not_closed(tmp_path: Path) -> None:
    with PanelRig(tmp_path, request_ms=SHORT_MS) as rig, rig.browser() as browser:
        for _ in range(15):
            browser.read()
        assert browser.order(type="jog", output="left.lift_extend", hold=False)["ok"]


def test_a_body_that_does_not_arrive_in_time_is_refused_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(answers, "BODY_S", 0.1)
    with PanelRig(tmp_path, request_ms=SHORT_MS) as rig:
        head = f"POST /api/login HTTP/1.1\r\nHost: {rig.host}\r\nOrigin: {rig.origin}\r\nContent-Length: 99\r\n\r\n{{"
        with connections(rig, 1, head.encode()) as (connection,):
            answer = ends(connection)
    assert answer.startswith(b"HTTP/1.1 408 ")
    assert b"did not arrive completely within" in answer


def test_sockets_without_a_login_neither_lock_out_a_user_nor_keep_a_browser_out(tmp_path: Path) -> None:
    with PanelRig(tmp_path) as rig, ExitStack() as stack:
        guests = [stack.enter_context(rig.socket()) for _ in range(QUOTA.most)]
        assert close_code(guests[0]) == TOO_MANY
        maintainer = rig.client("192.0.2.7")
        login = {"user": "maintain", "password": PASSWORDS["maintain"]}
        assert maintainer.post("/api/login", json=login).status_code == 200
        for _ in range(QUOTA.reserved):
            user = Browser(stack.enter_context(rig.socket(maintainer)))
            assert user.until(lambda view: bool(view["link"]["controller"]))["me"] == {"level": "maintain"}
        assert f"panel_clients {QUOTA.most}.0\n" in rig.here.get("/metrics").text, "a user takes no slot of a guest"
        stack.enter_context(rig.socket(maintainer))
        assert close_code(guests[QUOTA.most - QUOTA.reserved]) == TOO_MANY
        Browser(guests[-1]).until(lambda view: bool(view["link"]["controller"]))
