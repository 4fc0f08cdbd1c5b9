"""The machine's own program on the bench, in one process and in lock step, with outputs that a test can damage."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache

from controller.core.machine_code import MachineExecution
from controller.core.retentive_store import MemoryStore
from controller.core.scan import Plc
from controller.io.retentive_writer import DirectRetentiveWriter
from controller.io.runtime import Runtime
from controller.iomap.loader import DEFAULT_IO_MAP, IoMap, load_io_map
from controller.program.machine import Transplanter, build
from plant_sim.hil.bench import Bench
from plant_sim.hil.bench_run import BenchRun, CaseResult, CaseVerdict
from plant_sim.hil.delaying_module import DelayingModule
from plant_sim.links.in_process import InProcessLink
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant

SCAN_MS = 10
LIMIT_MS = 3_600_000

Damage = Callable[[Bench, set[str]], set[str] | None]
"""Function that receives the actuators and lamps that the program switches on, and returns those that are switched;
None = the outputs are not written."""


@cache
def program(io_map: IoMap) -> Transplanter:
    return build(io_map)


def default_map() -> IoMap:
    return load_io_map(DEFAULT_IO_MAP)


class DamagedLink(InProcessLink):
    """Link that changes the outputs on their way to the module."""

    def __init__(self, module: DelayingModule, change: Callable[[set[str]], set[str] | None]) -> None:
        super().__init__(module)
        self._points = module.io_map.outputs
        self._change = change

    def write_outputs(self, image: Sequence[bool]) -> None:
        on = self._change({point.tag for point in self._points if point.active(image[point.number])})
        if on is None:
            return
        levels = list(image)
        for point in self._points:
            levels[point.number] = point.level(point.tag in on)
        super().write_outputs(levels)


def judge(
    groups: Iterable[str] = ("trial",),
    *,
    only: str = "",
    damage: Damage | None = None,
    trays: int = 60,
    io_map: IoMap | None = None,
    reference_lost: int | None = 10,
    set_points: Mapping[str, int] | None = None,
) -> tuple[list[CaseResult], Bench]:
    """Run the bench on the program until its last case; return the results and the bench."""
    io_map, machine = io_map or default_map(), load_machine()
    module = DelayingModule(Plant(io_map, machine, seed=1, trays=trays), io_map)
    bench = Bench(module, machine)
    link = DamagedLink(module, (lambda on: damage(bench, on)) if damage else lambda on: on)
    transplanter = program(io_map)
    plc = Plc(transplanter.program, execution=MachineExecution(transplanter.program))
    for name, value in (set_points or {}).items():
        plc.write(getattr(transplanter.tags.sp, name), value)
    runtime = Runtime(transplanter, plc, link, DirectRetentiveWriter(MemoryStore()))
    run = BenchRun(bench, groups=groups, only=only, reference_lost=reference_lost)
    ended: list[int] = []
    bench.play(run.procedure(), ended=lambda: ended.append(bench.now_ms))
    now_ms = 0
    while not ended:
        assert now_ms < LIMIT_MS, "the bench does not end"
        runtime.tick(now_ms)
        module.advance(SCAN_MS)
        now_ms += SCAN_MS
    assert run.is_complete
    return run.results, bench


def failures(results: Iterable[CaseResult]) -> dict[str, list[str]]:
    """Return the reasons of the failed cases by group and name."""
    return {f"{each.group}: {each.name}": each.reasons for each in results if each.verdict is CaseVerdict.FAILED}
