"""The Modbus TCP link: frames on the wire, and everything that can go wrong on the way."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable
from dataclasses import replace
from types import TracebackType
from typing import Self

import pytest

from controller.io.link import LinkError
from controller.io.modbus_tcp import ModbusTcpLink, Run, group_into_runs
from controller.io_map import DEFAULT_IO_MAP, IoMap, Point, load_io_map
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.parameters import load_machine
from plant_sim.plant import Plant

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
PATIENT_S = 5.0  # for answers that must come; a slow computer must not fail a test
ALL_OFF = [False] * IO_MAP.output_count


def scattered(io_map: IoMap) -> IoMap:
    """The same machine on a module that keeps its points backwards and with gaps."""

    def move(point: Point) -> Point:
        offset = 100 - 2 * point.number if point.number > 7 else 20 - point.number
        return replace(point, offset=offset)

    return replace(io_map, inputs=tuple(map(move, io_map.inputs)), outputs=tuple(map(move, io_map.outputs)))


def test_the_map_as_delivered_takes_one_transfer_each_way() -> None:
    assert group_into_runs(IO_MAP.inputs) == (Run(0, tuple(range(22))),)
    assert group_into_runs(IO_MAP.outputs) == (Run(0, tuple(range(18))),)


def test_gaps_split_transfers_and_offsets_order_them() -> None:
    """Y0 to Y7 lie backwards at 13 to 20; from Y10 on every other offset is free."""
    runs = group_into_runs(scattered(IO_MAP).outputs)
    assert runs[0] == Run(13, (7, 6, 5, 4, 3, 2, 1, 0))
    assert runs[1:] == tuple(Run(100 - 2 * number, (number,)) for number in range(17, 7, -1))


class ScriptedServer:
    """A far side that says exactly what a test wants: request frame in, bytes out, or silence."""

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
        """Say goodbye, which comes after everything else that was sent."""
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
                except ConnectionError:  # the client has given up and gone
                    continue
                if last == self.GOODBYE:
                    return

    def _converse(self, connection: socket.socket) -> bytes:
        """Answer one client until it hangs up; return the last it said."""
        while (request := connection.recv(1_000)) not in (b"", self.GOODBYE):
            self.requests.append(request)
            answer = self._answer(request)
            if answer is not None:
                connection.sendall(answer)
            if self._hangs_up:
                break
        return request


def reply(request: bytes, pdu: bytes) -> bytes:
    """A sound frame around `pdu`."""
    return request[:4] + struct.pack(">H", len(pdu) + 1) + request[6:7] + pdu


def good_reply(request: bytes) -> bytes:
    return reply(request, b"\x02\x03\xff\xff\x3f" if request[7] == 2 else request[7:12])


def link_to(port: int, *, timeout_s: float = PATIENT_S) -> ModbusTcpLink:
    return ModbusTcpLink("127.0.0.1", port, IO_MAP, timeout_s=timeout_s)


@pytest.fixture
def free_port() -> int:
    """A port nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port: int = listener.getsockname()[1]
        return port


def test_nobody_there_is_one_line_that_names_the_address(free_port: int) -> None:
    with pytest.raises(LinkError, match=rf"^no field I/O at 127\.0\.0\.1:{free_port}: .*running$"):
        link_to(free_port).open()


def test_the_frames_on_the_wire() -> None:
    """Written out by hand: one FC02 over all inputs, one FC15 over all outputs, low bit first."""
    with ScriptedServer(good_reply) as far_side:
        link = ModbusTcpLink("127.0.0.1", far_side.port, IO_MAP, unit=7, timeout_s=PATIENT_S)
        link.open()
        assert link.read_inputs() == [True] * 22
        link.write_outputs([True, False, True] + [False] * 14 + [True])
        link.close()
    read, write = far_side.requests
    assert read[2:] == bytes.fromhex("0000 0006 07 02 0000 0016")
    assert write[2:] == bytes.fromhex("0000 000a 07 0f 0000 0012 03 05 00 02")


def test_small_frames_are_not_held_back() -> None:
    with ScriptedServer(good_reply) as far_side:
        link = link_to(far_side.port)
        link.open()
        assert link._client.socket is not None
        assert link._client.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
        link.close()


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        pytest.param(lambda q: reply(q, b"\x82\x04"), r"exception 04 \(device failure\)", id="exception 04"),
        pytest.param(lambda q: reply(q, b"\x82\x63"), r"exception 99 \(unknown\)", id="unknown exception"),
        pytest.param(lambda q: reply(q, b"\x02\x02\xff\xff"), "16 bits came back", id="too few bits"),
        pytest.param(lambda q: reply(q, b"\x02\x00"), "0 bits came back", id="no bits"),
        pytest.param(lambda q: reply(q, b"\x02\x04\xff\xff\xff\xff"), "32 bits came back", id="too many bits"),
        pytest.param(lambda q: reply(q, b"\x01\x03\xff\xff\xff"), "another function", id="another function"),
    ],
)
def test_an_answer_that_is_not_one(answer: Callable[[bytes], bytes], reason: str) -> None:
    """Each becomes one line that says what was asked, of whom, and what came."""
    with ScriptedServer(answer) as far_side:
        link = link_to(far_side.port)
        link.open()
        where = rf"^field I/O at 127\.0\.0\.1:{far_side.port}: read of 22 inputs from offset 0: "
        with pytest.raises(LinkError, match=where + ".*" + reason) as caught:
            link.read_inputs()
        assert "\n" not in str(caught.value)
        with pytest.raises(LinkError, match="not open"):
            link.read_inputs()
    assert len(far_side.requests) == 1, "no second attempt, no reconnecting"


def test_an_acknowledgement_of_something_else_is_none() -> None:
    with ScriptedServer(lambda q: reply(q, b"\x0f\x00\x00\x00\x11")) as far_side:
        link = link_to(far_side.port)
        link.open()
        with pytest.raises(LinkError, match="answer names 17 from 0"):
            link.write_outputs(ALL_OFF)


@pytest.mark.parametrize(
    "answer",
    [
        pytest.param(lambda q: None, id="silent"),
        pytest.param(lambda q: good_reply(q)[:-1], id="cut off"),
        pytest.param(lambda q: b"\x00\x00" + good_reply(q)[2:], id="untitled"),
        pytest.param(lambda q: b"\xff\xff" + good_reply(q)[2:], id="of another question"),
        pytest.param(lambda q: good_reply(q)[:6] + b"\x09" + good_reply(q)[7:], id="of another unit"),
        pytest.param(lambda q: q[:2] + b"\x00\x01" + good_reply(q)[4:], id="of another protocol"),
    ],
)
def test_no_valid_answer_in_time(answer: Callable[[bytes], bytes | None]) -> None:
    """The wait ends by the timeout, after a single attempt."""
    with ScriptedServer(answer) as far_side:
        link = link_to(far_side.port, timeout_s=0.02)
        link.open()
        with pytest.raises(LinkError, match="no valid answer within 20 ms"):
            link.read_inputs()
        with pytest.raises(LinkError, match="not open"):
            link.read_inputs()
    assert len(far_side.requests) == 1


def test_a_far_side_that_hangs_up() -> None:
    with ScriptedServer(lambda q: None, hangs_up=True) as far_side:
        link = link_to(far_side.port)
        link.open()
        with pytest.raises(LinkError, match="read of 22 inputs from offset 0: connection lost"):
            link.read_inputs()
        with pytest.raises(LinkError, match="not open"):
            link.write_outputs(ALL_OFF)
    assert len(far_side.requests) == 1, "no reconnecting"


def test_rubbish_of_any_kind_is_a_link_error() -> None:
    """A sound answer with one byte changed: an image or a LinkError, never anything else."""
    sound = bytes.fromhex("0001 0000 0006 01 02 03 ffff3f")
    current = sound
    outcomes = {"image": 0, "error": 0}
    with ScriptedServer(lambda q: current, hangs_up=True) as far_side:
        for position in range(len(sound)):
            for value in (0x00, 0x01, 0x7F, 0x80, 0xFF):
                current = sound[:position] + bytes([value]) + sound[position + 1 :]
                link = link_to(far_side.port)
                link.open()
                try:
                    assert len(link.read_inputs()) == 22
                    outcomes["image"] += 1
                except LinkError:
                    outcomes["error"] += 1
                link.close()
    assert min(outcomes.values()) > 10


def test_the_far_side_may_go_and_come_back() -> None:
    module = IoModule(Plant(IO_MAP, MACHINE, seed=1), IO_MAP)
    with ServerThread(PlantServer(module, port=0, lock_step_ms=10)) as thread:
        port = thread.server.port
        link = link_to(port)
        link.open()
        link.write_outputs(ALL_OFF)
    with pytest.raises(LinkError, match="connection lost"):
        link.read_inputs()
    with pytest.raises(LinkError, match="no field I/O"):
        link.open()
    with ServerThread(PlantServer(module, port=port, lock_step_ms=10)):
        with pytest.raises(LinkError, match="not open"):
            link.read_inputs()
        link.open()
        assert len(link.read_inputs()) == 22
        link.close()
