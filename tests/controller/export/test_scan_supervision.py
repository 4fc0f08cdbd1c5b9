"""Supervision of the scan time in the exported FX2N program: too long scans abort the machine with alarm S902."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from random import Random

import pytest

from controller.core.rungs import Out
from controller.export.instruction_list import export
from controller.export.scan_supervision import COUNTER, LEAST_PER_S, LONGEST_MEAN_MS, LONGEST_MS
from controller.fx.engine.execution import fastest_execution
from controller.fx.engine.plc import FxPlc
from controller.program.states import State
from plant_sim.machine.plant import Plant
from tests.controller.export.fx_equality import EXPORTED, TAGS
from tests.controller.export.test_dividing import X, one_block
from tests.controller.program.interlock_scene import MACHINE
from tests.controller.program.modes.stand_in import MACHINE as PARAMETERS
from tests.sampling import one_in

FAULT = TAGS.system.scan_fault.number
ALARM = MACHINE.alarms.scan_fault.number
LEVELS = Plant(MACHINE.io_map, PARAMETERS, seed=1).x
"""Terminals of the machine at power-up."""


@dataclass
class Scans:
    """Exported program at rest, with scans of given durations.

    Attributes:
        faults_ms: Times of the scans in which the relay of the fault was on.
    """

    plc: FxPlc = field(default_factory=lambda: FxPlc(EXPORTED, execution=fastest_execution))
    now_ms: int = 0
    faults_ms: list[int] = field(default_factory=list)

    def run(self, periods_ms: Iterable[int]) -> Scans:
        for period_ms in periods_ms:
            self.plc.scan(self.now_ms, LEVELS)
            if self.plc.memory.M[FAULT]:
                self.faults_ms.append(self.now_ms)
            self.now_ms += period_ms
        return self

    @property
    def alarm(self) -> bool:
        return self.plc.memory.S[ALARM]


@pytest.mark.parametrize("first_ms", one_in(2, [0, 1, 370, 995]))
@pytest.mark.parametrize("period_ms", one_in(2, [1, 7, 10, LONGEST_MEAN_MS]))
def test_permitted_scan_times_raise_no_alarm(period_ms: int, first_ms: int) -> None:
    scans = Scans(now_ms=first_ms).run([period_ms] * (5_000 // period_ms))
    assert (scans.faults_ms, scans.alarm) == ([], False)


@pytest.mark.parametrize("first_ms", one_in(2, [0, 370, 995]))
@pytest.mark.parametrize("period_ms", [LONGEST_MEAN_MS + 1, 20, LONGEST_MS])
def test_a_long_mean_is_found_within_two_seconds(period_ms: int, first_ms: int) -> None:
    scans = Scans(now_ms=first_ms).run([period_ms] * (2_100 // period_ms))
    assert scans.faults_ms
    assert scans.faults_ms[0] - first_ms <= 2_000 + period_ms
    scans.run([10] * 5)
    assert scans.alarm
    assert scans.plc.memory.D[TAGS.machine.state.number] == State.ABORTED


def test_jitter_is_judged_by_its_mean() -> None:
    chance = Random(1)
    assert not Scans().run(chance.randint(4, 18) for _ in range(500)).alarm
    assert Scans().run(chance.randint(8, 30) for _ in range(500)).alarm


def test_a_single_long_scan_is_found_at_once_and_its_relay_is_on_for_one_scan() -> None:
    permitted = Scans().run([10] * 130 + [LONGEST_MS] + [10] * 300)
    assert (permitted.faults_ms, permitted.alarm) == ([], False)
    scans = Scans().run([10] * 130 + [LONGEST_MS + 1])
    assert scans.faults_ms == []
    scans.run([10] * 300)
    assert scans.faults_ms == [1_300 + LONGEST_MS + 1]
    assert scans.alarm, "the alarm stays on"


def test_a_fault_set_by_other_means_stays_on() -> None:
    scans = Scans().run([10] * 5)
    scans.plc.memory.M[FAULT] = True
    assert len(scans.run([10] * 50).faults_ms) == 50


def test_the_counter_starts_again_after_power_up() -> None:
    scans = Scans().run([10] * 150)
    scans.plc.power_cycle()
    scans.run([10] * 30)
    assert scans.plc.memory.D[COUNTER.number] > LEAST_PER_S
    assert not scans.alarm


def test_a_program_without_the_relay_has_no_supervision() -> None:
    names = {str(each) for each in export(one_block(Out(TAGS.system.link_lost, X[1]))).instructions}
    assert f"INC {COUNTER}" not in names
    assert f"INC {COUNTER}" in {str(each) for each in EXPORTED.instructions}
