"""Alarm list on the complete machine: alarms, causes and resets."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from controller.core.devices import ANNUNCIATOR_ON
from controller.core.expr import evaluate
from controller.events.alarm_list import AlarmChange, AlarmList, AlarmRefusalError
from controller.program.states import State
from plant_sim.faults import Fault
from plant_sim.twin.lock_step import Twin
from tests.controller.events.alarm_rig import (
    ACKNOWLEDGED,
    LATCHED,
    LATCHED_ACKNOWLEDGED,
    NORMAL,
    RETURNED,
    SHELF_MS,
    UNACKNOWLEDGED,
)
from tests.paths import DOCS
from tests.plant_sim.twin.twin_rig import switched_on

GUIDE = DOCS / "alarms.md"


def listed(twin: Twin, changes: list[AlarmChange]) -> AlarmList:
    """Connect an alarm list to a twin, and return the list."""
    alarms = AlarmList(twin.machine.alarms, twin.machine.tags.machine.first_out, changes.append)
    twin.runtime.observers.append(alarms)
    return alarms


def test_an_emergency_stop_is_latched_until_it_is_cleared() -> None:
    """After the alarm is acknowledged and the button released, a press of X24 of 3 s empties the list."""
    changes: list[AlarmChange] = []
    twin = switched_on()
    alarms = listed(twin, changes)
    twin.plant.box.emergency_stop = True
    twin.run_for(100)
    alarms.acknowledge(by="Li")
    twin.plant.box.emergency_stop = False
    twin.run_for(100)
    twin.press("stop", for_ms=3_200)
    twin.run_for(3_150)
    (row,) = alarms.rows()
    assert (row.alarm.key, row.state, row.first_out) == ("emergency_stop", LATCHED_ACKNOWLEDGED, True)
    twin.run_for(100)
    assert alarms.rows() == ()
    assert [change.after for change in changes] == [UNACKNOWLEDGED, ACKNOWLEDGED, LATCHED_ACKNOWLEDGED, NORMAL]


def test_a_motion_timeout_is_latched_and_listed_until_it_is_acknowledged() -> None:
    """After the limit switch is repaired and X0 is pressed, the alarm still requires acknowledgement."""
    changes: list[AlarmChange] = []
    twin = switched_on()
    alarms = listed(twin, changes)
    twin.plant.faults.add(Fault("stuck_off", "left.lift_up"))
    twin.press("start")
    twin.run_until_state(State.HELD, within_ms=60_000)
    (row,) = alarms.rows()
    assert (row.alarm.side, row.state, row.first_out) == ("left", LATCHED, True)
    twin.plant.faults.clear("stuck_off:left.lift_up")
    twin.home()
    (row,) = alarms.rows()
    assert row.state is RETURNED
    alarms.acknowledge(row.alarm.bit.number, by="Li")
    twin.scan()
    assert alarms.rows() == ()


def test_a_reset_does_not_clear_an_alarm_whose_cause_is_present() -> None:
    """X0 does not reset the alarm of a stuck limit switch until the switch is repaired; the repair alone does not."""
    changes: list[AlarmChange] = []
    twin = switched_on()
    twin.home()
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=1_000)
    twin.run_for(100)
    alarms = listed(twin, changes)
    twin.plant.faults.add(Fault("stuck_on", "left.lift_down"))
    twin.press("start")
    twin.run_until_state(State.HELD, within_ms=60_000)
    assert [(row.alarm.key, row.state) for row in alarms.rows()] == [("lift switches", UNACKNOWLEDGED)]
    alarms.acknowledge(by="Li")
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=1_000)
    twin.run_until_state(State.HELD, within_ms=60_000)
    assert [row.state for row in alarms.rows()] == [ACKNOWLEDGED]
    twin.plant.faults.clear("stuck_on:left.lift_down")
    twin.run_for(100)
    assert [row.state for row in alarms.rows()] == [LATCHED_ACKNOWLEDGED]
    twin.home()
    assert [change.after for change in changes] == [UNACKNOWLEDGED, ACKNOWLEDGED, LATCHED_ACKNOWLEDGED, NORMAL]


def test_only_warnings_can_be_shelved() -> None:
    """Only warnings and the loss of memory can be shelved; the refusal for a safety alarm states that it is one."""
    twin = switched_on()
    alarms = listed(twin, [])
    refused: dict[str, str] = {}
    for each in twin.machine.alarms:
        try:
            alarms.shelve(each.bit.number, SHELF_MS, by="Li")
        except AlarmRefusalError as refusal:
            refused[each.key] = str(refusal)
    twin.scan()
    shelved = {row.alarm.key for row in alarms.rows()}
    assert shelved == {
        "memory_lost",
        "stop_stuck",
        "magazine_empty",
        "hmi_silent",
        "lambda",
        "planting_fast",
        "outputs_contested",
        "cups_slow",
        "start_stuck",
        "reset_stuck",
        "constants",
    }
    assert shelved.isdisjoint(refused)
    safety = {key for key, reason in refused.items() if "safety" in reason}
    assert safety == {"emergency_stop", "link_lost", "scan_fault", "store_fault", "outputs_taken", "guard_open"}


def test_the_causes_of_all_alarms_can_be_evaluated() -> None:
    """With every annunciator set, each alarm is listed, and it is latched if and only if its cause is absent."""
    twin = switched_on()
    alarms = listed(twin, [])
    for each in twin.machine.alarms:
        twin.plc.memory.S[each.bit.number] = True
    twin.plc.memory.M[ANNUNCIATOR_ON] = True
    alarms(twin.now_ms, twin.plc)
    rows = alarms.rows()
    assert len(rows) == len(list(twin.machine.alarms))
    for row in rows:
        caused = row.alarm.cause is not None and evaluate(row.alarm.cause, twin.plc.memory)
        assert row.state is (UNACKNOWLEDGED if caused else LATCHED), row.alarm.key


def test_the_example_of_the_guide_prints_the_alarm_and_the_acknowledging_operator(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```$", GUIDE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    example = tmp_path / "example.py"
    example.write_text(code, encoding="utf-8")
    runpy.run_path(str(example))
    alarm, change = capsys.readouterr().out.splitlines()
    assert re.fullmatch(
        r"S9\d\d \| latched, unacknowledged \| Homing: left arm not up.* \| The lift did not reach its upper switch.*",
        alarm,
    )
    assert change == "latched_unacknowledged -> latched_acknowledged by Li"
