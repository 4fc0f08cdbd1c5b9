"""Exports of the program as controllers on the bench: the FX program in the engine, a package in its compiled text."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from controller.fx.engine.plc import FxPlc
from plant_sim.hil.bench import Bench
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.bench_run import BenchRun, CaseResult
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS
from tests.controller.export.fx_equality import EXPORTED
from tests.controller.export.package_rig import rig
from tests.plant_sim.hil.hil_rig import TRAYS, default_map, own_trial

Scan = Callable[[int, Sequence[bool]], Sequence[bool]]
"""Function that runs one scan with the plant time, ms, and the levels of the inputs; returns those of the outputs."""


def fx_engine() -> Scan:
    """Return the exported FX program in the engine of the project, with zeroed memory."""
    plc = FxPlc(EXPORTED)
    return plc.scan


def package(target: str) -> Scan:
    """Return a package in the runner of its Structured Text."""
    machine = rig(target)

    def scan(now_ms: int, levels: Sequence[bool]) -> Sequence[bool]:
        machine.clock_ms = machine.utc_ms = machine.link_ms = now_ms
        return machine.outputs(levels)

    return scan


def judge_export(scan: Scan, groups: Sequence[str]) -> list[CaseResult]:
    """Run groups of cases on an export in lock step."""
    io_map, machine = default_map(), load_machine()
    module = BenchModule(Plant(io_map, machine, seed=1, trays=TRAYS), io_map)
    bench = Bench(module, machine)
    run = BenchRun(bench, groups=groups, reference=own_trial())
    ended: list[bool] = []
    bench.play(run.procedure(), ended=lambda: ended.append(True))
    while not ended:
        module.write_outputs(0, scan(module.plant.time_ms, module.inputs())[: io_map.output_count])
        module.advance(SCAN_MS)
    return run.results
