"""Capture proxy: a defect in the decoding ends one connection on both sides, and the proxy works on."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from controller.common.stop_request import StopRequest
from controller.common.supervision.failures import failures
from controller.io import capture_proxy
from controller.io.capture_proxy import Decoder, forward
from tests.controller.common.asyncio_rig import run
from tests.controller.common.modbus_rig import frame, write_coils_pdu
from tests.controller.common.supervision.failure_rig import DefectError, FailsOnce, drawn, fresh_counts
from tests.real_time import WAIT_S

REQUEST = frame(write_coils_pdu(0, "0101"))
Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@pytest.fixture(autouse=True)
def _counts(monkeypatch: pytest.MonkeyPatch) -> None:
    fresh_counts(monkeypatch)


class CountingDecoder(Decoder):
    """Decoder that counts the answers, and fails at one of them."""

    def __init__(self, failing: int) -> None:
        self.answers = 0
        self._failing = failing

    def answered(self, request: bytes, answer: bytes) -> None:
        self.answers += 1
        if self.answers == self._failing + 1:
            raise DefectError


def through_proxy(
    decoder: Decoder, work: Callable[[Callable[[], Coroutine[Any, Any, Streams]], asyncio.Queue[str]], Any]
) -> None:
    """Run a function with a proxy before a field I/O that echoes; it gets a connecting function and the ends."""

    async def main() -> None:
        ended: asyncio.Queue[str] = asyncio.Queue()
        echoes: list[Any] = []

        async def echo(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            echoes.append(asyncio.current_task())
            while data := await reader.read(4_096):
                writer.write(data)
            await closed(writer)
            ended.put_nowait("field")

        async def connect() -> Streams:
            return await asyncio.open_connection("127.0.0.1", await ready)

        ready: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        field = await asyncio.start_server(echo, "127.0.0.1", 0)
        address = ("127.0.0.1", field.sockets[0].getsockname()[1])
        with StopRequest() as stop:
            async with asyncio.timeout(WAIT_S), field:
                proxy = asyncio.create_task(forward(("127.0.0.1", 0), address, decoder, stop, ready.set_result))
                await work(connect, ended)
                stop.set()
                await asyncio.gather(proxy, *echoes)

    run(main())


async def exchanged(streams: Streams) -> bool:
    """Return whether a request is answered; False if the connection has ended."""
    reader, writer = streams
    writer.write(REQUEST)
    answer = await reader.read(len(REQUEST))
    assert answer in {REQUEST, b""}
    return bool(answer)


async def closed(writer: asyncio.StreamWriter) -> None:
    """Close a connection and wait until it is closed."""
    writer.close()
    await writer.wait_closed()


@pytest.mark.parametrize("failing", drawn("captured direction", 30))
def test_a_defect_in_the_decoding_closes_both_sides_and_others_are_forwarded(failing: int) -> None:
    decoder = CountingDecoder(failing)

    async def work(connect: Callable[[], Coroutine[Any, Any, Streams]], ended: asyncio.Queue[str]) -> None:
        master = await connect()
        assert [await exchanged(master) for _ in range(failing + 1)] == [True] * failing + [False]
        assert await ended.get() == "field"
        await closed(master[1])
        again = await connect()
        assert [await exchanged(again) for _ in range(3)] == [True] * 3
        await closed(again[1])

    through_proxy(decoder, work)
    assert (decoder.answers, failures()) == (failing + 4, {"captured direction": 1})


@pytest.mark.parametrize("failing", drawn("captured connection", 8, 1))
def test_a_defect_in_a_connection_closes_it(failing: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capture_proxy, "_relay", FailsOnce(capture_proxy._relay, failing))

    async def work(connect: Callable[[], Coroutine[Any, Any, Streams]], _: asyncio.Queue[str]) -> None:
        answered: list[bool] = []
        while len(answered) < 8:
            master = await connect()
            answered.append(await exchanged(master))
            await closed(master[1])
        assert answered == [number != failing for number in range(8)]

    through_proxy(CountingDecoder(10), work)
    assert failures() == {"captured connection": 1}
