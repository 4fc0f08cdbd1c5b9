"""Shared helpers of the Modbus server tests: hand-written frames, a socket client and a running server."""

from __future__ import annotations

import contextlib
import socket
import struct
from contextlib import ExitStack
from types import TracebackType
from typing import Self

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.links.telemetry import TELEMETRY_REGISTERS, read_telemetry
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = load_machine()
PATIENT_S = 10.0
"""Timeout for expected responses, s; long enough for a slow computer."""

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4


def make_module(io_map: IoMap = IO_MAP) -> IoModule:
    return IoModule(Plant(io_map, MACHINE, seed=1), io_map)


def frame(pdu: bytes, *, transaction: int = 0x1234, unit: int = 1) -> bytes:
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


def read_pdu(function_code: int, first: int, count: int) -> bytes:
    return struct.pack(">BHH", function_code, first, count)


def write_coil_pdu(offset: int, value: int) -> bytes:
    return struct.pack(">BHH", 5, offset, value)


def write_coils_pdu(first: int, bits: str) -> bytes:
    """Return a request that writes coils; `bits` begins with the first coil: '101' sets the first and third coils."""
    packed = int(bits[::-1], 2).to_bytes((len(bits) + 7) // 8, "little")
    return struct.pack(">BHHB", 15, first, len(bits), len(packed)) + packed


def exception(function_code: int, code: int) -> bytes:
    return bytes([function_code | 0x80, code])


ALL_OFF = write_coils_pdu(0, "0" * 18)
READ_ALL_INPUTS = read_pdu(2, 0, 22)


class Client:
    """Socket client that receives complete frames."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENT_S)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # each part of a frame is sent at once

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.socket.close()

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def receive(self) -> tuple[int, int, bytes]:
        """Return the transaction ID, unit ID and PDU of the next response."""
        transaction, protocol, length, unit = struct.unpack(">HHHB", self._exactly(7))
        assert protocol == 0
        return transaction, unit, self._exactly(length - 1)

    def ask(self, pdu: bytes) -> bytes:
        self.send(frame(pdu))
        transaction, unit, answer = self.receive()
        assert (transaction, unit) == (0x1234, 1)
        return answer

    def rest(self) -> bytes:
        """Return all data received until the server closes the connection."""
        data = b""
        while chunk := self.socket.recv(65_536):
            data += chunk
        return data

    def rest_after_rubbish(self) -> bytes:
        """Return the remaining data, or no data if the server resets the connection because of unread data."""
        with contextlib.suppress(ConnectionResetError):
            return self.rest()
        return b""

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            chunk = self.socket.recv(count - len(data))
            assert chunk, f"closed after {data!r}"
            data += chunk
        return data


class Rig:
    """Running server (in lock step by default) and its clients; all are closed at the end of the `with` block."""

    def __init__(self, server: PlantServer | None = None) -> None:
        self.server = server or PlantServer(make_module(), port=0, lock_step_ms=10)
        self.module = self.server.module
        self.thread = ServerThread(self.server)
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self._stack.enter_context(self.thread)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stack.close()

    def client(self) -> Client:
        return self._stack.enter_context(Client(self.server.port))


def read_raw_registers(client: Client) -> tuple[int, ...]:
    answer = client.ask(read_pdu(4, 0, TELEMETRY_REGISTERS))
    return struct.unpack(f">{TELEMETRY_REGISTERS}H", answer[2:])


def read_registers(client: Client) -> dict[str, float]:
    return read_telemetry(read_raw_registers(client))
