"""Connections of the debug adapter: damaged messages, clients that leave, a second client."""

from __future__ import annotations

import json
import os
import random
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from controller.common.errors import InputError
from controller.debug.adapter.server import listening, serve_port, serve_stdio
from controller.debug.adapter.wire import LONGEST_BODY, RequestReader, WireError, encoded
from controller.debug.timeline import RunTimeline
from tests.controller.debug.step_program import recorded

INITIALIZE = encoded({"seq": 1, "type": "request", "command": "initialize", "arguments": {"adapterID": "fx"}})
DISCONNECT = encoded({"seq": 2, "type": "request", "command": "disconnect"})


@pytest.fixture(scope="module")
def line(tmp_path_factory: pytest.TempPathFactory) -> RunTimeline:
    return recorded(tmp_path_factory.mktemp("program"))


def messages(data: bytes) -> list[dict[str, Any]]:
    """Return the messages in a stream of bytes."""
    found = []
    while data:
        header, _, rest = data.partition(b"\r\n\r\n")
        length = int(header.removeprefix(b"Content-Length: "))
        found.append(json.loads(rest[:length]))
        data = rest[length:]
    return found


def exchanged(line: RunTimeline, folder: Path, data: bytes) -> list[dict[str, Any]]:
    """Return the messages of an adapter whose client sends some bytes and leaves."""
    source, client = os.pipe()
    stop, _ = pair = socket.socketpair()
    answers = folder / "answers"
    with stop, pair[1], answers.open("wb") as file:
        os.write(client, data)
        os.close(client)
        try:
            serve_stdio(line, source, file.fileno(), stop)
        finally:
            os.close(source)
    return messages(answers.read_bytes())


def test_a_client_on_standard_input_is_served_to_its_end(line: RunTimeline, tmp_path: Path) -> None:
    found = exchanged(line, tmp_path, INITIALIZE + DISCONNECT + b"what follows the end is not read")
    assert [each.get("command", each.get("event")) for each in found] == ["initialize", "initialized", "disconnect"]


@pytest.mark.parametrize("data", [b"", INITIALIZE, INITIALIZE + DISCONNECT[:30], b"Content-Le"])
def test_a_client_may_leave_at_any_time(data: bytes, line: RunTimeline, tmp_path: Path) -> None:
    assert len(exchanged(line, tmp_path, data)) == (2 if INITIALIZE in data else 0)


def framed(text: str) -> bytes:
    return b"Content-Length: %d\r\n\r\n%b" % (len(text.encode()), text.encode())


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n", "not a message: the header has no Content-Length"),
        (b"Content-Length: -1\r\n\r\n", "not a message: the header has no Content-Length"),
        (b"Content-Length: 5\r\nContent-Length: 6\r\n\r\n", "not a message: the header has no Content-Length"),
        (
            b"Content-Length: 999999999\r\n\r\n",
            f"Content-Length 999999999: too long; send at most {LONGEST_BODY} bytes",
        ),
        (b"Content-Length: 99999999999999999999\r\n\r\n", "not a message: the header has no Content-Length"),
        (b"x" * 5_000, "not a message: no end of the header"),
        (framed("{"), "not a message: the body is not JSON"),
        (framed("[" * 50_000), "not a message: the body is not JSON"),
        (b"Content-Length: 2\r\n\r\n\xff\xfe", "not a message: the body is not JSON"),
        (framed("[]"), "not a request: type, seq or command is missing or has another type"),
        (framed('{"type":"request","seq":"1","command":"threads"}'), "not a request"),
        (framed('{"type":"request","seq":true,"command":"threads"}'), "not a request"),
        (framed('{"type":"request","seq":1,"command":null}'), "not a request"),
        (framed('{"type":"response","seq":1,"command":"x"}'), "not a request"),
        (
            framed('{"type":"request","seq":1,"command":"threads","arguments":[]}'),
            "threads: arguments is not an object",
        ),
    ],
)
def test_bytes_that_are_not_a_request_end_the_session(
    data: bytes, error: str, line: RunTimeline, tmp_path: Path
) -> None:
    with pytest.raises(WireError) as raised:
        exchanged(line, tmp_path, INITIALIZE + data[:60_000])
    assert str(raised.value).startswith(error)
    assert "\n" not in str(raised.value)


def test_requests_arrive_in_any_parts() -> None:
    data, reader = INITIALIZE + DISCONNECT, RequestReader()
    commands = [request.command for n in range(len(data)) for request in reader.feed(data[n : n + 1])]
    assert commands == ["initialize", "disconnect"]
    assert [request.command for request in RequestReader().feed(data)] == commands


def refusal(data: bytes) -> str | None:
    """Return the error of some bytes; None if they are requests, complete or not."""
    try:
        list(RequestReader().feed(data))
    except WireError as error:
        return str(error)
    return None


def test_damaged_bytes_give_requests_or_one_line() -> None:
    chance = random.Random(1)
    refused = 0
    for _ in range(2_000):
        data = bytearray(INITIALIZE + DISCONNECT)
        for _ in range(chance.randint(1, 4)):
            data[chance.randrange(len(data))] = chance.randrange(256)
        refused += refusal(bytes(data)) is not None
    assert 1_000 < refused < 2_000


class Client:
    """Client on a port."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=20)
        self._file = self._socket.makefile("rb")

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._socket.close()

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def receive(self) -> dict[str, Any] | None:
        """Return the next message; None at the end of the connection."""
        header = self._file.readline()
        if not header:
            return None
        self._file.readline()
        message: dict[str, Any] = json.loads(self._file.read(int(header.split(b":")[1])))
        return message


@contextmanager
def served(line: RunTimeline, reports: list[str]) -> Iterator[int]:
    """Serve clients on a port in a thread; yield the port."""
    stop, stopped = socket.socketpair()
    with stop, stopped, listening(0) as listener:
        thread = threading.Thread(target=serve_port, args=(line, listener, stopped, reports.append))
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            stop.send(b"x")
            thread.join()


def test_a_port_serves_one_client_at_a_time_and_then_the_next(line: RunTimeline) -> None:
    reports: list[str] = []
    with served(line, reports) as port:
        with Client(port) as first:
            first.send(INITIALIZE)
            response = first.receive()
            assert response is not None
            assert response["success"]
            with Client(port) as second:
                refusal = second.receive()
                assert refusal is not None
                assert refusal["body"]["output"] == "another client is connected; end its session first\n"
                assert second.receive() is None
            first.receive()
            first.send(DISCONNECT)
            response = first.receive()
            assert response is not None
            assert response["command"] == "disconnect"
            assert first.receive() is None
        with Client(port) as damaged:
            damaged.send(b"GET / HTTP/1.1\r\n\r\n")
            assert damaged.receive() is None
        with Client(port) as leaving:
            leaving.send(INITIALIZE[:20])
        with Client(port) as last:
            last.send(INITIALIZE)
            response = last.receive()
            assert response is not None
            assert response["success"]
    assert reports == ["client: not a message: the header has no Content-Length; write Content-Length: N"]


def test_the_port_is_on_the_loopback_interface_and_must_be_free() -> None:
    with listening(0) as listener:
        host, port = listener.getsockname()
        assert host == "127.0.0.1"
        with pytest.raises(InputError, match=rf"--dap {port}: .*; choose another port"), listening(port):
            pass
