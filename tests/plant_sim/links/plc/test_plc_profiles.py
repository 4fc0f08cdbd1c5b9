"""Every delivered profile with a real counterpart: the exported program drives the machine in lock step.

The counterparts are servers that nobody here wrote (pyModbusTCP, modbus_tk), and an MC protocol server of the tests.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from modbus_tk import defines, modbus, modbus_rtu  # type: ignore[import-untyped]

from controller.common.modbus.async_client import AsyncRtuClient, AsyncTcpClient
from controller.common.modbus.rtu import SerialLine
from plant_sim.links.io_module import IoModule
from plant_sim.links.plc.mc import McPlc
from plant_sim.links.plc.modbus import ModbusPlc
from plant_sim.links.plc.profile import PlcProtocol, profile_names
from scripts.benchmark.live.serial_cable import SerialCable
from tests.controller.common.modbus_rig import IO_MAP, PATIENT_S
from tests.plant_sim.links.plc.mc_plc import Handler1E, Handler3E, mc_plc
from tests.plant_sim.links.plc.plc_rig import (
    ProgramOfPlc,
    Reference,
    homing,
    modbus_plc,
    profile_of,
    reference,
    run_in_lock_step,
)
from tests.sampling import first_of

OUTPUTS = IO_MAP.output_count
MODBUS = [name for name in profile_names() if profile_of(name).protocol is PlcProtocol.MODBUS]
SERIAL = [name for name in MODBUS if name.startswith("fx3u")]
UNIT = 17


def assert_equal(module: IoModule, expected: Reference) -> None:
    """Check that counts and complete state of the plant are those of the twin."""
    assert module.plant.counts() == expected.counts
    assert module.plant.state.tobytes() == expected.state


@pytest.mark.nightly
@pytest.mark.parametrize("name", first_of(MODBUS))
def test_a_program_behind_a_modbus_tcp_server_drives_the_machine_like_the_twin(name: str) -> None:
    profile, expected = profile_of(name), reference()
    with modbus_plc(profile, ProgramOfPlc().scan) as port:
        client = AsyncTcpClient("127.0.0.1", port, timeout_s=PATIENT_S)
        module = run_in_lock_step(ModbusPlc(profile, client, output_count=OUTPUTS), profile, expected)
    assert_equal(module, expected)
    assert expected.counts.in_cups > 10


@pytest.mark.nightly
def test_a_complete_trial_behind_a_modbus_server_has_the_counts_of_the_twin() -> None:
    """Two trays: 134 seedlings in cups, 4 P, 3 D, 3 T."""
    profile, expected = profile_of("fx3u-registers"), reference(2, None)
    with modbus_plc(profile, ProgramOfPlc(2).scan) as port:
        client = AsyncTcpClient("127.0.0.1", port, timeout_s=PATIENT_S)
        module = run_in_lock_step(ModbusPlc(profile, client, output_count=OUTPUTS), profile, expected, trays=2)
    assert_equal(module, expected)
    counts = module.plant.counts()
    assert (counts.in_cups, counts.P, counts.D, counts.T, counts.in_tray) == (134, 4, 3, 3, 0)


class SerialSlave(modbus.Slave):  # type: ignore[misc]
    """Slave of modbus_tk: a write of the inputs executes one scan of the program."""

    program: ProgramOfPlc
    inputs = outputs = (0, 0)

    def handle_request(self, request: bytes, broadcast: bool = False) -> bytes:
        if request[0] == 23:  # modbus_tk executes the read first; the write must take effect before it
            write = request[5:9] + request[9:]
            super().handle_request(bytes([16]) + write, broadcast)
            self._scan()
            return b"\x17" + bytes(super().handle_request(bytes([3]) + request[1:5], broadcast)[1:])
        answer: bytes = super().handle_request(request, broadcast)
        if request[0] in (15, 16):
            self._scan()
        return answer

    def _scan(self) -> None:
        values = self.get_values("inputs", self.inputs[0], self.inputs[1])
        is_words = self.inputs[1] < 32
        levels = [bool(word >> n & 1) for word in values for n in range(16)] if is_words else [bool(v) for v in values]
        y = self.program.scan(levels)
        words = [sum(on << n for n, on in enumerate(y[first : first + 16])) for first in (0, 16)]
        self.set_values("outputs", self.outputs[0], words if is_words else y)


@contextmanager
def serial_slave(name: str, path: str) -> Iterator[None]:
    """Run a PLC as Modbus RTU slave."""
    profile = profile_of(name)
    is_words = profile.function_23
    kind = defines.HOLDING_REGISTERS if is_words else defines.COILS
    slave = SerialSlave(UNIT)
    slave.program = ProgramOfPlc()
    input_bits = profile.input_bits(IO_MAP.input_count)
    for block, key, bits in ((profile.inputs, "inputs", input_bits), (profile.outputs, "outputs", 32)):
        length = bits // 16 if is_words else bits
        slave.add_block(key, kind, block.first, length)
        setattr(slave, key, (block.first, length))
    line = SerialLine(path, 115_200, "N", 1).open()
    server = modbus_rtu.RtuServer(line)
    server._databank._slaves[UNIT] = slave
    server.start()
    try:
        yield
    finally:
        server.stop()
        line.close()


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:isSet:DeprecationWarning")  # modbus_tk 1.1.5
@pytest.mark.parametrize("name", first_of(SERIAL))
def test_a_program_behind_a_serial_slave_drives_the_machine_like_the_twin(name: str) -> None:
    profile, expected = profile_of(name), homing(until_ms=2_000)
    with SerialCable() as cable, serial_slave(name, cable.ends[1]):
        client = AsyncRtuClient(SerialLine(cable.ends[0], 115_200, "N", 1, UNIT), timeout_s=PATIENT_S)
        module = run_in_lock_step(ModbusPlc(profile, client, output_count=OUTPUTS), profile, expected)
    assert_equal(module, expected)


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "handler"), first_of([("fx3u-enet", Handler1E), ("fx5u-slmp", Handler3E)]))
def test_a_program_behind_an_mc_server_drives_the_machine_like_the_twin(name: str, handler: type) -> None:
    profile, expected = profile_of(name), reference()
    with mc_plc(handler, ProgramOfPlc().scan) as port:
        plc = McPlc(profile, "127.0.0.1", port, output_count=OUTPUTS, timeout_s=PATIENT_S)
        module = run_in_lock_step(plc, profile, expected)
    assert_equal(module, expected)


def test_every_profile_has_a_counterpart() -> None:
    assert set(profile_names()) == {*MODBUS, "fx3u-enet", "fx5u-slmp"}
