"""Controller and plant as processes on loopback: errors, a trial over Modbus, a killed controller, and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

from controller.cli.main import main as controller_main
from controller.core.retentive_store import FileStore, MemoryStore
from controller.core.scan import Plc
from controller.events.kinds import Event
from controller.events.production import ProductionLog
from controller.io.modbus_tcp import ModbusTcpLink
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.states import Mode, State
from plant_sim.cli.main import main as plant_main
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.operator import PRESS_MS, Operator, counts_of
from tests.controller.history.history_rig import table
from tests.plant_sim.twin.process_rig import controller_process, first_events, plant_process, plant_thread, run_command
from tests.real_time import COMMAND_S, LOCK_STEP, WAIT_S
from tests.sampling import first_of, one_in

MAIN = {"controller": controller_main, "plant_sim": plant_main}


def run(*arguments: str, timeout_s: float = COMMAND_S) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", *arguments]
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=timeout_s)


def ended(arguments: tuple[str, ...]) -> int | str | None:
    """Run a command in this process; return its exit code."""
    with pytest.raises(SystemExit) as end:
        sys.exit(MAIN[arguments[0]](arguments[1:]))
    return end.value.code


@pytest.mark.parametrize("program", ["controller", "plant_sim"])
def test_help_names_the_options(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended((program, "--help")) == 0
    assert {"--io-map", "--port", "--host"} <= set(capsys.readouterr().out.replace("[", " ").split())
    first = "run" if program == "controller" else "serve"
    assert ended((program, first, "--help")) == 0
    assert "--io-map" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    one_in(
        3,
        [
            (("controller", "--io-map", "no.yaml"), "no.yaml"),
            (("plant_sim", "--io-map", "no.yaml"), "no.yaml"),
            (("plant_sim", "serve", "--machine", "no.yaml"), "no.yaml"),
            (("plant_sim", "trial", "--trays", "0"), "--trays 0"),
            (("plant_sim", "serve", "--host", "192.0.2.1"), "192.0.2.1"),
            (
                ("plant_sim", "serve", "--host", "192.0.2.1", "--allow-remote"),
                "--host must be an address of this computer",
            ),
            (("plant_sim", "serve", "--watchdog-ms", "0"), "--watchdog-ms 0: must be 1 to"),
            (("plant_sim", "run", "--fast", "--keep"), "--keep"),
            (("controller", "--set", "tray_target=2"), "trays_target"),
            (("controller", "--set", "trays_target=two"), "must be an integer"),
            (("controller", "--set", "clamp=0"), "10 to 200"),
            (("controller", "--constants", "no.yaml"), "no.yaml"),
            (("controller", "--retain", "."), "is a folder"),
            (("controller", "--retain", "/proc/no/retentive.json"), "/proc/no/retentive.json"),
            (
                ("controller", "--retain", "no/such/retentive.json"),
                "folder no does not exist; create it or choose another file",
            ),
            (("controller", "--scan-ms", "0"), "--scan-ms"),
            (("controller", "--hmi-port", "65536"), "--hmi-port 65536: must be 0 to 65535"),
            (("controller", "--unit", "0"), "--unit 0: must be 1 to 255"),
            (("controller", "--unit", "256"), "--unit 256: must be 1 to 255"),
            (("controller", "--hmi-host", "192.0.2.1"), "--hmi-allow-remote"),
            (("controller", "--hmi-host", "panel"), "must be an IP address"),
            (
                ("controller", "--new-machine", "--hmi-host", "192.0.2.1", "--hmi-allow-remote"),
                "--hmi-host must be an address of this computer",
            ),
            (("controller", "--hmi-certificate", "no.pem"), "no.pem"),
            (("controller", "--hmi-serial", "COM1:fast"), "DEVICE:BAUD"),
            (
                ("controller", "--new-machine", "--hmi-port", "0", "--hmi-serial", "/dev/null"),
                "specify another --hmi-serial",
            ),
            (("controller", "--simulated-time", "--pace", "6000"), "--pace"),
            (("controller", "--history", "/proc/no/history.sqlite"), "--history"),
            (("controller", "history", "no.sqlite"), "no.sqlite"),
            (("controller", "panel", "--telemetry", "127.0.0.1:5020"), "--telemetry-tags"),
            (("controller", "--input-filter-ms", "99"), "--input-filter-ms"),
            (("controller", "--panel-limit-ms", "5"), "--panel-limit-ms 5"),
            (("controller", "--link-limit-ms", "40"), "must be more than --timeout-ms plus --scan-ms, 40 ms"),
        ],
    ),
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: tuple[str, ...],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Commands run in this process; the one-line error of a real process is that of a locked retentive memory."""
    monkeypatch.chdir(tmp_path)
    assert expected in rejected(arguments, capsys)


@pytest.mark.parametrize("option", ["--retain", "--history", "--io-map"])
def test_a_file_name_that_is_too_long_is_one_line(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    name = "n" * 300
    assert rejected(("controller", "run", option, name), capsys).startswith(f"{name}: ")
    assert list(tmp_path.iterdir()) == []


def rejected(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command with an invalid argument in this process; return its line of error output."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert MAIN[arguments[0]](arguments[1:]) == 2
    finally:
        signal.signal(signal.SIGTERM, before)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1, printed.err
    return str(printed.err)


def test_a_port_in_use_is_one_line_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        error = rejected(("plant_sim", "serve", "--port", str(port)), capsys)
    assert f"127.0.0.1:{port}" in error
    assert "choose another --port" in error


@pytest.mark.parametrize(
    "arguments",
    [
        ("controller", "frobnicate"),
        ("controller", "ladder"),
        ("controller", "ladder", "export", "--target", "iec", "--out", "x"),
        ("plant_sim", "serve", "--port"),
        ("plant_sim", "study", "cabbage"),
    ],
)
def test_a_wrong_argument_is_one_line_and_exit_code_2(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert line.startswith(f"python -m {arguments[0]}")
    assert line.endswith("; see --help")


@pytest.mark.parametrize(
    "arguments",
    first_of(
        [
            (("controller", "ladder", "check", "long.il"),),
            (("plant_sim", "docs", "--out", "tables"),),
            (("controller", "docs", "--out", "tables"),),
            (("controller", "tags", "--out", "tables"),),
            (("plant_sim", "trial", "--seedlings", "1", "--json"),),
        ]
    ),
)
def test_a_closed_pipe_ends_a_command_without_output(arguments: tuple[str, ...], tmp_path: Path) -> None:
    (tmp_path / "long.il").write_text("LD X0\nOUT M0\nOUT M0\n" * 500 + "END\n", encoding="utf-8")
    reader, writer = os.pipe()
    os.close(reader)
    try:
        done = subprocess.run(
            [sys.executable, "-m", *arguments],
            check=False,
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            cwd=tmp_path,
            timeout=WAIT_S,
        )
    finally:
        os.close(writer)
    assert done.stderr == ""
    assert done.returncode == 128 + signal.SIGPIPE


def test_a_controller_without_a_plant_reports_it_and_retries(tmp_path: Path) -> None:
    """Without a plant the controller reports and waits; when the plant starts, it enters Stopped."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = [sys.executable, "-m", *run_command(port, tmp_path, "--events", "json", "--no-history")]
    waiting = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert waiting.stderr is not None
        assert waiting.stdout is not None
        assert f"127.0.0.1:{port}" in waiting.stderr.readline()
        with plant_thread(port):
            assert json.loads(waiting.stdout.readline())["state"] == State.STOPPED
            waiting.send_signal(signal.SIGINT)
            _, errors = waiting.communicate(timeout=WAIT_S)
            assert "outputs set to their safe levels" in errors
        assert waiting.returncode == 0
    finally:
        waiting.kill()
        waiting.communicate()


def test_commands_are_read_from_standard_input(tmp_path: Path) -> None:
    """A running controller executes a command name on its standard input and rejects anything else.

    Bytes that are not text are rejected in the same way.
    """
    with plant_thread() as port:
        running = subprocess.Popen(
            [sys.executable, "-m", *run_command(port, tmp_path, "--events", "json")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONIOENCODING": "utf-8:strict"},
        )
        try:
            assert running.stdin is not None
            assert running.stdout is not None
            assert json.loads(running.stdout.readline())["state"] == State.STOPPED
            running.stdin.write(b"\xff\ndance\nreset\n")
            running.stdin.flush()
            assert json.loads(running.stdout.readline())["state"] == State.RESETTING
            running.send_signal(signal.SIGINT)
            _, errors = running.communicate(timeout=WAIT_S)
        finally:
            running.kill()
            running.communicate()
    assert b"unknown command 'dance'" in errors
    assert b"Traceback" not in errors


def test_a_damaged_store_is_reported_and_set_aside(tmp_path: Path) -> None:
    store = tmp_path / "retentive.json"
    store.write_text('{"format": "transplanter-retentive-1", "values": {"M1024": 1}, "sha256": "0"}')
    with plant_thread() as port, controller_process(port, tmp_path) as controller:
        events = [json.loads(controller.next_line(WAIT_S) or "{}") for _ in range(2)]
    assert {"state", "alarm"} == {event["event"] for event in events}
    assert "memory" in next(event["text"] for event in events if event["event"] == "alarm")
    assert (tmp_path / "retentive.json.damaged-1").exists()


def test_a_start_names_its_constants_and_believes_no_impossible_memory(tmp_path: Path) -> None:
    """A constant given with ``--set`` is no part of the memory, and is gone at the next start.

    The memory of the first start is then changed to a mode that does not exist, with a valid checksum.
    """
    store = FileStore(tmp_path / "retentive.json")
    with plant_thread() as port:
        events, errors = first_events(port, tmp_path, "--set", "arms_may_meet=1")
        assert "machine constant arms_may_meet: 1 instead of 0" in errors
        assert [event["number"] for event in events if event["event"] == "alarm"] == [999]
        stored = store.load()
        assert stored is not None
        assert stored["D562"] == Mode.CONTINUOUS
        assert "D516" not in stored
        store.save(stored | {"D562": 9})
        events, errors = first_events(port, tmp_path)
    assert "D562 mode: 9 is not a valid value; renamed to" in errors
    assert "machine constant" not in errors
    assert [event["number"] for event in events if event["event"] == "alarm"] == [904]


class TcpMachine:
    """Machine program with a plant in another process, in lock step over Modbus TCP."""

    def __init__(self, port: int, trays: int) -> None:
        io_map = load_io_map(DEFAULT_IO_MAP)
        machine = build(io_map)
        self.plc = Plc(machine.program)
        self.plc.write(machine.tags.sp.trays_target, trays)
        self.link = ModbusTcpLink("127.0.0.1", port, io_map, timeout_s=WAIT_S)
        self.link.open()
        self.runtime = Runtime(machine, self.plc, self.link, DirectRetentiveWriter(MemoryStore()))
        self.events: list[Event] = []
        self.runtime.observers.append(ProductionLog(machine, self.events.append))
        self.state = machine.tags.machine.state
        self.now_ms = 0

    def scan(self) -> State:
        self.runtime.tick(self.now_ms)
        self.now_ms += SCAN_MS
        return State(self.plc.read(self.state))


RELEASE_AFTER = 10
"""Last scan in which the button is pressed."""
WHOLE_TRIAL = 20_000
"""Number of scans that is sufficient for homing or for a trial."""


@pytest.mark.parametrize(("trays", "scans"), first_of([(1, 2_200), (1, 3_000), (1, WHOLE_TRIAL), (2, WHOLE_TRIAL)]))
def test_a_trial_over_modbus_equals_the_trial_in_process(trays: int, scans: int) -> None:
    """In lock step, a trial of two processes over Modbus has the same events and counts as one in a single process.

    By default the trials are compared 22 s after the start, when the first rows have been picked.
    """
    with ExitStack() as stack:
        _, port = stack.enter_context(plant_process(*LOCK_STEP, "--seed", "7", "--trays", str(trays)))
        operator = stack.enter_context(Operator("127.0.0.1", port))
        far = TcpMachine(port, trays=trays)
        stack.callback(far.link.close)
        near = Twin(seed=7, trays=trays, set_points={"trays_target": trays})
        near.scan()
        far.scan()
        for until in (State.IDLE, State.COMPLETE):
            operator.hold("start", pressed=True)
            near.plant.box.start = True
            for number in range(scans):
                state = far.scan()
                if number == RELEASE_AFTER:
                    operator.hold("start", pressed=False)
                if state == until:
                    break
            near.run_for((RELEASE_AFTER + 1) * SCAN_MS)
            near.plant.box.start = False
            near.run_for((number - RELEASE_AFTER) * SCAN_MS)
            assert near.state == state
            assert state == until or scans < WHOLE_TRIAL
        assert far.events == near.events
        counts = counts_of(operator.telemetry())
    assert counts == near.plant.counts()
    assert counts.total == 72 * trays
    assert counts.in_cups + counts.in_claw >= 12
    assert counts.in_cups >= 12 or scans < 3_000
    assert counts.in_cups + counts.P + counts.D + counts.T == counts.total or scans < WHOLE_TRIAL


@pytest.mark.nightly
def test_the_trial_command_prints_one_reproducible_json_object(capsys: pytest.CaptureFixture[str]) -> None:
    """Two runs with the same seed, in two processes, differ only in the wall-clock time."""
    command = ("plant_sim", "trial", "--trays", "1", "--json", "--seed")
    done = run(*command, "1")
    assert done.returncode == 0, done.stderr
    records = [json.loads(done.stdout)]
    for seed in ("1", "2"):
        assert ended((*command, seed)) == 0
        records.append(json.loads(capsys.readouterr().out))
    wanted = {"seedlings", "in_cups", "P", "D", "T", "S", "cycles", "cycle_time_s", "missed_cups", "alarms"}
    wanted |= {"simulated_s", "wall_s"}
    assert wanted <= records[0].keys()
    first, second = ({k: v for k, v in record.items() if k != "wall_s"} for record in records[:2])
    assert first == second
    assert first["seedlings"] == 72 == first["in_cups"] + first["P"] + first["D"] + first["T"]
    assert first["S"] == pytest.approx(100 * first["in_cups"] / 72)
    assert first["cycles"] == 6
    other = records[2]
    assert {k: other[k] for k in ("P", "D", "T")} != {k: first[k] for k in ("P", "D", "T")}


def test_two_presses_of_a_button_stay_distinct() -> None:
    """A press and the pause after it each last their full time on the plant's clock."""
    with plant_thread(lock_step_ms=None) as port, Operator("127.0.0.1", port) as operator:
        before_ms = operator.telemetry()["time_ms"]
        operator.press("start")
        assert operator.telemetry()["time_ms"] - before_ms >= 2 * PRESS_MS


@pytest.mark.nightly
def test_the_live_run_is_stopped_by_ctrl_c_in_order(tmp_path: Path) -> None:
    """Ctrl-C ends panel, controller and plant of a live run: safe outputs are written and the ports are released."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = [
        *(sys.executable, "-m", "plant_sim", "run", "--pace", "5000", "--trays", "10"),
        *("--port", str(port), "--hmi-port", "0", "--panel-port", "0"),
    ]
    live = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert live.stderr is not None
        history = next(line for line in live.stderr if line.startswith("history: "))
        url = next(line for line in live.stderr if line.startswith("panel at ")).removeprefix("panel at ").strip()
        assert httpx.get(url, timeout=WAIT_S).status_code == 200
        assert any("Execute" in line for line in live.stderr)
        live.send_signal(signal.SIGINT)
        report, errors = live.communicate(timeout=WAIT_S)
    finally:
        live.kill()
        live.communicate()
    assert live.returncode == 130
    assert report.startswith("the trial did not complete, so it has no S: interrupted\nseedlings 720: ")
    assert "outputs set to their safe levels" in errors
    assert "Traceback" not in errors
    path = tmp_path / history.removeprefix("history: ").partition(",")[0]
    assert State.EXECUTE in [row["number"] for row in table(path, "events")]
    with socket.create_server(("127.0.0.1", port)):
        pass


@pytest.mark.nightly
def test_a_retentive_memory_is_locked_by_its_controller(tmp_path: Path) -> None:
    """A second controller that opens the file of a running one is rejected in one line."""
    with plant_thread() as port, controller_process(port, tmp_path) as first:
        assert first.next_line(WAIT_S)
        second = run(*run_command(port, tmp_path))
    assert second.returncode == 2
    assert "another controller" in second.stderr
    assert second.stderr.count("\n") == 1


@pytest.mark.nightly
def test_sigterm_ends_the_live_run_with_its_children(tmp_path: Path) -> None:
    """After SIGTERM to a live run, no process is listening on the port."""
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = reserved.getsockname()[1]
    command = [sys.executable, "-m", "plant_sim", "run", "--port", str(port), "--hmi-port", "0", "--no-panel"]
    live = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert live.stderr is not None
        for line in live.stderr:
            if "Stopped" in line:
                break
        live.terminate()
        report, errors = live.communicate(timeout=WAIT_S)
    finally:
        live.kill()
        live.communicate()
    assert live.returncode == 130
    assert report.startswith("the trial did not complete, so it has no S: interrupted\nseedlings 144: ")
    assert "outputs set to their safe levels" in errors
    with socket.create_server(("127.0.0.1", port)):
        pass
