"""Reaction time from an input edge at the plant to the output edge at the plant, with real processes.

The controller runs the machine's complete program without input filter; two lamps follow the cup counters of the two
rows, whose pulses have no fixed phase to the scans. A bare loop of the same period runs beside it as a measure of the
timing of the computer.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

from controller.common.modbus.io_map import IoMap
from controller.common.modbus.rtu import SerialLine
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.links.io_module import IoModule
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.process import LiveError
from scripts.benchmark.live.echo_controller import ECHOES
from scripts.benchmark.live.serial_cable import SerialCable

PULSES_PER_MIN: Final = 287.3
"""Planting frequency, 1/min: 208.84 ms per pulse, which has every phase to a scan of 5 or 10 ms."""
BOUNCE_MS: Final = 3
"""Longest time between two edges of a bouncing contact, ms; the reaction is measured from the last one."""
SECONDS: Final = 15.0
LIMIT_S: Final = 60.0
UNIT: Final = 1
"""Unit of the plant on a serial line."""


class EdgeTimer:
    """Observer of a module that measures the time from every edge of a cup counter to the edge of its lamp.

    Attributes:
        times_ms: Reaction times in plant time, ms.
        missed: Input edges that were followed by another one before the output edge.
    """

    def __init__(self, module: IoModule) -> None:
        self.times_ms: list[int] = []
        self.missed = 0
        self._module = module
        io_map = module.io_map
        self._wires = [(io_map[f"{side}.cup_pulse"].number, io_map[lamp].number) for lamp, side in ECHOES.items()]
        self._levels: list[bool] = []
        self._since_ms: list[int | None] = [None] * len(self._wires)

    def __call__(self) -> None:
        """Look at the wires; called after every advance of plant time."""
        module = self._module
        inputs, outputs, now_ms = module.inputs(), module.outputs, module.plant.time_ms
        if module.last_write_ms is None or now_ms - module.last_write_ms > module.watchdog_ms:
            self._levels = []  # before the first and after the last scan
            return
        levels = [inputs[x] for x, _ in self._wires]
        echoes = [outputs[y] for _, y in self._wires]
        for number, (level, before) in enumerate(zip(levels, self._levels, strict=False)):
            since_ms, follows = self._since_ms[number], echoes[number] == level
            if level != before:
                self.missed += since_ms is not None and now_ms - since_ms > BOUNCE_MS
                self._since_ms[number] = None if follows else now_ms
            elif since_ms is not None and follows:
                self.times_ms.append(now_ms - since_ms)
                self._since_ms[number] = None
        self._levels = levels


def measure_reaction(
    _seed: int, *, scan_ms: int, seconds: float = SECONDS, baud: int | None = None
) -> dict[str, float]:
    """Measure the reaction for some seconds.

    Args:
        scan_ms: Scan period, ms.
        seconds: Duration of the measurement, s.
        baud: Baud rate of a serial line with Modbus RTU, 8N1, whose transmission times are modelled; None = Modbus TCP.

    Raises:
        LiveError: A process failed, or no edge was answered.
    """
    with tempfile.TemporaryDirectory(prefix="transplanter-") as folder, ExitStack() as stack:
        path = _map_with_lamps(Path(folder))
        plant = Plant(load_io_map(path), load_machine(), seed=1, trays=1)
        plant.planting_frequency_per_min = PULSES_PER_MIN
        module = IoModule(plant, load_io_map(path))
        timer = EdgeTimer(module)
        module.observers.append(timer)
        serial, way = None, ["--port"]
        if baud is not None:
            ends = stack.enter_context(SerialCable()).ends
            serial = SerialLine(ends[0], baud, "N", 1, UNIT)
            way = ["--field", str(_field_file(Path(folder), module.io_map, ends[1], baud))]
        server = PlantServer(module, port=0, serial=serial, models_wire=serial is not None)
        thread = stack.enter_context(ServerThread(server))
        if baud is None:
            way.append(str(thread.server.port))
        common = ["--scan-ms", str(scan_ms), "--seconds", str(seconds)]
        controller = stack.enter_context(
            _process("scripts.benchmark.live.echo_controller", "--io-map", str(path), *way, *common)
        )
        bare = stack.enter_context(_process("scripts.benchmark.live.bare_loop", *common))
        figures, alone = _figures(controller), _figures(bare)
    if not timer.times_ms:
        raise LiveError("no edge was answered")
    times_ms = sorted(timer.times_ms)
    median_ms, p99_ms = _quantile(times_ms, 0.5), _quantile(times_ms, 0.99)
    late_ms, bare_ms = (_quantile(sorted(each["late_us"]), 0.99) / 1_000 for each in (figures, alone))
    return {
        "median": median_ms,
        "median_scans": median_ms / scan_ms,
        "p99": p99_ms,
        "p99_scans": p99_ms / scan_ms,
        "longest": times_ms[-1],
        "edges": len(times_ms),
        "missed": timer.missed,
        "late_p99": late_ms,
        "bare_p99": bare_ms,
        "late_ratio": late_ms / bare_ms,
        "overruns": figures["overruns"],
    }


def _map_with_lamps(folder: Path) -> Path:
    """Write the default I/O map with both lamps wired; return its path."""
    lines = DEFAULT_IO_MAP.read_text("utf-8").splitlines(keepends=True)
    wired = [
        line.replace("wired: false", "wired: true") if any(f"tag: {lamp}," in line for lamp in ECHOES) else line
        for line in lines
    ]
    path = folder / "io_map.yaml"
    path.write_text("".join(wired), "utf-8")
    return path


def _field_file(folder: Path, io_map: IoMap, device: str, baud: int) -> Path:
    """Write a field file with one device on a serial line; return its path."""
    path = folder / "field.yaml"
    wires = "".join(f"      {point.tag}: {point.offset}\n" for point in (*io_map.inputs, *io_map.outputs))
    path.write_text(
        f"lines:\n  - {{name: bus, device: {device}, baud: {baud}, frame: 8N1}}\n"
        f"devices:\n  - name: plant\n    profile: coils\n    line: bus\n    unit: {UNIT}\n    wires:\n{wires}",
        "utf-8",
    )
    return path


@contextmanager
def _process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Start a program; kill it at the end of the block if it still runs."""
    with subprocess.Popen(  # noqa: S603 - our own programs
        [sys.executable, "-m", *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def _figures(process: subprocess.Popen[str]) -> dict[str, Any]:
    module = str(process.args[2])  # type: ignore[index]
    try:
        printed, _ = process.communicate(timeout=LIMIT_S)
    except subprocess.TimeoutExpired:
        raise LiveError(f"{module} did not end within {LIMIT_S:.0f} s") from None
    if process.returncode:
        raise LiveError(f"{module} ended with exit code {process.returncode}")
    figures: dict[str, Any] = json.loads(printed)
    return figures


def _quantile(ordered: Sequence[int], share: float) -> float:
    """Return a quantile of ordered values by the nearest-rank rule."""
    return float(ordered[max(0, math.ceil(share * len(ordered)) - 1)])
