"""The plant as a Modbus RTU server, with masters that nobody here wrote."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from modbus_tk import defines, modbus_rtu  # type: ignore[import-untyped]
from pymodbus.client import ModbusSerialClient

from controller.common.modbus.rtu import SerialLine, framed
from controller.common.serial_server import REOPEN_S
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.telemetry import TELEMETRY_REGISTERS, read_telemetry
from scripts.benchmark.live.serial_cable import SerialCable
from tests.controller.common.modbus_rig import PATIENT_S, READ_ALL_INPUTS, read_registers
from tests.plant_sim.links.block_rig import Rig, make_module

UNIT = 3
BAUD = 115_200


@contextmanager
def served(cable: SerialCable, *, lock_step_ms: int | None = 10, models_wire: bool = False) -> Iterator[Rig]:
    line = SerialLine(cable.ends[1], BAUD, "N", 1, UNIT)
    server = PlantServer(make_module(), port=0, lock_step_ms=lock_step_ms, serial=line, models_wire=models_wire)
    with Rig(server) as rig:
        yield rig


def test_pymodbus_reads_and_writes_over_the_line() -> None:
    """Inputs, outputs, buttons and telemetry; each complete write of the outputs is a step of plant time."""
    with SerialCable() as cable, served(cable) as rig:
        client = ModbusSerialClient(cable.ends[0], baudrate=BAUD, timeout=PATIENT_S, retries=0)
        assert client.connect()
        assert client.read_discrete_inputs(0, count=22, device_id=UNIT).bits[:22] == rig.module.inputs()[:22]
        for scan in range(1, 4):
            assert not client.write_coils(0, [False] * 5 + [True] + [False] * 12, device_id=UNIT).isError()
            assert rig.module.plant.time_ms == 10 * scan
        assert client.read_coils(0, count=18, device_id=UNIT).bits[5]
        client.write_coil(100, True, device_id=UNIT)
        assert rig.module.plant.box.start
        reply = client.read_input_registers(0, count=TELEMETRY_REGISTERS, device_id=UNIT)
        assert read_telemetry(reply.registers)["y_image"] == 1 << 5
        assert client.write_coils(0, [False] * 19, device_id=UNIT).exception_code == 2
        client.close()  # type: ignore[no-untyped-call]


def test_modbus_tk_and_a_tcp_client_share_one_lease() -> None:
    """The line has the lease of the outputs; a TCP client reads the same image, but is refused."""
    with SerialCable() as cable, served(cable) as rig:
        master = modbus_rtu.RtuMaster(SerialLine(cable.ends[0], BAUD, "N", 1).open())
        master.set_timeout(PATIENT_S)
        assert master.execute(UNIT, defines.WRITE_MULTIPLE_COILS, 0, output_value=[0] * 18) == (0, 18)
        levels = master.execute(UNIT, defines.READ_DISCRETE_INPUTS, 0, 22)
        client = rig.client()
        assert client.ask(READ_ALL_INPUTS)[2:] == sum(on << n for n, on in enumerate(levels)).to_bytes(3, "little")
        assert client.ask(b"\x05\x00\x05\xff\x00") == b"\x85\x06"
        assert rig.module.lease.owner == cable.ends[1]
        master.close()


def test_the_watchdog_trips_when_the_cable_is_cut() -> None:
    with SerialCable() as cable, served(cable, lock_step_ms=None) as rig:
        client = ModbusSerialClient(cable.ends[0], baudrate=BAUD, timeout=PATIENT_S, retries=0)
        assert client.connect()
        client.write_coils(0, [False] * 5 + [True] + [False] * 12, device_id=UNIT)
        cable.is_cut = True
        observer = rig.client()
        while not rig.thread.call(lambda: rig.module.tripped):
            pass
        telemetry = read_registers(observer)
        assert telemetry["y_image"] == 0
        assert telemetry["tripped_at_ms"] == telemetry["last_write_ms"] + 101
        cable.is_cut = False
        assert client.write_coils(0, [False] * 5 + [True] + [False] * 12, device_id=UNIT).exception_code == 4
        assert not client.write_coils(0, [False] * 18, device_id=UNIT).isError()
        client.close()  # type: ignore[no-untyped-call]


def test_the_transmission_time_is_modelled() -> None:
    """A read of the inputs at 115,200 baud 8N1: 8 + 8 bytes of 10 bits, and the silence of 1.75 ms."""
    line = SerialLine("", BAUD, "N", 1)
    expected_s = line.wire_s(8) + line.silence_s + line.wire_s(8)
    assert expected_s == pytest.approx(0.00314, abs=1e-5)
    with SerialCable() as cable, served(cable, models_wire=True):
        port = os.open(cable.ends[0], os.O_RDWR | os.O_NOCTTY)
        try:
            start_s = time.perf_counter()
            os.write(port, framed(UNIT, READ_ALL_INPUTS))
            answer = b""
            while len(answer) < 8:
                assert select.select([port], [], [], PATIENT_S)[0]
                answer += os.read(port, 8)
            assert time.perf_counter() - start_s >= expected_s
        finally:
            os.close(port)
    assert answer[:3] == bytes([UNIT, 2, 3])


@pytest.mark.parametrize(
    ("line", "silence_ms"),
    [(SerialLine("", 9_600, "E", 1), 4.01), (SerialLine("", 19_200, "E", 1), 2.01), (SerialLine("", 38_400), 1.75)],
)
def test_the_silence_between_frames_is_that_of_the_specification(line: SerialLine, silence_ms: float) -> None:
    """3.5 characters of 11 bits, or 1.75 ms above 19,200 baud. Source: Modbus over Serial Line V1.02, 2.5.1.1."""
    assert 1e3 * line.silence_s == pytest.approx(silence_ms, abs=0.005)


def test_a_line_that_is_connected_again_is_served_again(tmp_path: Path) -> None:
    """An unplugged adapter: the device file vanishes, and later exists again; TCP clients are served throughout."""
    device = tmp_path / "ttyUSB0"
    first_master, first = os.openpty()
    device.symlink_to(os.ttyname(first))
    line = SerialLine(str(device), BAUD, "N", 1, UNIT)
    with Rig(PlantServer(make_module(), port=0, lock_step_ms=10, serial=line)) as rig:
        os.write(first_master, framed(UNIT, READ_ALL_INPUTS))
        assert os.read(first_master, 8)[:2] == bytes([UNIT, 2])
        device.unlink()
        os.close(first)
        os.close(first_master)
        client = rig.client()
        assert client.ask(READ_ALL_INPUTS)[0] == 2
        with SerialCable() as cable:
            device.symlink_to(cable.ends[1])
            port = os.open(cable.ends[0], os.O_RDWR | os.O_NOCTTY)
            try:
                deadline = time.perf_counter() + PATIENT_S
                while not select.select([port], [], [], REOPEN_S)[0]:  # repeats the request until it is answered
                    assert time.perf_counter() < deadline
                    os.write(port, framed(UNIT, READ_ALL_INPUTS))
                assert os.read(port, 8)[:2] == bytes([UNIT, 2])
            finally:
                os.close(port)
            rig.thread.call(rig.server.end)
