"""Two controller processes at one plant process: who owns the outputs, who is told, and what follows.

The controllers are in simulated time. Where the lease of the outputs must end, the plant is in real time: in lock step,
no time passes without a write.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.program.states import State
from plant_sim.twin.lock_step import CLEAR_MS
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import Process
from tests.controller.common.modbus_rig import ALL_OFF, Client, exception
from tests.plant_sim.twin.process_rig import controller_process, plant_process, wait_for_state
from tests.real_time import LOCK_STEP, WAIT_S, host_delay
from tests.sampling import first_of

WATCHDOG_MS = 1_000
"""Output watchdog of a plant in real time, ms, on a computer that is not busy."""


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def real_time_plant(stack: ExitStack) -> tuple[int, int]:
    """Serve a plant in real time; return its port and the limit of its output watchdog, ms."""
    watchdog_ms = host_delay().relative_ms(WATCHDOG_MS)
    return stack.enter_context(plant_process("--watchdog-ms", str(watchdog_ms)))[1], watchdog_ms


def controller(stack: ExitStack, port: int, folder: Path) -> Process:
    folder.mkdir(exist_ok=True)
    return stack.enter_context(controller_process(port, folder))


def event_of(process: Process, kind: str) -> dict[str, object]:
    """Return the next event of a kind."""
    while True:
        line = process.next_line(WAIT_S)
        assert line is not None, f"the process ended before {kind}"
        event: dict[str, object] = json.loads(line)
        if event["event"] == kind:
            return event


@pytest.mark.nightly
@pytest.mark.parametrize("together", first_of([False, True]))
def test_one_of_two_controllers_is_refused_and_both_say_so(together: bool, stack: ExitStack, tmp_path: Path) -> None:
    """Whichever writes first owns the outputs; the other one is told its address, and the owner that of the other."""
    _, port = stack.enter_context(plant_process(*LOCK_STEP))
    first = controller(stack, port, tmp_path / "first")
    if not together:
        wait_for_state(first, State.STOPPED)
    second = controller(stack, port, tmp_path / "second")
    reports = [event_of(process, "outputs") for process in (first, second)]
    assert sorted(bool(report["taken"]) for report in reports) == [False, True]
    owner, refused = (first, second) if reports[1]["taken"] else (second, first)
    if not together:
        assert owner is first
    wait_for_state(refused, State.ABORTED)
    taken = next(str(report["text"]) for report in reports if report["taken"])
    told = next(str(report["text"]) for report in reports if not report["taken"])
    assert "the outputs belong to 127.0.0.1:" in taken
    assert "write by 127.0.0.1:" in told
    assert taken.rpartition(":")[2] != told.split(":")[1].split()[0]
    assert refused.stop() == 0
    assert owner.stop() == 0


@pytest.mark.nightly
@pytest.mark.real_time
def test_the_lease_of_a_killed_controller_ends_and_it_is_restarted(stack: ExitStack, tmp_path: Path) -> None:
    """Killed while it moves an arm, with a second one waiting: the outputs go off, and its restart is the owner."""
    port, watchdog_ms = real_time_plant(stack)
    operator = stack.enter_context(Operator("127.0.0.1", port))
    first = controller(stack, port, tmp_path / "first")
    wait_for_state(first, State.STOPPED)
    second = controller(stack, port, tmp_path / "second")
    wait_for_state(second, State.ABORTED)
    operator.hold("start", pressed=True)
    wait_for_state(first, State.RESETTING)
    operator.hold("start", pressed=False)
    while not operator.telemetry()["y_image"]:
        pass
    first.kill()
    while operator.telemetry()["watchdog_state"] != 2:
        pass
    found = operator.telemetry()
    assert found["y_image"] == 0
    assert found["tripped_at_ms"] - found["last_write_ms"] == watchdog_ms + 1
    assert found["refused_writes"] == 1
    first.stop()
    again = controller(stack, port, tmp_path / "first")
    events = wait_for_state(again, State.STOPPED)
    assert not [event for event in events if event["event"] == "outputs"]
    operator.hold("start", pressed=True)
    wait_for_state(again, State.RESETTING)
    assert operator.telemetry()["refused_writes"] == 1


@pytest.mark.nightly
@pytest.mark.real_time
def test_the_second_controller_takes_over_when_its_operator_clears_it(stack: ExitStack, tmp_path: Path) -> None:
    """Killed with SIGKILL, the owner is gone; X24 held for 3 s clears the second one, which then writes."""
    port, _ = real_time_plant(stack)
    operator = stack.enter_context(Operator("127.0.0.1", port))
    first = controller(stack, port, tmp_path / "first")
    wait_for_state(first, State.STOPPED)
    second = controller(stack, port, tmp_path / "second")
    wait_for_state(second, State.ABORTED)
    first.kill()
    while operator.telemetry()["watchdog_state"] != 2:
        pass
    operator.press("stop", for_ms=CLEAR_MS + 1_000)
    wait_for_state(second, State.STOPPED)
    while operator.telemetry()["watchdog_state"] != 1:
        pass
    assert second.stop() == 0


@pytest.mark.nightly
def test_the_plant_reports_a_refused_write_once_a_second(stack: ExitStack, tmp_path: Path) -> None:
    """On standard error, with both addresses; a client that hammers it does not fill the log."""
    process = subprocess.Popen(
        [sys.executable, "-m", "plant_sim", "serve", "--port", "0", "--lock-step-ms", "10"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    stack.callback(process.communicate)
    stack.callback(process.kill)
    assert process.stdout is not None
    port = int(process.stdout.readline().rpartition(":")[2])
    owner, second = stack.enter_context(Client(port)), stack.enter_context(Client(port))
    for _ in range(250):
        owner.ask(ALL_OFF)
        assert second.ask(ALL_OFF) == exception(15, 6)
    process.send_signal(signal.SIGINT)
    assert process.stderr is not None
    lines = process.stderr.read().splitlines()
    assert len(lines) == 3
    host, number = owner.socket.getsockname()
    assert lines[0].startswith(f"outputs belong to {host}:{number}: write by {host}:{second.socket.getsockname()[1]} ")
    assert process.wait() == 0
