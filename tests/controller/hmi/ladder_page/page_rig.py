"""Ladder page of a small program whose scans the test executes, served in this process."""

from __future__ import annotations

import socket
import threading
from collections.abc import Collection, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

import httpx
import uvicorn

from controller.cli.ladder.live import _MODBUS_NAMES
from controller.core.clock import MonotonicClock
from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.fx.language.instruction import Ladder
from controller.fx.observation.cross_reference import CrossReference
from controller.hmi.ladder.live import LivePlc
from controller.hmi.ladder_page.application import LadderPage, application
from controller.hmi.ladder_page.live_source import LiveSource
from controller.hmi.ladder_page.program import PageProgram
from controller.hmi.ladder_page.source import PageSource
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.modbus.endpoint import modbus_tcp
from controller.hmi.serving.endpoints import TcpSettings
from controller.hmi.serving.server import DeviceServer
from controller.hmi.web.server import server_config
from tests.controller.common.modbus_rig import PATIENT_S

TIMEOUT_S = 60.0


class WebRig:
    """Server of a ladder page in a thread."""

    def __init__(self, source: PageSource) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.origin = "http://127.0.0.1:{1}".format(*self._socket.getsockname())
        self._server = uvicorn.Server(server_config(application(LadderPage(source), [])))
        self._thread = threading.Thread(target=lambda: self._server.run([self._socket]), name="ladder page")
        self.client = httpx.Client(base_url=self.origin, timeout=TIMEOUT_S)

    def __enter__(self) -> Self:
        self._thread.start()
        while self.get("/api/look", view="end", first=0, count=0).json().get("state") == "starting":
            pass
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.client.close()
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()

    def get(self, path: str, **values: object) -> httpx.Response:
        return self.client.get(path, params={name: str(value) for name, value in values.items()})

    def look(self, view: str = "end", **values: object) -> dict[str, Any]:
        answer = self.get("/api/look", **({"view": view, "first": 0, "count": 100} | values))
        assert answer.status_code == 200, answer.text
        result: dict[str, Any] = answer.json()
        return result


class ModbusRig:
    """Program with a Modbus server; `scan` executes one scan with the given inputs."""

    def __init__(self, text: str | Ladder) -> None:
        self.ladder = read_il(text) if isinstance(text, str) else text
        self.live = LivePlc(FxPlc(self.ladder, input_filter_ms=0))
        self.endpoint = modbus_tcp(self.live, {0: "a", 1: "b", 2: "c"}, TcpSettings("127.0.0.1", 0), _MODBUS_NAMES)
        self._server = DeviceServer([self.endpoint], self.live.writes)
        self.now_ms = 0

    def __enter__(self) -> Self:
        self._server.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._server.__exit__(kind, error, traceback)

    @property
    def port(self) -> int:
        return self.endpoint.port

    def scan(self, *inputs: Sequence[int]) -> None:
        """Execute a scan for each collection of the numbers of the inputs that are on."""
        for on in inputs:
            for number in range(16):
                self.live._levels[number] = number in on
            self.now_ms += 10
            self.live.scan(self.now_ms)


class LadderRig(ModbusRig):
    """Program with its ladder page."""

    def __init__(self, text: str | Ladder) -> None:
        super().__init__(text)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        super().__enter__()
        self.scan((), (), ())
        self.web = WebRig(live_source(self.ladder, self.port))
        self._stack.enter_context(self.web)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()
        super().__exit__(kind, error, traceback)


def live_source(ladder: Ladder, port: int, work: Collection[tuple[str, int]] = ()) -> LiveSource:
    connection = ModbusConnection("127.0.0.1", port, timeout_s=PATIENT_S)
    return LiveSource(PageProgram("program", CrossReference(ladder)), connection, MonotonicClock(), work)
