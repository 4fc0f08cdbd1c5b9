"""The machine's own program as a controller on the bench, in this process and in lock step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import repeat

from controller.core.machine_code import MachineExecution
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.program.memory import declare_new
from plant_sim.hil.bench import ControllerSupply
from plant_sim.links.in_process import InProcessLink
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.lock_step import SCAN_MS


def drive(
    link: InProcessLink,
    supply: ControllerSupply,
    *,
    until: Callable[[], bool],
    set_points: Mapping[str, int],
    periods_ms: Iterable[int] = repeat(SCAN_MS),
) -> None:
    """Run the program as that of a new machine, with the memory that it retains whenever its power returns.

    Args:
        link: Link to the module.
        supply: Power and link, which the bench interrupts.
        until: Function that is called before each scan, and returns True to end.
        set_points: Values of set-points at each power-up, by name of `SetPoints`.
        periods_ms: Scan periods in turn, ms, without end.
    """
    store = MemoryStore()
    runtime: Runtime | None = None
    now_ms = 0
    for period_ms in periods_ms:
        if until():
            return
        link.is_cut = not supply.is_linked
        if not supply.is_on:
            runtime = None
        else:
            runtime = runtime or _started(link, store, set_points)
            runtime.tick(now_ms)
        link.module.advance(period_ms)
        now_ms += period_ms


def _started(link: InProcessLink, store: MemoryStore, set_points: Mapping[str, int]) -> Runtime:
    machine = program_of(link.module.io_map)
    plc = Plc(machine.program, execution=MachineExecution(machine.program))
    if (retained := store.load()) is not None:
        plc.restore_retained(retained)
    else:
        declare_new(machine.tags, plc)
    for name, value in set_points.items():
        plc.write(getattr(machine.tags.sp, name), value)
    link.close()
    return Runtime(machine, plc, link, DirectRetentiveWriter(store))
