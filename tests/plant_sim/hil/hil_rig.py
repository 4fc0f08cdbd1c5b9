"""The machine's own program on the bench, in one process and in lock step, with outputs that a test can damage."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.hil.bench import Bench
from plant_sim.hil.bench_run import BenchRun, CaseResult, CaseVerdict
from plant_sim.hil.delaying_module import DelayingModule
from plant_sim.links.in_process import InProcessLink
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.own_program import drive

LIMIT_MS = 7_200_000
"""Time limit of a run, ms; all groups take 3,960 s."""

Damage = Callable[[Bench, set[str]], set[str] | None]
"""Function that receives the actuators and lamps that the program switches on, and returns those that are switched;
None = the outputs are not written."""


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
    run = BenchRun(bench, groups=groups, only=only, reference_lost=reference_lost)
    ended: list[int] = []
    bench.play(run.procedure(), ended=lambda: ended.append(bench.now_ms))

    def is_over() -> bool:
        assert bench.now_ms < LIMIT_MS, "the bench does not end"
        return bool(ended)

    drive(link, until=is_over, set_points=set_points or {})
    assert run.is_complete
    return run.results, bench


def failures(results: Iterable[CaseResult]) -> dict[str, list[str]]:
    """Return the reasons of the failed cases by group and name."""
    return {f"{each.group}: {each.name}": each.reasons for each in results if each.verdict is CaseVerdict.FAILED}
