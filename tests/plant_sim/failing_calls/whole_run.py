"""Run of 30 s of a running controller with plant, retentive memory, history, capture, events, trends and clients.

The controller is the delivered command ``run`` in simulated time; the plant is its Modbus server in lock step. Both run
in this process, so that any of their calls can fail.
"""

from __future__ import annotations

import io
import logging
import socket
import sqlite3
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import pytest

from controller.cli.main import main
from controller.common.capture import Capture, read_capture
from controller.common.stop_request import StopRequest
from controller.common.supervision import failures
from controller.core.retentive_store import FileStore
from controller.core.scan import Plc
from controller.events.writer import EventWriter
from controller.history.file import HistoryFile, HistoryRow
from controller.history.schema import TABLES
from controller.history.writer import HistoryWriter
from controller.hmi.modbus.fx3u_map import register_address
from controller.io.loop import run_simulated_time
from controller.io.retentive_writer import ThreadedRetentiveWriter, writer_until_end
from controller.io.runtime import Runtime
from controller.io.scan_writes import ScanWrite, ScanWrites
from controller.program.states import State
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.links.telemetry import TELEMETRY_REGISTERS
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import constants_file, default_io_map
from tests.plant_sim.failing_calls.calls import Calls, Fault, WatchedFile
from tests.plant_sim.failing_calls.panel import PATIENT_S, Panel, PanelTrends, periods_of, shorten_periods
from tests.retained import retained

SCAN_MS: Final = 20
SECOND: Final = 1_000 // SCAN_MS
ANSWERED: Final = 2
"""Scans from the request of a write to its answer: the next one takes it, and answers it after its observers."""
FIRST_RUN: Final = SECOND // 2
"""Scans of a first run, which creates the files."""
SECONDS: Final = 30
"""Machine time of the run after it, which finds the files, s."""
PRESSES: Final = {
    SECOND: ("start", True),
    SECOND + 10: ("start", False),
    12 * SECOND: ("start", True),
    12 * SECOND + 10: ("start", False),
}
"""Homing, and the start of the machine, which moves in the middle of the run."""
VISITS: Final = (4 * SECOND, 16 * SECOND, 28 * SECOND)
"""Scans in which a second client connects, reads and disconnects."""
SAMPLED: Final = SECOND // 5
WRITTEN: Final = 4 * SECOND
"""Scans between two samples of the trends, and between two writes of their file."""


@dataclass
class Told:
    """Messages of a run.

    Attributes:
        lines: Lines on standard error and in the log.
        events: Lines of events.
        clients: Errors that clients noticed.
        counts: Increase of the counts of failures and of lost items.
    """

    lines: list[str] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    clients: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)


@dataclass
class Outcome:
    """Course of a run.

    Attributes:
        calls: Calls of the run.
        exit_codes: Exit codes of the controller in its two runs; an exception has none.
        told: Messages.
        scans: Number of scans of the last run.
        ends: Scan after the last one of each run, counted over both: its connections are being closed.
        outputs_on: Outputs of the plant that are on after the end of the controller.
        unsafe: Outputs of the plant that are on 100 ms after an abort, lamps excepted.
        writes: Values of a set-point other than those of the writes that can be in effect.
        saved: Retentive values stored last, and those of a save that failed after it.
        retained: Retentive values after a restart; None if there are none.
        stored: Rows that the history reported as stored.
        submitted: Number of rows submitted to the history.
        rows: Rows of the history after a restart.
        events_submitted: Number of events.
        captures: Captures of the runs, None for an empty file; a run that could not create its file has none.
        periods_stored: Periods of the trends that their file reported as stored.
        periods: Periods in the file after a restart.
        final: PackML state at the end.
        trouble: Exceptions that no part of the product has handled.
    """

    calls: Calls
    exit_codes: list[int] = field(default_factory=list)
    told: Told = field(default_factory=Told)
    scans: int = 0
    ends: list[int] = field(default_factory=list)
    outputs_on: list[str] = field(default_factory=list)
    unsafe: list[str] = field(default_factory=list)
    writes: list[str] = field(default_factory=list)
    saved: list[dict[str, int]] = field(default_factory=list)
    retained: dict[str, int] | None = None
    stored: list[HistoryRow] = field(default_factory=list)
    submitted: int = 0
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    events_submitted: int = 0
    captures: list[Capture | None] = field(default_factory=list)
    periods_stored: Counter[int] = field(default_factory=Counter)
    periods: Counter[int] = field(default_factory=Counter)
    final: State | None = None
    trouble: list[str] = field(default_factory=list)


class WholeRun:
    """One run of the run, with at most one fault.

    Args:
        folder: Folder of the files.
        fault: Fault of one call; None = none.
        threaded: Whether a thread writes the retentive memory, as in real time; a scan waits for it.
        seconds: Machine time of the second run, s.
    """

    def __init__(
        self, folder: Path, fault: Fault | None = None, *, threaded: bool = False, seconds: int = SECONDS
    ) -> None:
        self.folder, self._threaded, self._scans = folder, threaded, seconds * SECOND
        self._writer: ThreadedRetentiveWriter | None = None
        self.outcome = Outcome(Calls(folder, fault))
        self._events = folder.parent / "events.txt"
        self._captures = [folder / f"capture-{number}" for number in range(2)]
        self._runtime: Runtime | None = None
        self._values = {0}
        self._aborted = 0
        self._signals = {f"Y{point.number:o}" for point in default_io_map().outputs if "lamp" in point.tag}
        self._writing: tuple[int, int, Future[Any]] | None = None
        self._waiting = threading.Condition()
        self._committed = threading.Condition()
        self._commits = 0

    def run(self, monkeypatch: pytest.MonkeyPatch) -> Outcome:
        """Run controller and plant, then read what they have stored."""
        outcome, calls = self.outcome, self.outcome.calls
        constants = self.folder.parent / "constants.yaml"
        constants.write_text(constants_file(load_machine()), encoding="utf-8")
        before = {**failures.failures(), **{name: failures.dropped(name) for name in failures.ITEMS}}
        interval = sys.getswitchinterval()
        lines = io.StringIO()
        with monkeypatch.context() as patch, ExitStack() as stack:
            self._capture(patch, stack, lines)
            self._record(patch)
            hmi_port = _free_port()
            calls.watch(patch)
            self._module = IoModule(Plant(default_io_map(), load_machine(), seed=1, trays=2), default_io_map())
            stack.enter_context(self._plant_failure_told(lines))
            server = stack.enter_context(ServerThread(PlantServer(self._module, port=0, lock_step_ms=SCAN_MS)))
            self._plant, port = server, server.server.port
            calls.ports.update({hmi_port: "panel", port: "telemetry"})
            self._panel = stack.enter_context(Panel(hmi_port, port, outcome.told.clients))
            options = f"--port {port} --events json --no-console --simulated-time"
            options += (
                f" --pace 65535 --timeout-ms 1000 --hmi-port {hmi_port} --constants {constants} --scan-ms {SCAN_MS}"
            )
            for capture, scans in zip(self._captures, (FIRST_RUN, self._scans), strict=True):
                files = ["--capture", str(capture), *retained(self.folder / "retentive.json")]
                self._control([*options.split(), *files], scans)
            outcome.outputs_on = server.call(self._outputs_on)
        sys.setswitchinterval(interval)
        outcome.told.lines += [line for line in lines.getvalue().splitlines() if line]
        after = {**failures.failures(), **{name: failures.dropped(name) for name in failures.ITEMS}}
        outcome.told.counts = {
            name: count - before.get(name, 0) for name, count in after.items() if count > before.get(name, 0)
        }
        self._restart()
        return outcome

    def _control(self, options: Sequence[str], scans: int) -> None:
        """Run the controller for a number of scans."""
        outcome = self.outcome
        self._left, outcome.scans = scans, 0
        path = self.folder / "trends.sqlite"
        with ExitStack() as stack:
            self._trends = PanelTrends(path, outcome.periods_stored, outcome.calls.at * SCAN_MS)
            stack.callback(lambda: self._panel.finish(self._trends.trends.close()))
            self._stop = stack.enter_context(StopRequest())
            events = stack.enter_context(self._events.open("a+", encoding="utf-8"))
            patch = stack.enter_context(pytest.MonkeyPatch.context())
            patch.setattr(sys, "stdout", WatchedFile(outcome.calls, "events", events))
            try:
                outcome.exit_codes.append(main(["run", *options], self._stop))
            except Exception as error:  # noqa: BLE001 - judged
                outcome.trouble.append(repr(error))
        if not (self.folder / "history.sqlite").exists():  # a refused start removes the files that it has created
            outcome.stored.clear()
            outcome.submitted = 0
        outcome.ends.append(outcome.calls.at)
        outcome.calls.at += 1

    @contextmanager
    def _plant_failure_told(self, lines: io.StringIO) -> Iterator[None]:
        """Tell an exception with which the server of the plant ends, as its process does."""
        try:
            yield
        except OSError as error:
            lines.write(f"plant: {error}\n")
        self.outcome.outputs_on += self._outputs_on()

    def _capture(self, patch: pytest.MonkeyPatch, stack: ExitStack, lines: io.StringIO) -> None:
        """Collect the lines on standard error and in the log."""
        handler = logging.StreamHandler(lines)
        logging.getLogger().addHandler(handler)
        stack.callback(logging.getLogger().removeHandler, handler)
        patch.setattr(sys, "stderr", lines)
        patch.setattr(failures, "_process_failed", threading.Event())

    def _record(self, patch: pytest.MonkeyPatch) -> None:
        """Record what stores and histories accept and report as stored, and follow the scans."""
        outcome = self.outcome
        save, append, put, write = FileStore.save, HistoryFile.append, HistoryWriter._put, EventWriter.write
        submit = ScanWrites.submit

        def saved(store: FileStore, values: Any) -> None:
            try:
                save(store, values)
            except OSError:
                outcome.saved.append(dict(values))
                raise
            outcome.saved = [dict(values)]

        def appended(file: HistoryFile, rows: Any) -> None:
            append(file, rows)
            outcome.stored += rows
            with self._committed:
                self._commits += 1
                self._committed.notify_all()

        def submitted(writer: HistoryWriter, *arguments: Any, **options: Any) -> None:
            outcome.submitted += 1
            put(writer, *arguments, **options)

        def written(writer: EventWriter, event: Any) -> None:
            outcome.events_submitted += 1
            write(writer, event)

        def waits(writes: ScanWrites, action: Callable[[], None]) -> ScanWrite:
            write = submit(writes, action)
            with self._waiting:
                self._waiting.notify_all()
            return write

        def followed(runtime: Runtime, *arguments: Any, **options: Any) -> Any:
            self._runtime = runtime
            runtime.observers.append(self._follow)
            return run_simulated_time(runtime, *arguments, **options)

        patch.setattr(FileStore, "save", saved)
        patch.setattr(HistoryFile, "append", appended)
        patch.setattr(HistoryWriter, "_put", submitted)
        patch.setattr(EventWriter, "write", written)
        patch.setattr(ScanWrites, "submit", waits)

        @contextmanager
        def in_thread(store: FileStore, **_: object) -> Iterator[ThreadedRetentiveWriter]:
            with writer_until_end(store, threaded=True) as writer:
                assert isinstance(writer, ThreadedRetentiveWriter)
                self._writer = writer
                yield writer
            self._writer = None

        patch.setattr("controller.cli.run.run_simulated_time", followed)
        if self._threaded:
            patch.setattr("controller.cli.run.writer_until_end", in_thread)
        shorten_periods(patch)

    def _follow(self, _now_ms: int, plc: Plc) -> None:
        """Act as operator and clients between two scans."""
        try:
            self._act(self.outcome.scans, plc)
        except Exception as error:  # noqa: BLE001 - judged
            self.outcome.trouble.append(f"run: {error!r}")
        self.outcome.scans += 1
        self.outcome.calls.at += 1
        if self.outcome.scans == self._left:
            assert self._runtime is not None
            self.outcome.final = State(plc.read(self._runtime.machine.tags.machine.state))
            self._stop.set()

    def _act(self, scan: int, plc: Plc) -> None:
        runtime = self._runtime
        assert runtime is not None
        if (writer := self._writer) is not None:
            with writer._wake:
                writer._wake.wait_for(lambda: writer._newest is None and not writer._busy, PATIENT_S)
        is_aborted = plc.read(runtime.machine.tags.machine.state) == State.ABORTED
        self._aborted = self._aborted + 1 if is_aborted else 0
        if self._aborted > SECOND // 10 and (on := [name for name in self._outputs_on() if name not in self._signals]):
            self.outcome.unsafe.append(f"{on} on in Aborted")
        if (value := plc.memory.D[(number := runtime.machine.tags.sp.trays_target.number)]) not in self._values:
            self.outcome.writes.append(f"D{number} is {value}, not {self._values}")
        if self._writing is not None and scan == self._writing[0] + ANSWERED:
            self._end_write(*self._writing)
        if scan in PRESSES:
            button, pressed = PRESSES[scan]
            self._plant.call(lambda: setattr(self._module.plant.box, button, pressed))
        if scan in VISITS:
            self._panel.done(self._panel.visit())
        if scan % SAMPLED == 0:
            self._trends.sample(self.outcome.calls.at * SCAN_MS)
        if scan % WRITTEN == WRITTEN - 1:
            self._panel.finish(self._trends.trends.write())
        if scan % SECOND == SECOND // 2:
            self._begin_write(scan, number)
        if scan % SECOND == 0:
            self._panel.done(self._panel.telemetry.read_words(0, TELEMETRY_REGISTERS, input_=True))
            self._panel.done(self._panel.controller.read_bits(0, 64))

    def _begin_write(self, scan: int, number: int) -> None:
        """Begin to write a set-point; the next scan takes it, unless a call fails before."""
        value, commits = value_of(scan), self._commits
        self._values.add(value)
        written = self._panel.begin(self._panel.controller.write_word(register_address("D", number), value))
        assert self._runtime is not None
        writes = self._runtime.writes

        def notify(_: object) -> None:
            with self._waiting:
                self._waiting.notify_all()

        written.add_done_callback(notify)
        with self._waiting:
            self._waiting.wait_for(lambda: writes.are_waiting or written.done(), PATIENT_S)
        self._writing = scan, commits, written

    def _end_write(self, scan: int, commits: int, written: Future[Any]) -> None:
        """Take the answer, with which the write is in effect, and wait for the record of it in the history."""
        self._writing = None
        if self._panel.is_answered(written):
            self._values = {value_of(scan)}
            with self._committed:
                self._committed.wait_for(lambda: self._commits > commits, timeout=0.5)

    def _outputs_on(self) -> list[str]:
        safe = default_io_map().safe_outputs()
        return [f"Y{number:o}" for number, level in enumerate(self._module.outputs) if level != safe[number]]

    def _restart(self) -> None:
        """Read what a restarted controller reads."""
        outcome = self.outcome
        store = FileStore(self.folder / "retentive.json")
        with suppress(ValueError):
            outcome.retained = store.load()
        if store.interrupted:
            outcome.told.lines.append("the last run did not end in order")
        outcome.periods = periods_of(self.folder / "trends.sqlite")
        outcome.rows = rows_of(self.folder / "history.sqlite")
        outcome.captures = [
            read_capture(path) if path.stat().st_size else None for path in self._captures if path.exists()
        ]
        outcome.told.events = self._events.read_text(encoding="utf-8").splitlines()


def rows_of(path: Path) -> list[tuple[Any, ...]]:
    """Return the rows of all tables, each with the name of its table and without its number and its run."""
    if not path.exists():
        return []
    with closing(sqlite3.connect(path)) as db:
        found = {table: db.execute(f"SELECT * FROM {table} ORDER BY id").fetchall() for table in TABLES}  # noqa: S608
    return [(table, row[1], row[2], *row[4:]) for table, rows in found.items() for row in rows]


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])


def value_of(scan: int) -> int:
    """Return the value of the set-point that is written after a scan."""
    return 100 + scan // SECOND
