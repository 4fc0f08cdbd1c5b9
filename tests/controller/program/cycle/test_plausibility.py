"""Implausible inputs: two switches of one device on together, and a switch that changes at rest."""

from __future__ import annotations

import pytest

from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, home_again
from tests.controller.program.modes.hands import in_manual, jog
from tests.plant_sim.twin.twin_rig import arm_of, at_work, tags_of, to_complete, undisturbed, until_picking, until_step

IN_DOUBT_MS, TICK_MS, FILTER_MS = 200, 100, 20
SECOND_SWITCH: list[tuple[Side, str, str]] = [
    ("left", "lift_up", "lift"),
    ("right", "slide_at_pick_1", "slide"),
    ("left", "claws_converged", "belt"),
]
"""Switches that cannot be on while an arm is over the cups, lowered and spread."""


def over_the_cups(side: Side) -> Twin:
    """Return a machine whose arm on this side holds row 1 and waits for its cups."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, side, 1)
    until_step(twin, f"{side} arm", "wait for cups")
    twin.run_for(1_200)
    return twin


@pytest.mark.parametrize(("side", "switch", "device"), SECOND_SWITCH)
def test_two_switches_of_one_device_raise_an_alarm_that_is_reset_only_without_its_cause(
    side: Side, switch: str, device: str
) -> None:
    """The alarm is raised 0.1 s to 0.23 s after the second switch turns on; X0 resets it only after repair."""
    twin = over_the_cups(side)
    alarm = f"{side}: {device} switches"
    sensor = arm_of(twin, side).sensors[switch]
    sensor.stuck = True
    twin.run_for(IN_DOUBT_MS - TICK_MS)
    assert twin.alarms() == []
    twin.run_for(TICK_MS + FILTER_MS + 10)
    assert twin.alarms() == [alarm]
    twin.run_until_state(State.HELD, within_ms=20_000)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert alarm in twin.alarms()
    assert [event.active for event in twin.alarm_events() if event.number == twin.alarm_events()[0].number] == [True]
    sensor.stuck = None
    home_again(twin)
    assert twin.alarms() == []
    twin.start()
    assert to_complete(twin) == undisturbed()


@pytest.mark.parametrize(("side", "switch", "device"), SECOND_SWITCH)
def test_two_switches_on_together_briefly_raise_no_alarm(side: Side, switch: str, device: str) -> None:
    """If a second switch is on for 100 ms, no alarm is raised and the row is released over the cups."""
    twin = over_the_cups(side)
    sensor = arm_of(twin, side).sensors[switch]
    sensor.stuck = True
    twin.run_for(100)
    sensor.stuck = None
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []


@pytest.mark.parametrize(
    ("side", "switch"), [("right", "lift_up"), ("left", "slide_at_pick_3"), ("right", "claws_spread")]
)
def test_in_manual_mode_an_implausible_switch_raises_no_alarm(side: Side, switch: str) -> None:
    """In manual mode neither two switches on together nor a change at rest raises an alarm."""
    twin = in_manual(side)
    twin.run_for(2_000)
    sensor = arm_of(twin, side).sensors[switch]
    sensor.stuck = True
    twin.run_for(3_000)
    sensor.stuck = False
    twin.run_for(3_000)
    sensor.stuck = None
    assert twin.alarm_events() == []
    assert twin.state is State.EXECUTE


@pytest.mark.parametrize("side", SIDES)
def test_in_manual_mode_cups_on_one_side_only_raise_no_alarm(side: Side) -> None:
    """In manual mode, no alarm is raised if ten cups pass on one side while the other carousel is at rest."""
    twin = in_manual(side)
    arm_of(twin, side).cups.jammed = True
    twin.run_for(14_000)
    assert twin.alarm_events() == []


@pytest.mark.parametrize("side", SIDES)
def test_in_manual_mode_interlocks_limit_an_arm_with_a_stuck_switch(side: Side) -> None:
    """While the upper switch is stuck on, no lift position is confirmed, and inward motion is blocked."""
    twin = in_manual(side)
    arm_of(twin, side).sensors["lift_up"].stuck = True
    twin.run_for(100)
    assert not twin.plc.read(tags_of(twin, side).up)
    assert not twin.plc.read(tags_of(twin, side).down)
    jog(twin, f"{side}.slide_inward", 1_000)
    assert arm_of(twin, side).slide.at_feed.read()
