"""Benchmark of all documented speeds in one run."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import asdict, dataclass

from controller.core.scan import Plc
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.states import State
from plant_sim.benchmark.fx_engine import FxFigures, measure_fx
from plant_sim.benchmark.hmi import HmiFigures, measure_hmi
from plant_sim.benchmark.reaction import Reaction, measure_reactions
from plant_sim.benchmark.twin import TwinFigures, measure_twin
from plant_sim.line.command import result_of
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS, Twin

SCAN_GOAL_US = 50.0
PLANT_GOAL = 1000.0
WARM_START_GOAL_S = 1.0
ROW_GOAL_S = 60.0

ROW_METRES = 1_000.0
"""Length of the rows of the lines, m."""

_WARM_START = """
import time
began_s = time.perf_counter()
from plant_sim.twin.lock_step import Twin
Twin().scan()
print(time.perf_counter() - began_s)
"""


@dataclass(frozen=True)
class Figures(HmiFigures, FxFigures, TwinFigures):
    """Benchmark figures; see also `TwinFigures`, `FxFigures` and `HmiFigures`.

    Attributes:
        scan_us: CPU time of one scan of the complete program, mean over the recorded inputs of a trial, us.
        worst_scan_us: Mean CPU time of a scan in the slowest tenth of the trial, us.
        plant_us: CPU time for 10 ms of plant time with the outputs recorded in the same trial, us.
        plant_ratio: Ratio of simulated time to CPU time for the plant alone, called from Python.
        warm_start_s: Start-up time of a new process, from its first import to the end of the first scan of a twin, with
            the machine code of the plant on disk, s.
        cabbage_row_s: CPU time of one row of 1 km with the cabbage line, s.
        pepper_row_s: CPU time of two rows of 1 km with the pepper line, s.
        combined_row_s: CPU time of two rows of 1 km with the combined line, s.
        reactions: Reaction times from input edge to output edge at the plant.
    """

    scan_us: float
    worst_scan_us: float
    plant_us: float
    plant_ratio: float
    warm_start_s: float
    cabbage_row_s: float
    pepper_row_s: float
    combined_row_s: float
    reactions: tuple[Reaction, ...]

    def record(self) -> dict[str, object]:
        """Return the figures as one JSON object."""
        return asdict(self)

    def text(self) -> str:
        """Return the figures with their goals as text."""
        return "\n".join(
            [
                f"scan of the full program   {self.scan_us:7.1f} us CPU (goal: at most {SCAN_GOAL_US:.0f})",
                f"  slowest tenth of a trial {self.worst_scan_us:7.1f} us CPU",
                f"plant, 10 ms in 1 ms steps {self.plant_us:7.1f} us CPU, {self.plant_ratio:.0f} x real time "
                f"(goal: at least {PLANT_GOAL:.0f})",
                self.twin_text(),
                f"warm start of a process     {self.warm_start_s:6.2f} s (goal: at most {WARM_START_GOAL_S:.0f})",
                self.fx_text(),
                f"rows of 1 km, cabbage      {self.cabbage_row_s:7.2f} s CPU (goal: at most {ROW_GOAL_S:.0f})",
                f"  pepper                   {self.pepper_row_s:7.2f} s CPU",
                f"  combined                 {self.combined_row_s:7.2f} s CPU",
                self.hmi_text(),
                *(reaction.text() for reaction in self.reactions),
            ]
        )


def measure(*, seed: int = 1) -> Figures:
    """Measure a trial, then the PLC and the plant separately on its recorded images, and the operator interface.

    Args:
        seed: Seed of the trial.

    Returns:
        Benchmark figures; CPU times are those of this process.

    Raises:
        LiveError: A process of the operator interface failed, or its machine did not reach a required state.
    """
    Twin(seed=seed).scan()  # compiles or loads the plant
    inputs, outputs = _record(seed)
    scans = _replay_scans(inputs)
    plant_s = _replay_plant(outputs, seed)
    count = len(inputs)
    tenth = max(1, count // 10)
    parts = [sum(scans[start : start + tenth]) / tenth for start in range(0, count - tenth + 1, tenth)]
    return Figures(
        **asdict(measure_hmi()),
        **asdict(measure_fx()),
        **asdict(measure_twin(seed=seed)),
        scan_us=round(1e6 * sum(scans) / count, 2),
        worst_scan_us=round(1e6 * max(parts), 2),
        plant_us=round(1e6 * plant_s / count, 2),
        plant_ratio=round(count * SCAN_MS / 1000 / plant_s, 1),
        warm_start_s=round(_warm_start_s(), 3),
        cabbage_row_s=_row_s("cabbage", seed),
        pepper_row_s=_row_s("pepper", seed),
        combined_row_s=_row_s("combined", seed),
        reactions=measure_reactions(),
    )


def _row_s(name: str, seed: int) -> float:
    """Return the CPU time of a run of a line over `ROW_METRES`, s."""
    machine = load_machine()
    began_s = time.process_time()
    result_of(name, profile=None, metres=ROW_METRES, seed=seed, machine=machine)
    return round(time.process_time() - began_s, 2)


def _warm_start_s() -> float:
    """Return the time from the start of a process to the end of its first scan, s; the minimum of two runs."""
    command = [sys.executable, "-c", _WARM_START]
    return min(
        float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)  # noqa: S603 - our own code
        for _ in range(2)
    )


def _record(seed: int) -> tuple[list[list[bool]], list[list[bool]]]:
    """Return every X and Y image of a trial from power-up to Complete.

    Raises:
        NotReachedError: The trial does not complete.
    """
    twin = Twin(seed=seed, set_points={"trays_target": 2})
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


def _replay_scans(inputs: list[list[bool]]) -> list[float]:
    """Return the CPU time of every scan of a new PLC that reads the recorded inputs, s."""
    machine = build(load_io_map(DEFAULT_IO_MAP))
    plc = Plc(machine.program)
    plc.write(machine.tags.sp.trays_target, 2)
    scan, clock = plc.scan, time.process_time
    times: list[float] = []
    for number, image in enumerate(inputs):
        began_s = clock()
        scan(number * SCAN_MS, image)
        times.append(clock() - began_s)
    return times


def _replay_plant(outputs: list[list[bool]], seed: int) -> float:
    """Return the CPU time of a new plant driven by the recorded outputs, s."""
    plant = Plant(load_io_map(DEFAULT_IO_MAP), load_machine(), seed=seed, trays=2)
    began_s = time.process_time()
    for image in outputs:
        plant.step(SCAN_MS, image)
    return time.process_time() - began_s
