"""Servers of the simulated modules: Modbus TCP and RTU, written independently of the client."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

from tests.controller.io.field.modules import Box


class TcpModule:
    """Modbus TCP server of a box, which can be unplugged and plugged in again at the same port."""

    def __init__(self, box: Box, wrap: Callable[[socket.socket], socket.socket] = lambda plain: plain) -> None:
        self.box = box
        self._wrap = wrap
        self._connections: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self.port = 0
        self.is_connected = threading.Event()

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.unplug()

    def plug(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._accepting = threading.Thread(target=self._accept, args=(self._listener,))
        self._accepting.start()

    def unplug(self) -> None:
        with contextlib.suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._accepting.join()  # afterwards no connection is new
        self._listener.close()
        for connection in self._connections:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        self._connections.clear()
        self._threads.clear()

    def _start(self, work: Callable[[socket.socket], None], connection: socket.socket) -> None:
        thread = threading.Thread(target=work, args=(connection,))
        self._threads.append(thread)
        thread.start()

    def _accept(self, listener: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = listener.accept()
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._connections.append(connection)
                self._start(self._serve, connection)

    def _serve(self, plain: socket.socket) -> None:
        client = object()
        with contextlib.suppress(OSError), self._wrap(plain) as connection:
            self._connections.append(connection)  # with TLS, it has taken over the plain one
            while True:
                header = exactly(connection, 7)
                transaction, _, length, unit = struct.unpack(">HHHB", header)
                reply = self.box.answer(exactly(connection, length - 1), client)
                if reply is not None:
                    connection.sendall(struct.pack(">HHHB", transaction, 0, len(reply) + 1, unit) + reply)
        self.box.on_disconnect(client)


def exactly(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        chunk = connection.recv(count - len(data))
        if not chunk:
            raise ConnectionResetError
        data += chunk
    return data


def crc(data: bytes) -> bytes:
    """Return the checksum of an RTU frame, low byte first. Source: Modbus over Serial Line V1.02, 6.2.2."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")


class SerialModules:
    """Modules at one end of a pseudo-terminal; a link at a fixed path is the device file of the other end.

    Attributes:
        path: Path of the device file; it does not exist while the adapter is unplugged.
        alter: Function that returns the frames that are sent instead of an answer.
        returned: Function that returns what the adapter of the master receives of a request that the master sends.
    """

    def __init__(self, path: str, boxes: dict[int, Box]) -> None:
        self.path = path
        self.boxes = boxes
        self.alter: Callable[[bytes], list[bytes]] = lambda frame: [frame]
        self.returned: Callable[[bytes], bytes] = lambda _frame: b""

    def __enter__(self) -> Self:
        self.plug()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if os.path.lexists(self.path):
            self.unplug()

    def plug(self) -> None:
        self._end, self._line = os.openpty()
        os.symlink(os.ttyname(self._line), self.path)
        self._stop_reader, self._stop_writer = os.pipe()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def unplug(self) -> None:
        os.unlink(self.path)
        os.write(self._stop_writer, b"x")
        self._thread.join()
        for number in (self._end, self._line, self._stop_reader, self._stop_writer):
            os.close(number)

    def send(self, data: bytes) -> None:
        os.write(self._end, data)

    def _serve(self) -> None:
        data = b""
        while True:
            ready, _, _ = select.select([self._end, self._stop_reader], [], [])
            if self._stop_reader in ready:
                return
            data += os.read(self._end, 512)
            while len(data) >= 8:
                function = data[1]
                size = {15: 9, 16: 9, 23: 13}.get(function, 8)
                if size > 8:
                    size += data[6 if size == 9 else 10]
                if len(data) < size:
                    break
                frame, data = data[:size], data[size:]
                assert crc(frame[:-2]) == frame[-2:]
                os.write(self._end, self.returned(frame))
                box = self.boxes.get(frame[0])
                reply = None if box is None else box.answer(frame[1:-2], None)
                if reply is not None:
                    body = frame[:1] + reply
                    for each in self.alter(body + crc(body)):
                        os.write(self._end, each)
