"""Confirmed positions: valid only after the minimum travel time and while no other switch of the device is on."""

from __future__ import annotations

import pytest

from controller.program.set_points import SLIDE_LEAST_X10_MS
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.twin.commissioning import MisfitError, set_points_of
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import answer_truly, home_again
from tests.plant_sim.twin.routes import finish, run_to
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    MACHINE,
    TRAY_MS,
    arm_of,
    at_work,
    switched_on,
    tags_of,
    to_complete,
    undisturbed,
    until_step,
)
from tests.sampling import first_of

IN_DOUBT_MS = 200
NARROW = MACHINE.with_values({"layout.row_spacing_m": 0.350})


def alarm_ms(twin: Twin, alarm: str) -> int:
    """Run until this alarm and no other is raised; return the time since the filtered inputs changed, ms."""
    took_ms = twin.run_until(ALARM, within_ms=1_000, what=alarm)
    assert twin.alarms() == [alarm]
    return took_ms - 2 * SCAN_MS


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(
    ("step", "switch", "device"),
    [
        ("lift from row", "lift_up", "lift"),
        ("slide to feed", "slide_at_feed", "slide"),
        ("spread", "claws_spread", "belt"),
    ],
)
def test_a_switch_that_is_on_too_early_is_ignored_and_raises_an_alarm(
    side: Side, step: str, switch: str, device: str
) -> None:
    """If the end switch is stuck on as the motion begins, the step waits and the alarm is raised after 0.2 s."""
    twin = switched_on({"trays_target": 1})
    run_to(step)(twin, side)
    sensor = arm_of(twin, side).sensors[switch]
    sensor.stuck = True
    assert IN_DOUBT_MS - 100 <= alarm_ms(twin, f"{side}: {device} switches") <= IN_DOUBT_MS
    assert not {tag for tag in twin.outputs() if tag.startswith(f"{side}.")}
    twin.run_until_state(State.HELD, within_ms=20_000)
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_a_switch_that_flickers_on_confirms_no_position_and_raises_no_alarm(side: Side) -> None:
    """If the feed switch turns on for 100 ms halfway along the stroke, the slide continues to the feed position."""
    twin = switched_on({"trays_target": 1})
    run_to("slide to feed")(twin, side)
    twin.run_for(500)
    sensor = arm_of(twin, side).sensors["slide_at_feed"]
    sensor.stuck = True
    twin.run_for(100)
    assert not twin.plc.read(tags_of(twin, side).at_feed)
    sensor.stuck = None
    until_step(twin, f"{side} arm", "pause at feed", within_ms=3_000)
    assert arm_of(twin, side).slide.at_feed.read()
    finish_running(twin)


@pytest.mark.parametrize("power", first_of(["lost", "kept"]))
@pytest.mark.parametrize(
    ("step", "switch", "device"),
    [
        ("lift from row", "lift_up", "lift"),
        ("slide to feed", "slide_at_feed", "slide"),
        ("spread", "claws_spread", "belt"),
        ("converge", "claws_converged", "belt"),
    ],
)
def test_an_implausible_switch_is_checked_before_it_is_trusted(step: str, switch: str, device: str, power: str) -> None:
    """If X0 is pressed repeatedly while the switch is still stuck, the alarm is raised again; no seedling is lost."""
    twin = switched_on({"trays_target": 1})
    run_to(step)(twin, "left")
    sensor = arm_of(twin, "left").sensors[switch]
    sensor.stuck = True
    alarm_ms(twin, f"left: {device} switches")
    twin.run_until_state(State.HELD, within_ms=20_000)
    if power == "lost":
        twin.power_cycle()
        twin.scan()
    presses = 0
    while presses < 3 or twin.state is not State.HELD:
        presses += 1
        answer_truly(twin)
        twin.press("start")
        twin.run_for(100)
        twin.run_until_state(State.IDLE, State.HELD, within_ms=60_000)
    assert f"left: {device} switches" in twin.alarms()
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_an_alarm_with_a_switch_still_stuck_is_not_reset() -> None:
    """While the upper switch is stuck on, X0 does not reset the alarm; after repair, X0 resets it and starts homing."""
    twin = at_work({"trays_target": 1})
    until_step(twin, "left arm", "wait for cups", within_ms=TRAY_MS)
    sensor = arm_of(twin, "left").sensors["lift_up"]
    sensor.stuck = True
    assert IN_DOUBT_MS - 100 <= alarm_ms(twin, "left: lift switches") <= IN_DOUBT_MS
    twin.run_until_state(State.HELD, within_ms=20_000)
    twin.press("start")
    twin.run_for(2_000)
    assert [event.active for event in twin.alarm_events()] == [True]
    twin.run_until_state(State.HELD, within_ms=20_000)
    sensor.stuck = None
    home_again(twin)
    assert twin.alarms() == []
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_another_row_spacing_needs_another_minimum_travel_time() -> None:
    """At a row spacing of 350 mm, the default minimum travel time raises an alarm; the calculated one does not."""
    values = {"trays_target": 1, "slide_least": SLIDE_LEAST_X10_MS}
    with pytest.raises(MisfitError, match="a switch is believed after 900 ms, but can come on after 310 ms"):
        Twin(set_points=values, parameters=NARROW)
    twin = Twin(set_points=values, parameters=NARROW, trays=1, misfit=True)
    twin.home()
    twin.start()
    twin.run_until(ALARM, within_ms=TRAY_MS)
    assert {alarm.partition(": ")[2] for alarm in twin.alarms()} == {"slide switches"}
    assert set_points_of(NARROW)["slide_least"] == 28, "75 % of 55.5 mm between the switches at 0.15 m/s, x 10 ms"
    twin = at_work({"trays_target": 1}, parameters=NARROW)
    assert to_complete(twin) == undisturbed()
    assert [event.number for event in twin.alarm_events()] == [999, 900, 900], "the difference is confirmed with X25"


def finish_running(twin: Twin) -> None:
    """Run to Complete and check that no seedling was lost and no alarm was raised."""
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []
