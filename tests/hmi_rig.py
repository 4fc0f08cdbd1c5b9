"""A twin with the controller's Modbus server: the test lets time pass, clients ask in between."""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count
from types import TracebackType
from typing import Any, Self

from modbus_rig import Client, read_pdu

from controller.hmi.alarm_list import AlarmList
from controller.hmi.fx3u import coil_address, register_address
from controller.hmi.modbus_server import HmiOptions, HmiServer
from controller.hmi.production import ProductionLog
from controller.io.loop import LoopFigures
from controller.io.pace import Pace
from plant_sim.bench.twin import Twin

SERVER_BUSY = 6
READ_D0 = read_pdu(3, 0, 1)
MOST_ASKED = 5_000


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
    """Let the server's thread get on with what is under way; each question is one round of its loop."""
    for asked in count():
        done = condition()
        bystander.ask(READ_D0)  # once more when done: its thread may be in the middle of it
        if done:
            return
        assert asked < MOST_ASKED, "the server has not done it"


class HmiRig:
    """A twin that is served; `audits` holds what was written and by whom."""

    def __init__(
        self,
        twin: Twin | None = None,
        options: HmiOptions | None = None,
        *,
        pace: Pace | None = None,
        allow_forcing: bool = False,
    ) -> None:
        self.twin = twin or Twin()
        runtime = self.twin.runtime
        runtime.forcing.allowed = allow_forcing
        self.audits: list[tuple[str, ...]] = []
        self.changes: list[Any] = []
        machine = self.twin.machine
        self.alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, self.changes.append)
        runtime.observers.append(self.alarms)
        self.figures = LoopFigures()
        self.server = HmiServer(
            runtime, self.alarms, options or HmiOptions(port=0), figures=self.figures, pace=pace,
            audit=lambda *row: self.audits.append(row), version="1.2.3",
        )  # fmt: skip
        runtime.observers.append(ProductionLog(machine, self.server.cycles.take))
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
        """How many clients the server has."""
        return len(self.server._frontend.connections)

    def coil(self, output: str) -> bool:
        """Whether an output is on at the terminals."""
        return output in self.twin.outputs()
