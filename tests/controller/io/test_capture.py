"""Captures: of a real controller and by the proxy, replayed on the program and on the plant, and invalid files."""

from __future__ import annotations

import json
import resource
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.common.capture import CONTROLLER, PROXY, Capture, CaptureHeader, CaptureWriter, read_capture
from controller.core.clock import MonotonicClock
from controller.io.capture_proxy import Decoder, _Connection
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.states import State
from plant_sim.cli.main import main as plant_main
from plant_sim.twin.operator import Operator
from plant_sim.twin.process import Process
from tests.retained import retained
from tests.sampling import first_of

LIMIT_S = 60.0
IO_MAP = load_io_map(DEFAULT_IO_MAP)
INPUTS = IO_MAP.input_count
_OFFSETS = [point.offset for point in IO_MAP.inputs]
HAS_ONE_READ = max(_OFFSETS) - min(_OFFSETS) < len(_OFFSETS)
"""True if the offsets of the inputs are consecutive, so that one request reads them all."""
PATIENT = ["--timeout-ms", "5000", "--link-limit-ms", "10000"]


def started(name: str, *arguments: str) -> tuple[Process, str]:
    """Start a process and return its first line."""
    process = Process(name, arguments)
    line = process.next_line(LIMIT_S)
    assert line is not None
    return process, line


def homed(field_port: int, plant_port: int, folder: Path, *options: str, state: State = State.IDLE) -> None:
    """Run a controller in simulated time until it has homed."""
    retain = [*retained(folder / "retentive.json"), "--events", "json", "--no-hmi", "--no-console"]
    controller, line = started(
        "controller", "controller", "run", "--port", str(field_port), *retain, *PATIENT, *options
    )
    with controller, Operator("127.0.0.1", plant_port) as operator:
        while json.loads(line).get("state") != State.STOPPED:
            line = controller.next_line(LIMIT_S) or ""
        operator.press("start")
        while json.loads(line).get("state") != state:
            line = controller.next_line(LIMIT_S) or ""
        assert controller.stop() == 0


LOCK_STEP = ["--simulated-time", "--pace", "65535"]


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the capture of a homing in lock step."""
    folder = tmp_path_factory.mktemp("captured")
    plant, line = started("plant", "plant_sim", "serve", "--port", "0", "--lock-step-ms", "10")
    with plant:
        port = int(line.rpartition(":")[2])
        homed(port, port, folder, *LOCK_STEP, "--capture", str(folder / "run.capture"))
    return folder / "run.capture"


def replayed(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    code = main(["capture", "replay", str(path), *options])
    return code, capsys.readouterr().out


def on_plant(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    code = plant_main(["replay", str(path), *options])
    return code, capsys.readouterr().out


def test_a_capture_replays_without_a_difference(captured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, text = replayed(captured, capsys)
    assert (code, text.splitlines()[-1]) == (0, "the program writes the captured outputs")
    capture = read_capture(captured)
    assert capture.is_closed
    assert capture.end_ms > 1_000
    assert {entry.kind for entry in capture.entries} >= {"X", "Y", "W", "E"}
    code, text = on_plant(captured, capsys)
    assert (code, text.splitlines()[-1]) == (0, "the plant has the captured inputs")


def changed(path: Path, folder: Path, change: Callable[[list[str]], object]) -> Path:
    lines = path.read_text(encoding="utf-8").split("\n")
    change(lines)
    (folder / "changed.capture").write_text("\n".join(lines), encoding="utf-8")
    return folder / "changed.capture"


def line_of(capture: Capture, kind: str, number: int) -> int:
    """Return the index of the line of a kind, by its number."""
    return [entry.line for entry in capture.entries if entry.kind == kind][number] - 1


def test_a_changed_output_is_the_first_difference(
    captured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capture = read_capture(captured)
    index = line_of(capture, "Y", 3)
    at_ms, _, image = captured.read_text(encoding="utf-8").split("\n")[index].split()

    def change(lines: list[str]) -> None:
        lines[index] = f"{at_ms} Y {int(image, 16) ^ 1 << 8:x}"

    code, text = replayed(changed(captured, tmp_path, change), capsys)
    lines = text.splitlines()
    assert code == 1
    assert lines[1] == (
        f"first difference at {int(at_ms) / 1000:.3f} s, scan {int(at_ms) // 10 + 1} "
        f"({tmp_path}/changed.capture:{index + 1}):"
    )
    was_on = bool(int(image, 16) >> 8 & 1)
    names = ("off", "on") if was_on else ("on", "off")
    assert lines[2] == f"  Y10 right.slide_outward: captured {names[0]}, program {names[1]}"
    assert lines[3].startswith("  state: ")
    assert any(line.startswith("  left homing: ") for line in lines[4:])


def test_a_missing_write_and_another_memory_are_differences(
    captured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The replay depends on every part of the capture: the last change of an input is enough."""
    capture = read_capture(captured)
    press = next(entry for entry in capture.entries if entry.kind == "X" and entry.image[0])  # X0, start

    def change(lines: list[str]) -> None:
        del lines[press.line - 1]

    code, text = replayed(changed(captured, tmp_path, change), capsys)
    assert code == 1
    assert "  state: STOPPED" in text


def test_a_different_machine_is_found_by_the_plant(captured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, text = on_plant(captured, capsys, "--fault", "slow_valve:left.lift=200ms")
    assert code == 1
    first, second = text.splitlines()[1:]
    assert first.startswith("first difference at ")
    assert second.startswith(("  X1 left.lift_down: captured off at ", "  X2 left.lift_up: "))
    assert on_plant(captured, capsys, "--fault", "slow_valve:left.lift=200ms", "--tolerance-ms", "60000")[0] == 0


def test_inputs_can_be_ignored(captured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fault = ["--fault", "stuck_on:left.cup_pulse"]
    code, text = on_plant(captured, capsys, *fault)
    assert (code, text.splitlines()[-1]) == (1, "  X22 left.cup_pulse: captured off at 0.000 s, plant on at 0.000 s")
    assert on_plant(captured, capsys, *fault, "--ignore", "X22")[0] == 0
    assert plant_main(["replay", str(captured), "--ignore", "left.cup_pulze"]) == 2
    assert capsys.readouterr().err.endswith("did you mean left.cup_pulse?\n")


@pytest.mark.nightly
def test_the_proxy_captures_the_traffic_of_both_directions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "proxy.capture"
    plant, line = started("plant", "plant_sim", "serve", "--port", "0", "--lock-step-ms", "10")
    with plant:
        port = line.rpartition(":")[2]
        proxy, line = started(
            "proxy", "controller", "capture", "record", str(path), "--listen-port", "0", "--port", port
        )
        with proxy:
            both = tmp_path / "run.capture"
            homed(int(line.rpartition(":")[2]), int(port), tmp_path, *LOCK_STEP, "--capture", str(both))
            assert proxy.stop() == 0
    direct, by_proxy = read_capture(both), read_capture(path)
    assert by_proxy.is_closed
    for kind in "XY":
        expected = [entry.image for entry in direct.entries if entry.kind == kind]
        found = [entry.image for entry in by_proxy.entries if entry.kind == kind]
        if kind == "X" and not HAS_ONE_READ:  # the proxy also has the images between the reads of one scan
            images = iter(found)
            found = [image for image in expected if image in images]
        assert found == expected
    assert main(["capture", "replay", str(path)]) == 2
    assert "a capture of a proxy does not contain the scans" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("host", "reason"), first_of([("..", "encoding with 'idna'"), ("127.0.0.1", "Connect call failed")])
)
def test_the_proxy_reports_a_field_that_it_cannot_reach_once(
    host: str, reason: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as reserved:
        port = str(reserved.getsockname()[1])
    path = tmp_path / "proxy.capture"
    arguments = ("capture", "record", str(path), "--listen-port", "0", "--host", host, "--port", port)
    proxy, line = started("proxy", "controller", *arguments)
    with proxy:
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", int(line.rpartition(":")[2])), timeout=LIMIT_S) as master:
                assert master.recv(1) == b"", "the connection is ended on the side of the master as well"
        assert proxy.stop() == 0
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith(f"no field I/O at {host}:{port}: ")
    assert reason in error


def test_the_proxy_decodes_nothing_after_an_invalid_header(tmp_path: Path) -> None:
    """A frame that follows the invalid header in the data of the next packet is forwarded only."""
    header = CaptureHeader("test", PROXY, "0", 22, 18, 0, 0, "2026-11-23T19:00:00Z")
    path = tmp_path / "proxy.capture"
    frame = bytes.fromhex("0001 0000 0006 01 05 0000 ff00")
    with CaptureWriter(path, header) as writer:
        connection = _Connection(Decoder(IO_MAP, writer, MonotonicClock()))
        connection.feed("request", b"\xff" * 12)
        connection.feed("request", frame)
        connection.feed("answer", frame)
    assert [entry.kind for entry in read_capture(path).entries] == ["E"]


def test_a_killed_controller_leaves_a_capture_that_can_be_replayed(
    captured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def cut(lines: list[str]) -> None:
        del lines[line_of(read_capture(captured), "Y", 4) + 1 :]
        lines[-1] = lines[-1][:4]

    path = changed(captured, tmp_path, cut)
    assert not read_capture(path).is_closed
    assert main(["capture", "replay", str(path)]) == 0
    printed = capsys.readouterr()
    assert printed.err == f"{path}: not closed; replayed up to its last line\n"


def test_the_last_scan_of_a_killed_controller_may_lack_its_outputs(
    captured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def cut(lines: list[str]) -> None:
        """Replace the fourth image of outputs, and what follows, with the inputs of its scan."""
        index = line_of(read_capture(captured), "Y", 4)
        inputs = [line for line in lines[:index] if " X " in line][-1]
        lines[index:] = [f"{lines[index].partition(' ')[0]} {inputs.partition(' ')[2]}", "9"]

    path = changed(captured, tmp_path, cut)
    assert not read_capture(path).is_closed
    assert main(["capture", "replay", str(path)]) == 0
    assert "the program writes the captured outputs" in capsys.readouterr().out


def replace_header(key: str, value: str) -> Callable[[list[str]], None]:
    def change(lines: list[str]) -> None:
        index = next(index for index, line in enumerate(lines) if line.startswith(f"{key}: "))
        lines[index] = f"{key}: {value}"

    return change


def replace_entry(text: str) -> Callable[[list[str]], None]:
    def change(lines: list[str]) -> None:
        lines[lines.index("---") + 2] = text

    return change


INVALID: list[tuple[Callable[[list[str]], object], str]] = [
    (lambda lines: lines.__setitem__(0, "x"), "1: file: does not begin with 'transplanter-capture 1'; specify"),
    (lambda lines: lines.pop(1), "2: made_by: is missing; write 'made_by: VALUE' or capture again"),
    (replace_header("source", "tape"), "3: source: 'tape' is unknown; write one of controller, proxy"),
    (replace_header("io_map", "0"), "4: io_map: the capture belongs to another I/O map; specify it with --io-map"),
    (replace_header("inputs", "-1"), "5: inputs: '-1' is not a number from 0 to 9999; capture again"),
    (replace_header("memory", '{"D200": "x"}'), "10: memory: is not an object of integers; capture again"),
    (replace_header("memory", '{"Q7": 1}'), "10: Q7: 'Q7' is not a device; capture again"),
    (replace_header("memory", '{"D9999": 1}'), "10: D9999: "),
    (lambda lines: lines.pop(10), "11: file: '---' is missing after the header; capture again"),
    (replace_entry("hello"), "13: file: 'hello' is not a line of a capture; see docs/commissioning.md, or capture"),
    (replace_entry("0 X 7fffffffff"), f"13: X: '7fffffffff' is not an image of {INPUTS} bits; capture again"),
    (replace_entry("0 X zz"), f"13: X: 'zz' is not an image of {INPUTS} bits; capture again"),
    (replace_entry("0 Y"), "13: Y: takes 1 values; capture again"),
    (replace_entry("0 W M1"), "13: W: takes 2 values; capture again"),
    (replace_entry("0 W Q1 1"), "13: Q1: 'Q1' is not a device; capture again"),
    (replace_entry("0 H 2"), "13: H: '2' is not 0 or 1; capture again"),
    (replace_entry("5 S 9"), "13: S: '9' is not the time of an earlier scan; capture again"),
    (replace_entry("0 E"), "14: file: follows the end; see docs/commissioning.md"),
]


@pytest.mark.parametrize(("change", "message"), INVALID, ids=[message[:24] for _, message in INVALID])
def test_an_invalid_capture_is_one_line_with_file_line_key_and_remedy(
    change: Callable[[list[str]], object],
    message: str,
    captured: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = changed(captured, tmp_path, change)
    assert main(["capture", "replay", str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert printed.err.startswith(f"{path}:{message}")


def test_a_full_disk_ends_the_capture_with_one_message(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The limit of the size of a file acts as a full disk; the scans continue, and what was written can be read."""
    path = tmp_path / "run.capture"
    header = CaptureHeader("test", CONTROLLER, "0", 22, 18, 10, 10, "2026-11-23T19:00:00Z")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000, before[1]))
    try:
        with CaptureWriter(path, header) as writer:
            for number in range(2_000):
                writer.image(10 * number, "X", [number % 2 == 0] * 22)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [record.getMessage() for record in caplog.records] == [f"capture {path} ends here: File too large"]
    capture = read_capture(path)
    assert not capture.is_closed
    assert 0 < capture.end_ms < 20_000


def test_missing_files_and_existing_ones_are_refused(
    captured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, message in (
        (["capture", "replay", str(tmp_path / "no")], f"{tmp_path}/no: No such file or directory; specify a capture"),
        (["capture", "record", str(captured)], f"{captured}: File exists; choose a new file in a writable folder"),
        (["run", "--capture", str(captured)], f"--capture {captured}: File exists; choose a new file in a writable"),
        (
            ["run", "--capture", str(tmp_path / "no" / "x"), "--retain", str(tmp_path / "retain" / "memory")],
            f"--capture {tmp_path}/no/x: No such file or directory; choose a new file in a writable folder",
        ),
        (["capture", "record", "x", "--port", "0"], "--port 0: must be 1 to 65535"),
    ):
        assert main(arguments) == 2
        error = capsys.readouterr().err
        assert error.startswith(message)
        assert error.count("\n") == 1
    assert not [*tmp_path.iterdir()], "the controller was not started"
    (tmp_path / "binary").write_bytes(b"\xff\xfe")
    assert plant_main(["replay", str(tmp_path / "binary")]) == 2
    assert capsys.readouterr().err.startswith(f"{tmp_path}/binary: not UTF-8 text; specify a capture")
