"""Plant and controller in real time: the output watchdog of the plant, and a complete trial."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from controller.program.states import State
from plant_sim.twin.operator import Operator
from tests.plant_sim.twin.process_rig import controller_process, plant_process, wait_for_state
from tests.real_time import host_delay, judge_live_run
from tests.sampling import first_of

pytestmark = pytest.mark.real_time
"""The watchdog of the plant measures the time in which nobody writes; in lock step, this time does not pass."""
WATCHDOG_MS = 500
REAL_TRIAL_S = 380


@pytest.mark.parametrize("stroke", first_of([signal.SIGSTOP, signal.SIGKILL]))
def test_the_watchdog_switches_outputs_off_when_the_controller_is_killed_or_hangs(
    tmp_path: Path, stroke: signal.Signals
) -> None:
    """If the controller is killed or suspended while an arm moves, the watchdog trips after its limit in plant time."""
    watchdog_ms = host_delay().relative_ms(WATCHDOG_MS)
    with (
        plant_process("--watchdog-ms", str(watchdog_ms)) as (_, port),
        Operator("127.0.0.1", port) as operator,
        controller_process(port, tmp_path) as controller,
    ):
        wait_for_state(controller, State.STOPPED)
        operator.hold("start", pressed=True)
        wait_for_state(controller, State.RESETTING)
        operator.hold("start", pressed=False)
        moving = operator.telemetry()
        while not moving["y_image"]:
            moving = operator.telemetry()
        assert moving["watchdog_state"] == 1
        controller._process.send_signal(stroke)
        after = operator.telemetry()
        while after["watchdog_state"] != 2:
            after = operator.telemetry()
        controller.kill()
    assert after["y_image"] == 0
    assert after["tripped_at_ms"] - after["last_write_ms"] == watchdog_ms + 1


@pytest.mark.nightly
def test_the_full_trial_over_modbus_in_real_time() -> None:
    """The trial of the README in real time accounts for all 144 seedlings."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = ["plant_sim", "run", "--real-time", "--port", str(port), "--hmi-port", "0", "--no-panel"]
    done = subprocess.run(
        [sys.executable, "-m", *command], check=False, capture_output=True, text=True, timeout=REAL_TRIAL_S
    )
    judge_live_run(done.returncode, done.stdout, done.stderr)
    assert "seedlings 144" in done.stdout or done.returncode
