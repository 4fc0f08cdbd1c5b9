"""The machine's own program as the controller of an I/O module, in this process and in lock step."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from controller.core.machine_code import MachineExecution
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from plant_sim.links.in_process import InProcessLink
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.lock_step import SCAN_MS


def drive(link: InProcessLink, *, until: Callable[[], bool], set_points: Mapping[str, int]) -> None:
    """Run the program from power-up; each scan is followed by plant time.

    Args:
        link: Link to the module.
        until: Function that is called before each scan, and returns True to end.
        set_points: Initial values of set-points, by name of `SetPoints`.
    """
    module = link.module
    machine = program_of(module.io_map)
    plc = Plc(machine.program, execution=MachineExecution(machine.program))
    for name, value in set_points.items():
        plc.write(getattr(machine.tags.sp, name), value)
    runtime = Runtime(machine, plc, link, DirectRetentiveWriter(MemoryStore()))
    now_ms = 0
    while not until():
        runtime.tick(now_ms)
        module.advance(SCAN_MS)
        now_ms += SCAN_MS
