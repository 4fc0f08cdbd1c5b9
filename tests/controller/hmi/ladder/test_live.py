"""Live FX program: writes of partners, RUN and STOP, and all servers of a real process at once."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Coroutine
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from pyModbusTCP.client import ModbusClient  # type: ignore[import-untyped]

from controller.cli.main import main as controller
from controller.common.mitsubishi.client import McClient
from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.fx_port import encode
from controller.common.mitsubishi.mc3e import Frame3E
from controller.common.mitsubishi.requests import RefusedError, RemoteRun, RemoteStop
from controller.fx.engine.plc import FxPlc
from controller.fx.language.cpu_model import FX3U
from controller.fx.language.il import read_il
from controller.hmi.ladder.live import LivePlc, LiveSession
from controller.hmi.modbus.fx3u_map import coil_address, discrete_address, register_address
from controller.hmi.serving.devices import AccessRefusal, AccessRefusedError
from plant_sim.twin.process import Process
from tests.controller.common.modbus_rig import PATIENT_S
from tests.controller.hmi.scan_rig import carried_out
from tests.controller.io.test_rtu import Master

D = Device.parsed
PROGRAM = "LD X10\nOUT Y10\nOUT T0 K5\nLD M8000\nINC D0\nLD X11\nOUT C200 K3\nEND\n"
LIMIT_S = 60.0
ATTEMPTS = 20_000


class LiveRig:
    def __init__(self) -> None:
        self.live = LivePlc(FxPlc(read_il(PROGRAM), input_filter_ms=0))
        self.session: LiveSession = self.live.session("test")
        self.now_ms = 0

    def scan(self, scans: int = 1) -> None:
        for _ in range(scans):
            self.live.scan(self.now_ms)
            self.now_ms += 10

    def write(self, write: Coroutine[Any, None, None]) -> None:
        carried_out(write, self.scan)


@pytest.fixture
def rig() -> LiveRig:
    return LiveRig()


def test_nothing_is_read_before_the_first_scan(rig: LiveRig) -> None:
    with pytest.raises(AccessRefusedError) as error:
        rig.session.read_bits(D("X0"), 1)
    assert error.value.refusal is AccessRefusal.NOT_READY


def test_an_input_keeps_its_level_and_an_output_is_driven_again(rig: LiveRig) -> None:
    rig.scan()
    rig.write(rig.session.write_bits([(D("X10"), True), (D("Y10"), False)]))
    assert rig.session.read_bits(D("X10"), 1) == [True]
    rig.scan(60)
    assert rig.session.read_bits(D("X7"), 3) == [False, True, False]
    assert rig.session.read_bits(D("Y10"), 1) == [True]
    assert rig.session.read_words(D("TN0"), 1) == [5]
    assert rig.session.read_bits(D("T0"), 1) == [True]


def test_words_are_unsigned_outside_and_signed_inside(rig: LiveRig) -> None:
    rig.write(rig.session.write_words([(D("D10"), 0xFFFE), (D("CN200"), 0xFFFF_FFFD), (D("TN5"), 7)]))
    memory = rig.live.plc.memory
    assert (memory.D[10], memory.CV[200], memory.TV[5]) == (-2, -3, 7)
    assert rig.session.read_words(D("D10"), 1) == [0xFFFE]
    assert rig.session.read_words(D("CN199"), 3) == [0, 0xFFFD, 0xFFFF]


@pytest.mark.parametrize(("first", "count"), [("CN199", 2), ("CN200", 1), ("CN200", 3), ("CN190", 13), ("CN255", 1)])
def test_half_of_a_32_bit_value_is_not_read(rig: LiveRig, first: str, count: int) -> None:
    with pytest.raises(AccessRefusedError) as error:
        rig.session.read_words(D(first), count)
    assert error.value.refusal is AccessRefusal.NO_DEVICE


@pytest.mark.parametrize(
    "write",
    [
        lambda session: session.write_bits([(D("M0"), True), (D("M5000"), True)]),
        lambda session: session.write_words([(D("D0"), 99), (D("D8256"), 1)]),
        lambda session: session.write_words([(D("R0"), 1)]),
    ],
)
def test_a_write_to_a_device_that_does_not_exist_is_refused_as_a_whole(
    rig: LiveRig, write: Callable[[LiveSession], Coroutine[Any, None, None]]
) -> None:
    with pytest.raises(AccessRefusedError) as error:
        rig.write(write(rig.session))
    assert error.value.refusal is AccessRefusal.NO_DEVICE
    rig.scan()
    assert not rig.live.plc.memory.M[0]
    assert rig.live.plc.memory.D[0] == 1


def test_a_write_is_settled_when_its_scan_can_be_read(rig: LiveRig) -> None:
    rig.scan()
    shown: list[list[int]] = []
    write = rig.live.writes.submit(lambda: rig.live.put_words([(D("D10"), 7)]))
    write.when_settled(lambda: shown.append(rig.session.read_words(D("D10"), 1)))
    rig.scan()
    assert shown == [[7]]


def test_stop_turns_the_outputs_off_and_run_starts_again(rig: LiveRig) -> None:
    rig.write(rig.session.write_bits([(D("X10"), True)]))
    rig.scan(3)
    rig.write(rig.session.set_running(running=False))
    assert not rig.session.is_running
    assert rig.session.read_bits(D("Y10"), 1) == [False]
    counted = rig.session.read_words(D("D0"), 1)
    rig.scan(5)
    assert rig.session.read_words(D("D0"), 1) == counted
    rig.write(rig.session.set_running(running=True))
    assert rig.session.read_bits(D("Y10"), 1) == [True]


def test_the_devices_of_an_fx3u_are_accessible() -> None:
    live = LivePlc(FxPlc(read_il("LD M7013\nOUT Y0\nLD T511\nOUT S4095\nEND\n", cpu=FX3U), input_filter_ms=0))
    session = live.session("test")
    live.scan(0)
    bits = [(D("M7013"), True), (D("M7679"), True), (D("S4095"), True)]
    carried_out(session.write_bits(bits), lambda: live.scan(10))
    assert session.read_bits(D("Y0"), 1) == [True]
    assert session.read_bits(D("M7679"), 1) == [True]
    words = [(D("R0"), 0xFFFE), (D("R32767"), 7)]
    carried_out(session.write_words(words), lambda: live.scan(20))
    assert session.read_words(D("R32767"), 1) == [7]
    assert session.read_words(D("R0"), 2) == [0xFFFE, 0]
    assert live.plc.memory.word("R", 0) == -2
    assert session.read_words(D("D8511"), 1) == [0]
    for first, number in (("R32768", 1), ("R32767", 2), ("D8512", 1), ("D8511", 2)):
        with pytest.raises(AccessRefusedError):
            session.read_words(D(first), number)
    for first, number in (("M7680", 1), ("M7679", 2), ("S4096", 1), ("T512", 1)):
        with pytest.raises(AccessRefusedError):
            session.read_bits(D(first), number)


def test_a_timer_interrupt_runs_between_two_scans_of_a_live_program() -> None:
    program = "LD M8000\nFEND\nI610\nLD M8000\nINC D0\nIRET\nEND\n".replace("LD M8000\nFEND", "EI\nFEND")
    live = LivePlc(FxPlc(read_il(program), input_filter_ms=0))
    for now_ms in range(0, 1_001, 50):
        live.scan(now_ms)
    assert live.snapshots.latest is not None
    assert live.snapshots.latest.words["D"][0] == 100


@pytest.mark.nightly
def test_a_live_process_takes_cpu_and_modules(tmp_path: Path) -> None:
    path = tmp_path / "program.il"
    path.write_text("LD M7013\nOUT Y0\nEND\n", encoding="utf-8")
    options = ["--cpu", "fx3u", "--serve-mc", "3e", "--mc-port", "0"]
    with ExitStack() as stack:
        process = stack.enter_context(Process("ladder", ["controller", "ladder", "run", str(path), *options]))
        served = json.loads(process.next_line(LIMIT_S) or "{}")
        mc = stack.enter_context(McClient("127.0.0.1", served["mc_port"], Frame3E(), timeout_s=PATIENT_S))
        mc.write_bits(D("M7013"), [True])
        until(lambda: mc.read_bits(D("Y0"), 1) == (True,))
        assert process.stop() == 0


# --- processes --------------------------------------------------------------------------------------


@pytest.fixture
def program(tmp_path: Path) -> Path:
    path = tmp_path / "program.il"
    path.write_text(PROGRAM, encoding="utf-8")
    return path


def until(condition: Callable[[], bool]) -> None:
    for attempt in count():
        if condition():
            return
        assert attempt < ATTEMPTS, "condition not met"


def test_all_servers_of_a_process_show_the_same_devices(program: Path) -> None:
    """Modbus and MC protocol over TCP, the programming port on a pseudo-terminal; STOP and RUN from outside."""
    line = Master()
    with ExitStack() as stack:
        stack.callback(line.close)
        options = ["--serve-modbus", "--modbus-port", "0", "--serve-mc", "3e", "--mc-port", "0"]
        options += ["--serve-port", line.path, "--input-filter-ms", "0"]
        process = stack.enter_context(Process("ladder", ["controller", "ladder", "run", str(program), *options]))
        served = json.loads(process.next_line(LIMIT_S) or "{}")
        mc = stack.enter_context(McClient("127.0.0.1", served["mc_port"], Frame3E(), timeout_s=PATIENT_S))
        modbus = ModbusClient("127.0.0.1", served["modbus_port"], timeout=PATIENT_S)
        stack.callback(modbus.close)

        mc.write_bits(D("X10"), [True])
        until(lambda: mc.read_bits(D("Y7"), 3) == (False, True, False))
        assert modbus.read_discrete_inputs(discrete_address("X", 0o10), 1) == [True]
        assert modbus.write_single_coil(coil_address("M", 5), True)
        assert modbus.write_single_register(register_address("D", 100), 0x1234)
        until(lambda: mc.read_words(D("D100"), 1) == (0x1234,))
        assert mc.read_bits(D("M5"), 1) == (True,)

        line.send(b"\x05")
        assert line.receive(1) == b"\x06"
        line.send(encode(b"0008002"))
        assert line.receive(8) == encode(b"0001"), "X10 is bit 0 of the second byte of X"
        line.send(encode(b"70005"))  # force Y0, bit number 0500h
        assert line.receive(1) == b"\x06"
        until(lambda: mc.read_bits(D("Y0"), 1) == (True,))
        line.send(encode(b"2"))
        assert line.receive(1) == b"\x15"

        mc.request(RemoteStop())
        until(lambda: mc.read_bits(D("Y10"), 1) == (False,))
        mc.request(RemoteRun())
        until(lambda: mc.read_bits(D("Y10"), 1) == (True,))
        assert process.stop() == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "specify --stimulus FILE, or --serve-modbus"),
        (["--serve-modbus", "--json"], "no effect on a live program"),
        (["--serve-modbus", "--scan-ms", "0"], "--scan-ms 0: must be 1 to 1000"),
        (["--serve-mc", "1e", "--mc-port", "65536"], "--mc-port 65536: must be 0 to 65535"),
        (["--serve-modbus", "--pace", "0"], "--pace 0: must be 1 to 5000, or 65535"),
        (["--serve-modbus", "--pace", "6000"], "--pace 6000: must be 1 to 5000, or 65535"),
        (["--serve-modbus", "--input-filter-ms", "70"], "--input-filter-ms"),
        (["--serve-mc", "3e", "--host", "0.0.0.0"], "use --allow-remote"),  # noqa: S104 - refused
        (["--serve-port", "/dev/no-such-line"], "specify another --serve-port"),
    ],
)
def test_invalid_options_are_reported_in_one_line(
    program: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert controller(["ladder", "run", str(program), *options]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert message in line


def test_cpu_and_modules_apply_to_a_live_program(tmp_path: Path) -> None:
    """Devices and instructions of an FX3U, and FROM of a module, whose buffer has no other source."""
    program, modules = tmp_path / "fx3u.il", tmp_path / "modules.yaml"
    program.write_text(
        "LD M8000\nDEMOV E1.5 D0\nOUT M7600\nOUT T300 K1\nMOV R0 R32767\nFROM K0 K1 D10 K1\nEND\n", encoding="utf-8"
    )
    modules.write_text("modules:\n  - {position: 0, model: buffer, size: 2, initial: {1: 77}}\n", encoding="utf-8")
    options = ["--cpu", "fx3u", "--modules", str(modules), "--serve-mc", "3e", "--mc-port", "0"]
    options += ["--serve-modbus", "--modbus-port", "0"]
    with Process("ladder", ["controller", "ladder", "run", str(program), *options]) as process:
        served = json.loads(process.next_line(LIMIT_S) or "{}")
        modbus = ModbusClient("127.0.0.1", served["modbus_port"], timeout=PATIENT_S)
        with McClient("127.0.0.1", served["mc_port"], Frame3E(), timeout_s=PATIENT_S) as mc:
            mc.write_words(D("R0"), [0x1234])
            until(lambda: modbus.read_holding_registers(register_address("R", 32_767), 1) == [0x1234])
            assert modbus.write_single_register(register_address("R", 0), 0xFFFF)
            until(lambda: mc.read_words(D("R32767"), 1) == (0xFFFF,))
            modbus.close()
            until(lambda: mc.read_bits(D("M7600"), 1) == (True,))
            until(lambda: mc.read_bits(D("T300"), 1) == (True,))
            assert mc.read_words(D("D0"), 2) == (0, 0x3FC0), "1.5"
            assert mc.read_words(D("D10"), 1) == (77,)
            mc.write_bits(D("S4095"), [True])
            until(lambda: mc.read_bits(D("S4095"), 1) == (True,))
            with pytest.raises(RefusedError):
                mc.read_bits(D("M7600"), 400)
        assert process.stop() == 0


@pytest.mark.nightly
def test_a_port_in_use_is_reported_in_one_line(program: Path) -> None:
    with Process(
        "ladder", ["controller", "ladder", "run", str(program), "--serve-mc", "1e", "--mc-port", "0"]
    ) as first:
        port = json.loads(first.next_line(LIMIT_S) or "{}")["mc_port"]
        done = subprocess.run(
            [sys.executable, "-m", "controller", "ladder", "run", program, "--serve-mc", "1e", "--mc-port", str(port)],
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
    assert done.returncode == 2
    [message] = done.stderr.splitlines()
    assert "choose another --mc-port, or omit --serve-mc" in message
