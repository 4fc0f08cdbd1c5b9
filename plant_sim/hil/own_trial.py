"""The machine's own program on the bench, in this process, and its trial, with which others are compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from itertools import repeat

from controller.common.modbus.io_map import IoMap
from controller.core.machine_code import MachineExecution
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from plant_sim.hil.bench import Bench, ControllerSupply
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.bench_run import FIRST_GROUPS, BenchRun
from plant_sim.hil.reference import TrialQuantities
from plant_sim.links.in_process import InProcessLink
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.commissioning import program_of, set_points_of
from plant_sim.twin.lock_step import SCAN_MS


class OwnTrialError(Exception):
    """The machine's own program does not complete the trial; the message is one line."""


def measure(plant: Plant, io_map: IoMap, machine: Machine) -> TrialQuantities:
    """Run the first cases with the machine's own program until the end of the trial.

    Args:
        plant: New plant, equal to that of the controller to be judged.
        io_map: I/O map.
        machine: Parameters of the plant.

    Raises:
        OwnTrialError: The trial is not completed.
    """
    module = BenchModule(plant, io_map)
    bench = Bench(module, machine)
    run = BenchRun(bench, groups=FIRST_GROUPS)
    ended: list[bool] = []
    bench.play(run.procedure(), ended=lambda: ended.append(True))
    drive(
        InProcessLink(module),
        ControllerSupply(),
        until=lambda: bool(ended) or bench.trial is not None,
        set_points=set_points_of(machine),
    )
    if bench.trial is None:
        raise OwnTrialError("the machine's own program does not complete this trial")
    return bench.trial


def drive(
    link: InProcessLink,
    supply: ControllerSupply,
    *,
    until: Callable[[], bool],
    set_points: Mapping[str, int],
    periods_ms: Iterable[int] = repeat(SCAN_MS),
) -> None:
    """Run the program from power-up, with the memory that it retains whenever its power returns.

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
    for name, value in set_points.items():
        plc.write(getattr(machine.tags.sp, name), value)
    link.close()
    return Runtime(machine, plc, link, DirectRetentiveWriter(store))
