"""Command `connect`, and the serial line of `serve`, as processes.

The plant at a PLC is in real time: the cycle of the PLC sets the time, and the timing is reported.
"""

from __future__ import annotations

import math
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pymodbus.client import ModbusSerialClient

from plant_sim.cli.main import main
from scripts.benchmark.live.serial_cable import SerialCable
from tests.controller.common.modbus_rig import PATIENT_S, Client, read_registers
from tests.plant_sim.links.plc.plc_rig import modbus_plc, profile_of

LIMIT_S = 60.0


@pytest.fixture(autouse=True)
def _signal() -> Iterator[None]:
    """Restore the SIGTERM handler of the test process, which `main` replaces."""
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@contextmanager
def plant(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command of the plant; it is ready when it listens."""
    command = [sys.executable, "-m", "plant_sim", *arguments]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def ended(process: subprocess.Popen[str]) -> list[str]:
    """Stop a process and return its lines on standard error."""
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, errors
    return errors.splitlines()


def port_of(process: subprocess.Popen[str]) -> int:
    assert process.stdout is not None
    return int(process.stdout.readline().rpartition(":")[2])


@pytest.mark.real_time
def test_connect_exchanges_with_a_plc_and_reports_the_timing() -> None:
    outputs = [number == 5 for number in range(18)]
    with modbus_plc(profile_of("fx5u"), lambda _: outputs) as port:
        where = ("--host", "127.0.0.1", "--port", str(port), "--timeout-ms", "5000")
        patient = ("--watchdog-ms", "60000")  # this PLC writes no safe levels, which would end a trip
        with plant("connect", "fx5u", *where, *patient, "--period-ms", "5", "--listen-port", "0") as process:
            with Client(port_of(process)) as client:
                while math.isnan((telemetry := read_registers(client))["write_period_ms"]):
                    assert process.poll() is None
                assert telemetry["y_image"] == 1 << 5
                assert telemetry["plc_state"] == 1
            lines = ended(process)
    assert lines[0].startswith(f"PLC 127.0.0.1:{port} answers at ")
    assert any(line.startswith("ticks of 1 ms: ") for line in lines)
    assert any(line.startswith(f"outputs from PLC 127.0.0.1:{port}: ") and "jitter" in line for line in lines)


@pytest.mark.nightly
@pytest.mark.real_time
def test_connect_over_a_serial_line_without_a_plc_says_so_and_goes_on() -> None:
    with SerialCable() as cable, plant("connect", "fx3u", "--serial", f"{cable.ends[0]}:115200:8N1:2") as process:
        assert process.stderr is not None
        assert f"PLC {cable.ends[0]} does not answer at" in process.stderr.readline()
        assert process.poll() is None


@pytest.mark.nightly
def test_serve_on_a_serial_line() -> None:
    with SerialCable() as cable:
        arguments = ("serve", "--port", "0", "--serial", f"{cable.ends[1]}:115200:8N1:4", "--lock-step-ms", "10")
        with plant(*arguments, "--wire-time") as process:
            assert port_of(process) > 0
            assert process.stdout is not None
            assert process.stdout.readline() == f"plant listening on {cable.ends[1]}, unit 4\n"
            client = ModbusSerialClient(cable.ends[0], baudrate=115_200, timeout=PATIENT_S, retries=0)
            assert client.connect()
            assert not client.write_coils(0, [False] * 18, device_id=4).isError()
            client.close()  # type: ignore[no-untyped-call]
            assert ended(process) == []


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("connect", "fx3u"), "specify either --host, the address of the PLC, or --serial"),
        (("connect", "fx3u", "--host", "127.0.0.1", "--serial", "/dev/x"), "specify either --host"),
        (("connect", "fx2n", "--host", "127.0.0.1"), "profile 'fx2n': "),
        (("connect", "fx3u-enet", "--serial", "/dev/x"), "--serial: profile fx3u-enet is for TCP"),
        (("connect", "fx3u", "--serial", "/dev/x:fast"), "serial line '/dev/x:fast': must be DEVICE:BAUD:FRAME:UNIT"),
        (("connect", "fx3u", "--host", "h", "--port", "0"), "--port 0: must be 1 to 65535"),
        (("connect", "fx3u", "--host", "h", "--period-ms", "0"), "--period-ms 0: must be 1 to 10000"),
        (("connect", "fx3u", "--host", "h", "--gap-limit-ms", "0"), "--gap-limit-ms 0: must be 1 to 600000"),
        (("connect", "fx3u", "--host", "h", "--lock-step-ms", "101"), "lock_step_ms is 101"),
        (("serve", "--serial", "/dev/no-such-line"), "serial line /dev/no-such-line: "),
        (("serve", "--wire-time"), "--wire-time: requires --serial"),
    ],
)
def test_invalid_options_start_nothing(
    arguments: tuple[str, ...], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    listen = ("--listen-port", "0") if arguments[0] == "connect" else ("--port", "0")
    assert main([*arguments, *listen]) == 2
    out, errors = capsys.readouterr()
    assert out == ""
    assert complaint in errors
    assert errors.count("\n") == 1


def test_an_invalid_profile_starts_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "my.yaml"
    path.write_text("title: a\nprotocol: modbus\nport: many\n", encoding="utf-8")
    assert main(["connect", str(path), "--host", "127.0.0.1", "--listen-port", "0"]) == 2
    out, errors = capsys.readouterr()
    assert out == ""
    assert errors.startswith(f"{path}:1: outputs: is missing; add it")
