"""The plant's Modbus TCP server at byte level: framing, exceptions, limits, and effects of writes."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from dataclasses import replace

import pytest

from controller.iomap.loader import IoMapError
from plant_sim.links.box import BOX_COILS
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.telemetry import TELEMETRY_REGISTERS
from tests.controller.common import modbus_rig
from tests.controller.common.modbus_rig import (
    DEVICE_FAILURE,
    ILLEGAL_ADDRESS,
    ILLEGAL_FUNCTION,
    ILLEGAL_VALUE,
    READ_ALL_INPUTS,
    Client,
    exception,
    frame,
    read_pdu,
    write_coil_pdu,
    write_coils_pdu,
)
from tests.plant_sim.links.block_rig import IO_MAP, Rig, make_module
from tests.sampling import one_in
from tests.wiring import wired


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


@pytest.fixture
def client(rig: Rig) -> Client:
    return rig.client()


# --- framing --------------------------------------------------------------------------------------


def test_thirty_requests_in_one_segment_are_answered_in_order(client: Client) -> None:
    requests = [frame(read_pdu(2, n % 22, 1), transaction=n, unit=n) for n in range(1, 31)]
    client.send(b"".join(requests))
    answers = [client.receive() for _ in requests]
    assert [answer[:2] for answer in answers] == [(n, n) for n in range(1, 31)]
    assert all(pdu[:2] == b"\x02\x01" for *_, pdu in answers)


def test_requests_that_exceed_the_receive_buffer(rig: Rig, client: Client) -> None:
    """Requests that together exceed the receive buffer are all answered, even if split at arbitrary points."""
    client.send(b"".join(frame(READ_ALL_INPUTS, transaction=n) for n in range(2_000)))
    assert [client.receive()[0] for _ in range(2_000)] == list(range(2_000))


def test_a_frame_in_single_bytes(client: Client) -> None:
    client.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for byte in frame(READ_ALL_INPUTS) * 3:
        client.send(bytes([byte]))
    for _ in range(3):
        assert client.receive()[2][:2] == b"\x02\x03"


def test_a_request_and_a_half(client: Client) -> None:
    whole = frame(READ_ALL_INPUTS)
    client.send(whole + whole[:9])
    client.receive()
    client.send(whole[9:])
    assert client.receive()[2][:2] == b"\x02\x03"


@pytest.mark.parametrize(
    "header",
    [
        pytest.param("0001 0001 0006 01", id="protocol 1"),
        pytest.param("0001 ff00 0006 01", id="protocol 65280"),
        pytest.param("0001 0000 0000 01", id="length 0"),
        pytest.param("0001 0000 0001 01", id="length 1, no function code"),
        pytest.param("0001 0000 00ff 01", id="length 255"),
        pytest.param("0001 0000 ffff 01", id="length 65535"),
    ],
)
def test_a_malformed_header_closes_the_connection_after_the_previous_requests(rig: Rig, header: str) -> None:
    good = frame(READ_ALL_INPUTS)
    client, bystander = rig.client(), rig.client()
    client.send(good + bytes.fromhex(header) + READ_ALL_INPUTS + good)
    assert client.receive()[0] == 0x1234
    assert client.rest() == b""
    assert rig.server.traffic.bad_frames == 1
    assert bystander.ask(READ_ALL_INPUTS)[0] == 2


def test_the_longest_frame_is_accepted(client: Client) -> None:
    """A length of 254 is valid, so the frame is rejected only as an invalid read request."""
    assert client.ask(READ_ALL_INPUTS + bytes(253 - 5)) == exception(2, ILLEGAL_VALUE)


def test_the_shortest_frame_is_accepted(client: Client) -> None:
    assert client.ask(b"\x02") == exception(2, ILLEGAL_VALUE)


@pytest.mark.parametrize("unit", [0, 1, 17, 247, 255])
def test_any_unit_identifier_is_echoed(client: Client, unit: int) -> None:
    client.send(frame(READ_ALL_INPUTS, unit=unit))
    assert client.receive()[1] == unit


# --- limits ------------------------------------------------------------------------------


@pytest.mark.parametrize("function_code", one_in(7, sorted(set(range(256)) - {1, 2, 4, 5, 15})))
def test_other_functions_are_refused(client: Client, function_code: int) -> None:
    pdu = bytes([function_code]) + bytes(4)
    assert client.ask(pdu) == exception(function_code, ILLEGAL_FUNCTION)


@pytest.mark.parametrize(
    ("function_code", "first", "count"),
    [(1, 0, 18), (1, 17, 1), (1, 100, 4), (2, 0, 22), (2, 21, 1), (4, 0, TELEMETRY_REGISTERS), (4, 29, 1)],
)
def test_reads_up_to_the_limits(client: Client, function_code: int, first: int, count: int) -> None:
    size = 2 * count if function_code == 4 else (count + 7) // 8
    answer = client.ask(read_pdu(function_code, first, count))
    assert answer[:2] == bytes([function_code, size])
    assert len(answer) == 2 + size


@pytest.mark.parametrize(
    ("function_code", "first", "count"),
    [
        *[(1, 0, 19), (1, 18, 1), (1, 99, 1), (1, 99, 2), (1, 100, 6), (1, 105, 1), (1, 17, 84), (1, 0, 2_000)],
        *[(2, 0, 23), (2, 22, 1), (2, 21, 2), (2, 65_535, 1), (2, 65_535, 2_000)],
        *[(4, 0, TELEMETRY_REGISTERS + 1), (4, TELEMETRY_REGISTERS, 1), (4, 65_535, 125)],
    ],
)
def test_an_undeclared_address_is_refused_not_read_as_0(
    client: Client, function_code: int, first: int, count: int
) -> None:
    assert client.ask(read_pdu(function_code, first, count)) == exception(function_code, ILLEGAL_ADDRESS)


@pytest.mark.parametrize(
    ("function_code", "count"),
    [(1, 0), (1, 2_001), (1, 65_535), (2, 0), (2, 2_001), (2, 65_535), (4, 0), (4, 126), (4, 65_535)],
)
def test_a_quantity_beyond_the_response_size(client: Client, function_code: int, count: int) -> None:
    assert client.ask(read_pdu(function_code, 0, count)) == exception(function_code, ILLEGAL_VALUE)


@pytest.mark.parametrize("function_code", [1, 2, 4, 5])
@pytest.mark.parametrize("change", [-4, -1, 1])
def test_a_request_of_the_wrong_size(client: Client, function_code: int, change: int) -> None:
    pdu = (bytes([function_code, 0, 0, 0, 0]) + b"\x00")[: 5 + change]
    assert client.ask(pdu) == exception(function_code, ILLEGAL_VALUE)


@pytest.mark.parametrize("value", [0x0001, 0x00FF, 0x1234, 0xFF01, 0xFFFF])
def test_a_single_coil_takes_0000_and_ff00_only(rig: Rig, client: Client, value: int) -> None:
    assert client.ask(write_coil_pdu(5, value)) == exception(5, ILLEGAL_VALUE)
    assert rig.module.outputs == [False] * 18
    assert rig.module.last_write_ms is None


@pytest.mark.parametrize(
    "pdu",
    [
        pytest.param("0f 0000 0000 00", id="quantity 0"),
        pytest.param("0f 0000 0012 02 ffff", id="byte count too small"),
        pytest.param("0f 0000 0012 04 ffffffff", id="byte count too large"),
        pytest.param("0f 0000 0012 03 ffff", id="fewer bytes than declared"),
        pytest.param("0f 0000 0012 03 ffffffff", id="more bytes than declared"),
        pytest.param("0f 0000 0012 02 ffffff", id="the right number of bytes, wrongly declared"),
        pytest.param("0f 0000 0012", id="cut off"),
        pytest.param("0f 0000 07b1 f7" + "00" * 247, id="quantity 1969"),
    ],
)
def test_write_coils_with_inconsistent_lengths(rig: Rig, client: Client, pdu: str) -> None:
    assert client.ask(bytes.fromhex(pdu)) == exception(15, ILLEGAL_VALUE)
    assert rig.module.outputs == [False] * 18
    assert rig.module.last_write_ms is None


def test_quantity_1968_is_limited_by_the_address_only(client: Client) -> None:
    pdu = struct.pack(">BHHB", 15, 0, 1_968, 246) + bytes(246)
    assert client.ask(pdu) == exception(15, ILLEGAL_ADDRESS)


@pytest.mark.parametrize(
    "pdu",
    [
        write_coil_pdu(18, 0xFF00),
        write_coil_pdu(99, 0xFF00),
        write_coil_pdu(105, 0xFF00),
        write_coils_pdu(0, "1" * 19),
        write_coils_pdu(17, "11"),
        write_coils_pdu(99, "11"),
        write_coils_pdu(65_535, "11"),
    ],
)
def test_a_write_that_touches_an_undeclared_address_changes_nothing(rig: Rig, client: Client, pdu: bytes) -> None:
    assert client.ask(pdu) == exception(pdu[0], ILLEGAL_ADDRESS)
    assert rig.module.outputs == [False] * 18
    assert rig.module.last_write_ms is None
    assert not any(coil.pressed(rig.module.plant.box) for coil in BOX_COILS)


# --- outputs, inputs, buttons ---------------------------------------------------------------------


def test_coils_are_written_and_read_back(rig: Rig, client: Client) -> None:
    assert client.ask(write_coils_pdu(0, "100000000000000001")) == bytes.fromhex("0f 0000 0012")
    assert client.ask(read_pdu(1, 0, 18)) == bytes.fromhex("01 03 010002")
    assert client.ask(write_coils_pdu(7, "101")) == bytes.fromhex("0f 0007 0003")
    assert client.ask(write_coil_pdu(0, 0x0000)) == bytes.fromhex("05 0000 0000")
    assert client.ask(write_coil_pdu(1, 0xFF00)) == bytes.fromhex("05 0001 ff00")
    assert client.ask(read_pdu(1, 0, 18)) == bytes.fromhex("01 03 820202")
    assert [number for number, level in enumerate(rig.module.outputs) if level] == [1, 7, 9, 17]


def test_inputs_are_raw_levels_low_bit_first(rig: Rig, client: Client) -> None:
    x = rig.thread.call(rig.module.inputs)[:22]
    expected = sum(level << index for index, level in enumerate(x)).to_bytes(3, "little")
    assert client.ask(READ_ALL_INPUTS) == b"\x02\x03" + expected
    assert client.ask(read_pdu(2, 20, 2)) == b"\x02\x01\x03", "stop and emergency stop, not pressed"


def test_points_are_at_the_offsets_of_the_map_only() -> None:
    """With this map, stop is at 500, tray_run (Y0) at 40 and left.lift_extend (Y1) at 39."""
    move = {"stop": 500, "tray_run": 40, "left.lift_extend": 39}
    io_map = replace(
        IO_MAP,
        inputs=tuple(replace(point, offset=move.get(point.tag, point.offset)) for point in IO_MAP.inputs),
        outputs=tuple(replace(point, offset=move.get(point.tag, point.offset)) for point in IO_MAP.outputs),
    )
    with Rig(PlantServer(make_module(io_map), port=0, lock_step_ms=10)) as rig:
        client = rig.client()
        assert client.ask(read_pdu(2, 500, 1)) == b"\x02\x01\x01"
        assert client.ask(read_pdu(2, 20, 1)) == exception(2, ILLEGAL_ADDRESS)
        assert client.ask(write_coils_pdu(39, "01")) == bytes.fromhex("0f 0027 0002")
        assert rig.module.outputs == [True] + [False] * 17
        assert client.ask(write_coils_pdu(0, "1")) == exception(15, ILLEGAL_ADDRESS)


@pytest.mark.parametrize("coils", [18, 19])
def test_the_outputs_that_move_something_complete_the_block(coils: int) -> None:
    """One request writes all outputs of the delivered map; a controller without a lamp writes the first 18."""
    with modbus_rig.Rig() as rig:
        client = rig.client()
        assert client.ask(write_coils_pdu(0, "000001" + "0" * 12 + "1" * (coils - 18))) is not None
        assert rig.module.plant.time_ms == 10
        assert rig.module.outputs[20] is (coils == 19)
        assert client.ask(write_coils_pdu(18, "1")) == bytes.fromhex("0f 0012 0001")
        assert rig.module.plant.time_ms == 10
        assert rig.module.outputs[20]


def test_an_output_at_an_address_of_the_operator_box_is_rejected_in_one_line() -> None:
    io_map = replace(IO_MAP, outputs=(*IO_MAP.outputs[:-1], replace(IO_MAP.outputs[-1], offset=102)))
    with pytest.raises(IoMapError, match=r"io_map\.yaml:\d+: tray_forward: coil offset 102 .* choose another offset"):
        PlantServer(make_module(io_map))


@pytest.mark.parametrize(("offset", "button"), [(100, "start"), (101, "stop"), (102, "emergency_stop"), (103, "reset")])
def test_buttons(rig: Rig, client: Client, offset: int, button: str) -> None:
    """A button stays pressed until released; the other buttons are unchanged."""
    assert client.ask(read_pdu(1, 100, 4)) == b"\x01\x01\x00"
    client.ask(write_coil_pdu(offset, 0xFF00))
    box = rig.module.plant.box
    assert [coil.button for coil in BOX_COILS if getattr(box, coil.button)] == [button]
    assert client.ask(read_pdu(1, 100, 4)) == bytes([1, 1, 1 << offset - 100])
    client.ask(write_coil_pdu(offset, 0x0000))
    assert client.ask(read_pdu(1, 100, 4)) == b"\x01\x01\x00"


def test_a_button_reaches_the_terminal_with_its_polarity(client: Client) -> None:
    """The start button is normally open; stop and emergency stop are normally closed."""
    before = client.ask(read_pdu(2, 0, 1)), client.ask(read_pdu(2, 20, 2))
    client.ask(write_coils_pdu(100, "111"))
    after = client.ask(read_pdu(2, 0, 1)), client.ask(read_pdu(2, 20, 2))
    assert before == (b"\x02\x01\x00", b"\x02\x01\x03")
    assert after == (b"\x02\x01\x01", b"\x02\x01\x00")


# --- output registers -----------------------------------------------------------------------------


def test_holding_registers_exist_if_the_map_has_output_registers() -> None:
    """A refused write changes nothing; after a trip, only the safe value is accepted."""
    module = make_module(wired("planter_speed"))
    with Rig(PlantServer(module, port=0, lock_step_ms=10)) as rig:
        client = rig.client()
        assert client.ask(bytes.fromhex("03 0000 0001")) == bytes.fromhex("03 02 0000")
        assert client.ask(bytes.fromhex("06 0000 01c8")) == bytes.fromhex("06 0000 01c8")
        assert client.ask(bytes.fromhex("03 0000 0001")) == bytes.fromhex("03 02 01c8")
        assert client.ask(bytes.fromhex("10 0000 0002 04 0001 0002")) == exception(16, ILLEGAL_ADDRESS)
        assert client.ask(read_pdu(3, 1, 1)) == exception(3, ILLEGAL_ADDRESS)
        assert module.registers == {0: 456}
        module.tripped = True
        assert client.ask(bytes.fromhex("10 0000 0001 02 01f4")) == exception(16, DEVICE_FAILURE)
        assert module.registers == {0: 456}
