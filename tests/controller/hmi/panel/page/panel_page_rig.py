"""Complete setup for browser tests: plant over Modbus, controller, and the panel as a process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import pytest

from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.events.alarm_list import AlarmList
from controller.events.cycle_edges import CycleEdges
from controller.events.kinds import Event
from controller.events.production import ProductionLog
from controller.history.writer import HistoryWriter
from controller.hmi.access.server import HmiServer
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.panel.orders.login import Cost, Users
from controller.io.loop import LoopFigures, run_simulated_time
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.pace import FLAT_OUT, REAL_TIME, Pace
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.io.scan_writes import NO_SCAN_LIMIT_S, ScanWrite
from controller.program.states import State
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.links.tag_file import tag_csv
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import program_of, set_points_of
from tests.controller.common.modbus_rig import IO_MAP, MACHINE

SCAN_MS = 10
TIMEOUT_S = 60.0
SLOWER = 3
"""Factor by which simulated time is slowed in tests that hold a jog button; the panel's jog lease is lengthened
accordingly.
"""
PATIENCE = 12
"""Factor by which limits are lengthened, because a busy computer may take seconds: the wait of a write for a scan, and
in tests of anything else also the ages from which panel and page regard values as outdated, and the panel's time limit
of an answer.
"""
PASSWORDS = {"operate": "turn the soil", "maintain": "mend the claws"}
CHEAP = Cost(n=2, r=1, p=1)


class LiveMachine:
    """Plant and controller in simulated time, in separate threads.

    Attributes:
        levels: Time of each scan, ms, and tags of the outputs that were on at the terminals.
    """

    def __init__(self, folder: Path, *, trays: int = 1, seed: int = 1) -> None:
        plant = Plant(IO_MAP, MACHINE, seed=seed, trays=trays)
        self.plant = ServerThread(PlantServer(IoModule(plant, IO_MAP), port=0, lock_step_ms=SCAN_MS))
        self.machine = program_of(IO_MAP)
        self.pace = Pace(REAL_TIME)
        self.levels: list[tuple[int, frozenset[str]]] = []
        self._folder = folder
        self._trays = trays
        self._scanned = threading.Condition()
        self._stop = threading.Event()
        self._cups_stop_in: State | None = None
        self._stack = ExitStack()
        self.port = 0

    def __enter__(self) -> Self:
        patch = self._stack.enter_context(pytest.MonkeyPatch.context())
        patch.setattr(ScanWrite, "limit_s", PATIENCE * NO_SCAN_LIMIT_S)
        self._stack.enter_context(self.plant)
        self.plant_port = self.plant.server.port
        self.runtime = self._runtime()
        self.history = HistoryWriter(
            self._folder / "history.sqlite",
            wall_ms=lambda: 1_790_000_000_000,
            program="transplanter",
            version="0",
            edges_of=self._edges.of,
        )
        self._stack.callback(self.history.close)
        figures = LoopFigures()
        machine = self.machine
        alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, self.history.write)
        server = HmiServer(self.runtime, alarms, HmiOptions(port=0), figures=figures, pace=self.pace, audit=self._audit)

        def report(event: Event) -> None:
            server.cycles.record(event)
            self.history.write(event)

        self.runtime.observers[:0] = [self._edges, alarms, ProductionLog(machine, report), self._record]
        self._stack.enter_context(server)
        self.port = server.port
        self._thread = threading.Thread(
            target=run_simulated_time,
            args=(self.runtime, self.pace),
            kwargs={"scan_ms": SCAN_MS, "stop": self._stop, "figures": figures},
            name="scans",
        )
        self._stack.callback(self._end)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def state(self) -> State:
        return State(self.runtime.plc.memory.D[self.machine.tags.machine.state.number])

    def fast(self) -> None:
        self.pace.set(FLAT_OUT)

    def slow(self) -> None:
        """Slow simulated time down so that a browser on a busy computer renews a jog lease before it expires."""
        self.pace.set(REAL_TIME // SLOWER)

    def until(self, condition: Callable[[], bool], description: str, within_s: float = TIMEOUT_S) -> None:
        """Wait until a condition holds after a scan."""
        with self._scanned:
            assert self._scanned.wait_for(condition, within_s), (
                f"{description} not within {within_s} s, in {self.state.name}"
            )

    def until_state(self, state: State) -> None:
        self.until(lambda: self.state == state, state.name)

    def on(self, output: str) -> bool:
        """Return whether an output was on at the terminals after the last scan."""
        return bool(self.levels) and output in self.levels[-1][1]

    @property
    def now_ms(self) -> int:
        return self.levels[-1][0] if self.levels else 0

    def last_on_ms(self, output: str) -> int:
        """Return the time of the last scan with an output on, ms."""
        return max(at_ms for at_ms, outputs in self.levels if output in outputs)

    def counts(self) -> SeedlingCounts:
        return self.plant.call(self.plant.server.module.plant.counts)

    def _runtime(self) -> Runtime:
        self._edges = CycleEdges(self.machine)
        plc = Plc(self.machine.program)
        for name, value in (set_points_of(MACHINE) | {"trays_target": self._trays}).items():
            plc.write(getattr(self.machine.tags.sp, name), value)
        link = ModbusTcpLink("127.0.0.1", self.plant_port, IO_MAP, timeout_s=5.0)
        self._stack.callback(link.close)
        return Runtime(
            self.machine,
            plc,
            link,
            DirectRetentiveWriter(MemoryStore()),
            link_limit_ms=60_000,
            scan_limit_ms=60_000,
            allow_forcing=True,
        )

    def stop_cups_in(self, state: State) -> None:
        """Stop the cups in the scan in which the machine enters a state, so that what they contain can be compared."""
        self._cups_stop_in = state

    def _stop_cups(self) -> None:
        self.plant.server.module.plant.planting_frequency_per_min = 0.0

    def _record(self, now_ms: int, _: Plc) -> None:
        if self.state is self._cups_stop_in:
            self._cups_stop_in = None
            self.plant.call(self._stop_cups)
        released = self.runtime.released
        on = frozenset(point.tag for point in IO_MAP.outputs if point.active(released[point.number]))
        with self._scanned:
            self.levels.append((now_ms, on))
            self._scanned.notify_all()

    def _audit(self, peer: str, who: str, what: str, value: str, result: str) -> None:
        self.history.audit(peer, who, what, value, result, self.now_ms)

    def _end(self) -> None:
        self._stop.set()
        self._thread.join()


PATIENT_PANEL = f"""
import sys
from controller.cli.main import main
from controller.hmi.modbus import connection
from controller.hmi.panel.modbus import mirror
mirror.STALE_MS *= {PATIENCE}
connection.ModbusConnection.__init__.__kwdefaults__["timeout_s"] *= {PATIENCE}
sys.exit(main(sys.argv[1:]))
"""
SLOW_PANEL = f"""
from controller.hmi.panel.orders import jog
jog.LEASE_MS *= {SLOWER}
{PATIENT_PANEL}"""


class PanelProcess:
    """Panel in a separate process.

    Args:
        first_run: Whether no passwords have been set.
        patient: Whether the panel waits longer for answers, and before it regards values as outdated.
        slow: Whether it is patient, and its jog lease is lengthened for a machine that `LiveMachine.slow` has slowed
            down.
        options: Further options of the command line.
    """

    def __init__(
        self,
        live: LiveMachine,
        folder: Path,
        *options: str,
        first_run: bool = False,
        patient: bool = False,
        slow: bool = False,
    ) -> None:
        users = folder / "users.json"
        if not first_run and not users.exists():
            Users(users, CHEAP).set_first({"operate": PASSWORDS["operate"], "maintain": PASSWORDS["maintain"]})
        tags = folder / "tags.csv"
        tags.write_text(tag_csv(), encoding="utf-8")
        self._arguments = [
            sys.executable,
            *(["-c", SLOW_PANEL if slow else PATIENT_PANEL] if slow or patient else ["-m", "controller"]),
            "panel",
            "--controller",
            f"127.0.0.1:{live.port}",
            "--telemetry",
            f"127.0.0.1:{live.plant_port}",
            "--telemetry-tags",
            str(tags),
            "--history",
            str(folder / "history.sqlite"),
            "--trends",
            str(folder / "trends.sqlite"),
            "--users",
            str(users),
            *options,
        ]

    def __enter__(self) -> Self:
        self._start(port=0)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._end()

    @contextmanager
    def restarted(self) -> Iterator[None]:
        """Stop the panel during the block; start it again on the same port at the end."""
        self._end()
        try:
            yield
        finally:
            self._start(port=urlsplit(self.url).port or 0)

    def send(self, number: int) -> None:
        if self.process.poll() is None:
            os.kill(self.process.pid, number)

    def _start(self, port: int) -> None:
        self.process = subprocess.Popen([*self._arguments, "--port", str(port)], stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line.startswith("panel at "), line
        self.url = line.removeprefix("panel at ").strip()

    def _end(self) -> None:
        self.send(signal.SIGCONT)
        self.process.terminate()
        try:
            self.process.wait(TIMEOUT_S)
        finally:
            self.process.kill()
            self.process.wait()
            if self.process.stdout is not None:
                self.process.stdout.close()
