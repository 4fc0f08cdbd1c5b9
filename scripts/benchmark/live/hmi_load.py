"""Load on the operator interface during its measurement: ``python -m scripts.benchmark.live.hmi_load``.

Each process has one role: clients, browsers, a client at full speed, a sender of malformed frames, a reference server,
a bare loop that only waits, or one that only computes. It prints its result as one line of JSON. The clients
write their frames themselves, because they send malformed ones and many at once.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import random
import socket
import statistics
import struct
import sys
import time
from collections.abc import Callable
from itertools import accumulate
from typing import Final

from controller.common.modbus.mbap import HEADER, MAX_LENGTH, MIN_LENGTH, UNCOUNTED_BYTES
from controller.common.stop_request import StopRequest, run_process
from controller.io.loop import BOUNDS_US, Histogram
from scripts.benchmark.live.bare_loop import lateness_ns

READ_COILS: Final = 1
READ_REGISTERS: Final = 3
DEVICES_READ: Final = 64
CLIENT_PERIOD_S: Final = 0.02
WAIT_NS: Final = 10_000_000
LIMIT_S: Final = 10.0
"""Response timeout, s."""
ROUND_S: Final = 0.4
ROUNDS: Final = 5
MANY: Final = 8

_SOUND: Final = (
    "0100000040",
    "0200000040",
    "0300000040",
    "0400000040",
    "050190ff00",
    "0602000064",
    "0f0190000a020000",
    "100200000204000a000b",
    "170000000402000001020064",
    "2b0e0100",
)
"""One request for each function that the controller serves, in hexadecimal."""


class SilentServerError(Exception):
    """Protocol violation by the measured server, or a missing response."""


def request(function_code: int, first: int, count: int) -> bytes:
    """Return the complete frame of a read request."""
    return HEADER.pack(1, 0, 6, 1) + struct.pack(">BHH", function_code, first, count)


def read_registers(connection: socket.socket, first: int, count: int) -> tuple[int, ...]:
    """Read registers from a server.

    Raises:
        SilentServerError: The server returned an exception or no registers.
    """
    connection.sendall(request(READ_REGISTERS, first, count))
    pdu = _answer(connection)
    if pdu[0] != READ_REGISTERS:
        raise SilentServerError(f"registers {first} to {first + count - 1} were refused: exception {pdu[1]}")
    return struct.unpack(f">{count}H", pdu[2:])


def connect(port: int) -> socket.socket:
    """Return a connection to a server on this computer."""
    connection = socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def waits(seconds: int) -> None:
    """Wait for periodic deadlines, as the scan loop does, and print the lateness histogram."""
    late, missed = Histogram(), 0
    for late_ns in lateness_ns(WAIT_NS, seconds * 1_000_000_000 // WAIT_NS):
        late.add(late_ns // 1_000)
        missed += late_ns > WAIT_NS
    _print({"late": late.counts, "missed": missed})


def busy(seconds: int) -> None:
    """Use one processor completely."""
    _print({"ready": 1})
    until_s = time.perf_counter() + seconds
    while time.perf_counter() < until_s:
        pass


def clients(port: int, count: int, seconds: int) -> None:
    """Read coils and registers fifty times a second over each connection."""
    _print({"answers": asyncio.run(_read_together(port, count, seconds))})


async def _read_together(port: int, count: int, seconds: int) -> int:
    connections = [await asyncio.open_connection("127.0.0.1", port) for _ in range(count)]
    _print({"ready": count})
    return sum(await asyncio.gather(*(_read_steadily(*connection, seconds) for connection in connections)))


async def _read_steadily(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, seconds: int) -> int:
    loop, answers = asyncio.get_running_loop(), 0
    start_s = loop.time()
    for period in range(round(seconds / CLIENT_PERIOD_S)):
        await asyncio.sleep(max(0.0, start_s + period * CLIENT_PERIOD_S - loop.time()))
        for function_code in (READ_COILS, READ_REGISTERS):
            writer.write(request(function_code, 0, DEVICES_READ))
            header = await asyncio.wait_for(reader.readexactly(HEADER.size), LIMIT_S)
            await asyncio.wait_for(reader.readexactly(HEADER.unpack(header)[2] - 1), LIMIT_S)
            answers += 1
    writer.close()
    return answers


def browsers(url: str, count: int, seconds: int) -> None:
    """Receive the views of a panel over several WebSockets."""
    _print({"messages": asyncio.run(_receive_together(url, count, seconds))})


async def _receive_together(url: str, count: int, seconds: int) -> int:
    from websockets.asyncio.client import ClientConnection  # noqa: PLC0415 - part of another extra
    from websockets.asyncio.client import connect as open_socket  # noqa: PLC0415

    async def receive(opened: ClientConnection) -> int:
        messages, until_s = 0, loop.time() + seconds
        while (left_s := until_s - loop.time()) > 0:
            try:
                await asyncio.wait_for(opened.recv(), left_s)
            except TimeoutError:
                break
            messages += 1
        await opened.close()
        return messages

    loop = asyncio.get_running_loop()
    address = f"{url.replace('http', 'ws', 1)}/ws"
    sockets = [await open_socket(address, origin=url, proxy=None) for _ in range(count)]  # type: ignore[arg-type]
    _print({"ready": count})
    return sum(await asyncio.gather(*map(receive, sockets)))


def rates(ours: int, theirs: int) -> None:
    """Read registers from two servers alternately, over one connection and over several; print the rates."""
    samples: dict[str, list[float]] = {"one": [], "one_reference": [], "many": [], "many_reference": []}
    for _ in range(ROUNDS):
        for count, name in ((1, "one"), (MANY, "many")):
            samples[name].append(_rate(ours, count))
            samples[f"{name}_reference"].append(_rate(theirs, count))
    _print({name: round(statistics.median(each)) for name, each in samples.items()})


def _rate(port: int, count: int) -> float:
    """Return the answers per second of a server with one pending request per connection."""
    connections = [connect(port) for _ in range(count)]
    frame, answers = request(READ_REGISTERS, 0, DEVICES_READ), 0
    start_s = time.perf_counter()
    for connection in connections:
        connection.sendall(frame)
    while (took_s := time.perf_counter() - start_s) < ROUND_S:
        for connection in connections:
            _answer(connection)
            connection.sendall(frame)
            answers += 1
    for connection in connections:
        _answer(connection)
        connection.close()
    return answers / took_s


def malformed(port: int, frames: int, cycles: int, seed: int) -> None:
    """Send mutated frames, then connect and disconnect repeatedly; print the number of answered frames.

    Every complete frame must be answered. After any other frame the server must close the connection.
    """
    answered = _send_mutated(port, frames, random.Random(seed))
    for number in range(cycles):
        connection = connect(port)
        if number % 2:
            _end(connection)
        else:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closes with a reset
            connection.close()
    _print({"answered": answered})


def _send_mutated(port: int, frames: int, rng: random.Random) -> int:
    """Send mutated frames and return the number of answers."""
    answered, connection = 0, connect(port)
    try:
        for _ in range(frames):
            frame = _mutated(rng)
            connection.sendall(frame)
            if _is_complete(frame):
                _answer(connection)
                answered += 1
            else:
                _end(connection)
                connection = connect(port)
    finally:
        connection.close()
    return answered


def _mutated(rng: random.Random) -> bytes:
    """Return a frame with random errors in its request and, less often, in its length or header."""
    pdu = bytearray.fromhex(rng.choice(_SOUND))
    for _ in range(rng.randint(1, 3)):
        pdu[rng.randrange(len(pdu))] = rng.randrange(256)
    pdu = pdu[: rng.randint(1, len(pdu))] if rng.random() < 0.2 else pdu + rng.randbytes(rng.choice((0, 0, 0, 1, 40)))
    frame = bytearray(HEADER.pack(rng.randrange(1 << 16), 0, len(pdu) + 1, rng.randrange(256)) + pdu)
    if rng.random() < 0.2:
        frame[rng.randrange(HEADER.size)] = rng.randrange(256)
    return bytes(frame)


def _is_complete(frame: bytes) -> bool:
    _, protocol, length, _ = HEADER.unpack_from(frame)
    is_sound = protocol == 0 and MIN_LENGTH <= length <= MAX_LENGTH
    return is_sound and bool(length == len(frame) - UNCOUNTED_BYTES)


def _end(connection: socket.socket) -> None:
    """Shut down the sending side and wait until the server closes the connection."""
    try:
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(4_096):
            pass
    except ConnectionError:  # the server closed the connection without reading all data
        pass
    except TimeoutError as error:
        raise SilentServerError("the server did not close the connection after shutdown") from error
    finally:
        connection.close()


def reference() -> None:
    """Serve a thousand registers with the pymodbus server and its faster, older datastore; print the port."""
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # it logs every closed connection
    asyncio.run(_serve_reference())


async def _serve_reference() -> None:
    from pymodbus.datastore import (  # noqa: PLC0415 - slow to load, and not needed by the other roles
        ModbusDeviceContext,
        ModbusSequentialDataBlock,
        ModbusServerContext,
    )
    from pymodbus.server import ModbusTcpServer  # noqa: PLC0415

    device = ModbusDeviceContext(hr=ModbusSequentialDataBlock(1, [0] * 1_000))  # type: ignore[no-untyped-call]
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = ModbusTcpServer(ModbusServerContext(devices=device, single=True), address=("127.0.0.1", port))
    await server.serve_forever(background=True)
    _print({"port": port})
    await asyncio.Event().wait()


def _answer(connection: socket.socket) -> bytes:
    """Return the PDU of the next answer."""
    length = HEADER.unpack(_exactly(connection, HEADER.size))[2]
    return _exactly(connection, length - 1)


def _exactly(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        try:
            part = connection.recv(count - len(data))
        except OSError as error:
            raise SilentServerError(f"no answer: {error}") from error
        if not part:
            raise SilentServerError("the server closed the connection without answering")
        data += part
    return data


def _print(what: dict[str, object]) -> None:
    sys.stdout.write(f"{json.dumps(what)}\n")
    sys.stdout.flush()


def percentile_ms(counts: list[int], percent: float) -> float:
    """Return the upper bound of the bucket that contains a percentile, ms; 1 s for the last, unbounded bucket."""
    enough = sum(counts) * percent / 100
    bounds = zip((*BOUNDS_US, 1_000_000), accumulate(counts), strict=True)
    return next(bound_us / 1_000 for bound_us, upto in bounds if upto >= enough)


_ROLES: Final[dict[str, Callable[..., None]]] = {
    role.__name__: role for role in (waits, busy, clients, browsers, rates, malformed, reference)
}


def main(arguments: list[str]) -> None:
    """Run the role named by the first argument; the other arguments are numbers or an address."""
    role, *values = arguments
    try:
        _ROLES[role](*(int(each) if each.isdecimal() else each for each in values))
    except SilentServerError as error:
        sys.exit(f"{role}: {error}")


def _process(stop: StopRequest) -> int:
    """Run a role until it ends or is stopped."""
    with contextlib.suppress(KeyboardInterrupt):
        stop.interrupt()
        main(sys.argv[1:])
    return 0


if __name__ == "__main__":
    run_process(_process)
