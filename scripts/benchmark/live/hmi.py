"""Cost, speed and robustness of the operator interface, measured with real processes on loopback."""

from __future__ import annotations

import json
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from controller.hmi.modbus.fx3u_map import register_address
from controller.program.states import State
from plant_sim.links.tag_file import tag_csv
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.commissioning import set_points_of
from plant_sim.twin.lock_step import CLEAR_MS, SCAN_MS
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import LiveError, Process
from scripts.benchmark.live.hmi_load import connect, read_registers
from scripts.benchmark.live.punctuality import Punctuality, measured_seconds, total

STOLEN_LIMIT_S = 0.01
"""Maximum steal time (processor time taken by the host) in a calm second, s: one tick of the steal-time counter."""

WAITS_S: Final = 5
QUIET_S: Final = 5
SETTLING_S: Final = 3
LOADED_S: Final = 10
LOAD_PROCESSES: Final = 2
CLIENTS_A_PROCESS: Final = 4
BROWSERS: Final = 2
FRAMES: Final = 20_000
CONNECTIONS: Final = 10_000

START_LIMIT_S: Final = 60.0
HOMING_LIMIT_S: Final = 60.0
WORK_LIMIT_S: Final = 120.0
LATE_ALARMS: Final = {901, 902}
"""Numbers of the alarms of late scans: field link lost, scan time exceeded."""
ABORTS: Final = 10
"""Aborts because of late scans that the operator clears before the machine works (assumed)."""
LOAD: Final = "scripts.benchmark.live.hmi_load"
_MB: Final = 1_000_000


def measure_punctuality(
    _seed: int, *, waits_s: int = WAITS_S, quiet_s: int = QUIET_S, loaded_s: int = LOADED_S
) -> dict[str, float]:
    """Measure the lateness of a bare loop, then that of scans without and with clients.

    Args:
        waits_s: Duration of the bare loop, s.
        quiet_s: Duration without clients, s.
        loaded_s: Duration with clients, s.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
    """
    with bare_loop(waits_s) as waiting:
        bare = waited(waiting)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        machine = stack.enter_context(running_machine(folder, at_work=True))
        line = stack.enter_context(connect(machine.hmi_port))
        quiet = total(measured_seconds(line, quiet_s))
        _, url = running_panel(stack, folder, machine)
        for_s = str(SETTLING_S + loaded_s + 2)
        load = [
            stack.enter_context(
                Process("clients", [LOAD, "clients", str(machine.hmi_port), str(CLIENTS_A_PROCESS), for_s])
            )
            for _ in range(LOAD_PROCESSES)
        ]
        watching = stack.enter_context(Process("browsers", [LOAD, "browsers", url, str(BROWSERS), for_s]))
        for each in (*load, watching):
            read_record(each, START_LIMIT_S)
        threading.Event().wait(SETTLING_S)
        waiting = stack.enter_context(bare_loop(loaded_s))
        seconds = measured_seconds(line, loaded_s)
        beside = waited(waiting)
        answers = sum(read_record(each, START_LIMIT_S)["answers"] for each in load)
        views = read_record(watching, START_LIMIT_S)["messages"]
    calm = [second for second in seconds if second.stolen_s <= STOLEN_LIMIT_S]
    parts = {"bare": bare, "quiet": quiet, "loaded": total(seconds), "beside": beside}
    if calm:
        parts["calm"] = total(calm)
    figures = {
        f"{part}_{name}": value for part, lateness in parts.items() for name, value in lateness.figures().items()
    }
    return figures | {
        "calm_s": len(calm),
        "stolen": 100 * sum(second.stolen_s for second in seconds) / loaded_s,
        "answers": answers / int(for_s),
        "views": views / int(for_s),
    }


def measure_rates(_seed: int) -> dict[str, float]:
    """Measure the request rates of the controller and of the pymodbus server.

    Raises:
        LiveError: A process failed.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        port = stack.enter_context(running_machine(folder, at_work=False)).hmi_port
        theirs = stack.enter_context(Process("pymodbus server", [LOAD, "reference"]))
        their_port = read_record(theirs, START_LIMIT_S)["port"]
        asking = stack.enter_context(Process("client", [LOAD, "rates", str(port), str(their_port)]))
        rates: dict[str, float] = read_record(asking, WORK_LIMIT_S)
    ratios = {f"{count}_ratio": rates[count] / rates[f"{count}_reference"] for count in ("one", "many")}
    return rates | ratios


def measure_malformed(seed: int, *, frames: int = FRAMES, connections: int = CONNECTIONS) -> dict[str, float]:
    """Measure the memory of the controller before and after malformed frames, and count the answers.

    Args:
        seed: Seed of the mutations.
        frames: Number of mutated frames.
        connections: Number of connections that are opened and closed.

    Raises:
        LiveError: A process failed.
        SilentServerError: The controller did not answer afterwards.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        machine = stack.enter_context(running_machine(folder, at_work=False))
        controller, port = machine.controller, machine.hmi_port
        before_mb = controller.memory_mb
        given = [str(each) for each in (port, frames, connections, seed)]
        with Process("malformed", [LOAD, "malformed", *given]) as process:
            answered = read_record(process, WORK_LIMIT_S)["answered"]
        with connect(port) as line:
            read_registers(line, register_address("R", 0), 2)
        after_mb = controller.memory_mb
    return {"answered": answered, "memory_before": before_mb, "memory_after": after_mb}


class MeasuredProcess(Process):
    """Process whose memory use and open files can be read."""

    @property
    def memory_mb(self) -> float:
        """Resident memory, MB."""
        return self._kib("status", "VmRSS:") * 1024 / _MB

    @property
    def written_mb(self) -> float:
        """Memory that the process has written itself, resident or swapped: heap, stacks and the like, MB."""
        return (self._kib("smaps_rollup", "Anonymous:") + self._kib("smaps_rollup", "Swap:")) * 1024 / _MB

    @property
    def open_files(self) -> int:
        """Number of open files, sockets and pipes."""
        return sum(1 for _ in Path(f"/proc/{self._process.pid}/fd").iterdir())

    def _kib(self, file: str, name: str) -> int:
        """Return a value in KiB of a file of the process; 0 if it has none."""
        lines = Path(f"/proc/{self._process.pid}/{file}").read_text(encoding="ascii").splitlines()
        return next((int(line.split()[1]) for line in lines if line.startswith(name)), 0)


class Attendant:
    """Operator who puts a machine to work, and again after an abort because of late scans.

    A busy computer delays scans beyond the limits of the machine, which must abort then.

    Attributes:
        operator: Buttons and telemetry.
        is_at_work: True while the machine is in Execute.
    """

    def __init__(self, operator: Operator, *, is_patient: bool = False) -> None:
        """Initialise an attendant who presses the buttons of an operator.

        Args:
            operator: Buttons and telemetry.
            is_patient: True to put the machine to work again after any abort or hold, as often as needed.
        """
        self.operator = operator
        self.is_at_work = False
        self._is_patient = is_patient
        self._state: int | None = None
        self._aborts = 0
        self._alarms: set[int] = set()

    def start(self) -> None:
        """Press the start button."""
        self.operator.press("start")

    def attend(self, event: Mapping[str, Any]) -> None:
        """React to an event of the controller.

        Raises:
            LiveError: The machine aborted for another reason or too often, or was held, and the attendant is impatient.
        """
        state = event.get("state")
        if event["event"] == "alarm" and event["active"]:
            self._alarms.add(event["number"])
        is_refused = state == State.ABORTED and (self._aborts == ABORTS or not self._alarms & LATE_ALARMS)
        if (state == State.HELD or is_refused) and not self._is_patient:
            raise LiveError(f"{State.EXECUTE.name} not reached: {event['text']} {event['reason']}".rstrip())
        if state is not None:
            self._state, self.is_at_work = state, state == State.EXECUTE
            self._aborts += state == State.ABORTED
            self.act()

    def act(self) -> None:
        """Press the button that leads on from the present state, if a person must."""
        if self._state == State.ABORTED:
            self.operator.press("stop", for_ms=CLEAR_MS)
        elif self._state in (State.STOPPED, State.IDLE, State.HELD):
            self._alarms.clear()
            self.start()


@dataclass(frozen=True, slots=True)
class RunningMachine:
    """Plant and controller that run, and their operator.

    Attributes:
        plant: Process of the plant.
        controller: Process of the controller.
        plant_port: Port of the plant.
        hmi_port: Port of the controller's Modbus server.
        attendant: Operator at the buttons.
    """

    plant: MeasuredProcess
    controller: MeasuredProcess
    plant_port: int
    hmi_port: int
    attendant: Attendant


@contextmanager
def running_machine(
    folder: Path, *, at_work: bool, real_time: Sequence[str] = (), trays: int = 2, is_patient: bool = False
) -> Iterator[RunningMachine]:
    """Run plant and controller in real time.

    Args:
        folder: Folder of the retentive memory.
        at_work: True to home and start the machine.
        real_time: Options of real-time scheduling of both processes.
        trays: Number of trays in the magazine.
        is_patient: True if the operator puts the machine to work after any abort or hold.
    """
    with ExitStack() as stack:
        serve = ["plant_sim", "serve", "--port", "0", "--trays", str(trays), *real_time]
        plant = stack.enter_context(MeasuredProcess("plant", serve))
        plant_port = int(line_of(plant, START_LIMIT_S).rpartition(":")[2])
        command = [
            "controller",
            "run",
            "--port",
            str(plant_port),
            "--scan-ms",
            str(SCAN_MS),
            "--hmi-port",
            "0",
            "--retain",
            str(folder / "retentive.json"),
            "--new-machine",
            "--events",
            "json",
            "--no-console",
            *real_time,
        ]
        for name, value in set_points_of(load_machine()).items():
            command += ["--set", f"{name}={value}"]
        controller = stack.enter_context(MeasuredProcess("controller", command))
        hmi_port = int(read_record(controller, START_LIMIT_S)["hmi_port"])
        _until(controller, State.STOPPED, START_LIMIT_S)
        attendant = Attendant(stack.enter_context(Operator("127.0.0.1", plant_port)), is_patient=is_patient)
        if at_work:
            put_to_work(controller, attendant)
        yield RunningMachine(plant, controller, plant_port, hmi_port, attendant)


def put_to_work(controller: Process, attendant: Attendant) -> None:
    """Home and start a machine in Stopped.

    Raises:
        LiveError: The machine aborted for another reason or too often, was held, or did not report within the limit.
    """
    attendant.start()
    while not attendant.is_at_work:
        attendant.attend(read_record(controller, HOMING_LIMIT_S))


def running_panel(stack: ExitStack, folder: Path, machine: RunningMachine) -> tuple[MeasuredProcess, str]:
    """Start a panel, and return it and its address."""
    tags = folder / "plant-tags.csv"
    tags.write_text(tag_csv(), encoding="utf-8")
    command = [
        "controller",
        "panel",
        "--port",
        "0",
        "--users",
        str(folder / "users.json"),
        "--controller",
        f"127.0.0.1:{machine.hmi_port}",
        "--history",
        str(folder / "history.sqlite"),
        "--trends",
        str(folder / "panel-trends.sqlite"),
        "--telemetry",
        f"127.0.0.1:{machine.plant_port}",
        "--telemetry-tags",
        str(tags),
    ]
    panel = stack.enter_context(MeasuredProcess("panel", command))
    return panel, line_of(panel, START_LIMIT_S).removeprefix("panel at ")


def bare_loop(for_s: int) -> Process:
    """Start a loop that only waits for deadlines."""
    return Process("bare loop", [LOAD, "waits", str(for_s)])


def waited(waiting: Process) -> Punctuality:
    """Wait until a bare loop has ended, and return its lateness."""
    result = read_record(waiting, WORK_LIMIT_S)
    return Punctuality.of(result["late"], result["missed"])


def _until(controller: Process, state: State, limit_s: float) -> None:
    """Wait until the controller reports the given state."""
    while (event := read_record(controller, limit_s)).get("state") != state:
        if event.get("state") in (State.HELD, State.ABORTED):
            raise LiveError(f"{state.name} not reached: {event['text']} {event['reason']}".rstrip())


def read_record(process: Process, within_s: float) -> dict[str, Any]:
    """Return the next line of a process, which is an object of JSON.

    Raises:
        LiveError: The process has ended, or printed none in time.
    """
    record: dict[str, Any] = json.loads(line_of(process, within_s))
    return record


def line_of(process: Process, within_s: float) -> str:
    """Return the next line of a process.

    Raises:
        LiveError: The process has ended, or printed none in time.
    """
    line = process.next_line(within_s)
    if line is None:
        raise LiveError(f"the {process.name} ended with exit code {process.stop()}")
    return line
