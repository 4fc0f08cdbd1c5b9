"""Speed of the lines: rows planted by each included line."""

from __future__ import annotations

import time
from typing import Final

from plant_sim.line.command import line_result
from plant_sim.machine.parameters import load_machine

LINES: Final = ("cabbage", "pepper", "combined")
METRES: Final = 1_000.0
"""Length of the rows, m."""


def measure_rows(seed: int) -> dict[str, float]:
    """Measure the CPU time of a run of each line."""
    machine = load_machine()
    times_s = {}
    for name in LINES:
        began_s = time.process_time()
        line_result(name, profile=None, metres=METRES, seed=seed, machine=machine, repeat=1)
        times_s[name] = time.process_time() - began_s
    return times_s
