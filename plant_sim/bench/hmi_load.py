"""Who works against the operator's side while it is measured, each a process: ``python -m plant_sim.bench.hmi_load``.

Clients, browsers, a client that asks as fast as it is answered, one that sends rubbish, a server to compare with, and
a loop that only waits. Each tells what it has seen as one line of JSON.
"""

from __future__ import annotations

import asyncio
import json
import logging
import random
import socket
import statistics
import struct
import sys
import threading
import time
from collections.abc import Callable
from itertools import accumulate
from typing import Final

from controller.io.loop import BOUNDS_US, Histogram
from controller.modbus.mbap import HEADER, HEADER_BEFORE_LENGTH_ENDS, MAX_LENGTH, MIN_LENGTH

READ_COILS: Final = 1
READ_REGISTERS: Final = 3
DEVICES_READ: Final = 64
CLIENT_PERIOD_S: Final = 0.02
WAIT_NS: Final = 10_000_000
LIMIT_S: Final = 10.0
"""An answer that takes longer than this will not come."""
ROUND_S: Final = 0.4
ROUNDS: Final = 10
MANY: Final = 8

_SOUND: Final = (
    "0100000040", "0200000040", "0300000040", "0400000040", "050190ff00", "0602000064", "0f0190000a020000",
    "100200000204000a000b", "170000000402000001020064", "2b0e0100",
)  # fmt: skip
"""One request of each function that the controller serves, in hexadecimal."""


class SilentServerError(Exception):
    """The server under measurement did not do as Modbus TCP says; one line."""


def request(function_code: int, first: int, count: int) -> bytes:
    """Return a request to read, as a whole frame."""
    return HEADER.pack(1, 0, 6, 1) + struct.pack(">BHH", function_code, first, count)


def read_registers(line: socket.socket, first: int, count: int) -> tuple[int, ...]:
    """Read registers of a server.

    Raises:
        SilentServerError: It refused, or gave none.
    """
    line.sendall(request(READ_REGISTERS, first, count))
    pdu = _answer(line)
    if pdu[0] != READ_REGISTERS:
        raise SilentServerError(f"registers {first} to {first + count - 1} were refused: exception {pdu[1]}")
    return struct.unpack(f">{count}H", pdu[2:])


def connect(port: int) -> socket.socket:
    """Return a connection to a server on this computer."""
    line = socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S)
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return line


def waits(seconds: int) -> None:
    """Wait for one deadline after the other, as the scan loop does, and tell how late each was."""
    late, missed, never = Histogram(), 0, threading.Event()
    due_ns = time.perf_counter_ns()
    for _ in range(seconds * 1_000_000_000 // WAIT_NS):
        due_ns += WAIT_NS
        never.wait(max(0, due_ns - time.perf_counter_ns()) / 1e9)
        late_ns = max(0, time.perf_counter_ns() - due_ns)
        late.add(late_ns // 1_000)
        if late_ns > WAIT_NS:
            missed += 1
            due_ns += late_ns // WAIT_NS * WAIT_NS
    _tell({"late": late.counts, "missed": missed})


def clients(port: int, count: int, seconds: int) -> None:
    """Read coils and registers fifty times a second over each of some connections."""
    _tell({"answers": asyncio.run(_read_together(port, count, seconds))})


async def _read_together(port: int, count: int, seconds: int) -> int:
    connections = [await asyncio.open_connection("127.0.0.1", port) for _ in range(count)]
    _tell({"ready": count})
    return sum(await asyncio.gather(*(_read_steadily(*connection, seconds) for connection in connections)))


async def _read_steadily(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, seconds: int) -> int:
    loop, answers = asyncio.get_running_loop(), 0
    began_s = loop.time()
    for period in range(round(seconds / CLIENT_PERIOD_S)):
        await asyncio.sleep(max(0.0, began_s + period * CLIENT_PERIOD_S - loop.time()))
        for function_code in (READ_COILS, READ_REGISTERS):
            writer.write(request(function_code, 0, DEVICES_READ))
            header = await asyncio.wait_for(reader.readexactly(HEADER.size), LIMIT_S)
            await asyncio.wait_for(reader.readexactly(HEADER.unpack(header)[2] - 1), LIMIT_S)
            answers += 1
    writer.close()
    return answers


def browsers(url: str, count: int, seconds: int) -> None:
    """Look at a panel over some sockets."""
    _tell({"messages": asyncio.run(_look_together(url, count, seconds))})


async def _look_together(url: str, count: int, seconds: int) -> int:
    from websockets.asyncio.client import ClientConnection  # noqa: PLC0415 - of another extra
    from websockets.asyncio.client import connect as open_socket  # noqa: PLC0415

    async def look(opened: ClientConnection) -> int:
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
    _tell({"ready": count})
    return sum(await asyncio.gather(*map(look, sockets)))


def rates(ours: int, theirs: int) -> None:
    """Ask two servers in turns for registers, over one connection and over several; tell the answers a second."""
    found: dict[str, list[float]] = {"ours": [], "theirs": [], "ours_many": [], "theirs_many": []}
    for _ in range(ROUNDS):
        for count, mark in ((1, ""), (MANY, "_many")):
            found[f"ours{mark}"].append(_rate(ours, count))
            found[f"theirs{mark}"].append(_rate(theirs, count))
    _tell({name: round(statistics.median(each)) for name, each in found.items()})


def _rate(port: int, count: int) -> float:
    """Return the answers a second of a server that has one request of each connection at a time."""
    lines = [connect(port) for _ in range(count)]
    frame, answers = request(READ_REGISTERS, 0, DEVICES_READ), 0
    began_s = time.perf_counter()
    for line in lines:
        line.sendall(frame)
    while (took_s := time.perf_counter() - began_s) < ROUND_S:
        for line in lines:
            _answer(line)
            line.sendall(frame)
            answers += 1
    for line in lines:
        _answer(line)
        line.close()
    return answers / took_s


def rubbish(port: int, frames: int, cycles: int, seed: int) -> None:
    """Send mutated frames, then connect and disconnect; tell how many frames were answered.

    A frame that is whole must be answered, whatever it asks. With any other the connection must end once no more comes.
    """
    answered = _send_mutated(port, frames, random.Random(seed))
    for number in range(cycles):
        line = connect(port)
        if number % 2:
            _end(line)
        else:
            line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # closes with a reset
            line.close()
    _tell({"answered": answered})


def _send_mutated(port: int, frames: int, rng: random.Random) -> int:
    """Send mutated frames; return how many were answered."""
    answered, line = 0, connect(port)
    try:
        for _ in range(frames):
            frame = _mutated(rng)
            line.sendall(frame)
            if _is_whole(frame):
                _answer(line)
                answered += 1
            else:
                _end(line)
                line = connect(port)
    finally:
        line.close()
    return answered


def _mutated(rng: random.Random) -> bytes:
    """Return a sound frame with something wrong in its request, more seldom in its header or its length."""
    pdu = bytearray.fromhex(rng.choice(_SOUND))
    for _ in range(rng.randint(1, 3)):
        pdu[rng.randrange(len(pdu))] = rng.randrange(256)
    pdu = pdu[: rng.randint(1, len(pdu))] if rng.random() < 0.2 else pdu + rng.randbytes(rng.choice((0, 0, 0, 1, 40)))
    frame = bytearray(HEADER.pack(rng.randrange(1 << 16), 0, len(pdu) + 1, rng.randrange(256)) + pdu)
    if rng.random() < 0.2:
        frame[rng.randrange(HEADER.size)] = rng.randrange(256)
    return bytes(frame)


def _is_whole(frame: bytes) -> bool:
    _, protocol, length, _ = HEADER.unpack_from(frame)
    is_sound = protocol == 0 and MIN_LENGTH <= length <= MAX_LENGTH
    return is_sound and bool(length == len(frame) - HEADER_BEFORE_LENGTH_ENDS)


def _end(line: socket.socket) -> None:
    """Say that no more will come, and wait until the server has closed."""
    try:
        line.shutdown(socket.SHUT_WR)
        while line.recv(4_096):
            pass
    except ConnectionError:  # it closed before it had read everything
        pass
    except TimeoutError as error:
        raise SilentServerError("the server keeps a connection that has ended") from error
    finally:
        line.close()


def reference() -> None:
    """Serve a thousand registers by pymodbus' own server and its faster, older datastore; tell the port."""
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)  # it tells of every connection that ends
    asyncio.run(_serve_reference())


async def _serve_reference() -> None:
    from pymodbus.datastore import (  # noqa: PLC0415 - loads slowly, and the other roles do without
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
    _tell({"port": port})
    await asyncio.Event().wait()


def _answer(line: socket.socket) -> bytes:
    """Return the PDU of the next answer."""
    length = HEADER.unpack(_exactly(line, HEADER.size))[2]
    return _exactly(line, length - 1)


def _exactly(line: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        try:
            part = line.recv(count - len(data))
        except OSError as error:
            raise SilentServerError(f"no answer: {error}") from error
        if not part:
            raise SilentServerError("the server closed instead of answering")
        data += part
    return data


def _tell(what: dict[str, object]) -> None:
    sys.stdout.write(f"{json.dumps(what)}\n")
    sys.stdout.flush()


def percentile_ms(counts: list[int], percent: float) -> float:
    """Return the upper bound of the bucket that holds a percentile, ms; what no bucket bounds counts as 1 s."""
    enough = sum(counts) * percent / 100
    bounds = zip((*BOUNDS_US, 1_000_000), accumulate(counts), strict=True)
    return next(bound_us / 1_000 for bound_us, upto in bounds if upto >= enough)


_ROLES: Final[dict[str, Callable[..., None]]] = {
    role.__name__: role for role in (waits, clients, browsers, rates, rubbish, reference)
}


def main(arguments: list[str]) -> None:
    """Play a role; its arguments are numbers, or an address."""
    role, *given = arguments
    try:
        _ROLES[role](*(int(each) if each.isdecimal() else each for each in given))
    except SilentServerError as error:
        sys.exit(f"{role}: {error}")
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main(sys.argv[1:])
