"""Plant and controller in real time: output safe, and a complete trial.

Every coil is off within the output watchdog time, and nothing moves before a person has acted. A relay between the two
processes records every write of the outputs.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from controller.program.states import State
from plant_sim.links.io_module import WatchdogState
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import Process
from tests.plant_sim.twin.process_rig import DroppingProxy, plant_process, wait_for_state
from tests.real_time import host_delay, judge_live_run
from tests.retained import retained

pytestmark = pytest.mark.real_time
"""The watchdog of the plant measures the time in which nobody writes; in lock step, this time does not pass."""
WATCHDOG_MS = 500
LONGEST_LIMIT_MS = 10_000
TIMEOUT_MS = "150"
"""Timeout of an answer: long for a busy computer, and shorter than the longest time between two scans (200 ms)."""
POLL_S = 0.02
PRESS_WRITES, CLEAR_WRITES = 20, 330
"""Writes, one every 10 ms, in the time of a short press and in that of a press that clears an abort (3 s)."""
WAITING = 300
"""Writes without motion in Execute, after which both arms wait for cups (assumed: all other waits are shorter)."""
REAL_TRIAL_S = 380


class Machine:
    """Machine whose tractor stands still, so that both arms wait for cups once they have a row.

    The limit of the link is twice the output watchdog: an interruption between the two is bridged by the link, and only
    the time between two writes tells that the outputs have been off.
    """

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.watchdog_ms = host_delay().relative_ms(WATCHDOG_MS)
        options = ("--watchdog-ms", str(self.watchdog_ms), "--planting-frequency", "0")
        _, port = stack.enter_context(plant_process(*options))
        self.operator = stack.enter_context(Operator("127.0.0.1", port))
        self.proxy = stack.enter_context(DroppingProxy(port))
        self._stack, self._folder = stack, folder
        self.start_controller()

    def start_controller(self) -> None:
        limit_ms = str(min(2 * self.watchdog_ms, LONGEST_LIMIT_MS))
        where = ("--port", str(self.proxy.port), *retained(self._folder / "retentive.json"))
        options = (
            *where,
            "--link-limit-ms",
            limit_ms,
            "--timeout-ms",
            TIMEOUT_MS,
            "--no-hmi",
            "--no-history",
            "--events",
            "json",
        )
        self.controller = self._stack.enter_context(Process("controller", ["controller", "run", *options]))
        wait_for_state(self.controller, State.STOPPED)

    def signal(self, number: signal.Signals) -> None:
        self.controller._process.send_signal(number)

    def hold(self, button: str, until: Callable[[], object]) -> None:
        self.operator.hold(button, pressed=True)
        until()
        self.operator.hold(button, pressed=False)

    def start(self, state: State) -> None:
        self.hold("start", lambda: wait_for_state(self.controller, state))

    def home(self) -> None:
        """Give the order to home, which moves the lifts at once."""
        moved = self.proxy.moved
        self.start(State.RESETTING)
        self.proxy.wait(lambda: self.proxy.moved > moved)

    def wait_for_cups(self) -> None:
        self.home()
        wait_for_state(self.controller, State.IDLE)
        self.start(State.EXECUTE)
        self.proxy.wait(lambda: self.proxy.moved > 0 and self.proxy.still > WAITING)

    def check_trip(self) -> None:
        """Wait for the trip of the watchdog; every coil is off within its time."""
        while (now := self.operator.telemetry())["watchdog_state"] != WatchdogState.TRIPPED:
            threading.Event().wait(POLL_S)
        assert now["y_image"] == 0
        assert now["tripped_at_ms"] - now["last_write_ms"] == self.watchdog_ms + 1

    def check_rest_until_cleared(self) -> None:
        """Nothing moves before a person clears the abort and gives a fresh order; an order alone has no effect.

        The abort is cleared with the release of a button that has been pressed for 3 s.
        """
        wait_for_state(self.controller, State.ABORTED)
        self.proxy.wait(lambda: self.proxy.still > 2)  # a last order of motion may have been refused by the module
        moved = self.proxy.moved
        self.hold("start", lambda: self.pass_time(PRESS_WRITES))
        self.pass_time(PRESS_WRITES)
        self.hold("stop", lambda: self.pass_time(CLEAR_WRITES))
        wait_for_state(self.controller, State.STOPPED)
        self.pass_time(PRESS_WRITES)
        assert self.proxy.moved == moved

    def pass_time(self, writes: int) -> None:
        """Wait for a number of writes of the controller."""
        until = self.proxy.writes + writes
        self.proxy.wait(lambda: self.proxy.writes >= until)

    def suspend(self) -> None:
        self.signal(signal.SIGSTOP)
        self.check_trip()
        self.signal(signal.SIGCONT)
        self.check_rest_until_cleared()

    def cut(self) -> None:
        self.proxy.drop(drops=True)
        self.check_trip()
        self.proxy.drop(drops=False)
        self.check_rest_until_cleared()


def rest(_: Machine) -> None:
    """Leave the machine in Stopped with all outputs off."""


def test_outputs_are_safe_after_a_killed_controller_and_nothing_moves_after_its_restart(tmp_path: Path) -> None:
    with ExitStack() as stack:
        machine = Machine(stack, tmp_path)
        machine.home()
        machine.controller.kill()
        machine.check_trip()
        moved = machine.proxy.moved
        machine.start_controller()
        machine.pass_time(PRESS_WRITES)
        assert machine.proxy.moved == moved
        machine.home()


@pytest.mark.nightly
@pytest.mark.parametrize("stroke", [Machine.cut, Machine.suspend])
@pytest.mark.parametrize("before", [rest, Machine.home, Machine.wait_for_cups])
def test_nothing_moves_after_a_trip_before_a_person_acts(
    before: Callable[[Machine], None], stroke: Callable[[Machine], None], tmp_path: Path
) -> None:
    """In Stopped and while both arms wait for cups, with all outputs off, and in motion."""
    with ExitStack() as stack:
        machine = Machine(stack, tmp_path)
        before(machine)
        stroke(machine)
        machine.home()


@pytest.mark.nightly
def test_the_full_trial_over_modbus_in_real_time(tmp_path: Path) -> None:
    """The trial of the README in real time accounts for all 144 seedlings."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = ["plant_sim", "run", "--real-time", "--port", str(port), "--hmi-port", "0", "--no-panel"]
    done = subprocess.run(
        [sys.executable, "-m", *command],
        check=False,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=REAL_TRIAL_S,
    )
    judge_live_run(done.returncode, done.stdout, done.stderr)
    assert "seedlings 144" in done.stdout or done.returncode
