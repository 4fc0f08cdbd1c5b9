"""Controllers that could deceive the bench, and unusual ones that it must pass."""

from __future__ import annotations

import pytest

from plant_sim.faults import parse_fault
from plant_sim.hil.bench import Bench
from plant_sim.hil.bench_module import BenchModule
from plant_sim.hil.bench_run import CaseVerdict
from plant_sim.hil.procedure import NotRunError
from plant_sim.machine.parameters import load_machine
from plant_sim.machine.plant import Plant
from plant_sim.twin.lock_step import SCAN_MS
from tests.plant_sim.hil.hil_rig import default_map, failures, judge


def _bench() -> Bench:
    io_map, machine = default_map(), load_machine()
    return Bench(BenchModule(Plant(io_map, machine, seed=1, trays=2), io_map), machine)


@pytest.mark.nightly
def test_an_output_that_flickers_fails() -> None:
    """A valve that is switched in every scan has no situation that lasts long enough for an emergency stop."""

    def flickers(bench: Bench, on: set[str]) -> set[str]:
        return on - {"left.claws_close"} if bench.now_ms // SCAN_MS % 2 else on

    results, _ = judge(damage=flickers)
    reasons = failures(results)["cycle: both arms throw their first row"]
    assert any(each.startswith("flicker: left.claws_close switched 6 times") for each in reasons)


@pytest.mark.nightly
def test_a_controller_that_is_dead_for_400_ms_fails() -> None:
    def dies(bench: Bench, on: set[str]) -> set[str] | None:
        return None if 120_000 <= bench.now_ms < 120_400 else on

    results, _ = judge(damage=dies)
    reasons = failures(results)["trial: 144 seedlings"]
    assert "output watchdog: no output written for 100 ms, at 120.100 s" in reasons


@pytest.mark.nightly
def test_a_controller_that_works_on_after_homing_fails() -> None:
    """The start button is pressed once more as soon as the machine rests, as if by the program.

    A loaded arm waits at feed for twelve cups, which looks like the initial state.
    """
    pressed_ms: list[int] = []

    def starts_itself(bench: Bench, on: set[str]) -> set[str]:
        if not pressed_ms and bench.now_ms > 64_000 and not on and bench.view.quiet_for(500):
            pressed_ms.append(bench.now_ms)
        if pressed_ms:
            bench.module.plant.box.start = bench.now_ms - pressed_ms[0] < 200
        return on

    results, _ = judge(damage=starts_itself)
    reasons = failures(results)["homing: from power-up to the initial state"]
    assert any("seedlings picked while homing" in each for each in reasons)


@pytest.mark.nightly
def test_a_controller_that_stops_at_once_has_no_margin() -> None:
    """A machine that loses all seedlings without dead time must not count as one that tolerates every dead time."""
    stopped_with: list[int] = []

    def dies_after_stop(bench: Bench, on: set[str]) -> set[str]:
        if bench.forbidden.startswith("after stop"):
            stopped_with[:] = [bench.module.plant.counts().in_tray]
        picks = stopped_with and bench.module.plant.counts().in_tray < stopped_with[0]
        return set() if picks else on

    results, _ = judge(["scan-time margin"], damage=dies_after_stop)
    reasons = failures(results)["scan-time margin: 72 seedlings at each dead time"]
    assert reasons[0] == "does not transplant 72 seedlings without additional dead time"


@pytest.mark.nightly
def test_a_coil_that_stays_on_at_rest_passes() -> None:
    stopped: list[bool] = []

    def holds(bench: Bench, on: set[str]) -> set[str]:
        if bench.module.plant.box.stop:
            stopped.append(True)
        return on | {"right.lift_extend"} if stopped and not on else on

    results, _ = judge(damage=holds)
    assert not failures(results)


@pytest.mark.nightly
@pytest.mark.parametrize("only", ["no such case"])
def test_a_selection_without_a_case_is_not_run(only: str) -> None:
    results, _ = judge(["fault"], only=only)
    assert (results[-1].group, results[-1].verdict) == ("fault", CaseVerdict.NOT_RUN)
    assert results[-1].reasons == [f"no case whose name contains {only!r}"]


def test_faults_of_the_options_are_neither_started_again_nor_repaired() -> None:
    bench = _bench()
    faults = bench.module.plant.faults
    faults.add(parse_fault("broken_wire:stop"))
    with pytest.raises(NotRunError, match="changes the same value"):
        bench.set_fault("broken_wire:stop")
    bench.set_fault("jammed:right.lift")
    bench.repair()
    assert [each.name for each in faults.active] == ["broken_wire:stop"]


def test_a_machine_without_active_outputs_has_no_reaction_time() -> None:
    bench = _bench()
    bench.module.advance(SCAN_MS)
    bench.press_emergency_stop()
    bench.module.advance(SCAN_MS)
    assert not bench.findings.figures


def test_the_reaction_ends_with_the_last_switching() -> None:
    bench = _bench()
    module = bench.module
    safe = module.io_map.safe_outputs()
    on = list(safe)
    on[module.io_map["left.lift_extend"].number] ^= True
    module.write_outputs(0, on)
    module.advance(SCAN_MS)
    bench.press_emergency_stop()
    for image in (safe, on, safe):
        module.write_outputs(0, image)
        module.advance(SCAN_MS)
    assert bench.findings.figures["outputs off after"].value == 3 * SCAN_MS
