"""Programming port without a line: recorded telegrams, monitoring, forces, damaged and incomplete frames."""

from __future__ import annotations

import random

import pytest

from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.fx_port import (
    ForceBit,
    ReadMemory,
    Space,
    WriteMemory,
    decode_bytes,
    encode,
    encode_request,
)
from controller.common.mitsubishi.fx_port_map import address_of, bit_number
from controller.fx.engine.plc import FxPlc
from controller.fx.language.il import read_il
from controller.hmi.ladder.live import LivePlc
from controller.hmi.mitsubishi.port_session import PortSession
from tests.controller.common.mitsubishi.test_port_frames import telegrams
from tests.controller.hmi.hmi_rig import HmiRig
from tests.controller.hmi.scan_rig import answered, carried_out
from tests.controller.hmi.test_writes import record_commands

ACK, NAK = b"\x06", b"\x15"
PROGRAM = "LD X10\nOUT Y10\nOUT T0 K5\nLD X11\nOUT C0 K9\nLD M10\nMOV D10 D11\nEND\n"
D = Device.parsed


class PortRig:
    """Live program with a programming port; `ask` executes one scan after the request."""

    def __init__(self) -> None:
        self.live = LivePlc(FxPlc(read_il(PROGRAM), input_filter_ms=0))
        self.port = PortSession(self.live.session("line"))
        self.now_ms = 0
        self.scan()

    def scan(self, scans: int = 1) -> None:
        for _ in range(scans):
            self.live.scan(self.now_ms)
            self.now_ms += 10

    def ask(self, request: ReadMemory | WriteMemory | ForceBit) -> bytes:
        answer = self.feed(encode_request(request))
        self.scan()
        return answer

    def feed(self, data: bytes) -> bytes:
        return answered(self.port, data, self.scan)

    def read(self, space: Space, device: str, count: int) -> bytes:
        return decode_bytes(self.ask(ReadMemory(space, address_of(space, D(device)), count)))

    def force(self, space: Space, device: str, *, level: bool) -> bytes:
        return self.ask(ForceBit(space, bit_number(space, D(device)), level))


@pytest.fixture
def rig() -> PortRig:
    return PortRig()


FX2N_MODEL = b"\x02245E\x03E3"
MONITORING = [
    (source, sent, received) for source, sent, received in telegrams() if "/Monitoring" in source and sent != b"\x05"
]


def test_gx_works2_is_answered_as_in_the_recording_with_the_model_of_an_fx2n(rig: PortRig) -> None:
    """Connecting and monitoring in STOP: same answers, except for the values of D8000-D8127."""
    carried_out(rig.live.session("test").set_running(running=False), rig.scan)
    assert len(MONITORING) == 18
    assert rig.feed(b"\x05") == ACK
    for source, sent, received in MONITORING:
        answer = rig.feed(sent)
        if sent.startswith(b"\x02E000E"):
            assert len(answer) == len(received), source
        else:
            assert answer == received, (source, sent)
    registers = decode_bytes(rig.feed(encode(b"E000E0040")))
    assert registers[:6] == bytes.fromhex("C800245E0800"), "watchdog 200 ms, model 24100, 8 thousand steps"


def test_requests_that_need_the_program_are_refused(rig: PortRig) -> None:
    for text in (b"E01805CFE", b"E11805E020FB4", b"E41805C0F00", b"B", b"EC39427B1F1", b"F501108006", b"2"):
        assert rig.feed(encode(text)) == NAK


@pytest.mark.parametrize("space", ["basic", "extended"])
def test_every_kind_of_device_is_read_and_written(rig: PortRig, space: Space) -> None:
    assert rig.force(space, "X10", level=True) == ACK
    rig.scan(60)
    assert rig.read(space, "X10", 1) == b"\x01", "octal: X10 is the first bit of the second byte"
    assert rig.read(space, "Y0", 2) == b"\x00\x01"
    assert rig.read(space, "T0", 1) == b"\x01"
    assert rig.read(space, "TN0", 2) == b"\x05\x00"
    for _ in range(2):
        rig.force(space, "X11", level=True)
        rig.force(space, "X11", level=False)
    assert rig.read(space, "CN0", 2) == b"\x02\x00"
    assert rig.ask(WriteMemory(space, address_of(space, D("D10")), b"\xfe\xff")) == ACK
    assert rig.force(space, "M10", level=True) == ACK
    assert rig.read(space, "D10", 4) == b"\xfe\xff\xfe\xff"
    assert rig.live.plc.memory.D[11] == -2
    assert rig.force(space, "S20", level=True) == ACK
    assert rig.read(space, "S20", 1) == b"\x10"
    assert rig.ask(WriteMemory(space, address_of(space, D("CN201")), (-3).to_bytes(4, "little", signed=True))) == ACK
    assert rig.live.plc.memory.CV[201] == -3
    assert rig.read(space, "CN201", 4) == (-3).to_bytes(4, "little", signed=True)


def test_the_watch_list_shows_words_and_bits(rig: PortRig) -> None:
    rig.force("extended", "X10", level=True)
    rig.ask(WriteMemory("extended", address_of("extended", D("D10")), b"\x34\x12"))
    rig.scan(3)
    entries = [address_of("extended", D("D10")), address_of("extended", D("TN0"))]
    entries += [bit_number("extended", D(name)) for name in ("X10", "Y10", "M10", "T0")] + [0x2700, 0x2800]
    listed = bytes([2, 0x81, 6, 0]) + b"".join(entry.to_bytes(2, "little") for entry in entries)
    assert rig.ask(WriteMemory("extended", 0x1400, listed)) == ACK
    values = decode_bytes(rig.ask(ReadMemory("extended", 0x1790, 5)))
    assert values[:2] == b"\x34\x12"
    assert values[4] == 0b000011, "X10 and Y10; at 2700h and 2800h there is no known device"


def test_remote_stop_and_run_are_the_relays_that_gx_works2_forces(rig: PortRig) -> None:
    rig.scan()
    assert rig.read("extended", "M8000", 1) == b"\x09", "the recorded status of a real PLC in RUN"
    assert rig.force("extended", "M8037", level=True) == ACK
    rig.scan()
    assert not rig.live.plc.running
    assert rig.read("extended", "M8000", 1) == b"\x0a", "the recorded status of a real PLC in STOP"
    assert rig.force("extended", "M8037", level=False) == ACK
    assert rig.force("extended", "M8035", level=True) == ACK
    assert rig.force("extended", "M8036", level=True) == ACK
    rig.scan()
    assert rig.live.plc.running


@pytest.mark.parametrize(
    "request_",
    [
        ReadMemory("basic", 0x0300, 2),
        ReadMemory("basic", 0x4E7F, 2),
        ReadMemory("extended", 0x7E7F, 2),
        ReadMemory("program", 0x8000, 93),
        WriteMemory("basic", 0x1001, b"\x01\x02"),
        WriteMemory("basic", 0x1000, b"\x01"),
        WriteMemory("basic", 0x7FFE, b"\x01\x02"),
        WriteMemory("extended", 0x178F, b"\x01\x02"),
        ForceBit("extended", 0x2700, level=True),
        ForceBit("basic", 0x3FFF, level=True),
    ],
)
def test_addresses_without_a_device_are_refused(rig: PortRig, request_: ReadMemory | WriteMemory | ForceBit) -> None:
    before = rig.live.plc.memory.D.copy()
    assert rig.ask(request_) == NAK
    assert rig.live.plc.memory.D.copy()[:8000] == before[:8000]


def test_a_damaged_frame_is_refused_and_the_next_is_answered(rig: PortRig) -> None:
    good = encode(b"00E0202")
    assert rig.feed(good[:-1] + b"0" + good) == NAK + FX2N_MODEL


def test_frames_are_found_in_pieces_and_after_noise(rig: PortRig) -> None:
    good = encode(b"00E0202")
    answers = [rig.feed(bytes([byte])) for byte in b"\xff\x00A" + good]
    assert b"".join(answers) == FX2N_MODEL
    assert rig.feed(good[:6] + good) == FX2N_MODEL, "a cut frame is dropped when the next one starts"
    assert rig.feed(b"\x02" + b"0" * 2_000) == b""
    assert rig.feed(good) == FX2N_MODEL
    rig.feed(good[:6])
    rig.port.discard()
    assert rig.feed(good[6:] + good) == FX2N_MODEL


def test_mutated_frames_do_no_harm(rig: PortRig) -> None:
    """3,000 mutated recordings, seed 1: an answer is ACK, NAK or a frame, and a good request is answered afterwards."""
    generator = random.Random(1)
    frames = [sent for _, sent, _ in telegrams()]
    for _ in range(3_000):
        data = bytearray(generator.choice(frames))
        for _ in range(generator.randint(1, 4)):
            position = generator.randrange(len(data))
            data[position : position + generator.randint(0, 2)] = generator.randbytes(generator.randint(0, 2))
            data += b"" if data else b"\x02"
        answer = rig.feed(bytes(data))
        assert set(answer[:1]) <= {0x02, 0x05, 0x06, 0x15}
        rig.port.discard()
        assert rig.feed(encode(b"00E0202")) == FX2N_MODEL


# --- the machine's program, with a whitelist --------------------------------------------------------


def test_the_whitelist_of_the_machine_applies_to_forces_and_writes() -> None:
    with HmiRig() as hmi:
        port = PortSession(hmi.server.access.session("line"))
        tags = hmi.twin.machine.tags
        target = Device("D", tags.sp.trays_target.number)
        seen = record_commands(hmi)

        def ask(request: ReadMemory | WriteMemory | ForceBit) -> bytes:
            return answered(port, encode_request(request), hmi.twin.scan)

        for space in ("basic", "extended"):
            assert ask(WriteMemory(space, address_of(space, target), b"\x07\x00")) == ACK
            acknowledge = Device("M", tags.commands["acknowledge"].number)
            assert ask(ForceBit(space, bit_number(space, acknowledge), level=True)) == ACK
            assert seen[-1] == {"acknowledge"}
            assert hmi.twin.plc.memory.D[target.number] == 7
            before = (hmi.twin.plc.memory.Y.copy(), hmi.twin.plc.memory.D.copy(), hmi.twin.plc.memory.M.copy())
            audited = len(hmi.audits)
            for name in ("Y0", "X10", "M0", "S0", "T0", "C0", "M8037", "M8034"):
                assert ask(ForceBit(space, bit_number(space, D(name)), level=True)) == NAK, name
            for name in ("D100", "TN0", "CN0", "D8000"):
                assert ask(WriteMemory(space, address_of(space, D(name)), b"\x01\x00")) == NAK, name
            assert ask(WriteMemory(space, address_of(space, D("Y0")), b"\xff")) == NAK
            assert ask(WriteMemory(space, address_of(space, target), b"\xff\x7f")) == NAK, "out of range"
            after = (hmi.twin.plc.memory.Y.copy(), hmi.twin.plc.memory.D.copy(), hmi.twin.plc.memory.M.copy())
            assert after == before
            assert ask(WriteMemory(space, address_of(space, target) + 1, b"\x07")) == NAK, "half of a word"
            assert ask(ForceBit(space, 0xFFFF, level=True)) == NAK, "no device"
            assert ask(WriteMemory("program", 0x805C, b"\0")) == NAK, "the program"
            assert len(hmi.audits) == audited + 17
            assert {row[0] for row in hmi.audits} == {"line"}
        assert decode_bytes(ask(ReadMemory("basic", 0x0E02, 2))) == b"\x24\x5e", "the model of an FX2N"
