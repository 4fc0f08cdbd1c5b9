"""The operator's alarm list on the whole machine: its alarms, their causes, its resets."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest
from alarm_desk import ACKNOWLEDGED, LATCHED, LATCHED_ACKNOWLEDGED, NORMAL, RETURNED, SHELF_MS, UNACKNOWLEDGED
from twin_rig import switched_on

from controller.core.devices import ANNUNCIATOR_ON
from controller.core.expr import evaluate
from controller.hmi.alarm_list import AlarmChange, AlarmList, AlarmRefusalError
from controller.program.states import State
from plant_sim.bench.twin import Twin
from plant_sim.faults import Fault

GUIDE = Path(__file__).resolve().parent.parent / "docs" / "alarms.md"


def listed(twin: Twin, changes: list[AlarmChange]) -> AlarmList:
    """Put an alarm list on a twin."""
    alarms = AlarmList(twin.machine.alarms, twin.machine.tags.machine.first_out, changes.append)
    twin.runtime.observers.append(alarms)
    return alarms


def test_an_emergency_stop_is_latched_until_it_is_cleared() -> None:
    """Given an emergency stop acknowledged and let go, when X24 is held for 3 s, then the list is empty, not before."""
    changes: list[AlarmChange] = []
    twin = switched_on()
    alarms = listed(twin, changes)
    twin.plant.box.emergency_stop = True
    twin.run_for(100)
    alarms.acknowledge(by="Li")
    twin.plant.box.emergency_stop = False
    twin.run_for(100)
    twin.press("stop", for_ms=3_200)
    twin.run_for(2_900)
    (row,) = alarms.rows()
    assert (row.alarm.key, row.state, row.first_out) == ("emergency_stop", LATCHED_ACKNOWLEDGED, True)
    twin.run_for(300)
    assert alarms.rows() == ()
    assert [change.after for change in changes] == [UNACKNOWLEDGED, ACKNOWLEDGED, LATCHED_ACKNOWLEDGED, NORMAL]


def test_a_motion_that_did_not_end_is_latched_and_listed_until_it_is_acknowledged() -> None:
    """Given a lost limit switch, when it is mended and X0 resets, then its alarm waits to be acknowledged."""
    changes: list[AlarmChange] = []
    twin = switched_on()
    alarms = listed(twin, changes)
    twin.plant.faults.add(Fault("stuck_off", "left.lift_up"))
    twin.press("start")
    twin.run_until_state(State.HELD, within_ms=60_000)
    (row,) = alarms.rows()
    assert (row.alarm.side, row.state, row.first_out) == ("left", LATCHED, True)
    twin.plant.faults.mend("stuck_off:left.lift_up")
    twin.home()
    (row,) = alarms.rows()
    assert row.state is RETURNED
    alarms.acknowledge(row.alarm.bit.number, by="Li")
    twin.scan()
    assert alarms.rows() == ()


def test_no_reset_takes_an_alarm_whose_cause_is_there() -> None:
    """Given a limit switch that sticks, when X0 resets, then the alarm stays; mended and reset again, it goes.

    Mended is not enough: the arm has gone up under its stuck lower switch and has lost its place, so its upper switch
    is in doubt until homing begins anew.
    """
    changes: list[AlarmChange] = []
    twin = switched_on()
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
    twin.plant.faults.mend("stuck_on:left.lift_down")
    twin.run_for(100)
    assert [row.state for row in alarms.rows()] == [ACKNOWLEDGED]
    twin.home()
    assert [change.after for change in changes] == [UNACKNOWLEDGED, ACKNOWLEDGED, NORMAL]


def test_what_can_be_shelved_only_warns() -> None:
    """Given the alarms of the program, then four warnings can be shelved, and the safety alarms are called so."""
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
    assert shelved == {"memory_lost", "stop_stuck", "magazine_empty", "hmi_silent"}
    assert shelved.isdisjoint(refused)
    safety = {key for key, reason in refused.items() if "safety" in reason}
    assert safety == {"emergency_stop", "link_lost", "scan_fault", "store_fault"}


def test_the_real_causes_can_be_judged() -> None:
    """Given every annunciator set by hand, then each is listed, latched exactly where its cause is not there."""
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


def test_the_example_of_the_guide_prints_the_alarm_and_who_acknowledged_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (code,) = re.findall(r"^```python\n(.*?)^```$", GUIDE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    example = tmp_path / "example.py"
    example.write_text(code, encoding="utf-8")
    runpy.run_path(str(example))
    alarm, change = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"S9\d\d \| latched, unacknowledged \| Homing: left arm not up.* \| .*lift_retract.*", alarm)
    assert change == "latched_unacknowledged -> latched_acknowledged by Li"
