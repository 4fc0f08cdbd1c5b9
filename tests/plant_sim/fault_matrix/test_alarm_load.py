"""Alarm load of every fault of the matrix: one first-out alarm, and at most ten alarms in ten minutes."""

from __future__ import annotations

import pytest

from controller.events.alarm_list import AlarmChange, AlarmList
from controller.events.alarm_load import MOST_IN_WINDOW, WINDOW_MS
from controller.program.states import State
from plant_sim.fault_matrix.cases import Subject, subjects
from plant_sim.fault_matrix.run import MatrixSetup, run_case, run_unattended, undisturbed
from plant_sim.faults import Fault
from plant_sim.twin.lock_step import Twin
from tests.sampling import one_in

SETTING = MatrixSetup(trays=2)
ALL = subjects(SETTING.twin().plant)
EVERY = 40
"""Step of the sample by default; it contains faults with a consequence."""


def fault_of(subject: Subject) -> Fault:
    """Return the first moment of a row of the matrix."""
    reference = undisturbed(SETTING)
    fault, *_ = subject.faults(1, seed=SETTING.seed, from_ms=reference.begins_ms, to_ms=reference.ends_ms)
    return fault


@pytest.mark.parametrize("subject", one_in(EVERY, ALL), ids=str)
def test_a_fault_that_is_repaired_gives_one_first_alarm_with_its_consequences_folded(subject: Subject) -> None:
    outcome = run_case(fault_of(subject), SETTING)
    assert outcome.beside == []
    assert outcome.alarms <= MOST_IN_WINDOW


@pytest.mark.parametrize("subject", one_in(EVERY, ALL), ids=str)
def test_a_fault_to_which_nobody_reacts_gives_at_most_ten_alarms_in_ten_minutes(subject: Subject) -> None:
    listed = run_unattended(fault_of(subject), SETTING, WINDOW_MS)
    assert listed.beside == set()
    assert listed.most <= MOST_IN_WINDOW


def test_faults_of_both_arms_give_one_first_alarm_with_the_other_folded() -> None:
    """Two lifts that jam together: the alarm of the second one is folded under the first-out of the program."""
    twin = Twin()
    changes: list[AlarmChange] = []
    alarms = AlarmList(twin.machine.alarms, twin.machine.tags.machine.first_out, changes.append)
    twin.runtime.observers.append(alarms)
    twin.scan()
    twin.home()
    twin.start()
    for side in ("left", "right"):
        twin.plant.faults.add(Fault("jammed", f"{side}.lift", twin.now_ms))
    twin.run_until_state(State.HELD, within_ms=60_000)
    first, *others = alarms.rows()
    assert first.first_out
    assert first.alarm.bit.number == twin.plc.read(twin.machine.tags.machine.first_out)
    assert [row.follows for row in others] == [first.alarm.bit.number]
