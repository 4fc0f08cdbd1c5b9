"""The machine's own program on the bench, in one process and in lock step, with outputs that a test can damage."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import repeat

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from plant_sim.hil.bench import Bench, ControllerSupply
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.bench_run import BenchRun, CaseResult, CaseVerdict
from plant_sim.hil.own_program import drive
from plant_sim.hil.own_trial import measure
from plant_sim.hil.random_operator import SECONDS_PER_TRAY
from plant_sim.hil.reference import TrialQuantities
from plant_sim.hil.selection import GROUPS
from plant_sim.links.in_process import InProcessLink
from plant_sim.machine.parameters import Machine, load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS
from tests.plant_sim.hil.grammar import Shim, ShimmedLink, parse

TRAYS = 60
"""Trays in the magazine, enough for all cases."""
LIMIT_MS = 14_400_000
"""Time limit of a run, ms; all groups take about 7,100 s."""

Damage = Callable[[Bench, set[str]], set[str] | None]
"""Function that receives the actuators and lamps that the program switches on, and returns those that are switched;
None = the outputs are not written."""


@cache
def default_map() -> IoMap:
    return load_io_map(DEFAULT_IO_MAP)


class DamagedLink(InProcessLink):
    """Link that changes the outputs on their way to the module."""

    def __init__(self, module: BenchModule, change: Callable[[set[str]], set[str] | None]) -> None:
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
    reference: TrialQuantities | None = None,
    set_points: Mapping[str, int] | None = None,
    random_s: int = 0,
) -> tuple[list[CaseResult], Bench]:
    """Run the bench on the program until its last case; return the results and the bench."""
    io_map, machine = io_map or default_map(), load_machine()
    module = BenchModule(Plant(io_map, machine, seed=1, trays=trays), io_map)
    bench = Bench(module, machine)
    link = DamagedLink(module, (lambda on: damage(bench, on)) if damage else lambda on: on)
    run = BenchRun(bench, groups=groups, only=only, reference=reference, random_s=random_s)
    ended: list[int] = []
    bench.play(run.procedure(), ended=lambda: ended.append(bench.now_ms))

    def is_over() -> bool:
        assert bench.now_ms < LIMIT_MS, "the bench does not end"
        return bool(ended)

    bench.supply = ControllerSupply()
    drive(link, bench.supply, until=is_over, set_points=set_points or {})
    assert run.is_complete
    return run.results, bench


@cache
def own_trial(slide_share: float = 1.0, seed: int = 1) -> TrialQuantities:
    """Quantities of the trial of the delivered machine, with slides throttled to a share of their flow."""
    machine = throttled(slide_share)
    return measure(Plant(default_map(), machine, seed=seed, trays=TRAYS), default_map(), machine)


def throttled(slide_share: float) -> Machine:
    """Return the delivered machine with slides throttled to a share of their flow."""
    machine = load_machine()
    flow = slide_share * machine.slide.throttle_conductance_m3_s_pa
    return replace(machine, slide=replace(machine.slide, throttle_conductance_m3_s_pa=flow))


def judge_shimmed(
    damages: Iterable[str],
    groups: Iterable[str] = GROUPS,
    *,
    only: str = "",
    first_failure: bool = True,
    io_map: IoMap | None = None,
    periods_ms: Iterable[int] = repeat(SCAN_MS),
    set_points: Mapping[str, int] | None = None,
    slide_share: float = 1.0,
    seed: int = 1,
    random_s: int = 0,
) -> tuple[list[CaseResult], Bench, list[Shim]]:
    """Run the bench on the program behind damages of the grammar; end at the first failure if only a verdict counts."""
    io_map, machine = io_map or default_map(), throttled(slide_share)
    module = BenchModule(Plant(io_map, machine, seed=seed, trays=TRAYS + random_s // SECONDS_PER_TRAY), io_map)
    bench = Bench(module, machine)
    shims = [Shim(parse(text, io_map)) for text in damages]
    run = BenchRun(bench, groups=groups, only=only, reference=own_trial(slide_share, seed), random_s=random_s)
    ended: list[int] = []
    bench.play(run.procedure(), ended=lambda: ended.append(bench.now_ms))

    def is_over() -> bool:
        assert bench.now_ms < LIMIT_MS, "the bench does not end"
        failed = first_failure and run.results and run.results[-1].verdict is CaseVerdict.FAILED
        return bool(ended) or bool(failed)

    bench.supply = ControllerSupply()
    drive(ShimmedLink(module, shims), bench.supply, until=is_over, set_points=set_points or {}, periods_ms=periods_ms)
    return run.results, bench, shims


def failures(results: Iterable[CaseResult]) -> dict[str, list[str]]:
    """Return the reasons of the failed cases by group and name."""
    return {f"{each.group}: {each.name}": each.reasons for each in results if each.verdict is CaseVerdict.FAILED}
