"""node-fxplc (npm), a client of the programming port, against running processes on a pseudo-terminal.

The client has the basic map of the port. A serial-to-Ethernet adapter stands between it and the line, here a thread.
"""

from __future__ import annotations

import json
import os
import select
import shutil
import socket
import subprocess
import threading
import tty
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.states import Mode
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.process import Process
from tests.controller.io.test_rtu import Master

SCRIPT = Path(__file__).parent / "node" / "port_exchange.js"
LIMIT_S = 60.0
PROGRAM = "LD M10\nMOV D10 D11\nLD M11\nOUT M12\nEND\n"
MACHINE = program_of(load_io_map(DEFAULT_IO_MAP))
REFUSED = "NotSupportedCommandError"
"""Error of the client for the answer NAK."""


@contextmanager
def adapter(end: int) -> Iterator[int]:
    """Pass bytes between one TCP connection and one end of a line; yield the TCP port."""
    stop, stopped = socket.socketpair()
    with socket.create_server(("127.0.0.1", 0)) as listener, stop, stopped:

        def serve() -> None:
            if stopped in select.select([listener, stopped], [], [])[0]:
                return
            connection, _ = listener.accept()
            with connection:
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                sources = [connection.fileno(), end, stopped.fileno()]
                while sources[2] not in (ready := select.select(sources, [], [])[0]):
                    if end in ready:
                        connection.sendall(os.read(end, 4_096))
                    if sources[0] in ready:
                        if not (data := connection.recv(4_096)):
                            return
                        os.write(end, data)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            stop.send(b"x")
            thread.join()


class NodeFxPlc:
    """Process with the client."""

    def __init__(self, stack: ExitStack, port: int) -> None:
        node = shutil.which("node")
        assert node is not None, "the tests need nodejs: run scripts/setup dev"
        self.process = subprocess.Popen(
            [node, SCRIPT, str(port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        stack.enter_context(self.process)
        stack.callback(self.process.kill)

    def call(self, *calls: tuple[Any, ...]) -> list[Any]:
        """Return the results of calls that are made one after another."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(calls) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        assert line, "node-fxplc has ended; run scripts/setup dev"
        results: list[Any] = json.loads(line)
        return results


@contextmanager
def client_of_line() -> Iterator[tuple[str, NodeFxPlc]]:
    """Yield the path of a line, and the client at its other end."""
    with ExitStack() as stack:
        line = Master()
        stack.callback(line.close)
        tty.setraw(line.line)  # no echo before the server opens the line
        port = stack.enter_context(adapter(line.end))
        yield line.path, NodeFxPlc(stack, port)


def test_the_next_read_sees_every_write_to_any_program(tmp_path: Path) -> None:
    file = tmp_path / "program.il"
    file.write_text(PROGRAM, encoding="utf-8")
    with client_of_line() as (path, client):
        options = ["--serve-port", path, "--pace", "1000"]
        with Process("ladder", ["controller", "ladder", "run", str(file), *options]) as process:
            process.next_line(LIMIT_S)
            words = [-32_768, 0, 1, -1, 32_767]
            written = client.call(*(call for word in words for call in (("writeInt", "D10", word), ("readInt", "D10"))))
            assert written == [value for word in words for value in (None, word)]
            assert client.call(
                ("writeBit", "M11", True), ("readBit", "M12"), ("writeBit", "M11", False), ("readBit", "M12")
            ) == [None, True, None, False], "the program has executed the scan that took the write"
            assert client.call(("writeBit", "M10", True), ("writeInt", "D10", 77), ("readInt", "D11")) == [
                None,
                None,
                77,
            ]


@pytest.mark.nightly
def test_the_machine_is_commanded_with_the_effect_in_the_next_read_and_other_writes_are_refused(tmp_path: Path) -> None:
    tags, commands = MACHINE.tags, MACHINE.tags.commands
    mode, refusals = (f"D{word.number}" for word in (tags.machine.mode, tags.machine.refusals))
    target = f"D{tags.sp.trays_target.number}"
    with client_of_line() as (path, client), ExitStack() as stack:
        plant = stack.enter_context(Process("plant", ["plant_sim", "serve", "--port", "0", "--lock-step-ms", "10"]))
        port = (plant.next_line(LIMIT_S) or "").rpartition(":")[2]
        options = ["--port", port, "--retain", str(tmp_path / "retentive.json"), "--timeout-ms", "5000"]
        options += ["--fx-port", path, "--events", "json", "--no-console", "--no-hmi"]
        options += ["--simulated-time", "--pace", "100"]
        controller = stack.enter_context(Process("controller", ["controller", "run", *options]))
        while json.loads(controller.next_line(LIMIT_S) or "{}")["event"] != "state":
            pass
        for value in range(3, 23):
            assert client.call(("writeInt", target, value), ("readInt", target)) == [None, value]
        assert client.call(("writeInt", target, 30_000), ("readInt", target)) == [REFUSED, 22]
        for name in ("M0", "Y0"):
            assert client.call(("writeBit", name, True)) == [REFUSED], name
        assert client.call(("writeInt", "D100", 1)) == [REFUSED]
        for name, number in (("mode_manual", Mode.MANUAL), ("mode_continuous", Mode.CONTINUOUS)):
            assert client.call(("writeBit", f"M{commands[name].number}", True), ("readInt", mode)) == [None, number]
        (before,) = client.call(("readInt", refusals))
        pressed = client.call(("writeBit", f"M{commands['suspend'].number}", True), ("readInt", refusals))
        assert pressed == [None, before + 1], "refused by the program in this state"
