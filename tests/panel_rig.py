"""A panel on a real controller: a twin whose scans follow the clock, its Modbus server, and browsers."""

from __future__ import annotations

import itertools
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hmi_rig import HmiRig

from controller.core.clock import MonotonicClock
from controller.hmi.history_query import HistoryReader
from controller.hmi.modbus_server import HmiOptions, HmiServer
from controller.hmi.panel.app import Panel, Sources, application
from controller.hmi.panel.line import Line
from controller.hmi.panel.login import Cost, Users
from controller.hmi.panel.telemetry import Telemetry
from controller.io.pace import Pace
from plant_sim.bench.twin import Twin

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it would rather have another HTTP client than httpx
    from starlette.testclient import TestClient, WebSocketTestSession

URL = "http://127.0.0.1:8080"
ORIGIN = {"origin": URL}
HERE, ELSEWHERE = ("127.0.0.1", 50_000), ("192.0.2.7", 50_000)
PASSWORDS = {"operate": "seedling-1", "maintain": "seedling-2"}
CHEAP = Cost(n=2, r=1, p=1)
MOST_MESSAGES = 300
PATIENT_S = 20.0


class Browser:
    """A socket with the view it has been told, as a page keeps it."""

    def __init__(self, socket: WebSocketTestSession) -> None:
        self.socket = socket
        self.view: dict[str, Any] = {}
        self._replies: dict[Any, dict[str, Any]] = {}
        self._number = itertools.count(1)
        self._expected = 0

    def read(self) -> dict[str, Any]:
        """Take one message; views must come without a gap."""
        message: dict[str, Any] = self.socket.receive_json()
        if message["type"] == "reply":
            self._replies[message["id"]] = message
            return message
        assert message["seq"] == self._expected
        assert message["type"] == ("delta" if self._expected else "full")
        self._expected += 1
        apply(self.view, message["view"])
        return message

    def until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Read until a condition on the view holds."""
        for _ in range(MOST_MESSAGES):
            if self.view and condition(self.view):
                return self.view
            self.read()
        raise AssertionError(f"not so after {MOST_MESSAGES} messages: {self.view}")

    def send(self, **order: Any) -> int:
        """Send an order; return its id."""
        number = next(self._number)
        self.socket.send_json({"id": number, **order})
        return number

    def reply(self, id_: Any) -> dict[str, Any]:
        """Read until an order is answered."""
        for _ in range(MOST_MESSAGES):
            if id_ in self._replies:
                return self._replies.pop(id_)
            self.read()
        raise AssertionError(f"no answer to {id_}")

    def order(self, **order: Any) -> dict[str, Any]:
        """Send an order and return its answer."""
        return self.reply(self.send(**order))


def apply(view: dict[str, Any], changes: dict[str, Any]) -> None:
    """Bring a view up to date, as the schema says."""
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
    """A panel at work; scans follow the clock from `__enter__` on."""

    def __init__(
        self,
        folder: Path,
        twin: Twin | None = None,
        *,
        pace: Pace | None = None,
        allow_forcing: bool = False,
        telemetry: Callable[[MonotonicClock], Telemetry] | None = None,
        first_run: bool = False,
    ) -> None:
        self.hmi = HmiRig(twin, pace=pace, allow_forcing=allow_forcing)
        self.twin = self.hmi.twin
        self.users_file = folder / "users.json"
        users = Users(self.users_file, CHEAP)
        if not first_run:
            users.set_first({"operate": PASSWORDS["operate"], "maintain": PASSWORDS["maintain"]})
        self._stack = ExitStack()
        self._stack.enter_context(self.hmi)
        self.port = self.hmi.server.port
        clock = MonotonicClock()
        sources = Sources(
            self.twin.machine,
            lambda: Line("127.0.0.1", self.port),
            None if telemetry is None else telemetry(clock),
            HistoryReader(folder / "history.sqlite"),
            clock,
        )
        self.panel = Panel(sources, users)
        self.app = application(self.panel, ["panel.test"])
        self._scanned = threading.Condition()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._scan, name="scans")

    def __enter__(self) -> Self:
        self._thread.start()
        self._stack.callback(self._end)
        self.here = self._stack.enter_context(self.client(HERE))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()

    def client(self, peer: tuple[str, int]) -> TestClient:
        """A client of a peer; only the one that is entered runs the panel."""
        return TestClient(self.app, base_url=URL, client=peer, headers=ORIGIN)

    def log_in(self, user: str) -> None:
        """Log in on this computer; the sockets opened from then on have the level."""
        answer = self.here.post("/api/login", json={"user": user, "password": PASSWORDS[user]})
        assert answer.status_code == 200, answer.text

    @contextmanager
    def browser(self, user: str | None = None) -> Iterator[Browser]:
        """Open a socket and wait until it shows the controller."""
        if user is not None:
            self.log_in(user)
        with self.here.websocket_connect("/ws", headers=ORIGIN) as socket:
            browser = Browser(socket)
            browser.until(lambda view: bool(view["link"]["controller"]))
            yield browser

    def until(self, condition: Callable[[], bool], *, scans: int = 500) -> int:
        """Wait until a condition holds after a scan; return how many scans that took."""
        with self._scanned:
            for scan in range(scans):
                if condition():
                    return scan
                assert self._scanned.wait(PATIENT_S), "no scan"
        raise AssertionError(f"not so after {scans} scans; {self.twin.situation()}")

    def for_scans(self, scans: int) -> None:
        """Let scans pass."""
        end = self.twin.plc.scans + scans
        self.until(lambda: self.twin.plc.scans >= end, scans=scans + 1)

    def silence(self) -> None:
        """Stop the controller's server; the machine goes on."""
        self.hmi.server.__exit__(None, None, None)

    def answer_again(self) -> None:
        """Serve the controller anew at the same port."""
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
