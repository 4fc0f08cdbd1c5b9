"""Modbus TCP link: transmitted frames and communication errors."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Self

import pytest

from controller.common.modbus.io_map import IoMap, ModbusTable, Point
from controller.io.field.blocks import PointBlock, blocks_of
from controller.io.field.profiles import profiles
from controller.io.field.tcp_line import TcpBus
from controller.io.link import LinkError
from controller.io.modbus_tcp import ModbusTcpLink
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant

DELIVERED = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
PATIENT_S = 5.0
"""Timeout for expected responses, s; long enough for a slow computer."""


def terminals(points: tuple[Point, ...], count: int) -> tuple[Point, ...]:
    """Return the first points of an I/O map, moved to the terminals and the Modbus offsets from 0."""
    return tuple(replace(point, number=number, offset=number) for number, point in enumerate(points[:count]))


INPUTS, OUTPUTS = 22, 18
IO_MAP = replace(DELIVERED, inputs=terminals(DELIVERED.inputs, INPUTS), outputs=terminals(DELIVERED.outputs, OUTPUTS))
"""I/O map with X0 to X25 and Y0 to Y21 at consecutive offsets, regardless of the wires of the delivered map."""
ALL_OFF = [False] * OUTPUTS


def scattered(io_map: IoMap) -> IoMap:
    """Return the I/O map with offsets in reverse order and with gaps."""

    def move(point: Point) -> Point:
        offset = 100 - 2 * point.number if point.number > 7 else 20 - point.number
        return replace(point, offset=offset)

    return replace(io_map, inputs=tuple(map(move, io_map.inputs)), outputs=tuple(map(move, io_map.outputs)))


def blocks(points: Iterable[Point]) -> tuple[PointBlock, ...]:
    return blocks_of("X", [(point.number, point.offset) for point in points], profiles()["coils"])


def one_block(first: int, numbers: Sequence[int]) -> PointBlock:
    places = tuple((number, bit) for bit, number in enumerate(numbers))
    return PointBlock(ModbusTable.DISCRETE_INPUT, first, len(numbers), places)


def test_the_required_points_of_the_delivered_map_need_one_transfer_per_direction() -> None:
    """Optional points may be wired at any offset; the others are consecutive from 0."""
    for points in (DELIVERED.inputs, DELIVERED.outputs):
        required = [point for point in points if not point.optional]
        assert blocks(required) == (one_block(0, range(len(required))),)


def test_consecutive_offsets_need_one_transfer_per_direction() -> None:
    assert blocks(IO_MAP.inputs) == (one_block(0, range(INPUTS)),)
    assert blocks(IO_MAP.outputs) == (one_block(0, range(OUTPUTS)),)


def test_transfers_are_split_at_gaps_and_ordered_by_offset() -> None:
    """Y0 to Y7 are in reverse order at offsets 13 to 20; from Y10 every other offset is unused."""
    runs = blocks(scattered(IO_MAP).outputs)
    assert runs[0] == one_block(13, (7, 6, 5, 4, 3, 2, 1, 0))
    assert runs[1:] == tuple(one_block(100 - 2 * number, (number,)) for number in range(17, 7, -1))


class ScriptedServer:
    """Server that answers each request frame with scripted bytes or not at all."""

    GOODBYE = b"goodbye"

    def __init__(self, answer: Callable[[bytes], bytes | None], *, hangs_up: bool = False) -> None:
        self.requests: list[bytes] = []
        self._answer = answer
        self._hangs_up = hangs_up
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Send a final message, which the server reads after all other data, and stop the server."""
        with socket.create_connection(("127.0.0.1", self.port)) as connection:
            connection.sendall(self.GOODBYE)
            self._thread.join()
        self._listener.close()

    def _serve(self) -> None:
        while True:
            connection, _ = self._listener.accept()
            with connection:
                try:
                    last = self._converse(connection)
                except ConnectionError:  # the client has disconnected
                    continue
                if last == self.GOODBYE:
                    return

    def _converse(self, connection: socket.socket) -> bytes:
        """Respond to one client until it disconnects, and return its last message."""
        while (request := connection.recv(1_000)) not in (b"", self.GOODBYE):
            self.requests.append(request)
            answer = self._answer(request)
            if answer is not None:
                connection.sendall(answer)
            if self._hangs_up:
                break
        return request


def reply(request: bytes, pdu: bytes) -> bytes:
    """Return a valid response frame with `pdu`."""
    return request[:4] + struct.pack(">H", len(pdu) + 1) + request[6:7] + pdu


def good_reply(request: bytes) -> bytes:
    return reply(request, b"\x02\x03\xff\xff\x3f" if request[7] == 2 else request[7:12])


def link_to(port: int, *, timeout_s: float = PATIENT_S) -> ModbusTcpLink:
    return ModbusTcpLink("127.0.0.1", port, IO_MAP, timeout_s=timeout_s)


@pytest.fixture
def free_port() -> int:
    """Return a port without a listening server."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port: int = listener.getsockname()[1]
        return port


def test_an_unreachable_server_is_reported_in_one_line_with_its_address(free_port: int) -> None:
    with pytest.raises(LinkError, match=rf"^no field I/O at 127\.0\.0\.1:{free_port}: .*running$"):
        link_to(free_port).open()


def test_the_frames_on_the_wire() -> None:
    """One FC02 frame reads all inputs and one FC15 frame writes all outputs, low bit first."""
    with ScriptedServer(good_reply) as server:
        link = ModbusTcpLink("127.0.0.1", server.port, IO_MAP, unit=7, timeout_s=PATIENT_S)
        link.open()
        assert link.read_inputs() == [True] * INPUTS
        link.write_outputs([True, False, True] + [False] * 14 + [True])
        link.close()
    read, write = server.requests
    assert read[2:] == bytes.fromhex("0000 0006 07 02 0000 0016")
    assert write[2:] == bytes.fromhex("0000 000a 07 0f 0000 0012 03 05 00 02")


def test_small_frames_are_not_delayed() -> None:
    with ScriptedServer(good_reply) as server:
        link = link_to(server.port)
        link.open()
        line = link.devices[0].line
        assert isinstance(line, TcpBus)
        assert line.socket is not None
        assert line.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        link.close()


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        pytest.param(lambda q: reply(q, b"\x82\x04"), r"exception 04 \(device failure\)", id="exception 04"),
        pytest.param(lambda q: reply(q, b"\x82\x63"), r"exception 99 \(unknown\)", id="unknown exception"),
        pytest.param(lambda q: reply(q, b"\x02\x02\xff\xff"), "contains 16 bits", id="too few bits"),
        pytest.param(lambda q: reply(q, b"\x02\x00"), "contains 0 bits", id="no bits"),
        pytest.param(lambda q: reply(q, b"\x02\x04\xff\xff\xff\xff"), "contains 32 bits", id="too many bits"),
        pytest.param(lambda q: reply(q, b"\x01\x03\xff\xff\xff"), "another function", id="another function"),
    ],
)
def test_an_invalid_answer_is_reported(answer: Callable[[bytes], bytes], reason: str) -> None:
    """Each error is one line with the address, the request and the problem."""
    with ScriptedServer(answer) as server:
        link = link_to(server.port)
        link.open()
        where = rf"^field I/O at 127\.0\.0\.1:{server.port}: read of {INPUTS} inputs from offset 0: "
        with pytest.raises(LinkError, match=where + ".*" + reason) as caught:
            link.read_inputs()
        assert "\n" not in str(caught.value)
        with pytest.raises(LinkError, match="not open"):
            link.read_inputs()
    assert len(server.requests) == 1, "no retry and no reconnection"


def test_a_confirmation_of_a_different_write_is_an_error() -> None:
    with ScriptedServer(lambda q: reply(q, b"\x0f\x00\x00\x00\x11")) as server:
        link = link_to(server.port)
        link.open()
        with pytest.raises(LinkError, match="answer confirms 17 from 0"):
            link.write_outputs(ALL_OFF)


@pytest.mark.parametrize(
    "answer",
    [
        pytest.param(lambda q: None, id="no answer"),
        pytest.param(lambda q: good_reply(q)[:-1], id="truncated"),
        pytest.param(lambda q: b"\x00\x00" + good_reply(q)[2:], id="transaction 0"),
        pytest.param(lambda q: b"\xff\xff" + good_reply(q)[2:], id="another transaction"),
        pytest.param(lambda q: good_reply(q)[:6] + b"\x09" + good_reply(q)[7:], id="another unit"),
        pytest.param(lambda q: q[:2] + b"\x00\x01" + good_reply(q)[4:], id="another protocol"),
    ],
)
def test_no_valid_answer_in_time(answer: Callable[[bytes], bytes | None]) -> None:
    """The request fails when the timeout expires, without a second attempt."""
    with ScriptedServer(answer) as server:
        link = link_to(server.port, timeout_s=0.02)
        link.open()
        with pytest.raises(LinkError, match="no valid answer within 20 ms"):
            link.read_inputs()
        with pytest.raises(LinkError, match="not open"):
            link.read_inputs()
    assert len(server.requests) == 1


def test_a_server_that_closes_the_connection() -> None:
    with ScriptedServer(lambda q: None, hangs_up=True) as server:
        link = link_to(server.port)
        link.open()
        with pytest.raises(LinkError, match=f"read of {INPUTS} inputs from offset 0: connection lost"):
            link.read_inputs()
        with pytest.raises(LinkError, match="not open"):
            link.write_outputs(ALL_OFF)
    assert len(server.requests) == 1, "no reconnection"


def test_a_corrupted_answer_gives_an_image_or_a_link_error() -> None:
    """If any byte of a valid response is changed, no exception other than LinkError occurs."""
    valid = bytes.fromhex("0001 0000 0006 01 02 03 ffff3f")
    current = valid
    outcomes = {"image": 0, "error": 0}
    with ScriptedServer(lambda q: current, hangs_up=True) as server:
        for position in range(len(valid)):
            for value in (0x00, 0x01, 0x7F, 0x80, 0xFF):
                current = valid[:position] + bytes([value]) + valid[position + 1 :]
                link = link_to(server.port)
                link.open()
                try:
                    assert len(link.read_inputs()) == INPUTS
                    outcomes["image"] += 1
                except LinkError:
                    outcomes["error"] += 1
                link.close()
    assert min(outcomes.values()) > 10


def test_an_impossible_host_name_is_an_error() -> None:
    with pytest.raises(LinkError, match=r"\('\.\.' is no host name\)"):
        ModbusTcpLink("..", 502, DELIVERED).open()


def test_the_link_can_be_reopened_after_a_restart_of_the_server() -> None:
    module = IoModule(Plant(DELIVERED, MACHINE, seed=1), DELIVERED)
    with ServerThread(PlantServer(module, port=0, lock_step_ms=10)) as thread:
        port = thread.server.port
        link = ModbusTcpLink("127.0.0.1", port, DELIVERED, timeout_s=PATIENT_S)
        link.open()
        link.write_outputs(DELIVERED.safe_outputs())
    with pytest.raises(LinkError, match="connection lost"):
        link.read_inputs()
    with pytest.raises(LinkError, match="no field I/O"):
        link.open()
    with ServerThread(PlantServer(module, port=port, lock_step_ms=10)):
        with pytest.raises(LinkError, match="not open"):
            link.read_inputs()
        link.open()
        assert len(link.read_inputs()) == DELIVERED.input_count
        link.close()
