"""Operation of the plant's Modbus TCP server: time, watchdog, connections, start and stop, and malformed data."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import random
import socket
import struct
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from functools import partial

import pytest

from plant_sim.links.io_module import IoModule, WatchdogState
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.links.telemetry import TELEMETRY_REGISTERS
from plant_sim.machine.plant import Plant
from tests.controller.common.modbus_rig import (
    DEVICE_FAILURE,
    ILLEGAL_ADDRESS,
    MACHINE,
    READ_ALL_INPUTS,
    Client,
    exception,
    frame,
    read_pdu,
    read_registers,
    write_coil_pdu,
    write_coils_pdu,
)
from tests.plant_sim.links.block_rig import ALL_OFF, IO_MAP, Rig, make_module
from tests.sampling import first_of


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


@pytest.fixture
def client(rig: Rig) -> Client:
    return rig.client()


# --- time -----------------------------------------------------------------------------------------


def test_lock_step_time_passes_with_complete_writes_and_nothing_else(rig: Rig, client: Client) -> None:
    plant = rig.module.plant
    client.ask(READ_ALL_INPUTS)
    client.ask(read_pdu(4, 0, TELEMETRY_REGISTERS))
    client.ask(write_coils_pdu(100, "1111"))
    client.ask(write_coils_pdu(0, "0" * 17))
    client.ask(write_coil_pdu(5, 0xFF00))
    assert plant.time_ms == 0
    client.ask(write_coil_pdu(17, 0x0000))
    assert plant.time_ms == 10, "the last part of the block completes it"
    for scan in range(2, 12):
        client.ask(ALL_OFF)
        assert plant.time_ms == 10 * scan
    assert client.ask(write_coils_pdu(0, "0" * 19)) == exception(15, ILLEGAL_ADDRESS)
    assert plant.time_ms == 110


def test_in_lock_step_the_answer_to_a_write_comes_after_the_time_has_passed(client: Client) -> None:
    """The requests are pipelined: write, telemetry, write, telemetry."""
    client.send(frame(ALL_OFF) + frame(read_pdu(4, 0, 2)) + frame(ALL_OFF) + frame(read_pdu(4, 0, 2)))
    answers = [client.receive()[2] for _ in range(4)]
    assert answers[1::2] == [b"\x04\x04\x00\x00\x00\x0a", b"\x04\x04\x00\x00\x00\x14"]


def test_two_trials_in_lock_step_are_equal() -> None:
    """With the same seed and writes, over separate sockets, the registers are the same after every scan."""

    def trial() -> list[bytes]:
        rng = random.Random(3)
        log = []
        with Rig() as rig:
            client = rig.client()
            for _ in range(50):
                client.ask(write_coils_pdu(0, f"{rng.getrandbits(18):018b}"))
                log += [client.ask(READ_ALL_INPUTS), client.ask(read_pdu(4, 0, TELEMETRY_REGISTERS))]
        return log

    first, second = trial(), trial()
    assert first == second
    assert len(set(first)) > 50


@pytest.mark.parametrize("lock_step_ms", [0, -10, 101])
def test_a_lock_step_beyond_the_watchdog_time_is_rejected(lock_step_ms: int) -> None:
    with pytest.raises(ValueError, match="must be 1 to 100 ms"):
        PlantServer(make_module(), lock_step_ms=lock_step_ms)


def test_plant_time_and_watchdog_run_in_real_time() -> None:
    """After a single write the watchdog trips, although the client continues to read."""
    with Rig(PlantServer(make_module(), port=0)) as rig:
        client = rig.client()
        client.ask(write_coils_pdu(0, "000001" + "0" * 12))
        telemetry = read_registers(client)
        while telemetry["watchdog_state"] != WatchdogState.TRIPPED:
            assert telemetry["time_ms"] <= telemetry["last_write_ms"] + 100
            telemetry = read_registers(client)
        assert telemetry["tripped_at_ms"] == telemetry["last_write_ms"] + 101
        assert telemetry["y_image"] == 0
        assert client.ask(write_coil_pdu(5, 0xFF00)) == exception(5, DEVICE_FAILURE)


class BrokenPlant(Plant):
    """Plant whose equations raise an error."""

    def step(self, for_ms: int, y: Sequence[bool]) -> None:
        raise ArithmeticError("no such pressure")


@pytest.mark.parametrize("lock_step_ms", [None, 10], ids=["real time", "lock step"])
def test_an_error_of_the_plant_ends_the_server(lock_step_ms: int | None) -> None:
    """The error propagates to the caller of the server, and the server stops."""
    server = PlantServer(IoModule(BrokenPlant(IO_MAP, MACHINE, seed=1), IO_MAP), port=0, lock_step_ms=lock_step_ms)

    def run() -> None:
        with ServerThread(server), Client(server.port) as client:
            client.send(frame(ALL_OFF))
            client.rest_after_rubbish()

    with pytest.raises(ArithmeticError, match="no such pressure"):
        run()
    with pytest.raises(ConnectionRefusedError):
        Client(server.port)


# --- the output watchdog over the wire --------------------------------------------------------------


def test_a_tripped_module_answers_device_failure_until_all_is_safe(rig: Rig, client: Client) -> None:
    client.ask(write_coils_pdu(0, "000001" + "0" * 12))
    rig.thread.call(lambda: rig.module.advance(91))  # the write itself took 10 ms
    assert read_registers(client)["watchdog_state"] == WatchdogState.TRIPPED
    time_ms = rig.module.plant.time_ms

    assert client.ask(write_coils_pdu(0, "000001" + "0" * 12)) == exception(15, DEVICE_FAILURE)
    assert client.ask(write_coil_pdu(5, 0xFF00)) == exception(5, DEVICE_FAILURE)
    assert client.ask(read_pdu(1, 0, 18)) == b"\x01\x03\x00\x00\x00"
    assert rig.module.plant.time_ms == time_ms, "a refused write lets no time pass"
    client.ask(write_coil_pdu(100, 0xFF00))
    assert read_registers(client)["watchdog_state"] == WatchdogState.TRIPPED

    assert client.ask(ALL_OFF)[0] == 15
    assert read_registers(client)["watchdog_state"] == WatchdogState.ARMED
    assert client.ask(write_coil_pdu(5, 0xFF00))[0] == 5


@pytest.mark.parametrize(
    "pdu", [READ_ALL_INPUTS, read_pdu(1, 0, 18), read_pdu(4, 0, 8), write_coils_pdu(100, "0"), write_coil_pdu(18, 0)]
)
def test_only_output_writes_feed_the_watchdog(rig: Rig, client: Client, pdu: bytes) -> None:
    client.ask(write_coil_pdu(5, 0xFF00))
    rig.thread.call(lambda: rig.module.advance(100))
    client.ask(pdu)
    assert not rig.module.tripped
    rig.thread.call(lambda: rig.module.advance(1))
    assert rig.module.tripped


# --- connections ------------------------------------------------------------------------------------


def test_the_ninth_connection_is_closed_until_another_one_ends(rig: Rig) -> None:
    clients = [rig.client() for _ in range(8)]
    for client in clients:
        client.ask(READ_ALL_INPUTS)
    with Client(rig.server.port) as ninth:
        assert ninth.rest() == b""
    assert rig.server.traffic.refused == 1
    clients[3].socket.shutdown(socket.SHUT_WR)
    assert clients[3].rest() == b""
    assert rig.client().ask(READ_ALL_INPUTS)[0] == 2
    assert clients[0].ask(READ_ALL_INPUTS)[0] == 2


def test_many_connections_and_disconnections_leak_nothing(rig: Rig) -> None:
    for turn in range(300):
        with Client(rig.server.port) as client:
            client.send(frame(READ_ALL_INPUTS)[: turn % 13])
            client.socket.shutdown(socket.SHUT_WR)
            client.rest()
    assert rig.client().ask(READ_ALL_INPUTS)[0] == 2
    assert rig.server.traffic.refused == 0


def test_an_idle_connection_is_closed() -> None:
    with Rig(PlantServer(make_module(), port=0, lock_step_ms=10, idle_timeout_s=0.05)) as rig:
        assert rig.client().rest() == b""
        assert rig.server.traffic.timed_out == 1


def let_pass(rig: Rig, seconds: float) -> None:
    """Age all connections by a number of seconds, then run their timeout checks."""
    for connection in tuple(rig.server._frontend.connections):
        connection._last_request_s -= seconds
        connection._check_idle()


def test_only_complete_requests_keep_a_connection_alive(rig: Rig) -> None:
    """A connection that sends only parts of a frame for 61 s is closed; one with a complete request 2 s ago is not."""
    busy, halting = rig.client(), rig.client()
    halting.ask(READ_ALL_INPUTS)  # the server has accepted the connection, so let_pass ages it
    for piece, seconds in ((slice(0, 8), 59.0), (slice(8, 11), 2.0)):
        halting.send(frame(READ_ALL_INPUTS)[piece])
        busy.ask(READ_ALL_INPUTS)
        assert rig.server.traffic.timed_out == 0
        rig.thread.call(partial(let_pass, rig, seconds))
    assert halting.rest_after_rubbish() == b""
    assert rig.server.traffic.timed_out == 1
    busy.ask(READ_ALL_INPUTS)


def test_a_disconnected_client_is_not_timed_out_later(rig: Rig, client: Client) -> None:
    client.ask(READ_ALL_INPUTS)
    (connection,) = rig.server._frontend.connections
    client.socket.shutdown(socket.SHUT_WR)
    assert client.rest() == b""
    assert connection._idle_check is not None
    assert connection._idle_check.cancelled()


@pytest.mark.parametrize("count", first_of([4_000, 10_000]))
def test_requests_of_a_client_that_does_not_read_are_not_processed(rig: Rig, count: int) -> None:
    """The server buffers little unsent data, serves other clients, and continues once the client reads."""
    deaf, bystander = rig.client(), rig.client()
    deaf.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1_000_000)
    bystander.ask(READ_ALL_INPUTS)
    transports = [connection._transport for connection in rig.server._frontend.connections]
    for transport in transports:
        assert transport is not None
        transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 65_536)
    deaf.send(b"".join(frame(read_pdu(4, 0, TELEMETRY_REGISTERS), transaction=n) for n in range(count)))
    for _ in range(count // 50):  # each iteration serves the blocked client, up to 341 requests
        bystander.ask(READ_ALL_INPUTS)
    unsent = rig.thread.call(lambda: [transport.get_write_buffer_size() for transport in transports if transport])
    assert 0 < max(unsent) < 200_000
    assert [deaf.receive()[0] for _ in range(count)] == list(range(count))


def test_stop_sets_the_outputs_safe_and_closes_the_connections(rig: Rig) -> None:
    server = PlantServer(make_module(), port=0, lock_step_ms=10)
    with ServerThread(server), Client(server.port) as client:
        client.ask(write_coil_pdu(5, 0xFF00))
        assert server.module.outputs[5]
        port = server.port
    assert server.module.outputs == [False] * 18
    with pytest.raises(ConnectionRefusedError):
        Client(port)


def test_the_outputs_are_safe_although_the_port_cannot_be_closed() -> None:
    async def scenario(server: PlantServer) -> None:
        await server.start()
        server.module.write_outputs(5, [True])
        assert server.module.outputs[5]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(asyncio.Server, "close", failing)
            with pytest.raises(OSError, match="no port"):
                await server.stop()
        assert server.module.outputs == [False] * 18
        await server.stop()

    def failing(_: asyncio.Server) -> None:
        raise OSError("no port")

    asyncio.run(scenario(PlantServer(make_module(), port=0)))


def test_a_write_received_while_stopping_is_not_executed() -> None:
    async def scenario(server: PlantServer) -> None:
        await server.start()
        with Client(server.port) as client:
            await asyncio.to_thread(client.ask, READ_ALL_INPUTS)
            client.send(frame(write_coil_pdu(5, 0xFF00)))
            await server.stop()

    server = PlantServer(make_module(), port=0)
    asyncio.run(scenario(server))
    assert server.module.outputs == [False] * 18


def test_stop_disconnects_a_connected_client() -> None:
    server = PlantServer(make_module(), port=0, lock_step_ms=10)
    with ExitStack() as stack:
        with ServerThread(server):
            client = stack.enter_context(Client(server.port))
            client.ask(READ_ALL_INPUTS)
        assert client.rest() == b""


def test_a_port_in_use_is_an_os_error_that_names_it(rig: Rig) -> None:
    second = PlantServer(make_module(), port=rig.server.port, lock_step_ms=10)
    with pytest.raises(OSError, match=rf"{rig.server.port}.*in use"), ServerThread(second):
        pass
    assert rig.client().ask(READ_ALL_INPUTS)[0] == 2


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1"])  # noqa: S104 - must be rejected
def test_a_remote_address_requires_permission(host: str) -> None:
    with pytest.raises(ValueError, match="Modbus has no password"):
        PlantServer(make_module(), host=host)
    PlantServer(make_module(), host=host, allow_remote=True)


def test_a_host_must_be_an_address() -> None:
    with pytest.raises(ValueError, match="must be an IP address or localhost"):
        PlantServer(make_module(), host="plant.example")


def test_the_default_address_is_loopback_port_5020() -> None:
    server = PlantServer(make_module())
    assert (server.host, server.port) == ("127.0.0.1", 5020)


# --- malformed data ----------------------------------------------------------------------------------------


def mutated(rng: random.Random) -> bytes:
    """Return a valid frame with some bytes changed, removed or appended."""
    data = bytearray(
        frame(
            rng.choice(
                [
                    *[read_pdu(rng.choice([1, 2, 4]), rng.randrange(120), rng.randrange(2_100)), READ_ALL_INPUTS],
                    *[write_coil_pdu(rng.randrange(120), rng.choice([0, 0xFF00])), ALL_OFF],
                    write_coils_pdu(rng.randrange(19), f"{rng.getrandbits(18):018b}"),
                ]
            ),
            transaction=rng.getrandbits(16),
        )
    )
    for _ in range(rng.randrange(4)):
        data[rng.randrange(len(data))] = rng.choice([0, 1, 0x7F, 0x80, 0xFF, rng.getrandbits(8)])
    cut = rng.randrange(len(data) + 1) if rng.random() < 0.2 else len(data)
    tail = rng.randbytes(rng.randrange(30)) if rng.random() < 0.2 else b""
    return bytes(data[:cut]) + tail


@pytest.mark.parametrize("frames", first_of([600, 2_000]))
def test_mutated_frames(rig: Rig, caplog: pytest.LogCaptureFixture, frames: int) -> None:
    """Every response is a valid frame, another client is always served, and nothing is logged."""
    caplog.set_level(logging.INFO)
    rng = random.Random(2026)
    bystander = rig.client()
    answered = 0
    for turn in range(frames):
        with Client(rig.server.port) as client:
            client.send(mutated(rng))
            with contextlib.suppress(OSError):  # the server may have closed already
                client.socket.shutdown(socket.SHUT_WR)
            answers = client.rest_after_rubbish()
        while answers:
            _, protocol, length, _, function_code = struct.unpack(">HHHBB", answers[:8])
            assert protocol == 0
            assert len(answers) >= 6 + length
            if function_code & 0x80:
                assert length == 3
                assert 1 <= answers[8] <= 4
            answers = answers[6 + length :]
            answered += 1
        if turn % 20 == 0:
            assert bystander.ask(READ_ALL_INPUTS)[:2] == b"\x02\x03"
    assert answered > frames / 2
    assert rig.server.traffic.bad_frames > frames / 20
    assert caplog.records == []
