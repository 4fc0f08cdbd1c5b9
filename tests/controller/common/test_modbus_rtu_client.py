"""Asynchronous Modbus client of a serial line: answers, silence between frames, and errors of the line."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from controller.common.modbus.async_client import AsyncRtuClient, ModbusClientError
from controller.common.modbus.rtu import SerialLine, framed
from scripts.benchmark.live.serial_cable import SerialCable
from tests.controller.common.asyncio_rig import SimulatedLoop, SimulatedPort, run
from tests.controller.common.modbus_rig import read_pdu

UNIT = 17
REQUEST = read_pdu(1, 0, 18)
ANSWER = b"\x01\x03\x01\x02\x03"
LINE = SerialLine("/dev/ttyPLC", 9_600, "N", 1, UNIT)
TIMEOUT_S = 0.2
ANSWER_LIMIT_S = 0.475
"""The timeout and the transmission of 8 and at most 256 bytes, s, at 10 bits per byte."""
QUIET_S = ANSWER_LIMIT_S + TIMEOUT_S
SILENCE_S = 3.5 * 10 / 9_600
FRAME = framed(UNIT, ANSWER)


def on_line(
    monkeypatch: pytest.MonkeyPatch, port: SimulatedPort, use: Callable[[AsyncRtuClient], Awaitable[None]]
) -> None:
    """Use a client with an open line in simulated time, and close it."""
    monkeypatch.setattr(SerialLine, "open", lambda _line: port)

    async def main() -> None:
        client = AsyncRtuClient(LINE, timeout_s=TIMEOUT_S)
        await client.open()
        await use(client)
        client.close()

    run(main(), SimulatedLoop)
    assert port.is_closed


def test_frames_on_a_line_are_accepted_only_with_unit_and_checksum() -> None:
    """Another unit, an invalid checksum and half an answer are not answers; the next exchange is not disturbed by late
    ones.
    """

    async def exchange(cable: SerialCable) -> None:
        client = AsyncRtuClient(SerialLine(cable.ends[0], 115_200, "N", 1, UNIT), timeout_s=0.2)
        await client.open()
        loop = asyncio.get_running_loop()
        device = SerialLine(cable.ends[1], 115_200, "N", 1).open()

        def answer_with(data: bytes) -> None:
            if device.read(300):
                device.write(data)

        for wrong in (framed(18, ANSWER), FRAME[:-1] + bytes([FRAME[-1] ^ 1]), FRAME[:4]):
            loop.add_reader(device.fileno(), answer_with, wrong)
            with pytest.raises(ModbusClientError, match="no valid answer"):
                await client.request(REQUEST)
        loop.add_reader(device.fileno(), answer_with, FRAME)
        assert await client.request(REQUEST) == ANSWER
        loop.remove_reader(device.fileno())
        device.close()
        client.close()

    with SerialCable() as cable:
        run(exchange(cable))


def test_a_request_on_a_line_ends_when_another_task_closes_the_client(monkeypatch: pytest.MonkeyPatch) -> None:
    port = SimulatedPort([])

    async def use(client: AsyncRtuClient) -> None:
        asyncio.get_running_loop().call_later(0.1, client.close)
        with pytest.raises(ModbusClientError, match=r"^closed during the request$"):
            await client.request(REQUEST)
        assert asyncio.get_running_loop().time() == pytest.approx(0.1)
        with pytest.raises(ModbusClientError, match="not connected"):
            await client.request(REQUEST)

    on_line(monkeypatch, port, use)


def test_a_line_that_is_opened_again_leaves_no_port_open(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = SimulatedPort([]), SimulatedPort([(0.1, FRAME)])

    async def use(client: AsyncRtuClient) -> None:
        monkeypatch.setattr(SerialLine, "open", lambda _line: second)
        await client.open()
        assert first.is_closed
        assert await client.request(REQUEST) == ANSWER

    on_line(monkeypatch, first, use)
    assert second.is_closed


def test_after_an_answer_the_line_is_silent_as_between_two_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    port = SimulatedPort([(0.1, FRAME)], [(0.1, FRAME[:4]), (0.2, FRAME[4:])])

    async def use(client: AsyncRtuClient) -> None:
        for _ in range(2):
            assert await client.request(REQUEST) == ANSWER
        assert [frame for _, frame in port.sent] == 2 * [framed(UNIT, REQUEST)]
        assert [at_s for at_s, _ in port.sent] == pytest.approx([0, 0.1 + SILENCE_S])
        assert asyncio.get_running_loop().time() == pytest.approx(0.3 + SILENCE_S)

    on_line(monkeypatch, port, use)


@pytest.mark.parametrize(("after_s", "is_answer"), [(ANSWER_LIMIT_S - 0.001, True), (ANSWER_LIMIT_S + 0.001, False)])
def test_on_a_line_an_answer_counts_until_its_time_limit(
    monkeypatch: pytest.MonkeyPatch, after_s: float, *, is_answer: bool
) -> None:
    """After a request without an answer the line is silent for the timeout in addition."""
    port = SimulatedPort([(after_s, FRAME)], [(0.1, FRAME)])

    async def use(client: AsyncRtuClient) -> None:
        if is_answer:
            assert await client.request(REQUEST) == ANSWER
        else:
            with pytest.raises(ModbusClientError, match=r"^no valid answer within 475 ms$"):
                await client.request(REQUEST)
            assert asyncio.get_running_loop().time() == pytest.approx(ANSWER_LIMIT_S)
        assert await client.request(REQUEST) == ANSWER
        assert port.sent[1][0] == pytest.approx(after_s + SILENCE_S if is_answer else QUIET_S)

    on_line(monkeypatch, port, use)


def test_on_a_line_the_answer_to_a_cancelled_request_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    port = SimulatedPort([(0.3, FRAME)], [(0.1, FRAME)])

    async def use(client: AsyncRtuClient) -> None:
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(client.request(REQUEST), 0.1)
        assert await client.request(REQUEST) == ANSWER
        assert port.sent[1][0] == pytest.approx(QUIET_S)

    on_line(monkeypatch, port, use)


def test_on_a_line_bytes_in_the_port_are_discarded_before_a_request(monkeypatch: pytest.MonkeyPatch) -> None:
    """They have the form of an answer."""
    port = SimulatedPort([(0.1, FRAME)])

    async def use(client: AsyncRtuClient) -> None:
        port.receive(framed(UNIT, b"\x01\x03\xff\xff\xff"))
        assert await client.request(REQUEST) == ANSWER

    on_line(monkeypatch, port, use)


def test_a_line_that_fails_while_an_answer_is_awaited_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The failed line is read once, although it remains readable."""
    port = SimulatedPort([(0.1, OSError("device disconnected"))])

    async def use(client: AsyncRtuClient) -> None:
        with pytest.raises(ModbusClientError, match=r"^serial line: device disconnected$"):
            await client.request(REQUEST)
        assert asyncio.get_running_loop().time() == pytest.approx(0.1)
        assert port.reads == 1

    on_line(monkeypatch, port, use)


def test_a_line_that_fails_between_two_requests_is_told_by_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    port = SimulatedPort([(0.1, FRAME), (0.1, OSError("device disconnected"))], OSError("no such device"))

    async def use(client: AsyncRtuClient) -> None:
        assert await client.request(REQUEST) == ANSWER
        with pytest.raises(ModbusClientError, match=r"^serial line: no such device$"):
            await client.request(REQUEST)
        assert port.reads == 2

    on_line(monkeypatch, port, use)


def test_a_closed_line_is_not_connected(monkeypatch: pytest.MonkeyPatch) -> None:
    port = SimulatedPort()

    async def use(client: AsyncRtuClient) -> None:
        unopened = AsyncRtuClient(LINE, timeout_s=TIMEOUT_S)
        unopened.close()
        for _ in range(2):
            client.close()
            assert port.is_closed
            for closed in (client, unopened):
                with pytest.raises(ModbusClientError, match=r"^not connected$"):
                    await closed.request(REQUEST)
        assert port.sent == []

    on_line(monkeypatch, port, use)


@pytest.mark.parametrize("error", [OSError("no such file"), ValueError("invalid rate"), OverflowError("rate too high")])
def test_a_line_that_cannot_be_opened_is_told(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def fail(_line: SerialLine) -> None:
        raise error

    async def open_it() -> None:
        monkeypatch.setattr(SerialLine, "open", fail)
        client = AsyncRtuClient(LINE, timeout_s=TIMEOUT_S)
        assert client.address == LINE.path
        with pytest.raises(ModbusClientError, match=rf"^serial line cannot be opened: {error}$"):
            await client.open()
        with pytest.raises(ModbusClientError, match=r"^not connected$"):
            await client.request(REQUEST)

    run(open_it(), SimulatedLoop)


WRITE = b"\x06\x00\x07\x12\x34"
PROBE, REFUSED = read_pdu(3, 0, 1), b"\x83\x02"


@pytest.mark.parametrize("returns", [False, True])
def test_a_write_whose_answer_is_its_request_is_preceded_by_a_read(
    monkeypatch: pytest.MonkeyPatch, *, returns: bool
) -> None:
    """The read shows whether the adapter returns what is sent; one copy of the write is then no answer of the unit."""
    probe, write = framed(UNIT, PROBE), framed(UNIT, WRITE)
    own = returns * write
    port = SimulatedPort(
        [(0.1, returns * probe + framed(UNIT, REFUSED))], [(0.1, own), (0.2, write)], [(0.1, returns * write)]
    )

    async def use(client: AsyncRtuClient) -> None:
        assert await client.request(WRITE) == WRITE
        assert [frame for _, frame in port.sent] == [probe, write]
        with pytest.raises(ModbusClientError, match="no valid answer"):
            await client.request(WRITE)

    on_line(monkeypatch, port, use)
