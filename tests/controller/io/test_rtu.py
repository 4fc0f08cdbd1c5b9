"""Modbus RTU on a pseudo-terminal: requests, noise and invalid serial lines."""

from __future__ import annotations

import errno
import gc
import os
import select
import struct
import termios
from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from pymodbus.framer import FramerRTU

from controller.common.modbus.rtu import SerialError, SerialLine, request_length
from controller.common.serial_server import close_port, open_port
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.serving.endpoints import ServerError
from tests.controller.common.modbus_rig import PATIENT_S, Client, exception, read_pdu
from tests.controller.hmi.hmi_rig import READ_D0, HmiRig

UNIT = 17
LONG_START = bytes([UNIT, 16, 0, 0, 0, 100, 200])
"""Start of a long request; only the idle time of the line shows that it is incomplete."""
READ_M0 = read_pdu(1, 0, 8)
SILENCE_S = 0.3
"""Time without a byte after which no response is expected, s."""


def framed(pdu: bytes, unit: int = UNIT) -> bytes:
    body = bytes([unit]) + pdu
    return body + FramerRTU.compute_CRC(body).to_bytes(2)


class Master:
    """Modbus master at the other end of the serial line."""

    def __init__(self) -> None:
        self.end, self.line = os.openpty()
        self.path = os.ttyname(self.line)

    def send(self, data: bytes) -> None:
        assert os.write(self.end, data) == len(data)

    def receive(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            ready, _, _ = select.select([self.end], [], [], PATIENT_S)
            assert ready, f"only {data!r}"
            data += os.read(self.end, size - len(data))
        return data

    def receives_nothing(self) -> bool:
        return not select.select([self.end], [], [], SILENCE_S)[0]

    def ask(self, pdu: bytes, size: int) -> bytes:
        """Send a request and return the response PDU of `size` bytes."""
        self.send(framed(pdu))
        return self.answer(size)

    def answer(self, size: int) -> bytes:
        answer = self.receive(size + 3)
        assert answer == framed(answer[1:-2]), "wrong address or checksum"
        return answer[1:-2]

    def close(self) -> None:
        for number in (self.end, self.line):
            os.close(number)


@pytest.fixture
def master() -> Iterator[Master]:
    master = Master()
    yield master
    master.close()


@pytest.fixture
def rig(master: Master) -> Iterator[HmiRig]:
    with HmiRig(options=HmiOptions(port=0, serial=SerialLine(master.path, unit=UNIT))) as rig:
        yield rig


@pytest.mark.usefixtures("rig")
class TestRequests:
    """Answered and unanswered requests."""

    def test_valid_requests(self, master: Master) -> None:
        assert master.ask(READ_D0, 4)[:2] == b"\x03\x02"
        assert master.ask(READ_M0, 3)[:2] == b"\x01\x01"
        assert master.ask(read_pdu(4, 0x2040, 1), 2) == exception(4, 2)
        assert master.ask(b"\x2b\x0e\x04\x00", 8 + 2 + 21 - 1)[0] == 0x2B

    def test_an_unsupported_function(self, master: Master) -> None:
        assert master.ask(b"\x63", 2) == exception(0x63, 1)

    def test_an_invalid_checksum_is_not_answered_but_the_next_request_is(self, master: Master) -> None:
        valid = framed(READ_D0)
        master.send(valid[:-1] + bytes([valid[-1] ^ 1]))
        assert master.receives_nothing()
        assert master.ask(READ_M0, 3)[0] == 1
        assert master.receives_nothing()

    def test_another_unit_is_not_answered(self, master: Master) -> None:
        for unit in (1, 16, 18, 247):
            master.send(framed(READ_D0, unit))
        assert master.receives_nothing()
        assert master.ask(READ_M0, 3)[0] == 1

    def test_noise_before_a_request(self, master: Master) -> None:
        for noise in (
            b"\xff\x00\xa5",
            bytes([UNIT]),
            bytes([UNIT, 16, 0, 0, 0, 1, 2]),
            b"\x00\x03",
            b"\x11\x11\x03",
            LONG_START,
        ):
            master.send(noise + framed(READ_D0))
            assert master.answer(4)[:2] == b"\x03\x02"
        assert master.receives_nothing()

    def test_a_request_in_single_bytes(self, master: Master) -> None:
        for byte in framed(READ_D0):
            master.send(bytes([byte]))
        assert master.answer(4)[0] == 3

    def test_two_requests_back_to_back(self, master: Master) -> None:
        master.send(framed(READ_D0) + framed(READ_M0))
        assert [master.answer(4)[0], master.answer(3)[0]] == [3, 1]

    def test_an_incomplete_request_is_discarded(self, master: Master) -> None:
        master.send(framed(READ_D0)[:5])
        assert master.receives_nothing()
        assert master.ask(READ_M0, 3)[0] == 1


class TestWrites:
    """Writes by the master on the serial line."""

    def test_a_command_and_a_set_point(self, rig: HmiRig, master: Master) -> None:
        clamp = struct.pack(">BHH", 6, 523, 33)
        assert master.ask(clamp, 5) == clamp
        rig.twin.scan()
        assert rig.twin.plc.read(rig.twin.machine.tags.sp.pause_at_feed) == 33
        assert rig.audits == [(master.path, "", "set pause_at_feed", "33", "done")]

    def test_a_broadcast_is_executed_but_not_answered(self, rig: HmiRig, master: Master) -> None:
        master.send(framed(struct.pack(">BHH", 6, 523, 44), unit=0))
        assert master.receives_nothing()
        rig.twin.scan()
        assert rig.twin.plc.read(rig.twin.machine.tags.sp.pause_at_feed) == 44

    def test_a_write_with_an_invalid_checksum_changes_nothing(self, rig: HmiRig, master: Master) -> None:
        valid = framed(struct.pack(">BHHBH", 16, 523, 1, 2, 44))
        master.send(valid[:-2] + bytes(2))
        assert master.receives_nothing()
        rig.twin.scan()
        assert rig.audits == []


@pytest.mark.filterwarnings("error")
def test_a_disconnected_serial_line_does_not_affect_tcp(
    rig: HmiRig, master: Master, caplog: pytest.LogCaptureFixture
) -> None:
    """An unplugged adapter is logged in one line; TCP continues, and the server shuts down cleanly."""
    assert master.ask(READ_D0, 4)[0] == 3
    with rig.client() as client:
        master.close()
        master.end, master.line = os.open(os.devnull, os.O_RDONLY), os.open(os.devnull, os.O_RDONLY)
        for _ in range(300):
            assert client.ask(READ_D0)[0] == 3
    assert [record.levelname for record in caplog.records] == ["WARNING"]


def test_a_missing_serial_device_is_reported_in_one_line() -> None:
    options = HmiOptions(port=0, serial=SerialLine("/dev/no-such-line"))
    with pytest.raises(ServerError) as error, HmiRig(options=options):
        pass
    assert "/dev/no-such-line" in str(error.value)
    assert "--hmi-serial" in str(error.value)
    assert "\n" not in str(error.value)


def test_the_serial_settings_are_applied(master: Master) -> None:
    line = SerialLine(master.path, 38_400, "N", 2, UNIT)
    with ExitStack() as stack:
        stack.enter_context(HmiRig(options=HmiOptions(port=0, serial=line)))
        _, _, control, _, _, out_speed, _ = termios.tcgetattr(master.line)
        assert out_speed == termios.B38400
        assert control & termios.CSTOPB
        assert not control & termios.PARENB


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("/dev/ttyUSB0", SerialLine("/dev/ttyUSB0", 19_200, "E", 1, 1)),
        ("/dev/ttyUSB0:9600", SerialLine("/dev/ttyUSB0", 9_600, "E", 1, 1)),
        ("COM3:115200:8N2", SerialLine("COM3", 115_200, "N", 2, 1)),
        ("/dev/ttyS1:19200:8O1:247", SerialLine("/dev/ttyS1", 19_200, "O", 1, 247)),
    ],
)
def test_valid_serial_settings(text: str, line: SerialLine) -> None:
    assert SerialLine.parsed(text) == line


@pytest.mark.parametrize(
    "text",
    [
        *["", ":19200", "/dev/x:", "/dev/x:fast", "/dev/x:-1", "/dev/x:0", "/dev/x:9600:7E1", "/dev/x:9600:8X1"],
        *["/dev/x:9600:8E3", "/dev/x:9600:8E", "/dev/x:9600:8E1:0", "/dev/x:9600:8E1:248", "/dev/x:9600:8E1:one"],
        *["/dev/x:9600:8E1:1:1", "/dev/x:9600:8E1:", "/dev/x:9600::1"],
    ],
)
def test_invalid_serial_settings(text: str) -> None:
    with pytest.raises(SerialError, match="must be DEVICE:BAUD:FRAME:UNIT"):
        SerialLine.parsed(text)


@pytest.mark.parametrize(
    ("received", "length"),
    [
        (b"", None),
        (b"\x01", None),
        (b"\x01\x03", 8),
        (b"\x01\x2b", 7),
        (b"\x01\x63", 4),
        (b"\x01\x10\x00\x00\x00\x01", None),
        (b"\x01\x10\x00\x00\x00\x01\x02", 11),
        (b"\x01\x0f\x00\x00\x00\x09\x02", 11),
        (bytes([1, 23, *bytes(8), 4]), 17),
    ],
)
def test_the_length_of_a_request_follows_from_its_first_bytes(received: bytes, length: int | None) -> None:
    assert request_length(received) == length


def test_tcp_and_serial_clients_are_served_in_parallel(rig: HmiRig, master: Master) -> None:
    client: Client = rig.client()
    assert client.ask(READ_D0)[2:] == master.ask(READ_D0, 4)[2:]


def test_a_line_whose_closing_fails_leaves_no_descriptor_open(master: Master, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither now nor when the line is collected is a descriptor closed that has another file meanwhile."""
    before = {*os.listdir("/proc/self/fd")}
    port = open_port(master.path, 115_200, parity="N", stop_bits=1)
    close = os.close

    def fail(number: int) -> None:
        close(number)
        monkeypatch.undo()
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "close", fail)
    close_port(port)
    assert not port.is_open
    assert {*os.listdir("/proc/self/fd")} == before
    with open(os.devnull) as other:
        del port
        gc.collect()
        other.read()
