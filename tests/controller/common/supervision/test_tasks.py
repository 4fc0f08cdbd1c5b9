"""Unexpected exceptions in tasks and callbacks: each has the stated reaction, and all tasks are listed."""

from __future__ import annotations

import asyncio
import queue
import socket
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

import pytest

from controller.common.connections import Answered, FrameSession
from controller.common.supervision import tasks
from controller.common.supervision.failures import Reaction, failures
from controller.common.supervision.tasks import CALLBACK, REQUEST, TASKS, run_supervised, supervised_task
from controller.common.supervision.threads import CALLS, THREADS, in_thread
from controller.hmi.serving import server as device_server
from controller.hmi.serving.endpoints import EndpointNames, TcpEndpoint, TcpSettings
from controller.hmi.serving.server import DeviceServer
from controller.io.scan_writes import ScanWrites
from tests.controller.common.asyncio_rig import SimulatedLoop, run
from tests.controller.common.supervision.failure_rig import DefectError, drawn, fresh_counts
from tests.controller.common.supervision.source_calls import HOUSE, STARTS_TASKS, calls_in, source_calls
from tests.real_time import WAIT_S

ELSEWHERE = {
    ("plant_sim/links/server_thread.py", "run_coroutine_threadsafe"),  # its caller waits for the result
    ("controller/io/capture_proxy.py", "start_server"),  # its callback only starts a task
    ("controller/io/capture_proxy.py", "gather"),  # of tasks
    ("controller/hmi/panel/web/sockets.py", "gather"),  # of tasks
}
"""Calls outside the supervision that start no task of their own."""
NAMES = EndpointNames("server", "protocol", "--host", "--port", "--allow-remote", "omit it")


@pytest.fixture(autouse=True)
def _counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh_counts(monkeypatch)


def test_all_tasks_of_the_source_are_listed() -> None:
    calls = source_calls()
    found = {(call.file, call.function) for call in calls if call.function in STARTS_TASKS}
    assert {each for each in found if each[0] != f"{HOUSE}/tasks.py"} == ELSEWHERE
    assert {call.first for call in calls if call.function == "supervised_task"} == {*TASKS} - {CALLBACK, REQUEST}
    assert [call.first for call in calls if call.function == "supervised_item"] == ["REQUEST"]
    assert not {*TASKS} & {*THREADS}


@pytest.mark.parametrize("text", ["loop.create_task(f())", "asyncio.ensure_future(f())", "group = asyncio.TaskGroup()"])
def test_an_unlisted_task_is_found(text: str) -> None:
    (call,) = calls_in(text, "")
    assert call.function in STARTS_TASKS


@pytest.mark.parametrize("name", [*TASKS])
def test_each_reaction_is_that_of_the_list(name: str, caplog: pytest.LogCaptureFixture) -> None:
    reaction = TASKS[name].reaction
    (before,) = drawn(name, 50, 1)
    calls = iter(range(100))
    starts: list[int] = []
    told: list[Exception] = []

    async def work() -> None:
        starts.append(1)
        while (call := next(calls, None)) is not None:
            await asyncio.sleep(0.01)
            if call == before:
                raise DefectError

    async def main() -> None:
        await supervised_task(name, work, told.append)

    run(main(), SimulatedLoop)
    goes_on = reaction is Reaction.RESTART
    assert (len(starts), next(calls, 100)) == ((2, 100) if goes_on else (1, before + 1))
    assert [type(error) for error in told] == [DefectError]
    assert failures() == {name: 1}
    assert f"task {name}: {reaction.value} (1 since the start)" in caplog.text
    assert reaction in {Reaction.DROP, Reaction.RESTART, Reaction.TELL}


def test_a_task_that_is_cancelled_does_not_start_again() -> None:
    async def main() -> None:
        task = supervised_task("panel poll", partial(asyncio.sleep, 1_000))
        await asyncio.sleep(1)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    run(main(), SimulatedLoop)
    assert failures() == {}


def test_a_defect_that_recurs_leaves_the_loop_to_the_others(caplog: pytest.LogCaptureFixture) -> None:
    async def work() -> None:
        raise DefectError

    async def main() -> None:
        task = supervised_task("panel poll", work)
        await asyncio.sleep(99.5 * tasks.PAUSE_S)
        task.cancel()

    run(main(), SimulatedLoop)
    assert failures() == {"panel poll": 100}
    assert len(caplog.records) == 3


@pytest.mark.parametrize("name", [*CALLS])
def test_the_task_that_waits_for_a_call_is_told(name: str) -> None:
    async def main() -> None:
        with pytest.raises(DefectError):
            await in_thread(name, _raise)
        assert await in_thread(name, int, "7", base=8) == 7

    run(main())


def _raise() -> None:
    raise DefectError


def test_other_tasks_and_calls_are_refused() -> None:
    async def main() -> None:
        with pytest.raises(KeyError):
            supervised_task("another", partial(asyncio.sleep, 0))
        with pytest.raises(KeyError):
            await in_thread("another", int)

    run(main())


class EchoSession:
    """Session that answers each byte, and fails at a call counted over all sessions."""

    has_name = False

    def __init__(self, calls: Iterator[int], failing: int, gone: Callable[[], object]) -> None:
        self._calls, self._failing, self._gone = calls, failing, gone

    def answer(self, received: memoryview) -> Answered:
        if next(self._calls) == self._failing:
            raise DefectError
        return Answered(len(received), bytes(received), 1)

    def on_disconnect(self) -> None:
        self._gone()


@contextmanager
def device_server_on(
    session_for: Callable[[str], FrameSession], every_minute: Callable[[], Any] = lambda: None
) -> Iterator[Callable[[], socket.socket]]:
    """Run a device server, and yield a function that connects a client."""
    endpoint = TcpEndpoint(session_for, TcpSettings("127.0.0.1", 0), NAMES)
    with ExitStack() as stack, DeviceServer([endpoint], ScanWrites(), every_minute):
        yield lambda: stack.enter_context(socket.create_connection(("127.0.0.1", endpoint.port), WAIT_S))


@pytest.mark.parametrize("failing", drawn("callback", 30))
def test_a_defective_answer_closes_one_connection_and_releases_what_it_holds(
    failing: int, caplog: pytest.LogCaptureFixture
) -> None:
    calls = iter(range(100))
    gone: queue.SimpleQueue[str] = queue.SimpleQueue()
    with device_server_on(lambda peer: EchoSession(calls, failing, partial(gone.put, peer))) as connect:
        other, client = connect(), connect()
        for _ in range(failing):
            client.sendall(b"1")
            assert client.recv(10) == b"1"
        client.sendall(b"2")
        assert client.recv(10) == b""
        assert gone.get(timeout=WAIT_S) == "{}:{}".format(*client.getsockname())
        for each in (other, connect()):
            each.sendall(b"3")
            assert each.recv(10) == b"3"
    assert failures() == {CALLBACK: 1}
    assert "task callback: the item is dropped and counted" in caplog.text


@pytest.mark.parametrize("failing", drawn("client report", 10))
def test_the_report_of_the_device_server_starts_again(failing: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_server, "REPORT_EVERY_S", 0.001)
    minutes: queue.SimpleQueue[int] = queue.SimpleQueue()
    calls = iter(range(1_000_000))

    def every_minute() -> None:
        if (call := next(calls)) == failing:
            raise DefectError
        minutes.put(call)

    with device_server_on(lambda _: EchoSession(iter(range(9)), 9, lambda: None), every_minute):
        got = [minutes.get(timeout=WAIT_S) for _ in range(12)]
    assert got == [call for call in range(13) if call != failing]
    assert failures() == {"client report": 1}


def test_exceptions_of_the_main_coroutine_are_raised_and_other_reports_of_the_loop_are_kept(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        asyncio.get_running_loop().call_exception_handler({"message": "a report without exception"})
        raise DefectError

    with pytest.raises(DefectError):
        run_supervised(main())
    assert failures() == Counter()
    assert "a report without exception" in caplog.text
