"""MC protocol in front of the machine's program: reads, permitted and refused writes, connections, damaged data."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from controller.common.mitsubishi.client import McClient
from controller.common.mitsubishi.devices import Device
from controller.common.mitsubishi.mc1e import TOO_MANY_POINTS, Frame1E
from controller.common.mitsubishi.mc3e import Frame3E
from controller.common.mitsubishi.requests import (
    ReadBits,
    ReadBlocks,
    ReadRandom,
    ReadTypeName,
    ReadWords,
    RefusedError,
    RemoteStop,
    Request,
    SelfTest,
    TypeName,
    WriteBits,
    WriteBlocks,
    WriteRandomBits,
    WriteRandomWords,
    WriteWords,
)
from controller.core.devices import Memory
from controller.hmi.modbus.endpoint import HmiOptions
from controller.hmi.serving.endpoints import ServerError, TcpSettings
from plant_sim.twin.lock_step import Twin
from tests.controller.hmi.hmi_rig import IDLE_S, HmiRig, let_pass, until
from tests.controller.hmi.mitsubishi.mc_rig import FORMS, AnyFrame, McRig, RawClient
from tests.controller.hmi.test_writes import record_commands
from tests.controller.program.modes.hands import jog_command, to_manual
from tests.sampling import first_of, one_in

D = Device.parsed
SERVER_1E = {"no device": (0x57, 0), "not writable": (0x5B, 0x11), "bad value": (0x5B, 0x11), "remote": (0x5B, 0x18)}
SERVER_3E = {"no device": (0xC056, 0), "not writable": (0xC05B, 0), "bad value": (0xC05C, 0), "remote": (0xC05F, 0)}


@pytest.fixture(scope="module", params=list(FORMS.values()), ids=list(FORMS))
def running(request: pytest.FixtureRequest) -> Iterator[McRig]:
    with McRig(request.param) as rig:
        rig.hmi.twin.run_for(500)
        yield rig


@pytest.fixture
def shared(running: McRig) -> Iterator[McRig]:
    """Server for tests that change nothing."""
    yield running
    running.close_clients()


@pytest.fixture(params=list(FORMS.values()), ids=list(FORMS))
def rig(request: pytest.FixtureRequest) -> Iterator[McRig]:
    with McRig(request.param) as rig:
        yield rig


def codes(frame: AnyFrame) -> dict[str, tuple[int, int]]:
    return SERVER_1E if isinstance(frame, Frame1E) else SERVER_3E


def refused(client: McClient, request: Request) -> tuple[int, int]:
    """Return the end code and the abnormal code with which a request is refused."""
    with pytest.raises(RefusedError) as error:
        client.request(request)
    return error.value.code, error.value.abnormal_code


def unsigned(words: list[int]) -> tuple[int, ...]:
    return tuple(word & 0xFFFF for word in words)


# --- reads ----------------------------------------------------------------------------------------


def test_every_kind_of_device_is_read_as_the_program_has_it(shared: McRig) -> None:
    memory: Memory = shared.hmi.twin.plc.memory
    client = shared.client()
    for kind in "XYMSTC":
        bits = memory.bits(kind)
        assert client.read_bits(Device(kind, 0), 200) == tuple(bits[:200]), kind
        words = client.read_words(Device(kind, 0), 4)
        assert [words[bit // 16] >> bit % 16 & 1 for bit in range(64)] == bits[:64], kind
    assert client.read_bits(D("M8000"), 16) == tuple(memory.M[8000:8016])
    assert client.read_words(D("D100"), 50) == unsigned(memory.D[100:150])
    assert client.read_words(D("D8000"), 64) == unsigned(memory.D[8000:8064])
    assert client.read_words(D("TN0"), 64) == unsigned(memory.TV[:64])
    assert client.read_words(D("CN0"), 64) == unsigned(memory.CV[:64])
    assert any(memory.X), "the comparison of X means something"


def test_x10_is_the_ninth_input(shared: McRig) -> None:
    client, inputs = shared.client(), shared.hmi.twin.plc.memory.X
    for label, number in (("X7", 7), ("X10", 8), ("X17", 15), ("X20", 16)):
        assert client.read_bits(D(label), 1) == (inputs[number],)


def test_status_registers_are_read(shared: McRig) -> None:
    low, high = shared.client().read_words(D("R0"), 2)
    assert low | high << 16 == shared.hmi.twin.plc.scans


@pytest.mark.parametrize(
    "request_",
    [
        ReadBits(D("M3064"), 16),
        ReadBits(D("M4000"), 1),
        ReadBits(D("X370"), 16),
        ReadBits(D("S999"), 2),
        ReadWords(D("D8250"), 10),
        ReadWords(D("TN250"), 10),
        ReadWords(D("CN250"), 20),
        ReadWords(D("R320"), 20),
        ReadWords(D("X360"), 2),
    ],
)
def test_devices_that_do_not_exist_are_refused(shared: McRig, request_: Request) -> None:
    assert refused(shared.client(), request_) == codes(shared.frame)["no device"]


def test_model_and_self_test(shared: McRig) -> None:
    client = shared.client()
    is_1e = isinstance(shared.frame, Frame1E)
    assert client.type_name() == (TypeName(0xF3) if is_1e else TypeName(0x4A23, "FX5UCPU"))
    assert client.request(SelfTest(b"ABCDE")) == b"ABCDE"


@pytest.mark.parametrize("frame", [form for form in FORMS.values() if isinstance(form, Frame3E)])
def test_random_and_block_reads(frame: Frame3E) -> None:
    with McRig(frame) as rig:
        memory = rig.hmi.twin.plc.memory
        client = rig.client()
        assert client.request(ReadRandom((D("D8000"), D("M8000")), (D("D100"), D("CN200")))) == (
            memory.D[8000],
            sum(level << bit for bit, level in enumerate(memory.M[8000:8016])),
            memory.D[100] & 0xFFFF | (memory.D[101] & 0xFFFF) << 16,
            memory.CV[200],
        )
        blocks = ReadBlocks((ReadWords(D("D8000"), 2),), (ReadWords(D("M8000"), 1),))
        assert client.request(blocks) == (
            *unsigned(memory.D[8000:8002]),
            sum(level << bit for bit, level in enumerate(memory.M[8000:8016])),
        )
        assert client.read_bits(Device("SM", 8000), 4) == tuple(memory.M[8000:8004])
        assert client.read_words(Device("SD", 8000), 1) == (memory.D[8000],)
        assert refused(client, ReadBits(Device("SM", 400), 1))[0] == 0xC056
        assert refused(client, ReadWords(D("M3056"), 320))[0] == 0xC056, "M3072 to M7999 do not exist"


# --- writes ---------------------------------------------------------------------------------------


def image(rig: McRig) -> tuple[list[Any], ...]:
    memory = rig.hmi.twin.plc.memory
    return (*(memory.bits(kind).copy() for kind in "XYMSTC"), memory.D.copy(), memory.TV.copy(), memory.CV.copy())


def set_point(rig: McRig, name: str) -> Device:
    return Device("D", getattr(rig.hmi.twin.machine.tags.sp, name).number)


def command(rig: McRig, name: str) -> Device:
    return Device("M", rig.hmi.twin.machine.tags.commands[name].number)


def test_commands_and_set_points_are_written_and_audited(rig: McRig) -> None:
    client, twin = rig.client(), rig.hmi.twin
    seen = record_commands(rig.hmi)
    target = set_point(rig, "trays_target")
    client.write_words(target, [7])
    client.write_bits(command(rig, "acknowledge"), [True])
    assert twin.plc.memory.D[target.number] == 7
    assert seen == [set(), {"acknowledge"}]
    assert [row[2:] for row in rig.hmi.audits] == [("set trays_target", "7", "done"), ("acknowledge", "1", "done")]
    client.request(WriteRandomBits(((command(rig, "acknowledge"), True),)))
    client.request(WriteRandomWords(((target, 9),)))
    assert seen[2:] == [{"acknowledge"}, set()]
    assert twin.plc.memory.D[target.number] == 9
    assert len(rig.hmi.audits) == 4


@pytest.mark.parametrize(
    ("request_", "refusal"),
    one_in(
        3,
        [
            (RemoteStop(), "remote"),
            (WriteBits(D("Y0"), (True,)), "not writable"),
            (WriteBits(D("X10"), (True,)), "not writable"),
            (WriteBits(D("M8034"), (True,)), "not writable"),
            (WriteBits(D("M0"), (True,)), "not writable"),
            (WriteBits(D("S0"), (True,)), "not writable"),
            (WriteBits(D("M5000"), (True,)), "no device"),
            (WriteBits(D("T0"), (True,)), "not writable"),
            (WriteBits(D("C0"), (True,)), "not writable"),
            (WriteRandomBits(((D("Y0"), True),)), "not writable"),
            (WriteWords(D("D100"), (1,)), "not writable"),
            (WriteWords(D("D8000"), (1,)), "not writable"),
            (WriteRandomWords(((D("D100"), 1),)), "not writable"),
            (WriteWords(D("TN0"), (1,)), "not writable"),
            (WriteWords(D("CN0"), (1,)), "not writable"),
            (WriteWords(D("D8300"), (1,)), "no device"),
            (WriteWords(D("R0"), (1,)), "not writable"),
            (WriteWords(D("Y0"), (1,)), "not writable"),
        ],
    ),
)
def test_other_writes_are_refused_and_change_nothing(rig: McRig, request_: Request, refusal: str) -> None:
    before = image(rig)
    client = rig.client()
    assert refused(client, request_) == codes(rig.frame)[refusal]
    assert image(rig) == before
    assert rig.hmi.server.access.refused_writes == 1
    [row] = rig.hmi.audits
    assert row[4].startswith("refused")
    peer_port = int(row[0].rpartition(":")[2])
    assert client._socket is not None
    assert client._socket.getsockname()[1] == peer_port


def test_a_set_point_out_of_range_or_beside_another_device_is_refused_as_a_whole(rig: McRig) -> None:
    client = rig.client()
    first, value = set_point(rig, "trays_target"), rig.hmi.twin.plc.memory.D[set_point(rig, "trays_target").number]
    assert refused(client, WriteWords(first, (60_000,))) == codes(rig.frame)["bad value"]
    assert refused(client, WriteWords(Device("TN", first.number), (5,))) == codes(rig.frame)["no device"]
    pair = WriteRandomWords(((first, 5), (D("D100"), 1)))
    assert refused(client, pair) == codes(rig.frame)["not writable"]
    rig.hmi.twin.scan()
    assert rig.hmi.twin.plc.memory.D[first.number] == value


def test_writes_without_a_target_are_in_the_audit_log_and_change_nothing() -> None:
    """Half of a 32-bit counter, bits together with words, and a special device that an FX2N does not have."""
    with McRig(Frame3E()) as rig:
        before = image(rig)
        client, target = rig.client(), set_point(rig, "trays_target")
        bits = (WriteWords(command(rig, "acknowledge"), (1,)),)
        for request, code in (
            (WriteWords(D("CN200"), (1,)), 0xC05C),
            (WriteBlocks((WriteWords(target, (7,)),), bits), 0xC05F),
            (WriteBits(Device("SM", 400), (True,)), 0xC056),
        ):
            assert refused(client, request)[0] == code
        assert [row[2] for row in rig.hmi.audits] == ["WriteWords", "WriteBlocks", "WriteBits"]
        assert all(row[4].startswith("refused: ") for row in rig.hmi.audits)
        rig.hmi.twin.scan()
        assert rig.hmi.twin.plc.memory.D[target.number] == before[6][target.number]


@pytest.mark.parametrize("request_", [ReadWords(D("CN199"), 2), ReadWords(D("CN200"), 1), ReadWords(D("CN200"), 3)])
def test_half_of_a_32_bit_value_is_not_read(shared: McRig, request_: ReadWords) -> None:
    client = shared.client()
    no_device = (TOO_MANY_POINTS, 0) if isinstance(shared.frame, Frame1E) else codes(shared.frame)["no device"]
    assert refused(client, request_) == no_device
    assert len(client.read_words(D("CN199"), 3)) == 3


def test_a_jog_ends_with_its_connection() -> None:
    """Lease of the jog: any request renews it, and closing the connection releases it, as with Modbus."""
    with McRig(Frame3E()) as rig:
        twin = rig.hmi.twin
        rig.hmi.twin.run_for(100)
        to_manual(twin)
        name = jog_command("left.lift_retract")
        client = rig.client()
        client.write_bits(command(rig, name), [True])
        twin.run_for(50)
        client.read_bits(D("M0"), 1)
        bystander = rig.hmi.client()
        client.close()
        until(lambda: rig.hmi.audits[-1][2:] == (name, "0", "done"), bystander)


# --- connections ----------------------------------------------------------------------------------


def test_requests_in_one_segment_and_in_pieces_are_answered_in_order(shared: McRig) -> None:
    requests = [ReadWords(Device("D", number), 1) for number in (8000, 100, 8000, 512)] * 8
    frames = [shared.frame.encode_request(request) for request in requests]
    memory = shared.hmi.twin.plc.memory
    expected = b"".join(
        shared.frame.encode_reply(request, (memory.D[request.first.number] & 0xFFFF,)) for request in requests
    )
    with shared.raw() as raw:
        raw.send(b"".join(frames))
        assert raw.receive(len(expected)) == expected
        for byte in b"".join(frames[:4]):
            raw.send(bytes([byte]))
        size = len(expected) // 8
        assert raw.receive(size) == expected[:size]


@pytest.mark.parametrize("rubbish", [b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 40, b"QQQQ"])
def test_rubbish_closes_the_connection_and_others_continue(shared: McRig, rubbish: bytes) -> None:
    other = shared.client()
    before = shared.mc.traffic.bad_frames
    with shared.raw() as raw:
        raw.send(rubbish)
        assert raw.until_closed() == b""
    assert other.read_words(D("D8000"), 1) == (shared.hmi.twin.plc.memory.D[8000],)
    assert shared.mc.traffic.bad_frames == before + 1


def test_an_unknown_1e_command_is_answered_with_end_code_50() -> None:
    with McRig(Frame1E()) as rig, rig.raw() as raw:
        raw.send(bytes.fromhex("06FF0A00"))
        assert raw.receive(2) == bytes.fromhex("8650")
        raw.send(rig.frame.encode_request(ReadTypeName()))
        assert raw.receive(4) == bytes.fromhex("9500F300")


def test_a_3e_length_beyond_every_frame_closes_the_connection() -> None:
    with McRig(Frame3E()) as rig, rig.raw() as raw:
        raw.send(bytes.fromhex("500000FFFF0300" + "FFFF"))
        assert raw.until_closed() == b""


def test_connections_are_limited_and_idle_ones_are_closed() -> None:
    settings = TcpSettings("127.0.0.1", 0, max_connections=2, idle_timeout_s=IDLE_S)
    with McRig(Frame1E(), settings) as rig, rig.raw() as idle, rig.raw() as dribbling:
        bystander = rig.hmi.client()
        until(lambda: rig.mc.connections == 2, bystander)
        with rig.raw() as third:
            assert idle.until_closed() == b"", "the least active one"
            dribbling.send(b"\x01")
            let_pass(rig.mc._frontend, IDLE_S + 1)
            assert third.until_closed() == dribbling.until_closed() == b""
        traffic = rig.mc.traffic
        assert (traffic.refused, traffic.displaced, traffic.timed_out) == (0, 1, 2)
        assert rig.hmi.connections == 1


def test_a_hundred_connections_leave_no_slot_occupied(rig: McRig) -> None:
    bystander = rig.hmi.client()
    request = rig.frame.encode_request(ReadWords(D("D0"), 1))
    for turn in range(100):
        with rig.raw() as raw:
            raw.send(request[: turn % len(request) + 1])
            raw.socket.shutdown(socket.SHUT_WR)
            raw.until_closed()
    until(lambda: rig.mc.connections == 0, bystander)
    assert rig.client().read_words(D("D8000"), 1) == (rig.hmi.twin.plc.memory.D[8000],)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1"])  # noqa: S104 - refused
def test_remote_addresses_require_permission(host: str) -> None:
    with pytest.raises(ServerError, match=r"the MC protocol has no password.*--mc-allow-remote"):
        McRig(Frame1E(), TcpSettings(host, 0))


def test_a_port_in_use_is_reported_in_one_line() -> None:
    with McRig(Frame1E()) as rig:
        taken = TcpSettings("127.0.0.1", rig.mc.port)
        with (
            pytest.raises(ServerError, match=r"MC server: .*address already in use.*--mc-port.*omit --mc"),
            McRig(Frame1E(), taken),
        ):
            pass


def test_reads_before_the_first_scan_are_refused() -> None:
    for frame, expected in ((Frame1E(), (0x5B, 0x11)), (Frame3E(), (0xC05F, 0))):
        rig = McRig(frame)
        with rig.hmi.server:
            client = rig.client()
            assert refused(client, ReadWords(D("D0"), 1)) == expected
            client.close()


def test_commands_before_the_first_scan_are_refused_together() -> None:
    rig = McRig(Frame3E())
    seen = record_commands(rig.hmi)
    with rig.hmi.server:
        client = rig.client()
        commands = ((command(rig, "acknowledge"), True), (command(rig, jog_command("left.lift_retract")), True))
        assert refused(client, WriteRandomBits(commands))[0] == 0xC05F
        rig.hmi.twin.scan()
        assert seen == [set()]
        client.close()


def test_without_a_modbus_port_only_the_mc_protocol_is_served() -> None:
    rig = McRig(Frame1E())
    rig.hmi = HmiRig(Twin(), HmiOptions(port=None), further=rig._endpoints)
    with rig.hmi.server:
        rig.hmi.twin.scan()
        assert rig.hmi.server.modbus is None
        client = rig.client()
        assert client.read_words(D("D8000"), 1) == (rig.hmi.twin.plc.memory.D[8000],)
        client.close()


# --- damaged frames -------------------------------------------------------------------------------


def mutated(frame: AnyFrame, generator: random.Random) -> bytes:
    """Return a valid request with up to 4 damages."""
    requests: list[Request] = [
        ReadBits(D("X10"), 9),
        ReadWords(D("D100"), 20),
        WriteBits(D("Y0"), (True,) * 9),
        WriteWords(D("D100"), (1, 2, 3)),
        WriteRandomBits(((D("M0"), True), (D("Y1"), False))),
        WriteRandomWords(((D("D100"), 3),)),
        SelfTest(b"ABC"),
        ReadTypeName(),
    ]
    data = bytearray(frame.encode_request(generator.choice(requests)))
    for _ in range(generator.randint(1, 4)):
        position = generator.randrange(len(data) + 1)
        data[position : position + generator.randint(0, 2)] = generator.randbytes(generator.randint(0, 2))
    return bytes(data) or b"\x00"


@pytest.mark.parametrize("requests", first_of([100, 400]))
def test_mutated_frames_change_nothing_and_the_server_answers_afterwards(rig: McRig, requests: int) -> None:
    """Mutated requests on as many connections, seed 1; the memory of a PLC that does not scan stays the same."""
    generator = random.Random(1)
    before = image(rig)
    for _ in range(requests):
        with rig.raw() as raw:
            raw.send(mutated(rig.frame, generator))
            raw.socket.shutdown(socket.SHUT_WR)
            raw.until_closed()
    client = rig.client()
    assert client.read_words(D("D8000"), 1) == (rig.hmi.twin.plc.memory.D[8000],)
    commands = {row[2] for row in rig.hmi.audits if row[4] == "done"}
    assert not commands, "no mutation reached a command or a set-point"
    assert image(rig) == before
    until(lambda: rig.mc.connections == 1, rig.hmi.client())


@pytest.mark.nightly
def test_a_client_that_does_not_read_its_answers_is_not_read_either(shared: McRig) -> None:
    """Requests without reading an answer fill the buffers of the computer; the server then serves the others."""
    request = shared.frame.encode_request(ReadWords(D("D8000"), 60))
    other = shared.client()
    with RawClient(shared.mc.port) as raw:
        raw.socket.setblocking(False)
        full = 0
        while full < 50:  # full means: after each answer to the other client, nothing could be sent
            try:
                raw.socket.send(request * 500)
                full = 0
            except BlockingIOError:
                full += 1
            assert other.read_words(D("D8000"), 1) == (shared.hmi.twin.plc.memory.D[8000],)
