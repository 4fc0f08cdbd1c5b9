"""Speed of the PLC and of the plant alone, each driven by the images recorded in a trial."""

from __future__ import annotations

import time
from typing import Final

from controller.core.scan import Plc
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.states import State
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS, Twin

TRAYS: Final = 2


def measure_scan(seed: int) -> dict[str, float]:
    """Measure the CPU time of the scans of a new PLC that reads the recorded inputs of a trial."""
    inputs, _ = _record(seed)
    machine = build(load_io_map(DEFAULT_IO_MAP))
    plc = Plc(machine.program)
    plc.write(machine.tags.sp.trays_target, TRAYS)
    scan, clock = plc.scan, time.process_time
    times_s: list[float] = []
    for number, image in enumerate(inputs):
        began_s = clock()
        scan(number * SCAN_MS, image)
        times_s.append(clock() - began_s)
    count = len(inputs)
    tenth = max(1, count // 10)
    parts_s = [sum(times_s[start : start + tenth]) / tenth for start in range(0, count - tenth + 1, tenth)]
    return {"scan": 1e6 * sum(times_s) / count, "slowest_tenth": 1e6 * max(parts_s)}


def measure_plant(seed: int) -> dict[str, float]:
    """Measure the CPU time of a new plant that is driven by the recorded outputs of a trial."""
    _, outputs = _record(seed)
    plant = Plant(load_io_map(DEFAULT_IO_MAP), load_machine(), seed=seed, trays=TRAYS)
    began_s = time.process_time()
    for image in outputs:
        plant.step(SCAN_MS, image)
    taken_s = time.process_time() - began_s
    return {"plant": 1e6 * taken_s / len(outputs), "ratio": len(outputs) * SCAN_MS / 1000 / taken_s}


def _record(seed: int) -> tuple[list[list[bool]], list[list[bool]]]:
    """Return every X and Y image of a trial from power-up to Complete.

    Raises:
        NotReachedError: The trial does not complete.
    """
    twin = Twin(seed=seed, set_points={"trays_target": TRAYS})
    inputs: list[list[bool]] = []
    outputs: list[list[bool]] = []

    def record(twin: Twin) -> None:
        inputs.append(twin.plant.terminals.levels.tolist())
        outputs.append(list(twin.runtime.released))

    twin.watch(record)
    twin.home()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=600_000)
    return inputs, outputs
