"""Scripted person in front of ``check-io`` in a pseudo-terminal, on a plant with wiring errors."""

from __future__ import annotations

import csv
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from controller.cli.main import main
from controller.common.modbus.io_map import IoMap, Point, Polarity
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.machine.terminals import BUTTONS

IO_MAP = load_io_map(DEFAULT_IO_MAP)
LIMIT_S = 90.0
LOCK_STEP_MS = 100
WATCHDOG_MS = 500
BY_ADDRESS = {point.address: point for point in (*IO_MAP.inputs, *IO_MAP.outputs)}
HOLD_MS = 3_000
"""Plant time with an output on after which the person releases the key if nothing is reported, ms."""
HOLD_S = 0.6
"""Time for which the person holds the key at devices without a plant, s."""
REPEAT_S = 0.03
"""Period of the key repetition of the terminal, s."""


def swapped(first: str, second: str) -> IoMap:
    """Return the map of a machine in which the wires of two points are exchanged."""
    a, b = IO_MAP[first], IO_MAP[second]
    return changed(
        {
            first: {"address": b.address, "number": b.number, "offset": b.offset},
            second: {"address": a.address, "number": a.number, "offset": a.offset},
        }
    )


def inverted(tag: str) -> IoMap:
    """Return the map of a machine in which a point has the opposite polarity."""
    opposite = {
        Polarity.NORMALLY_OPEN: Polarity.NORMALLY_CLOSED,
        Polarity.NORMALLY_CLOSED: Polarity.NORMALLY_OPEN,
        Polarity.ACTIVE_HIGH: Polarity.ACTIVE_LOW,
        Polarity.ACTIVE_LOW: Polarity.ACTIVE_HIGH,
    }
    return changed({tag: {"polarity": opposite[IO_MAP[tag].polarity]}})


def changed(by_tag: Mapping[str, Mapping[str, object]]) -> IoMap:
    """Return the map of a machine with changed wires."""

    def points(listed: tuple[Point, ...]) -> tuple[Point, ...]:
        changed = [replace(point, **by_tag.get(point.tag, {})) for point in listed]  # type: ignore[arg-type]
        return tuple(sorted(changed, key=lambda point: point.number))

    return replace(IO_MAP, inputs=points(IO_MAP.inputs), outputs=points(IO_MAP.outputs))


def refusal(arguments: Sequence[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run the command without a terminal in this process; return its line of error output."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        assert main(["check-io", *arguments]) == 2
    finally:
        signal.signal(signal.SIGTERM, before)
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    return str(printed.err)


class WiredPlant:
    """Plant behind a Modbus server; its sensors can be operated by hand.

    Attributes:
        on_ms: Plant time with an output on, ms.
    """

    def __init__(self, thread: ServerThread, plant: Plant, module: IoModule) -> None:
        self.thread = thread
        self.plant = plant
        self.module = module
        self.on_ms = 0
        self._counted_ms = 0
        module.observers.append(self._count)

    @property
    def port(self) -> int:
        return self.thread.server.port

    def operate(self, tag: str, state: bool | None) -> None:
        """Operate or release a sensor or button; None leaves a sensor to the position of its axis."""

        def act() -> None:
            if tag in BUTTONS:
                setattr(self.plant.box, tag, bool(state))
            else:
                self.plant.sensors[tag].stuck = state

        self.thread.call(act)

    def _count(self) -> None:
        if any(self.module.outputs):
            self.on_ms += self.plant.time_ms - self._counted_ms
        self._counted_ms = self.plant.time_ms

    def outputs(self) -> list[bool]:
        return self.thread.call(lambda: self.module.outputs)


@contextmanager
def wired_plant(
    io_map: IoMap = IO_MAP,
    prepare: Callable[[Plant], None] = lambda _: None,
    *,
    lock_step_ms: int | None = LOCK_STEP_MS,
    watchdog_ms: int = WATCHDOG_MS,
) -> Iterator[WiredPlant]:
    """Serve a plant with the wires of `io_map`, by default in lock step with the writes of the outputs."""
    plant = Plant(io_map, load_machine(), seed=1, trays=0)
    prepare(plant)
    module = IoModule(plant, io_map, watchdog_ms=watchdog_ms)
    server = PlantServer(module, port=0, lock_step_ms=lock_step_ms)
    with ServerThread(server) as thread:
        yield WiredPlant(thread, plant, module)


class Person:
    """Person at the keyboard of ``check-io``: answers every printed line.

    Attributes:
        asked: Addresses of the outputs in the order in which they were asked for.
        said: All printed lines.
    """

    def __init__(
        self,
        plant: WiredPlant | None,
        folder: Path,
        *options: str,
        dead: Collection[str] = (),
        seen: Mapping[str, str] | None = None,
        answers: Mapping[str, str] | None = None,
    ) -> None:
        """Start the command.

        Args:
            plant: Plant; None = the devices of a field file in `options`.
            folder: Folder of the report.
            options: Further options of the command.
            dead: Inputs whose sensors cannot be operated.
            seen: Keys pressed at the question what an output has moved, by address; others are correct.
            answers: Keys pressed at other prompts, by a part of the prompt, instead of the usual ones.
        """
        self.plant = plant
        self.folder = folder
        self.said: list[str] = []
        self.asked: list[str] = []
        self._dead = dead
        self._seen = seen or {}
        self._answers = answers or {}
        self._received = b""
        self._operated = ""
        self.terminal, theirs = pty.openpty()
        command = [sys.executable, "-m", "controller", "check-io", "--out", str(folder)]
        one_device = [] if plant is None else ["--port", str(plant.port), "--timeout-ms", "5000"]
        self.process = subprocess.Popen(
            [*command, *one_device, *options],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
            env={**os.environ, "PYTHONUTF8": "1"},
        )
        os.close(theirs)

    def __enter__(self) -> Person:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self.close_terminal()

    def close_terminal(self) -> None:
        if self.terminal >= 0:
            os.close(self.terminal)
            self.terminal = -1

    def press(self, keys: str) -> None:
        os.write(self.terminal, keys.encode())

    def next_line(
        self, *, hold: str = "", within_s: float = LIMIT_S, ends: Callable[[], bool] = lambda: False
    ) -> str | None:
        """Return the next line, or None at the end, after a time or on a condition; a key is held meanwhile."""
        until_s = time.perf_counter() + within_s
        while b"\n" not in self._received:
            is_end = time.perf_counter() > until_s or ends()
            if hold and not is_end:
                self.press(hold)
            ready, _, _ = select.select([self.terminal], [], [], REPEAT_S)
            if ready:
                try:
                    self._received += os.read(self.terminal, 4_096)
                except OSError:  # the process has ended
                    return None
            elif is_end:
                return None
        line, _, self._received = self._received.partition(b"\n")
        self.said.append(line.decode().strip())
        return self.said[-1]

    def until(self, part: str) -> str:
        """Answer the lines until one contains a text; return it unanswered."""
        while (line := self.next_line()) is not None:
            if part in line:
                return line
            self.answer(line)
        raise AssertionError(f"{part!r} was not printed: {self.said}")

    def work(self) -> int:
        """Answer all lines and return the exit code."""
        while (line := self.next_line()) is not None:
            self.answer(line)
        return self.process.wait(LIMIT_S)

    def answer(self, line: str) -> None:
        """Do what a line asks for."""
        address, _, _ = line.partition(" ")
        point = BY_ADDRESS.get(address)
        usual = {"r = repeat": "\n", "output watchdog": "y", "area clear": "y", "What moved": "\n"}
        for part, keys in {**usual, **self._answers}.items():
            if part in line:
                usual[part] = keys
        if "area clear" in line:
            self.asked.append(address)
        if point is not None and "operate it" in line:
            self._operate(point.tag, "NOT" not in line)
            self.press("\n")
        elif "hold SPACE" in line:
            following = self._hold()
            if following is None:
                self.press("\n")
            else:
                self.answer(following)
        elif "did exactly" in line:
            self.press(self._seen.get(address, "y"))
        else:
            keys = next((keys for part, keys in usual.items() if part in line), "")
            self.press(keys) if keys else self._release()

    def _hold(self) -> str | None:
        """Hold the key; return the line that the command prints, or None if nothing has moved for long enough."""
        if self.plant is None:
            return self.next_line(hold=" ", within_s=HOLD_S)
        plant, before_ms = self.plant, self.plant.on_ms
        return self.next_line(hold=" ", ends=lambda: plant.on_ms - before_ms >= HOLD_MS)

    def _operate(self, tag: str, state: bool) -> None:
        if tag not in self._dead:
            assert self.plant is not None
            self._operated = tag
            self.plant.operate(tag, state)

    def _release(self) -> None:
        if self._operated and self.plant is not None:
            self.plant.operate(self._operated, None)
            self._operated = ""

    def results(self) -> dict[str, tuple[str, str]]:
        """Return result and other points by tag, from the CSV file."""
        (path,) = self.folder.glob("*.csv")
        with path.open(encoding="utf-8", newline="") as file:
            return {row["tag"]: (row["result"], row["others"]) for row in csv.DictReader(file)}

    def faults(self) -> dict[str, tuple[str, str]]:
        """Return the results that are not correct."""
        return {tag: found for tag, found in self.results().items() if found[0] != "ok"}
