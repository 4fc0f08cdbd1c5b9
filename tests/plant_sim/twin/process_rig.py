"""Plant and controller as processes on loopback, in simulated time by default, and a relay between them."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from controller.program.states import State
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS
from plant_sim.twin.process import Process
from tests.controller.common.modbus_rig import IO_MAP, MACHINE
from tests.controller.io.field.servers import exactly
from tests.real_time import SIMULATED, WAIT_S
from tests.retained import retained

_LENGTH_AT: Final = 4
_WRITE_COILS: Final = 15
_HEADER_BYTES: Final = 6
_FUNCTION_AT: Final = 7
_MOVING: Final = [point.offset for point in IO_MAP.outputs if point.moves]


@contextmanager
def plant_process(*options: str) -> Iterator[tuple[Process, int]]:
    """Serve a plant on a free port, in lock step if `options` contain `LOCK_STEP`."""
    with Process("plant", ["plant_sim", "serve", "--port", "0", *options]) as plant:
        line = plant.next_line(WAIT_S)
        assert line is not None, "the plant did not start"
        yield plant, int(line.rpartition(":")[2])


@contextmanager
def plant_thread(port: int = 0, *, lock_step_ms: int | None = SCAN_MS) -> Iterator[int]:
    """Serve a plant in this process, by default in lock step and on a free port; yield its port."""
    module = IoModule(Plant(IO_MAP, MACHINE, seed=1), IO_MAP)
    with ServerThread(PlantServer(module, port=port, lock_step_ms=lock_step_ms)) as thread:
        yield thread.server.port


def run_command(port: int, folder: Path, *options: str, declares: bool = True) -> list[str]:
    """Return the command line of a controller in simulated time, with the pace of real time."""
    path = folder / "retentive.json"
    retain = retained(path) if declares else ["--retain", str(path)]
    return ["controller", "run", "--port", str(port), *retain, "--no-hmi", *SIMULATED, *options]


def controller_process(port: int, folder: Path) -> Process:
    """Run a controller in simulated time that reports its events as JSON."""
    return Process("controller", run_command(port, folder, "--events", "json"))


def first_events(
    port: int,
    folder: Path,
    *options: str,
    count: int = 2,
    end: signal.Signals = signal.SIGINT,
    declares: bool = True,
) -> tuple[list[dict[str, object]], str]:
    """Start a controller, end it with a signal after its first events, and return its events and its messages."""
    command = [sys.executable, "-m", *run_command(port, folder, "--events", "json", *options, declares=declares)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None
        lines = [running.stdout.readline() for _ in range(count)]
        running.send_signal(end)
        rest, errors = running.communicate(timeout=WAIT_S)
    return [json.loads(line) for line in (*lines, *rest.splitlines())], errors


def wait_for_state(controller: Process, state: State) -> list[dict[str, object]]:
    """Read events until the machine enters a state."""
    events: list[dict[str, object]] = []
    while True:
        line = controller.next_line(WAIT_S)
        assert line is not None, f"the controller ended before {state.name}: {events}"
        events.append(json.loads(line))
        if events[-1]["event"] == "state" and events[-1]["state"] == state:
            return events


class DroppingProxy:
    """Modbus TCP relay. While packets are dropped, it accepts connections and bytes, and passes on nothing.

    The begin and the end of a connection are packets as well: the plant sees a connection when its first frame is
    passed on, and keeps one whose controller has closed it meanwhile.

    Attributes:
        port: Port for the controller.
        writes: Number of block writes that were passed on.
        moved: Number of these that switch on an output that moves something.
        still: Number of them since the last that does.
    """

    def __init__(self, plant_port: int) -> None:
        self._plant_port = plant_port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.writes = self.moved = self.still = 0
        self._drops = False
        self._changed = threading.Condition()
        self._sockets: list[socket.socket] = [self._listener]
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Self:
        self._start(self._accept)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for each in self._sockets:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        for thread in self._threads:
            thread.join()

    def drop(self, *, drops: bool) -> None:
        """Begin or end to drop every packet."""
        with self._changed:
            self._drops = drops

    def wait(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition on the record is true."""
        with self._changed:
            assert self._changed.wait_for(condition, WAIT_S), (self.writes, self.moved, self.still)

    def _start(self, work: Callable[..., None], *arguments: socket.socket) -> threading.Thread:
        thread = threading.Thread(target=work, args=arguments)
        self._threads.append(thread)
        thread.start()
        return thread

    def _accept(self) -> None:
        before: threading.Thread | None = None
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listener.accept()
                near.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sockets.append(near)
                if before is not None:
                    before.join()  # the plant sees the end of a connection before the begin of the next one
                before = self._start(self._pass_requests, near)

    def _pass_requests(self, near: socket.socket) -> None:
        far: socket.socket | None = None
        with contextlib.suppress(OSError):
            while True:
                frame = self._frame(near)
                with self._changed:
                    if self._drops:
                        continue
                    if frame[_FUNCTION_AT] == _WRITE_COILS:
                        self._record(frame[_FUNCTION_AT:])
                if far is None:
                    far = socket.create_connection(("127.0.0.1", self._plant_port))
                    far.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._sockets.append(far)
                    self._start(self._pass_answers, far, near)
                far.sendall(frame)
        if far is not None and not self._drops:
            with contextlib.suppress(OSError):
                far.shutdown(socket.SHUT_WR)

    def _pass_answers(self, far: socket.socket, near: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while True:
                frame = self._frame(far)
                if not self._drops:
                    near.sendall(frame)

    @staticmethod
    def _frame(source: socket.socket) -> bytes:
        header = exactly(source, _HEADER_BYTES)
        return header + exactly(source, int.from_bytes(header[_LENGTH_AT:]))

    def _record(self, request: bytes) -> None:
        first, coils = int.from_bytes(request[1:3]), request[6:]
        bits = [bool(byte >> n & 1) for byte in coils for n in range(8)]
        moves = any(bits[offset - first] for offset in _MOVING if 0 <= offset - first < len(bits))
        self.writes += 1
        self.moved += moves
        self.still = 0 if moves else self.still + 1
        self._changed.notify_all()
