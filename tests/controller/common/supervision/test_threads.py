"""Unexpected exceptions in threads: each thread has the stated reaction, and all threads are listed."""

from __future__ import annotations

import asyncio
import io
import json
import logging
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import pytest

from controller.common.capture import CaptureWriter
from controller.common.supervision.failures import FAILED, Reaction, dropped, failures
from controller.common.supervision.threads import CALLS, THREADS, supervised
from controller.core.clock import utc_ms
from controller.events.writer import EventWriter, ServingEvent
from controller.history.file import HistoryFile, HistoryRow
from controller.history.writer import HistoryWriter
from controller.hmi.console import Console, ConsoleReader
from controller.hmi.serving.server import DeviceServer
from controller.io.scan_writes import ScanWrites
from plant_sim.links.server_thread import ServerThread
from plant_sim.twin.process import Process
from tests.controller.common.supervision.failure_rig import DefectError, FailsOnce, drawn, fresh_counts, patch
from tests.controller.common.supervision.source_calls import HOUSE, STARTS_THREADS, source_calls
from tests.real_time import WAIT_S

EVENTS = 20


@pytest.fixture(autouse=True)
def _counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh_counts(monkeypatch)


def test_all_threads_of_the_source_are_listed() -> None:
    calls = source_calls()
    assert {call.file for call in calls if call.function in STARTS_THREADS} == {f"{HOUSE}/threads.py"}
    assert {call.first for call in calls if call.function == "supervised"} == {*THREADS}
    assert {call.first for call in calls if call.function == "in_thread"} == {*CALLS}


@pytest.mark.parametrize("failing", drawn("events", EVENTS))
def test_the_event_of_an_exception_is_dropped_and_reported(failing: int, caplog: pytest.LogCaptureFixture) -> None:
    """An event is written in two parts, the line and its end."""
    out = io.StringIO()
    out.write = FailsOnce(out.write, 2 * failing)  # type: ignore[method-assign]
    writer = EventWriter("json", out)
    for port in range(EVENTS):
        writer.write(ServingEvent(0, port))
    writer.close()
    kept = [port for port in range(EVENTS) if port != failing]
    assert [json.loads(line)["hmi_port"] for line in out.getvalue().splitlines()] == kept
    assert "thread events: the item is dropped and counted" in caplog.text
    assert (failures(), dropped("events")) == ({"events": 1}, 1)


@pytest.mark.parametrize("written", drawn("pipe", EVENTS))
def test_events_after_the_end_of_their_reader_are_counted(written: int) -> None:
    ours, theirs = os.pipe()
    with os.fdopen(theirs, "w") as out:
        writer = EventWriter("json", out)
        for port in range(written):
            writer.write(ServingEvent(0, port))
        for _ in range(written):
            while os.read(ours, 1) != b"\n":
                pass
        os.close(ours)
        for port in range(5):
            writer.write(ServingEvent(0, port))
        writer.close()
    assert (failures(), dropped("events")) == ({}, 5)


@pytest.mark.parametrize("failing", drawn("console", EVENTS))
def test_the_line_of_an_exception_is_dropped_and_the_console_works_on(
    failing: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """All lines arrive in one piece; those behind the defect are not lost."""
    executed: queue.SimpleQueue[str] = queue.SimpleQueue()
    console = Console.__new__(Console)
    monkeypatch.setattr(console, "execute", FailsOnce(executed.put, failing))
    lines = [f"line {number}" for number in range(EVENTS)]
    ours, theirs = os.pipe()
    os.write(theirs, "".join(f"{line}\n" for line in lines).encode())
    del lines[failing]
    with ConsoleReader(console, ours):
        assert [executed.get(timeout=WAIT_S) for _ in lines] == lines
    os.close(ours)
    os.close(theirs)
    assert "thread console: the item is dropped and counted" in caplog.text
    assert failures() == {"console": 1}


@pytest.mark.parametrize("failing", drawn("history", 8))
def test_the_history_is_tried_again(
    failing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Each row is committed on its own."""
    written: queue.SimpleQueue[HistoryRow] = queue.SimpleQueue()
    append = HistoryFile.append

    def noted(file: HistoryFile, rows: Sequence[HistoryRow]) -> None:
        append(file, rows)
        for row in rows:
            written.put(row)

    monkeypatch.setattr(HistoryFile, "append", noted)
    patch(monkeypatch, HistoryWriter, "_batch", 2 * failing)  # twice for each row: once to find that there is no other
    history = HistoryWriter(tmp_path / "history.sqlite", wall_ms=utc_ms, program="p", version="1")
    assert written.get(timeout=WAIT_S).table == "runs"
    for number in range(10):
        history.audit("peer", "who", "what", str(number), "done", number)
        assert written.get(timeout=WAIT_S).at_ms == number
    history.close()
    assert "thread history: the work is tried again" in caplog.text
    assert (failures(), history.dropped) == ({"history": 1}, 0)


@pytest.mark.parametrize("failing", drawn("capture", EVENTS))
@pytest.mark.parametrize("error", [DefectError(), OSError(28, "no space left")])
def test_a_capture_ends_and_its_queue_does_not_grow(
    error: Exception, failing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(CaptureWriter, "put_header", lambda *_: None)
    out = io.StringIO()
    calls = iter(range(EVENTS))

    def write(_: str) -> int:
        if next(calls) == failing:
            raise error
        return 0

    out.write = write  # type: ignore[method-assign]
    out.name = "capture"
    monkeypatch.setattr(Path, "open", lambda *_, **__: out)
    with CaptureWriter(tmp_path / "capture", None) as writer:  # type: ignore[arg-type]
        for number in range(EVENTS - 1):  # the last line is the end
            writer.write(0, "M0", number)
    assert writer._lines.empty()
    assert ("capture capture ends here" in caplog.text) == isinstance(error, OSError)
    assert ("thread capture: the part ends" in caplog.text) == isinstance(error, DefectError)
    assert dropped("capture") == EVENTS - failing


@pytest.mark.parametrize("calls", drawn("device server", 50))
def test_the_machine_works_on_without_the_device_server(
    calls: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def failing(server: DeviceServer) -> None:
        server._started.set()
        for _ in range(calls):
            await asyncio.sleep(0)
        raise DefectError

    monkeypatch.setattr(DeviceServer, "_serve", failing)
    server = DeviceServer([], ScanWrites())
    server._thread.start()
    server._thread.join(WAIT_S)
    assert "thread device server: the part ends; the process works on without it" in caplog.text
    assert failures() == {"device server": 1}


STORE = """
import sys
from controller.common.stop_request import run_process
from controller.io.retentive_writer import ThreadedRetentiveWriter
class Store:
    saves = 0
    def save(self, values): pass
    def confirm(self): pass
class Writer(ThreadedRetentiveWriter):
    left = {left}
    def _finish(self, error):
        self.left -= 1
        if self.left < 0: raise LookupError
        super()._finish(error)
def main(stop):
    writer = Writer(Store())
    while not stop.wait(0.001): writer.submit({{"D0": 1}})
    writer.close()
    print("outputs safe")
    return 0
run_process(main)
"""


@pytest.mark.parametrize("left", drawn("memory", 50))
def test_a_failed_thread_of_the_memory_stops_the_process_in_order(left: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STORE.format(left=left)], capture_output=True, text=True, check=False, timeout=WAIT_S
    )
    assert (done.returncode, done.stdout) == (FAILED, "outputs safe\n")
    assert THREADS["retentive memory"].reaction.value in done.stderr


@pytest.mark.parametrize("calls", drawn("plant server", 50))
def test_the_plant_server_hands_its_error_on(calls: int) -> None:
    stopped = []

    class Server:
        async def start(self) -> None: ...
        async def stop(self) -> None:
            stopped.append(True)

        def end(self) -> None: ...
        async def serve_forever(self) -> None:
            for _ in range(calls):
                await asyncio.sleep(0)
            raise DefectError

    with pytest.raises(DefectError), ServerThread(Server()):  # type: ignore[arg-type]
        pass
    assert stopped == [True]


@pytest.mark.parametrize("failing", drawn("output", 8))
def test_the_output_of_a_process_ends_where_it_cannot_be_read(
    failing: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    class DefectiveQueue(queue.Queue[str | None]):
        left = failing

        def put(self, item: str | None, block: bool = True, timeout: float | None = None) -> None:
            self.left -= 1
            if item is not None and self.left < 0:
                raise DefectError
            super().put(item, block, timeout)

    monkeypatch.setattr("plant_sim.twin.process.queue.SimpleQueue", DefectiveQueue)
    with Process("child", ["timeit", "-n", "1", "-r", "1", "print('line\\n' * 8)"]) as child:
        lines = [child.next_line(WAIT_S) for _ in range(failing + 1)]
    assert [line is None for line in lines] == [False] * failing + [True]
    assert "thread output of a process" in caplog.text


def failing_work(name: str) -> str:
    """Return an expression of a function that fails at a drawn moment."""
    (calls,) = drawn(name, 50, 1)
    return f"lambda: [1 // ({calls} - call) for call in range({calls + 1})]"


@pytest.mark.parametrize("name", [name for name, kind in THREADS.items() if kind.reaction is Reaction.EXIT])
def test_a_worker_ends_at_once(name: str) -> None:
    script = (
        "from controller.common.supervision.threads import supervised\n"
        f"thread = supervised({name!r}, {failing_work(name)})"
    )
    done = subprocess.run(
        [sys.executable, "-c", f"{script}\nthread.start()\nthread.join()"], capture_output=True, check=False
    )
    assert done.returncode == FAILED


@pytest.mark.parametrize("name", [name for name, kind in THREADS.items() if kind.reaction is Reaction.STOP])
def test_a_process_whose_thread_fails_stops_in_order_with_another_exit_code(name: str) -> None:
    lines = [
        "from controller.common.stop_request import run_process",
        "from controller.common.supervision.threads import supervised",
        "def main(stop):",
        f"    supervised({name!r}, {failing_work(name)}).start()",
        "    stop.wait()",
        "    return 0",
        "run_process(main)",
    ]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, check=False, timeout=WAIT_S)
    assert done.returncode == FAILED


@pytest.mark.parametrize(
    "name", [name for name, kind in THREADS.items() if kind.reaction in {Reaction.END, Reaction.TELL}]
)
def test_a_part_that_ends_is_reported(name: str, caplog: pytest.LogCaptureFixture) -> None:
    (calls,) = drawn(name, 50, 1)
    thread = supervised(name, lambda: [1 // (calls - call) for call in range(calls + 1)])
    thread.start()
    thread.join(WAIT_S)
    assert f"thread {name}: the part ends" in caplog.text


def test_a_defect_that_recurs_does_not_fill_the_log(caplog: pytest.LogCaptureFixture) -> None:
    failures = iter(range(12))

    def work() -> None:
        if next(failures, None) is not None:
            raise DefectError

    thread = supervised("events", work)
    thread.start()
    thread.join(WAIT_S)
    assert not thread.is_alive()
    assert [record.levelno for record in caplog.records] == [logging.ERROR] * 2


def test_other_threads_are_refused() -> None:
    with pytest.raises(KeyError):
        supervised("another", threading.Event().wait)
