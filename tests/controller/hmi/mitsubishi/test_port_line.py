"""Programming port on a pseudo-terminal: unplugged and connected again, jogs, and a line that is already in use."""

from __future__ import annotations

import os
import select
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.fx_port import ACK, ENQ, NAK, ForceBit, ReadMemory, encode_bytes, encode_request
from controller.common.mitsubishi.fx_port_map import address_of, bit_number
from controller.common.modbus.rtu import SerialLine
from controller.common.serial_server import REOPEN_S
from controller.hmi.access.status_registers import R_NAME
from controller.hmi.mitsubishi.port_line import programming_port
from controller.hmi.mitsubishi.port_session import PortSession
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.serving.endpoints import ServerError
from tests.controller.common.modbus_rig import PATIENT_S
from tests.controller.hmi.hmi_rig import HmiRig, until
from tests.controller.hmi.scan_rig import answered, carried_out
from tests.controller.io.test_rtu import Master
from tests.controller.program.modes.hands import jog_command, to_manual

JOG = "left.lift_retract"
JOG_LIMIT_MS = 300
READ_D8001 = encode_request(ReadMemory("basic", address_of("basic", Device("D", 8001)), 2))
MODEL = encode_bytes(b"\x24\x5e")


def served(path: str, options: HmiOptions | None = None) -> HmiRig:
    return HmiRig(options=options, further=lambda source: [programming_port(source, path, "--fx-port")])


def jog(rig: HmiRig, name: str) -> bytes:
    """Return the request that presses a jog button."""
    command = Device("M", rig.twin.machine.tags.commands[name].number)
    return encode_request(ForceBit("basic", bit_number("basic", command), level=True))


@pytest.fixture
def master() -> Iterator[Master]:
    master = Master()
    yield master
    master.close()


def test_a_line_that_is_connected_again_is_served_again(tmp_path: Path) -> None:
    """An unplugged adapter: the jog ends, TCP clients are served throughout, and the new device file is opened."""
    device = tmp_path / "ttyUSB0"
    first, second = Master(), Master()
    tty.setraw(second.line)  # no echo before the server opens the line
    device.symlink_to(first.path)
    with served(str(device)) as rig:
        rig.twin.run_for(100)
        to_manual(rig.twin)
        name = jog_command(JOG)
        first.send(jog(rig, name))
        assert first.receive(1) == ACK
        device.unlink()
        first.close()
        bystander = rig.client()
        until(lambda: rig.audits[-1][2:] == (name, "0", "done"), bystander)
        device.symlink_to(second.path)
        deadline_s = time.perf_counter() + PATIENT_S
        while not select.select([second.end], [], [], REOPEN_S)[0]:  # repeats the request until it is answered
            assert time.perf_counter() < deadline_s
            second.send(ENQ)
        assert os.read(second.end, 1) == ACK
    second.close()


def test_a_line_in_use_is_refused_in_one_line(master: Master) -> None:
    """A serial line has one protocol: a second server would take bytes from the first."""
    options = HmiOptions(port=0, serial=SerialLine(master.path))
    with pytest.raises(ServerError, match=r"lock.*specify another --fx-port") as error, served(master.path, options):
        pass
    assert "\n" not in str(error.value)


def test_the_next_partner_on_a_line_does_not_inherit_the_name_of_the_operator() -> None:
    with HmiRig() as rig:
        session = rig.server.access.session("line")
        acknowledge = Device("M", rig.twin.machine.tags.commands["acknowledge"].number)
        name = [(Device("R", R_NAME + index), word) for index, word in enumerate([0x416E, 0x6E00, *[0] * 6])]
        carried_out(session.write_words(name), rig.twin.scan)
        carried_out(session.write_bits([(acknowledge, True)]), rig.twin.scan)
        session.on_disconnect()
        carried_out(session.write_bits([(acknowledge, True)]), rig.twin.scan)
        assert [row[1] for row in rig.audits] == ["Ann", ""]


@pytest.mark.parametrize("damaged", [False, True])
def test_a_jog_is_renewed_by_requests_but_not_by_damaged_frames(*, damaged: bool) -> None:
    with HmiRig() as rig:
        rig.twin.run_for(100)
        to_manual(rig.twin)
        port = PortSession(rig.server.access.session("line"))
        assert answered(port, jog(rig, jog_command(JOG)), rig.twin.scan) == ACK
        rig.twin.run_for(JOG_LIMIT_MS // 2)
        assert rig.coil(JOG)
        for _ in range(4):
            answer = answered(port, READ_D8001[:-1] + b"?" if damaged else READ_D8001, rig.twin.scan)
            assert answer == (NAK if damaged else MODEL)
            rig.twin.run_for(JOG_LIMIT_MS // 2)
        assert rig.coil(JOG) != damaged
