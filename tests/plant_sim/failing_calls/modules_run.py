"""Run of a controller whose field I/O is a device with TLS and one on a serial line, in simulated time.

Each device has half of the inputs and half of the outputs. The machine begins to home, so that outputs are on. In one
of two runs both devices are disconnected meanwhile.
"""

from __future__ import annotations

import logging
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import pytest

from controller.io.link import LinkError
from controller.program.states import State
from tests.controller.io.field.field_rig import (
    INPUT_TAGS,
    OUTPUT_TAGS,
    FieldRig,
    at_rest,
    device,
    file_of,
    wires,
)
from tests.controller.io.field.modules import Box
from tests.controller.io.field.servers import SerialModules, TcpModule
from tests.controller.io.field.test_tls import Security, tls_way
from tests.plant_sim.failing_calls.calls import Calls, Fault

LINE: Final = "field line"
CONNECTION: Final = "MainThread"
BEFORE: Final = 60
"""Scans in which a call can fail."""
AFTER: Final = 60
"""Scans after them: a device that is lost is connected again within 0.5 s."""
UNPLUGGED: Final = 10
PLUGGED: Final = 28
"""Scans in which the devices are disconnected, and connected again."""
TIMEOUT_MS: Final = 1_000
"""Timeout of an answer, ms; a short answer is waited for so long."""


@dataclass
class ModulesOutcome:
    """Course of a run.

    Attributes:
        calls: Calls of the run.
        told: Messages: events of the devices, and the error of a start.
        is_started: True if the machine was put to work.
        on_while_aborted: Outputs of the devices that are on 100 ms after an abort, and while they are connected.
        state: State at the end.
        is_connected: True if every device is connected at the end.
        trouble: Exceptions that no part of the product has handled.
    """

    calls: Calls
    told: list[str] = field(default_factory=list)
    is_started: bool = False
    on_while_aborted: list[str] = field(default_factory=list)
    state: State | None = None
    is_connected: bool = False
    trouble: list[str] = field(default_factory=list)


class ModulesRun:
    """One run, with at most one fault.

    Args:
        folder: Folder of the files.
        fault: Fault of one call; None = none.
        unplugged: True if the devices are disconnected meanwhile.
    """

    def __init__(self, folder: Path, fault: Fault | None = None, *, unplugged: bool = False) -> None:
        self._folder, self._unplugged = folder, unplugged
        self.outcome = ModulesOutcome(Calls(folder / "var", fault))
        self._boxes = [Box(), Box()]

    def run(self, monkeypatch: pytest.MonkeyPatch) -> ModulesOutcome:
        """Run the controller, and disconnect its devices in the end."""
        outcome = self.outcome
        with ExitStack() as stack:
            patch = stack.enter_context(monkeypatch.context())
            security = Security(self._folder)
            secured = stack.enter_context(TcpModule(self._boxes[0], security.wrap))
            serial = stack.enter_context(SerialModules(str(self._folder / "tty"), {1: self._boxes[1]}))
            self._name_line(serial)
            rig = self._rig(secured.port, serial.path)
            outcome.calls.watch(patch)
            try:
                self._work(rig, (secured, serial))
            except Exception as error:
                logging.getLogger(__name__).debug("not handled", exc_info=True)
                outcome.trouble.append(repr(error))
            outcome.state = State(rig.state) if outcome.is_started else None
            outcome.is_connected = all(each.is_open for each in rig.link.devices)
            outcome.told += [f"{event.change} {event.device} {event.detail}" for event in rig.events]
            try:
                rig.link.close()
            except OSError as error:
                outcome.trouble.append(repr(error))
        return outcome

    def _rig(self, port: int, path: str) -> FieldRig:
        tags = [wires_of(INPUT_TAGS[n::2], OUTPUT_TAGS[n::2]) for n in range(2)]
        for n, box in enumerate(self._boxes):
            at_rest(box, INPUT_TAGS[n::2])
        way = tls_way(port, "server_name: io.farm.example")
        file = file_of(
            self._folder,
            device("cabinet", "coils", way, tags[0], timeout_ms=TIMEOUT_MS),
            device("bus-box", "coils", "line: bus", tags[1], "unit: 1", timeout_ms=TIMEOUT_MS),
            lines=f"lines:\n  - {{name: bus, device: {path}, baud: 115200, frame: 8N1}}\n",
        )
        return FieldRig(file, [])

    def _name_line(self, serial: SerialModules) -> None:
        self.outcome.calls.lines[str(Path(serial.path).resolve())] = LINE

    def _unplug(self, servers: tuple[TcpModule, SerialModules]) -> None:
        """Disconnect the devices; what their servers close is not watched."""
        lines = self.outcome.calls.lines
        named = dict(lines)
        lines.clear()
        for server in servers:
            server.unplug()
        lines.update(named)

    def _work(self, rig: FieldRig, servers: tuple[TcpModule, SerialModules]) -> None:
        outcome = self.outcome
        try:
            rig.start()
        except LinkError as error:  # the command tells it and ends, or tries again
            outcome.told.append(str(error))
            return
        rig.order("reset")
        outcome.is_started = True
        for scan in range(BEFORE + AFTER):
            if self._unplugged and scan == UNPLUGGED:
                self._unplug(servers)
            elif self._unplugged and scan == PLUGGED:
                for server in servers:
                    server.plug()
                self._name_line(servers[1])
            rig.scan()
            outcome.calls.at += 1
        if rig.is_aborted:
            outcome.on_while_aborted = [f"{n}" for n, box in enumerate(self._boxes) if any(box.outputs)]


def wires_of(inputs: list[str], outputs: list[str]) -> str:
    """Return the wires of a device with inputs and outputs at consecutive offsets."""
    return wires(inputs)[:-1] + ", " + wires(outputs)[1:]
