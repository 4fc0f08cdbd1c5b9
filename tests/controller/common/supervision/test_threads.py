"""Unexpected exceptions in threads: each thread has the stated reaction, and all threads are listed."""

from __future__ import annotations

import ast
import io
import logging
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from controller.common.capture import CaptureWriter
from controller.common.supervision.threads import FAILED, THREADS, Reaction, supervised
from controller.core.clock import utc_ms
from controller.events.writer import EventWriter, ServingEvent
from controller.history.file import HistoryFile, HistoryRow
from controller.history.writer import HistoryWriter
from controller.hmi.console import Console, ConsoleReader
from controller.hmi.serving.server import DeviceServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.twin.process import Process
from tests.real_time import WAIT_S

ROOT = Path(__file__).parents[4]
OWN = ROOT / "controller/common/supervision/threads.py"


class DefectError(Exception):
    """Exception that no thread expects."""


class FailsOnce:
    """Wrapper of a function that raises an exception instead of one of its calls."""

    def __init__(self, function: Callable[..., Any], call: int) -> None:
        self._function, self._call, self._calls = function, call, 0

    def __call__(self, *args: Any, **named: Any) -> Any:
        self._calls += 1
        if self._calls == self._call + 1:
            raise DefectError
        return self._function(*args, **named)


def calls() -> list[tuple[Path, str, str]]:
    """Return file, function and first argument of the calls in the source that start threads."""
    found = []
    for path in sorted([*(ROOT / "controller").rglob("*.py"), *(ROOT / "plant_sim").rglob("*.py")]):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func).rpartition(".")[2]
                if name in {"supervised", "ThreadPoolExecutor", "start_new_thread"} or ast.unparse(node.func) in {
                    "threading.Thread",
                    "threading.Timer",
                    "Thread",
                }:
                    first = node.args[0] if node.args else None
                    found.append((path, name, str(first.value) if isinstance(first, ast.Constant) else ""))
    return found


def test_all_threads_of_the_source_are_listed() -> None:
    found = calls()
    assert [path for path, name, _ in found if name != "supervised" and path != OWN] == []
    assert {thread for _, name, thread in found if name == "supervised"} == {*THREADS}


@pytest.mark.parametrize("failing", range(3))
def test_the_event_of_an_exception_is_dropped_and_reported(failing: int, caplog: pytest.LogCaptureFixture) -> None:
    """An event is written in two parts, the line and its end."""
    out = io.StringIO()
    out.write = FailsOnce(out.write, 2 * failing)  # type: ignore[method-assign]
    writer = EventWriter("json", out)
    for port in range(3):
        writer.write(ServingEvent(0, port))
    writer.close()
    kept = [str(port) for port in range(3) if port != failing]
    assert [line.partition('"hmi_port": ')[2][0] for line in out.getvalue().splitlines()] == kept
    assert "thread events: the item is dropped and counted" in caplog.text


@pytest.mark.parametrize("failing", range(3))
def test_the_line_of_an_exception_is_dropped_and_the_console_works_on(
    failing: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """All lines arrive in one piece; those behind the defect are not lost."""
    executed: queue.SimpleQueue[str] = queue.SimpleQueue()
    console = Console.__new__(Console)
    monkeypatch.setattr(console, "execute", FailsOnce(executed.put, failing))
    ours, theirs = os.pipe()
    os.write(theirs, b"first\nsecond\nthird\n")
    with ConsoleReader(console, ours):
        got = [executed.get(timeout=WAIT_S) for _ in range(2)]
    os.close(ours)
    os.close(theirs)
    lines = ["first", "second", "third"]
    del lines[failing]
    assert got == lines
    assert "thread console: the item is dropped and counted" in caplog.text


def test_the_history_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    written: queue.SimpleQueue[int] = queue.SimpleQueue()
    append = HistoryFile.append

    def noted(file: HistoryFile, rows: Sequence[HistoryRow]) -> None:
        append(file, rows)
        written.put(len(rows))

    monkeypatch.setattr(HistoryFile, "append", noted)
    batch = HistoryWriter._batch
    failing = FailsOnce(lambda writer: batch(writer), 0)  # noqa: PLW0108 - a function is bound to its instance
    monkeypatch.setattr(HistoryWriter, "_batch", lambda writer: failing(writer))  # noqa: PLW0108
    history = HistoryWriter(tmp_path / "history.sqlite", wall_ms=utc_ms, program="p", version="1")
    assert written.get(timeout=WAIT_S) == 1
    history.close()
    assert "thread history: the work is tried again" in caplog.text


@pytest.mark.parametrize("failing", range(3))
def test_a_capture_ends_and_its_queue_does_not_grow(
    failing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(CaptureWriter, "put_header", lambda *_: None)
    out = io.StringIO()
    out.write = FailsOnce(out.write, failing)  # type: ignore[method-assign]
    out.name = "capture"
    monkeypatch.setattr(Path, "open", lambda *_, **__: out)
    with CaptureWriter(tmp_path / "capture", None) as writer:  # type: ignore[arg-type]
        for number in range(3):
            writer.write(0, "M0", number)
    assert writer._lines.empty()
    assert "capture capture ends here" in caplog.text


def test_the_machine_works_on_without_the_device_server(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def failing(server: DeviceServer) -> None:
        server._started.set()
        raise DefectError

    monkeypatch.setattr(DeviceServer, "_serve", failing)
    server = DeviceServer([], lambda: None)
    server._thread.start()
    server._thread.join(WAIT_S)
    assert "the machine keeps running without it" in caplog.text


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


@pytest.mark.parametrize("left", [0, 1, 5])
def test_a_failed_thread_of_the_memory_stops_the_process_in_order(left: int) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STORE.format(left=left)], capture_output=True, text=True, check=False, timeout=WAIT_S
    )
    assert (done.returncode, done.stdout) == (FAILED, "outputs safe\n")
    assert THREADS["retentive memory"].reaction.value in done.stderr


def test_the_plant_server_hands_its_error_on() -> None:
    class Server:
        async def start(self) -> None: ...
        async def stop(self) -> None: ...
        def end(self) -> None: ...
        async def serve_forever(self) -> None:
            raise DefectError

    with pytest.raises(DefectError), ServerThread(Server()):  # type: ignore[arg-type]
        pass


def test_the_output_of_a_process_ends_where_it_cannot_be_read(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    class DefectiveQueue(queue.Queue[str | None]):
        def put(self, item: str | None, block: bool = True, timeout: float | None = None) -> None:
            if item is not None:
                raise DefectError
            super().put(item, block, timeout)

    monkeypatch.setattr("plant_sim.twin.process.queue.SimpleQueue", DefectiveQueue)
    with Process("child", ["timeit", "-n", "1", "-r", "1", "print(1)"]) as child:
        assert child.next_line(WAIT_S) is None
    assert "thread output of a process" in caplog.text


@pytest.mark.parametrize("name", [name for name, kind in THREADS.items() if kind.reaction is Reaction.EXIT])
def test_a_worker_ends_at_once(name: str) -> None:
    script = (
        f"from controller.common.supervision.threads import supervised\nthread = supervised({name!r}, lambda: 1 / 0)"
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
        f"    supervised({name!r}, lambda: 1 / 0).start()",
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
    thread = supervised(name, lambda: 1 / 0)
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
