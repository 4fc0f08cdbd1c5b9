"""Every delivered profile with a real counterpart: the exported program drives the machine in lock step."""

from __future__ import annotations

import pytest

from plant_sim.links.plc.modbus import ModbusPlc
from plant_sim.links.plc.profile import PlcProtocol, profile_names
from plant_sim.links.plc.transport import TcpTransport
from tests.controller.common.modbus_rig import IO_MAP, PATIENT_S
from tests.plant_sim.links.plc.plc_rig import ProgramOfPlc, modbus_plc, profile_of, reference, run_in_lock_step

MODBUS = [name for name in profile_names() if profile_of(name).protocol is PlcProtocol.MODBUS]


@pytest.mark.parametrize("name", MODBUS)
def test_the_program_behind_a_modbus_server_drives_the_machine_like_the_twin(name: str) -> None:
    """Counts and the complete state of the plant are those of the twin."""
    profile, expected = profile_of(name), reference()
    with modbus_plc(profile, ProgramOfPlc().scan) as port:
        transport = TcpTransport("127.0.0.1", port, unit=1, timeout_s=PATIENT_S)
        module = run_in_lock_step(ModbusPlc(profile, transport, output_count=IO_MAP.output_count), profile, expected)
    assert module.plant.counts() == expected.counts
    assert module.plant.state.tobytes() == expected.state
    assert expected.counts.in_cups > 5
