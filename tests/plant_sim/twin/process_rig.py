"""Plant and controller as processes on loopback, in simulated time."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from controller.program.states import State
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS
from plant_sim.twin.process import Process
from tests.controller.common.modbus_rig import IO_MAP, MACHINE
from tests.real_time import SIMULATED, WAIT_S


@contextmanager
def plant_process(*options: str) -> Iterator[tuple[Process, int]]:
    """Serve a plant on a free port, in lock step if `options` contain `LOCK_STEP`."""
    with Process("plant", ["plant_sim", "serve", "--port", "0", *options]) as plant:
        line = plant.next_line(WAIT_S)
        assert line is not None, "the plant did not start"
        yield plant, int(line.rpartition(":")[2])


@contextmanager
def plant_thread(port: int = 0, *, lock_step_ms: int | None = SCAN_MS) -> Iterator[int]:
    """Serve a plant in this process, by default in lock step and on a free port; yield its port."""
    module = IoModule(Plant(IO_MAP, MACHINE, seed=1), IO_MAP)
    with ServerThread(PlantServer(module, port=port, lock_step_ms=lock_step_ms)) as thread:
        yield thread.server.port


def run_command(port: int, folder: Path, *options: str) -> list[str]:
    """Return the command line of a controller in simulated time, with the pace of real time."""
    retain = str(folder / "retentive.json")
    return ["controller", "run", "--port", str(port), "--retain", retain, "--no-hmi", *SIMULATED, *options]


def controller_process(port: int, folder: Path) -> Process:
    """Run a controller in simulated time that reports its events as JSON."""
    return Process("controller", run_command(port, folder, "--events", "json"))


def first_events(
    port: int, folder: Path, *options: str, count: int = 2, end: signal.Signals = signal.SIGINT
) -> tuple[list[dict[str, object]], str]:
    """Start a controller, end it with a signal after its first events, and return its events and its messages."""
    command = [sys.executable, "-m", *run_command(port, folder, "--events", "json", *options)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        lines = [running.stdout.readline() for _ in range(count)]
        running.send_signal(end)
        rest, errors = running.communicate(timeout=WAIT_S)
    return [json.loads(line) for line in (*lines, *rest.splitlines())], errors


def wait_for_state(controller: Process, state: State) -> list[dict[str, object]]:
    """Read events until the machine enters a state."""
    events: list[dict[str, object]] = []
    while True:
        line = controller.next_line(WAIT_S)
        assert line is not None, f"the controller ended before {state.name}: {events}"
        events.append(json.loads(line))
        if events[-1]["event"] == "state" and events[-1]["state"] == state:
            return events
