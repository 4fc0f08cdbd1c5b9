"""Asynchronous Modbus client of a TCP connection: answers, their absence, and the end of the connection."""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
from collections.abc import Awaitable, Callable
from contextlib import suppress
from typing import Any

import pytest

from controller.common.modbus.async_client import AsyncTcpClient, ModbusClientError
from controller.common.modbus.mbap import HEADER
from tests.controller.common.asyncio_rig import SimulatedLoop, run
from tests.controller.common.modbus_rig import read_pdu

UNIT = 17
LIMIT_S = 60.0
REQUEST = read_pdu(1, 0, 18)
ANSWER = b"\x01\x03\x01\x02\x03"

Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]
Use = Callable[[AsyncTcpClient], Awaitable[None]]


def tcp_answer(request: bytes, pdu: bytes, *, later: int = 0) -> bytes:
    transaction, _, _, unit = HEADER.unpack_from(request)
    return HEADER.pack(transaction + later, 0, len(pdu) + 1, unit) + pdu


async def with_server(serve: Serve, use: Use, *, timeout_s: float = LIMIT_S, connections: int = 1) -> None:
    """Use a client; then close it, and wait until each of its connections has been served."""
    sessions: asyncio.Queue[asyncio.Task[None]] = asyncio.Queue()

    async def session(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with suppress(ConnectionError):
            await serve(reader, writer)
        writer.transport.abort()

    def begin(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        sessions.put_nowait(asyncio.create_task(session(reader, writer)))

    async with await asyncio.start_server(begin, "127.0.0.1", 0) as server:
        client = AsyncTcpClient("127.0.0.1", server.sockets[0].getsockname()[1], timeout_s=timeout_s, unit=UNIT)
        assert not client.is_open
        await use(client)
        client.close()
        for _ in range(connections):
            await (await sessions.get())


def end_of_connection(monkeypatch: pytest.MonkeyPatch) -> asyncio.Event:
    """Return an event that is set after the client has been told the end of the connection that it opens next."""
    ended, loop = asyncio.Event(), asyncio.get_running_loop()
    connect = loop.create_connection

    async def create_connection(factory: Callable[[], asyncio.Protocol], host: str, port: int) -> Any:
        protocol = factory()
        told = protocol.connection_lost

        def connection_lost(error: Exception | None) -> None:
            ended.set()
            told(error)

        monkeypatch.setattr(protocol, "connection_lost", connection_lost)
        return await connect(lambda: protocol, host, port)

    monkeypatch.setattr(loop, "create_connection", create_connection)
    return ended


def close(writer: asyncio.StreamWriter) -> None:
    writer.close()


def reset(writer: asyncio.StreamWriter) -> None:
    """End a connection without the handshake that ends it in order."""
    writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    writer.transport.abort()


def test_on_tcp_requests_are_answered_on_one_connection() -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        for number in range(3):
            writer.write(tcp_answer(await reader.readexactly(12), bytes([1, number])))
        await reader.read()

    async def use(client: AsyncTcpClient) -> None:
        await client.open()
        for number in range(3):
            assert await client.request(REQUEST) == bytes([1, number])
            assert client.is_open

    run(with_server(serve, use))


def test_on_tcp_a_request_without_an_answer_closes_the_connection() -> None:
    """No late answer can be taken for that of a later request; the client must be opened again."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read()  # until the connection ends

    async def use(client: AsyncTcpClient) -> None:
        await client.open()
        with pytest.raises(ModbusClientError, match=r"^no answer within 50 ms$"):
            await client.request(REQUEST)
        assert not client.is_open
        with pytest.raises(ModbusClientError, match="not connected"):
            await client.request(REQUEST)

    run(with_server(serve, use, timeout_s=0.05))


def test_on_tcp_a_request_ends_when_another_task_closes_the_client() -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read()

    async def use(client: AsyncTcpClient) -> None:
        await client.open()
        asyncio.get_running_loop().call_soon(client.close)
        with pytest.raises(ModbusClientError, match=r"^closed during the request$"):
            await client.request(REQUEST)
        assert not client.is_open

    run(with_server(serve, use))


def test_on_tcp_a_frame_that_is_no_answer_is_reported() -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(tcp_answer(await reader.read(100), ANSWER, later=1))
        await reader.read(100)

    async def use(client: AsyncTcpClient) -> None:
        await client.open()
        with pytest.raises(ModbusClientError, match="no answer within 500 ms, but a frame with transaction 2,"):
            await client.request(REQUEST)

    run(with_server(serve, use, timeout_s=0.5))


def test_on_tcp_the_beginning_of_an_answer_is_not_joined_to_the_next_connection() -> None:
    received = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        answer = tcp_answer(await reader.read(100), ANSWER)
        writer.write(answer if received.is_set() else answer[:-1])
        received.set()
        await reader.read(100)

    async def use(client: AsyncTcpClient) -> None:
        await client.open()
        with pytest.raises(ModbusClientError, match="no answer"):
            await client.request(REQUEST)
        await client.open()
        assert await client.request(REQUEST) == ANSWER

    run(with_server(serve, use, timeout_s=0.5, connections=2))


def test_on_tcp_a_cancelled_request_closes_the_connection() -> None:
    received = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        received.set()
        await reader.read(100)

    async def use(client: AsyncTcpClient) -> None:
        await client.open()
        request = asyncio.ensure_future(client.request(REQUEST))
        await received.wait()
        request.cancel()
        with pytest.raises(asyncio.CancelledError):
            await request
        assert not client.is_open

    run(with_server(serve, use))


@pytest.mark.parametrize("end", [close, reset])
def test_on_tcp_the_end_of_the_connection_is_told_at_once(end: Callable[[asyncio.StreamWriter], None]) -> None:
    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await reader.read(100)
        end(writer)

    async def use(client: AsyncTcpClient) -> None:
        await client.open()
        with pytest.raises(ModbusClientError, match="connection closed by the server"):
            await client.request(REQUEST)
        assert not client.is_open

    run(with_server(serve, use))


@pytest.mark.parametrize("end", [close, reset])
def test_on_tcp_a_connection_that_ends_between_two_requests_is_not_open(
    monkeypatch: pytest.MonkeyPatch, end: Callable[[asyncio.StreamWriter], None]
) -> None:
    """The end is no error of a request; the next one is refused, until the client is opened again."""
    answered = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(tcp_answer(await reader.read(100), ANSWER))
        await answered.wait()
        end(writer)

    async def use(client: AsyncTcpClient) -> None:
        ended = end_of_connection(monkeypatch)
        await client.open()
        assert await client.request(REQUEST) == ANSWER
        answered.set()
        await ended.wait()
        assert not client.is_open
        with pytest.raises(ModbusClientError, match="not connected"):
            await client.request(REQUEST)
        await client.open()
        assert await client.request(REQUEST) == ANSWER

    run(with_server(serve, use, connections=2))


def test_on_tcp_a_closed_client_is_not_open(monkeypatch: pytest.MonkeyPatch) -> None:
    async def serve(reader: asyncio.StreamReader, _writer: asyncio.StreamWriter) -> None:
        assert await reader.read(100) == b""

    async def use(client: AsyncTcpClient) -> None:
        ended = end_of_connection(monkeypatch)
        await client.open()
        for _ in range(2):
            client.close()
            assert not client.is_open
            with pytest.raises(ModbusClientError, match="not connected"):
                await client.request(REQUEST)
        await ended.wait()

    run(with_server(serve, use))


def test_an_answer_that_has_arrived_counts_even_if_the_event_loop_looks_late() -> None:
    """The computer stops the client for longer than the timeout; the answer arrives meanwhile."""
    answered = threading.Event()

    def serve(listener: socket.socket) -> None:
        connection, _ = listener.accept()
        with connection:
            request = connection.recv(100)
            connection.sendall(tcp_answer(request, bytes([request[6]])))  # the unit identifier
            answered.set()
            connection.recv(100)

    def stop() -> None:
        answered.wait(LIMIT_S)
        threading.Event().wait(0.1)

    async def use(port: int) -> None:
        client = AsyncTcpClient("127.0.0.1", port, timeout_s=0.05)
        await client.open()
        request = asyncio.ensure_future(client.request(REQUEST))
        asyncio.get_running_loop().call_soon(stop)  # directly after the request has been sent
        assert await request == b"\x01"  # unit 1, if none is specified
        client.close()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = threading.Thread(target=serve, args=(listener,))
        server.start()
        run(use(listener.getsockname()[1]))
        server.join(LIMIT_S)


def test_to_open_an_open_connection_closes_the_first_one() -> None:
    first_ended = asyncio.Event()

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while request := await reader.read(100):
            await first_ended.wait()
            writer.write(tcp_answer(request, ANSWER))
        first_ended.set()

    async def use(client: AsyncTcpClient) -> None:
        for _ in range(2):
            await client.open()
        assert await client.request(REQUEST) == ANSWER
        assert client.is_open

    run(with_server(serve, use, connections=2))


def test_a_server_that_is_not_there_is_told() -> None:
    async def open_it() -> None:
        client = AsyncTcpClient("127.0.0.1", 1, timeout_s=60.0)
        assert client.address == "127.0.0.1:1"
        with pytest.raises(ModbusClientError, match=r"^Connect call failed"):
            await client.open()
        assert not client.is_open

    run(open_it())


def test_a_server_that_cannot_be_reached_by_any_address_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The error of several attempts has no text of the operating system."""

    async def create_connection(*_arguments: object) -> None:
        raise OSError("Multiple exceptions: one, two")

    async def open_it() -> None:
        monkeypatch.setattr(asyncio.get_running_loop(), "create_connection", create_connection)
        with pytest.raises(ModbusClientError, match=r"^Multiple exceptions: one, two$"):
            await AsyncTcpClient("plc", 502, timeout_s=60.0).open()

    run(open_it())


def test_a_server_that_does_not_accept_in_time_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    async def create_connection(*_arguments: object) -> None:
        await asyncio.Event().wait()

    async def open_it() -> None:
        loop = asyncio.get_running_loop()
        monkeypatch.setattr(loop, "create_connection", create_connection)
        client = AsyncTcpClient("plc", 502, timeout_s=1.5)
        with pytest.raises(ModbusClientError, match=r"^not reachable within 1500 ms$"):
            await client.open()
        assert loop.time() == pytest.approx(1.5)
        assert not client.is_open

    run(open_it(), SimulatedLoop)
