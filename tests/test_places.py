"""Where an arm is believed to be: a switch on alone, and not sooner than the device can have come to it."""

from __future__ import annotations

import pytest
from routes import finish, run_to
from twin_rig import MACHINE, TRAY_MS, arm_of, at_work, switched_on, tags_of, to_complete, undisturbed, until_step

from controller.program.states import State
from controller.program.tags import SIDES, SLIDE_LEAST_X10_MS, Side
from plant_sim.bench.commissioning import set_points_of
from plant_sim.bench.recovery import home_again
from plant_sim.bench.twin import SCAN_MS, Twin

IN_DOUBT_MS = 200
NARROW = MACHINE.with_values({"layout.row_spacing_m": 0.350})


def told_ms(twin: Twin, alarm: str) -> int:
    """Run until an alarm comes, all alone; return the time since the inputs were filtered, ms."""
    took_ms = twin.run_until(lambda: twin.alarms() != [], within_ms=1_000, what=alarm)
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
def test_a_switch_that_is_on_too_early_is_not_believed_and_told(
    side: Side, step: str, switch: str, device: str
) -> None:
    """Given the switch that a motion waits for stuck on as it begins, the step waits, and its alarm comes in 0.2 s."""
    twin = switched_on({"trays_target": 1})
    run_to(step)(twin, side)
    sensor = arm_of(twin, side).sensors[switch]
    sensor.stuck = True
    assert IN_DOUBT_MS - 100 <= told_ms(twin, f"{side}: {device} switches") <= IN_DOUBT_MS
    assert not {tag for tag in twin.outputs() if tag.startswith(f"{side}.")}
    twin.run_until_state(State.HELD, within_ms=20_000)
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_a_switch_that_flickers_on_is_no_place_and_no_alarm(side: Side) -> None:
    """Given the switch at feed on for 100 ms half way, the slide goes on to feed."""
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


@pytest.mark.parametrize("power", ["kept", "lost"])
@pytest.mark.parametrize(
    ("step", "switch", "device"),
    [
        ("lift from row", "lift_up", "lift"),
        ("slide to feed", "slide_at_feed", "slide"),
        ("spread", "claws_spread", "belt"),
        ("converge", "claws_converged", "belt"),
    ],
)
def test_a_switch_that_has_lied_is_checked_before_it_is_believed(
    step: str, switch: str, device: str, power: str
) -> None:
    """Given a switch that stays stuck, X0 pressed again and again does no harm, and its alarm comes again."""
    twin = switched_on({"trays_target": 1})
    run_to(step)(twin, "left")
    sensor = arm_of(twin, "left").sensors[switch]
    sensor.stuck = True
    told_ms(twin, f"left: {device} switches")
    twin.run_until_state(State.HELD, within_ms=20_000)
    if power == "lost":
        twin.power_cycle()
        twin.scan()
    presses = 0
    while presses < 3 or twin.state is not State.HELD:
        presses += 1
        twin.press("start")
        twin.run_for(100)
        twin.run_until(lambda: twin.state in {State.IDLE, State.HELD}, within_ms=60_000, what="Idle or Held")
    assert f"left: {device} switches" in twin.alarms()
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_an_alarm_whose_switch_still_lies_is_not_reset() -> None:
    """Given the upper switch stuck on at feed, X0 keeps the alarm; mended, X0 resets it and homes."""
    twin = at_work({"trays_target": 1})
    until_step(twin, "left arm", "wait for cups", within_ms=TRAY_MS)
    sensor = arm_of(twin, "left").sensors["lift_up"]
    sensor.stuck = True
    assert IN_DOUBT_MS - 100 <= told_ms(twin, "left: lift switches") <= IN_DOUBT_MS
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


def test_another_row_spacing_needs_another_least_time() -> None:
    """At 350 mm the slide gets from row 1 to feed sooner than the first value allows: told, and set right, it works."""
    twin = at_work({"trays_target": 1, "slide_least": SLIDE_LEAST_X10_MS}, parameters=NARROW)
    twin.run_until(lambda: twin.alarms() != [], within_ms=TRAY_MS)
    assert {alarm.partition(": ")[2] for alarm in twin.alarms()} == {"slide switches"}
    assert set_points_of(NARROW) == {"slide_least": 28}, "75 % of 55.5 mm between the switches at 0.15 m/s, x 10 ms"
    twin = at_work({"trays_target": 1}, parameters=NARROW)
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []


def finish_running(twin: Twin) -> None:
    """Run to Complete and see that nothing was lost, and no alarm came."""
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []
