"""Cost, speed and robustness of the operator interface, measured with real processes on loopback."""

from __future__ import annotations

import json
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from controller.hmi.modbus.fx3u_map import register_address
from controller.program.states import State
from plant_sim.benchmark.hmi_load import connect, read_registers
from plant_sim.benchmark.punctuality import NOTHING, Punctuality, measured_seconds, total
from plant_sim.links.tag_file import tag_csv
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.commissioning import set_points_of
from plant_sim.twin.lock_step import SCAN_MS
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import LiveError, Process

STOLEN_LIMIT_S = 0.01
"""Maximum steal time (processor time taken by the host) in a calm second, s: one tick of the steal-time counter."""
LATE_GOAL_MS: Final = 2.0
RATIO_GOAL: Final = 2.0
LEAST_RATIO: Final = 1.0

WAITS_S: Final = 5
QUIET_S: Final = 10
SETTLING_S: Final = 3
LOADED_S: Final = 20
LOAD_PROCESSES: Final = 2
CLIENTS_A_PROCESS: Final = 4
BROWSERS: Final = 2
FRAMES: Final = 20_000
CONNECTIONS: Final = 10_000
SEED: Final = 1

START_LIMIT_S: Final = 30.0
HOMING_LIMIT_S: Final = 60.0
WORK_LIMIT_S: Final = 120.0
_LOAD: Final = "plant_sim.benchmark.hmi_load"
_MB: Final = 1_000_000


@dataclass(frozen=True)
class HmiFigures:
    """Figures of the operator interface; `p99` is the 99th percentile of the lateness.

    Attributes:
        bare_p99_ms: Lateness of a loop that only waits 10 ms, ms; a measure of the timing noise of the idle computer.
        bare_latest_ms: Maximum lateness of the bare loop, ms.
        bare_missed: Waits of the bare loop that ended after the next deadline.
        quiet_p99_ms: Lateness of the scans of a running machine while no client is connected, ms.
        quiet_latest_ms: Maximum lateness of a scan without clients, ms.
        quiet_missed: Scans without clients that ended after the next was due.
        loaded_p99_ms: Lateness of the scans with eight Modbus clients and a panel with two browsers, ms.
        loaded_latest_ms: Maximum lateness of a scan with clients, ms.
        loaded_missed: Scans with clients that ended after the next was due.
        calm_p99_ms: Lateness of the scans with clients in calm seconds, i.e. seconds with negligible steal time, ms;
            NaN if there is no calm second.
        calm_latest_ms: Maximum lateness of a scan in the calm seconds, ms.
        calm_missed: Scans in the calm seconds that ended after the next was due.
        calm_s: Number of calm seconds.
        stolen_pct: Steal time during the measurement, % of one processor.
        beside_p99_ms: Lateness of a bare loop run at the same time, ms; a lower limit for the lateness of the scans.
        beside_latest_ms: Maximum lateness of that loop, ms.
        beside_missed: Waits of that loop that ended after the next deadline.
        answers_per_s: Answered requests of the eight clients, 1/s.
        views_per_s: Views sent to the two browsers, 1/s.
        rate_per_s: Read requests for 64 registers answered by the controller over one connection, 1/s.
        reference_per_s: Read requests answered by the pymodbus server with a plain datastore, 1/s.
        many_per_s: Read requests answered by the controller over eight connections, 1/s.
        reference_many_per_s: Read requests answered by the pymodbus server over eight connections, 1/s.
        memory_before_mb: Resident memory of the controller before the mutated frames and the connections, MB.
        memory_after_mb: Resident memory of the controller after the frames, the connections and one more
            successful request, MB.
        frames_answered: Number of complete mutated frames, all of which were answered.
    """

    bare_p99_ms: float
    bare_latest_ms: float
    bare_missed: float
    quiet_p99_ms: float
    quiet_latest_ms: float
    quiet_missed: float
    loaded_p99_ms: float
    loaded_latest_ms: float
    loaded_missed: float
    calm_p99_ms: float
    calm_latest_ms: float
    calm_missed: float
    calm_s: float
    stolen_pct: float
    beside_p99_ms: float
    beside_latest_ms: float
    beside_missed: float
    answers_per_s: float
    views_per_s: float
    rate_per_s: float
    reference_per_s: float
    many_per_s: float
    reference_many_per_s: float
    memory_before_mb: float
    memory_after_mb: float
    frames_answered: float

    def hmi_text(self) -> str:
        """Return the figures with their goals as text."""
        f = self
        one, many = f.rate_per_s / f.reference_per_s, f.many_per_s / f.reference_many_per_s
        goals = f"(goal: {RATIO_GOAL:.0f}, at least {LEAST_RATIO:.0f})"
        return "\n".join(
            [
                f"bare loop of {SCAN_MS} ms waits  {_late(f.bare_p99_ms, f.bare_latest_ms, f.bare_missed)}",
                f"scans, no clients          {_late(f.quiet_p99_ms, f.quiet_latest_ms, f.quiet_missed)}",
                f"scans, panel and clients   {_late(f.loaded_p99_ms, f.loaded_latest_ms, f.loaded_missed)} "
                f"(goal: {LATE_GOAL_MS:g} ms, 0)",
                f"  {f.calm_s:2.0f} s without steal time  {_late(f.calm_p99_ms, f.calm_latest_ms, f.calm_missed)}; "
                f"steal time {f.stolen_pct:.0f} % of a processor",
                f"  bare loop meanwhile      {_late(f.beside_p99_ms, f.beside_latest_ms, f.beside_missed)}",
                f"  load: {f.answers_per_s:.0f} answers and {f.views_per_s:.0f} views per second",
                f"Modbus, one connection     {f.rate_per_s:7.0f} readings/s, pymodbus server {f.reference_per_s:.0f}, "
                f"ratio {one:.2f} {goals}",
                f"  eight connections        {f.many_per_s:7.0f} readings/s, pymodbus server "
                f"{f.reference_many_per_s:.0f}, ratio {many:.2f} {goals}",
                f"malformed frames           {f.frames_answered:7.0f} frames answered, memory "
                f"{f.memory_before_mb:.1f} MB before, {f.memory_after_mb:.1f} MB after",
            ]
        )


def _late(p99_ms: float, latest_ms: float, missed: float) -> str:
    return f"{p99_ms:7.1f} ms late in 99 % of cases, at most {latest_ms:.1f} ms, {missed:.0f} missed"


def measure_hmi() -> HmiFigures:
    """Measure lateness, throughput and robustness in sequence.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
    """
    return HmiFigures(**measure_punctuality(), **measure_service())


def measure_punctuality(
    *, waits_s: int = WAITS_S, quiet_s: int = QUIET_S, loaded_s: int = LOADED_S
) -> dict[str, float]:
    """Measure the lateness of a bare loop, then that of scans without and with clients.

    Args:
        waits_s: Duration of the bare loop, s.
        quiet_s: Duration without clients, s.
        loaded_s: Duration with clients, s.

    Returns:
        Lateness figures of `HmiFigures`.

    Raises:
        LiveError: A process failed, or the machine did not reach a required state.
    """
    with _bare_loop(waits_s) as waiting:
        bare = _waited(waiting)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        plant_port, _, hmi_port = stack.enter_context(running_controller(folder, at_work=True))
        line = stack.enter_context(connect(hmi_port))
        quiet = total(measured_seconds(line, quiet_s))
        url = _panel(stack, folder, plant_port, hmi_port)
        for_s = str(SETTLING_S + loaded_s + 2)
        load = [
            stack.enter_context(Process("clients", [_LOAD, "clients", str(hmi_port), str(CLIENTS_A_PROCESS), for_s]))
            for _ in range(LOAD_PROCESSES)
        ]
        watching = stack.enter_context(Process("browsers", [_LOAD, "browsers", url, str(BROWSERS), for_s]))
        for each in (*load, watching):
            _read_record(each, START_LIMIT_S)
        threading.Event().wait(SETTLING_S)
        waiting = stack.enter_context(_bare_loop(loaded_s))
        seconds = measured_seconds(line, loaded_s)
        beside = _waited(waiting)
        answers = sum(_read_record(each, START_LIMIT_S)["answers"] for each in load)
        views = _read_record(watching, START_LIMIT_S)["messages"]
    calm = [second for second in seconds if second.stolen_s <= STOLEN_LIMIT_S]
    parts = {
        "bare": bare,
        "quiet": quiet,
        "loaded": total(seconds),
        "calm": total(calm) if calm else NOTHING,
        "beside": beside,
    }
    stolen_s = sum(second.stolen_s for second in seconds)
    figures = {f"{part}_{name}": value for part, lateness in parts.items() for name, value in asdict(lateness).items()}
    return figures | {
        "calm_s": len(calm),
        "stolen_pct": round(100 * stolen_s / loaded_s, 1),
        "answers_per_s": round(answers / int(for_s)),
        "views_per_s": round(views / int(for_s), 1),
    }


def measure_service(*, frames: int = FRAMES, connections: int = CONNECTIONS) -> dict[str, float]:
    """Measure the request rates of the controller and of the pymodbus server, and the effect of malformed frames.

    Args:
        frames: Number of mutated frames.
        connections: Number of connections that are opened and closed.

    Returns:
        Service figures of `HmiFigures`.

    Raises:
        LiveError: A process failed.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="transplanter-")))
        _, controller, port = stack.enter_context(running_controller(folder, at_work=False))
        theirs = stack.enter_context(Process("pymodbus server", [_LOAD, "reference"]))
        their_port = _read_record(theirs, START_LIMIT_S)["port"]
        with Process("client", [_LOAD, "rates", str(port), str(their_port)]) as asking:
            rates = _read_record(asking, WORK_LIMIT_S)
        theirs.stop()
        before_mb = controller.memory_mb
        given = [str(each) for each in (port, frames, connections, SEED)]
        with Process("malformed", [_LOAD, "malformed", *given]) as process:
            answered = _read_record(process, WORK_LIMIT_S)["answered"]
        with connect(port) as line:
            read_registers(line, register_address("R", 0), 2)
        after_mb = controller.memory_mb
    return {
        "rate_per_s": rates["ours"],
        "reference_per_s": rates["theirs"],
        "many_per_s": rates["ours_many"],
        "reference_many_per_s": rates["theirs_many"],
        "memory_before_mb": before_mb,
        "memory_after_mb": after_mb,
        "frames_answered": answered,
    }


class MeasuredProcess(Process):
    """Process whose memory use can be read."""

    @property
    def memory_mb(self) -> float:
        """Resident memory, MB."""
        status = Path(f"/proc/{self._process.pid}/status").read_text(encoding="ascii")
        kib = next(line for line in status.splitlines() if line.startswith("VmRSS:")).split()[1]
        return round(int(kib) * 1024 / _MB, 1)


@contextmanager
def running_controller(
    folder: Path, *, at_work: bool, real_time: Sequence[str] = ()
) -> Iterator[tuple[int, MeasuredProcess, int]]:
    """Run plant and controller in real time; yield the plant's port, the controller and its Modbus port.

    Args:
        folder: Folder of the retentive memory.
        at_work: True to home and start the machine.
        real_time: Options of real-time scheduling of both processes.
    """
    with ExitStack() as stack:
        plant = stack.enter_context(Process("plant", ["plant_sim", "serve", "--port", "0", *real_time]))
        plant_port = int(_line(plant, START_LIMIT_S).rpartition(":")[2])
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
            "--events",
            "json",
            "--no-console",
            *real_time,
        ]
        for name, value in set_points_of(load_machine()).items():
            command += ["--set", f"{name}={value}"]
        controller = stack.enter_context(MeasuredProcess("controller", command))
        hmi_port = int(_read_record(controller, START_LIMIT_S)["hmi_port"])
        _until(controller, State.STOPPED, START_LIMIT_S)
        if at_work:
            operator = stack.enter_context(Operator("127.0.0.1", plant_port))
            operator.press("start")
            _until(controller, State.IDLE, HOMING_LIMIT_S)
            operator.press("start")
            _until(controller, State.EXECUTE, START_LIMIT_S)
        yield plant_port, controller, hmi_port


def _panel(stack: ExitStack, folder: Path, plant_port: int, hmi_port: int) -> str:
    """Start a panel and return its address."""
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
        f"127.0.0.1:{hmi_port}",
        "--history",
        str(folder / "history.sqlite"),
        "--telemetry",
        f"127.0.0.1:{plant_port}",
        "--telemetry-tags",
        str(tags),
    ]
    panel = stack.enter_context(Process("panel", command))
    return _line(panel, START_LIMIT_S).removeprefix("panel at ")


def _bare_loop(for_s: int) -> Process:
    """Start a loop that only waits for deadlines."""
    return Process("bare loop", [_LOAD, "waits", str(for_s)])


def _waited(waiting: Process) -> Punctuality:
    """Wait until a bare loop has ended, and return its lateness."""
    result = _read_record(waiting, WORK_LIMIT_S)
    return Punctuality.of(result["late"], result["missed"])


def _until(controller: Process, state: State, limit_s: float) -> None:
    """Wait until the controller reports the given state."""
    while (event := _read_record(controller, limit_s)).get("state") != state:
        if event.get("state") in (State.HELD, State.ABORTED):
            raise LiveError(f"{state.name} not reached: {event['text']} {event['reason']}".rstrip())


def _read_record(process: Process, within_s: float) -> dict[str, Any]:
    record: dict[str, Any] = json.loads(_line(process, within_s))
    return record


def _line(process: Process, within_s: float) -> str:
    line = process.next_line(within_s)
    if line is None:
        raise LiveError(f"the {process.name} ended with exit code {process.stop()}")
    return line
