"""Transparent proxy between a Modbus TCP master and its field I/O that captures the images of both directions.

Frames are forwarded unchanged and are decoded beside the traffic: functions 2 (inputs), 5 and 15 (outputs). Sources:
Modbus Application Protocol V1.1b3, sections 6.2, 6.5 and 6.11; framing as in `controller.common.modbus.mbap`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import struct
from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

from controller.common.capture import CaptureWriter
from controller.common.modbus.io_map import IoMap, Point
from controller.common.modbus.mbap import HEADER, MAX_LENGTH, MIN_LENGTH, UNCOUNTED_BYTES
from controller.common.stop_request import StopRequest
from controller.common.supervision.tasks import supervised_task
from controller.core.clock import Clock

_log = logging.getLogger(__name__)

READ_INPUTS: Final = 2
WRITE_COIL: Final = 5
WRITE_COILS: Final = 15
_MAX_WAITING: Final = 64
"""Requests of one connection that are remembered until their answers (assumed); masters send one at a time."""


_Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Decoder:
    """Images of the field, decoded from requests and their answers."""

    def __init__(self, io_map: IoMap, writer: CaptureWriter, clock: Clock) -> None:
        """Create a decoder that writes every changed image."""
        self._writer = writer
        self._clock = clock
        self._numbers = {"X": _numbers(io_map.inputs), "Y": _numbers(io_map.outputs)}
        self._images = {"X": [False] * io_map.input_count, "Y": [False] * io_map.output_count}

    def answered(self, request: bytes, answer: bytes) -> None:
        """Apply a request and its answer, both without header; an exception response changes nothing."""
        if len(request) < 5 or not answer or answer[0] != request[0]:
            return
        function, first, count = struct.unpack_from(">BHH", request)
        if function == READ_INPUTS and len(answer) >= 2 + (count + 7) // 8:
            self._set("X", first, _bits(answer[2:], count))
        elif function == WRITE_COILS and len(request) >= 6 + (count + 7) // 8:
            self._set("Y", first, _bits(request[6:], count))
        elif function == WRITE_COIL:
            self._set("Y", first, [count == 0xFF00])

    def _set(self, kind: str, first: int, levels: Iterable[bool]) -> None:
        image, is_known = self._images[kind], False
        for offset, level in enumerate(levels, first):
            number = self._numbers[kind].get(offset)
            if number is not None:
                image[number], is_known = level, True
        if is_known:
            self._writer.image(self._clock.now_ms(), kind, image)


class _Connection:
    """Requests of one connection that wait for their answers."""

    def __init__(self, decoder: Decoder) -> None:
        self._decoder = decoder
        self._waiting: dict[int, bytes] = {}
        self._parts: dict[str, bytes | None] = {"request": b"", "answer": b""}
        """Incomplete frame of each direction; None after an invalid header."""

    def feed(self, direction: str, data: bytes) -> None:
        """Decode the complete frames; after an invalid header the rest of the connection is only forwarded."""
        before = self._parts[direction]
        if before is None:
            return
        rest = before + data
        while len(rest) >= HEADER.size:
            transaction, protocol, length, _ = HEADER.unpack_from(rest)
            if protocol != 0 or not MIN_LENGTH <= length <= MAX_LENGTH:
                self._parts[direction] = None
                return
            if len(rest) < UNCOUNTED_BYTES + length:
                break
            pdu, rest = rest[HEADER.size : UNCOUNTED_BYTES + length], rest[UNCOUNTED_BYTES + length :]
            if direction == "request":
                if len(self._waiting) >= _MAX_WAITING:
                    self._waiting.clear()
                self._waiting[transaction] = pdu
            elif transaction in self._waiting:
                self._decoder.answered(self._waiting.pop(transaction), pdu)
        self._parts[direction] = rest


async def forward(
    listen: tuple[str, int], field: tuple[str, int], decoder: Decoder, stop: StopRequest, ready: Callable[[int], None]
) -> None:
    """Forward all connections until the request to stop.

    A connection ends on both sides as soon as one side ends it, so that the watchdog and the lease of the field I/O act
    as without the proxy. A field I/O that cannot be reached is reported once, until a connection has succeeded.

    Args:
        listen: Address and port to listen on; port 0 = any free port.
        field: Address and port of the field I/O.
        decoder: Decoder of the frames.
        stop: Request to stop.
        ready: Function called with the port.

    Raises:
        OSError: The port is in use.
    """
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    tasks: set[asyncio.Task[None]] = set()
    problem = ""

    def connect(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = supervised_task("captured connection", partial(serve, reader, writer))
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal problem
        with contextlib.closing(writer), contextlib.suppress(OSError):
            try:
                far = await asyncio.open_connection(*field)
            except (OSError, UnicodeError) as error:
                before, problem = problem, str(error)
                if problem != before:
                    _log.warning("no field I/O at %s:%d: %s; check --host and --port", *field, problem)
            else:
                problem = ""
                with contextlib.closing(far[1]):
                    await _relay((reader, writer), far, _Connection(decoder))

    server = await asyncio.start_server(connect, *listen)
    with stop.calling(lambda: loop.call_soon_threadsafe(ended.set)):
        async with server:
            ready(server.sockets[0].getsockname()[1])
            await ended.wait()
            for task in tuple(tasks):
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)


async def _relay(near: _Streams, far: _Streams, connection: _Connection) -> None:
    """Forward between the master and the field I/O until one side ends the connection."""
    (reader, writer), (field_reader, field_writer) = near, far
    pumps = [
        supervised_task("captured direction", partial(_pump, reader, field_writer, connection, "request")),
        supervised_task("captured direction", partial(_pump, field_reader, writer, connection, "answer")),
    ]
    try:
        await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for pump in pumps:
            pump.cancel()
        await asyncio.gather(*pumps, return_exceptions=True)


async def _pump(
    reader: asyncio.StreamReader, writer: asyncio.StreamWriter, connection: _Connection, direction: str
) -> None:
    with contextlib.suppress(OSError):  # one side has gone
        while data := await reader.read(4_096):
            connection.feed(direction, data)
            writer.write(data)
            await writer.drain()


def _numbers(points: Iterable[Point]) -> dict[int, int]:
    return {point.offset: point.number for point in points}


def _bits(data: bytes, count: int) -> list[bool]:
    return [bool(data[index // 8] >> index % 8 & 1) for index in range(count)]
