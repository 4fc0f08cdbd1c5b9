"""Connections of the debug adapter: standard input and output, or a loopback port, with one client at a time."""

from __future__ import annotations

import os
import select
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, Protocol

from controller.common.errors import InputError
from controller.debug.adapter.session import AdapterSession, Message
from controller.debug.adapter.wire import RequestReader, WireError, encoded
from controller.debug.timeline import RunTimeline

LOOPBACK: Final = "127.0.0.1"
_CHUNK: Final = 65_536
_SLOWEST_S: Final = 10.0
"""Time that a client has to receive a message, s."""
_TAKEN: Final = "another client is connected; end its session first"


class HasFileno(Protocol):
    """Object for which `select` can wait."""

    def fileno(self) -> int:
        """Return the file descriptor."""


def serve_stdio(line: RunTimeline, source: int, target: int, stop: HasFileno) -> None:
    """Serve one client on two file descriptors, until it ends the session or the process is to end.

    Args:
        line: Recorded run.
        source: File descriptor of the requests.
        target: File descriptor of the answers.
        stop: Request to end the process, which becomes readable.

    Raises:
        WireError: The client has sent something that is not a request.
    """
    _serve(line, _Pipe(source, target), stop, None)


def serve_port(line: RunTimeline, listener: socket.socket, stop: HasFileno, report: Callable[[str], None]) -> None:
    """Serve one client after another on a port, until the process is to end.

    Args:
        line: Recorded run.
        listener: Socket that listens.
        stop: Request to end the process, which becomes readable.
        report: Function that is called with the error that has ended a session.
    """
    sources: list[HasFileno] = [listener, stop]
    while True:
        ready, _, _ = select.select(sources, [], [])
        if stop in ready:
            return
        connection, _ = listener.accept()
        with connection:
            connection.settimeout(_SLOWEST_S)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            pipe = _Connection(connection)
            try:
                _serve(line, pipe, stop, listener)
            except WireError as error:
                report(f"client: {error}")


@contextmanager
def listening(port: int) -> Iterator[socket.socket]:
    """Listen on a loopback port within a `with` block; 0 = a free one.

    Raises:
        InputError: The port is not available.
    """
    try:
        listener = socket.create_server((LOOPBACK, port))
    except OSError as error:
        raise InputError(f"--dap {port}: {error.strerror or error}; choose another port") from None
    with listener:
        yield listener


class _Pipe:
    """Two file descriptors."""

    def __init__(self, source: int, target: int) -> None:
        self._source, self._target = source, target

    def fileno(self) -> int:
        return self._source

    def receive(self) -> bytes:
        return os.read(self._source, _CHUNK)

    def send(self, data: bytes) -> None:
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._target, rest) :]


class _Connection:
    """Connection of a client."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> bytes:
        return self._socket.recv(_CHUNK)

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)


def _serve(line: RunTimeline, pipe: _Pipe | _Connection, stop: HasFileno, listener: socket.socket | None) -> None:
    """Serve one client until it ends the session, is gone, or the process is to end."""
    reader = RequestReader()

    def send(message: Message) -> None:
        pipe.send(encoded(message))

    session = AdapterSession(line, send)
    sources: list[HasFileno] = [pipe, stop, *([] if listener is None else [listener])]
    try:
        while True:
            ready, _, _ = select.select(sources, [], [], 0 if session.is_searching else None)
            if stop in ready:
                return
            if pipe in ready:
                data = pipe.receive()
                if not (data and all(map(session.answer, reader.feed(data)))):
                    return
            elif listener is not None and listener in ready:  # the client is connected: it has sent no end
                _refuse(listener)
            session.advance()
    except OSError:  # the client is gone
        return


def _refuse(listener: socket.socket) -> None:
    """Tell a further client that there is one already."""
    connection, _ = listener.accept()
    with connection:
        event = {"category": "stderr", "output": f"{_TAKEN}\n"}
        try:
            connection.settimeout(_SLOWEST_S)
            connection.sendall(encoded({"seq": 1, "type": "event", "event": "output", "body": event}))
        except OSError:
            return
