"""A Modbus RTU server behind an RS-485 adapter that returns what is sent: each request is executed once."""

from __future__ import annotations

import asyncio
import logging
import os
import tty
from collections.abc import Awaitable, Callable, Sequence

import pytest

from controller.common.modbus.requests import ModbusDevice
from controller.common.modbus.returned_answer import RETURN_S, ReturnedAnswers
from controller.common.modbus.rtu import RtuServer, SerialLine, framed

UNIT = 3
WRITE = framed(UNIT, bytes([5, 0, 7, 0xFF, 0]))
"""Request whose answer has the same bytes."""
READ = framed(UNIT, bytes([1, 0, 7, 0, 1]))
LIMIT_S = 30.0


class Register(ModbusDevice):
    """Device that records its writes."""

    def __init__(self) -> None:
        self.writes: list[tuple[int, list[bool]]] = []

    def read_coils(self, first: int, count: int) -> list[bool]:
        assert (first, count) == (7, 1)
        return [True]

    async def write_coils(self, first: int, levels: Sequence[bool]) -> None:
        self.writes.append((first, list(levels)))


class Adapter:
    """Adapter and partner of the server; the adapter returns the first bytes of an answer that a function tells."""

    def __init__(self, end: int, returned: Callable[[bytes], bytes]) -> None:
        self.returned = returned
        self._end = end

    async def ask(self, request: bytes) -> bytes:
        """Send a request, return its answer of 8 bytes or less, and let the adapter return it to the server."""
        os.write(self._end, request)
        return await self.answer(8 if request[1] == 5 else 6)

    async def answer(self, size: int) -> bytes:
        loop, received = asyncio.get_running_loop(), b""
        while len(received) < size:
            ready = asyncio.Event()
            loop.add_reader(self._end, ready.set)
            await asyncio.wait_for(ready.wait(), LIMIT_S)
            loop.remove_reader(self._end)
            received += os.read(self._end, size)
        os.write(self._end, self.returned(received))
        return received


def played(
    play: Callable[[Adapter], Awaitable[None]], returned: Callable[[bytes], bytes]
) -> list[tuple[int, list[bool]]]:
    """Return the writes that a server has executed in a play of its partner."""
    device = Register()
    end, slave = os.openpty()
    tty.setraw(slave)
    server = RtuServer(SerialLine(os.ttyname(slave), 115_200, "N", 1, UNIT), device)

    async def run() -> None:
        server.start(asyncio.get_running_loop())
        try:
            await play(Adapter(end, returned))
        finally:
            server.stop()

    try:
        asyncio.run(run())
    finally:
        os.close(slave)
        os.close(end)
    return device.writes


def as_sent(answer: bytes) -> bytes:
    return answer


def nothing(_answer: bytes) -> bytes:
    return b""


async def three_writes(adapter: Adapter) -> None:
    for _ in range(3):
        assert await adapter.ask(WRITE) == WRITE
    for _ in range(2):  # the answer to the second shows that what returned before it has been processed
        assert (await adapter.ask(READ))[:3] == bytes([UNIT, 1, 1])


async def read_then_three_writes(adapter: Adapter) -> None:
    assert (await adapter.ask(READ))[:3] == bytes([UNIT, 1, 1])
    await three_writes(adapter)


@pytest.mark.parametrize("play", [three_writes, read_then_three_writes])
def test_a_returned_answer_is_not_executed(
    play: Callable[[Adapter], Awaitable[None]], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        assert played(play, as_sent) == [(7, [True])] * 3
    told = [record.getMessage() for record in caplog.records]
    assert len(told) == 1
    assert told[0].endswith(": the adapter returns what is sent; the returned bytes are removed")


def test_without_such_an_adapter_equal_requests_are_executed_at_once() -> None:
    """The first read shows it: a request that differs from the answer comes first."""
    assert played(read_then_three_writes, nothing) == [(7, [True])] * 3


def test_an_answer_that_returns_damaged_does_not_hide_the_adapter() -> None:
    async def play(adapter: Adapter) -> None:
        adapter.returned = lambda answer: b"\xff" + answer[1:]
        await adapter.ask(READ)
        adapter.returned = as_sent
        await three_writes(adapter)

    assert played(play, as_sent) == [(7, [True])] * 3


def test_the_adapter_is_unknown_again_after_a_disconnection() -> None:
    server = RtuServer(SerialLine("line", unit=UNIT), Register())
    server._returned.are_returned = False
    server._on_disconnect()
    assert server._returned.are_returned is None


# ---- the rule, without a line ----------------------------------------------------------------------------------------


def is_write(frame: bytes) -> bool:
    return frame == WRITE


def after(
    answer: bytes, *received: bytes, now_s: float = 0.0, known: bool | None = None
) -> tuple[bytes, bool, bool | None]:
    """Return what is left of the bytes received after an answer, whether it can be processed, and what is known."""
    rule, buffer = ReturnedAnswers("line", is_write), bytearray()
    rule.are_returned = known
    rule.sent(answer, 0.0)
    done = True
    for part in received:
        buffer += part
        done = rule.remove(buffer, now_s)
        if done and buffer == READ:
            rule.request_served()
    return bytes(buffer), done, rule.are_returned


ANSWER = framed(UNIT, bytes([1, 1, 1]))


@pytest.mark.parametrize(
    ("answer", "received", "known", "expected"),
    [
        (ANSWER, [ANSWER], None, (b"", True, True)),
        (ANSWER, [ANSWER + WRITE], None, (WRITE, True, True)),
        (ANSWER, [ANSWER[:2]], None, (ANSWER[:2], False, None)),
        (ANSWER, [ANSWER[:2], ANSWER[2:]], None, (b"", True, True)),
        (ANSWER, [READ], None, (READ, True, False)),
        (WRITE, [WRITE], None, (b"", True, None)),
        (WRITE, [WRITE], True, (b"", True, True)),
        (WRITE, [WRITE], False, (WRITE, True, False)),
        (ANSWER, [ANSWER], False, (b"", True, True)),
        (WRITE, [WRITE, WRITE], None, (WRITE, True, None)),
    ],
)
def test_the_first_bytes_after_an_answer_show_the_adapter(
    answer: bytes, received: list[bytes], known: bool | None, expected: tuple[bytes, bool, bool | None]
) -> None:
    assert after(answer, *received, known=known) == expected


def test_a_frame_that_comes_later_is_a_request_of_the_partner() -> None:
    assert after(WRITE, WRITE, now_s=RETURN_S) == (b"", True, None)
    assert after(WRITE, WRITE, now_s=RETURN_S + 0.001) == (WRITE, True, None)


def test_an_answer_that_begins_in_time_may_end_later() -> None:
    rule, buffer = ReturnedAnswers("line", is_write), bytearray(WRITE[:3])
    rule.sent(WRITE, 0.0)
    assert not rule.remove(buffer, RETURN_S)
    buffer += WRITE[3:]
    assert rule.remove(buffer, 2 * RETURN_S)
    assert buffer == b""


def test_a_damaged_answer_does_not_show_that_nothing_returns() -> None:
    rule, buffer = ReturnedAnswers("line", is_write), bytearray(b"\xff" + ANSWER)
    rule.sent(ANSWER, 0.0)
    assert rule.remove(buffer, 0.0)
    rule.noise_received()
    rule.request_served()
    assert rule.are_returned is None
