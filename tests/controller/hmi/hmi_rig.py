"""Twin with the Modbus server of the controller: the test advances time, and clients send requests between scans."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from contextlib import ExitStack, suppress
from itertools import count
from types import TracebackType
from typing import Any, Self

from controller.common.connections import ConnectionServer
from controller.events.alarm_list import AlarmList
from controller.events.production import ProductionLog
from controller.hmi.access.server import FurtherEndpoints, HmiServer
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.modbus.fx3u_map import coil_address, register_address
from controller.io.loop import LoopFigures
from controller.io.pace import Pace
from controller.io.scan_writes import ScanWrite
from plant_sim.twin.lock_step import Twin
from tests.controller.common.modbus_rig import Client, read_pdu

SERVER_BUSY = 6
READ_D0 = read_pdu(3, 0, 1)
MAX_REQUESTS = 5_000
IDLE_S = 30.0
"""Idle timeout of a server whose connections a test ages: not that of a server by default."""


def read_words(client: Client, kind: str, number: int, words: int = 1) -> tuple[int, ...]:
    answer = client.ask(read_pdu(3, register_address(kind, number), words))
    assert answer[0] == 3, answer
    return struct.unpack(f">{words}H", answer[2:])


def read_long(client: Client, kind: str, number: int) -> int:
    low, high = read_words(client, kind, number, 2)
    return low | high << 16


def write_words(client: Client, kind: str, number: int, *values: int) -> bytes:
    body = struct.pack(
        f">BHHB{len(values)}H", 16, register_address(kind, number), len(values), 2 * len(values), *values
    )
    return client.ask(body)


def write_word(client: Client, kind: str, number: int, value: int) -> bytes:
    return client.ask(struct.pack(">BHH", 6, register_address(kind, number), value))


def written(answer: bytes) -> bool:
    return answer[0] < 0x80


def until(condition: Callable[[], bool], bystander: Client) -> None:
    """Wait until a condition holds; each request of `bystander` makes the event loop of the server run once."""
    for requests in count():
        done = condition()
        bystander.ask(READ_D0)  # also after success: the thread may still be in this iteration
        if done:
            return
        assert requests < MAX_REQUESTS, "condition not met"


def let_pass(server: ConnectionServer, seconds: float) -> None:
    """Age the connections of a server by a number of seconds, and run their timeout checks, before its next request."""

    def age() -> None:
        for connection in tuple(server.connections):
            connection._last_request_s -= seconds
            connection._check_idle()

    next(iter(server.connections))._loop.call_soon_threadsafe(age)


def scan_for_writes(rig: HmiRig) -> None:
    """Let every write that is submitted in the server thread be followed by a scan in this thread."""
    writes = rig.twin.runtime.writes
    submit = writes.submit

    def scan() -> None:
        if rig.scans_for_writes and writes.are_waiting:
            rig.twin.scan()

    def submit_and_scan(action: Callable[[], None]) -> ScanWrite:
        write = submit(action)
        with suppress(RuntimeError):  # the test uses a session itself, and executes the scan
            asyncio.get_running_loop().call_soon(scan)
        return write

    writes.submit = submit_and_scan  # type: ignore[method-assign]


class HmiRig:
    """Twin with a Modbus server; `audits` contains the audit rows.

    While a client waits for the answer to a write, the server thread executes the scan that takes it, unless
    `scans_for_writes` is false.
    """

    def __init__(
        self,
        twin: Twin | None = None,
        options: HmiOptions | None = None,
        *,
        pace: Pace | None = None,
        allow_forcing: bool = False,
        further: FurtherEndpoints = lambda _source: (),
    ) -> None:
        self.twin = twin or Twin()
        runtime = self.twin.runtime
        self.scans_for_writes = True
        scan_for_writes(self)
        runtime.forcing.allowed = allow_forcing
        self.audits: list[tuple[str, ...]] = []
        self.changes: list[Any] = []
        machine = self.twin.machine
        self.alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, self.changes.append)
        runtime.observers.append(self.alarms)
        self.figures = LoopFigures()
        self.server = HmiServer(
            runtime,
            self.alarms,
            options or HmiOptions(port=0),
            figures=self.figures,
            pace=pace,
            audit=lambda *row: self.audits.append(row),
            version="1.2.3",
            further=further,
        )
        runtime.observers.append(ProductionLog(machine, self.server.cycles.record))
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self._stack.enter_context(self.server)
        self.twin.scan()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()

    def client(self) -> Client:
        return self._stack.enter_context(Client(self.server.port))

    def press(self, client: Client, command: str, level: bool = True) -> bytes:
        bit = self.twin.machine.tags.commands[command]
        return client.ask(struct.pack(">BHH", 5, coil_address("M", bit.number), 0xFF00 if level else 0))

    @property
    def connections(self) -> int:
        """Number of connected clients."""
        return self.server.connections

    def coil(self, output: str) -> bool:
        """Return whether an output is on at the terminals."""
        return output in self.twin.outputs()
