"""Switches, counts and phases that were true once: what a person, time or a fault changes since is not relied upon.

Each test is a story in which one changed condition of the program, harmless to every requirement, loses seedlings.
"""

from __future__ import annotations

import pytest

from controller.program.alarms.limits import TRAY_OUT_LIMIT_MS
from controller.program.states import State
from controller.program.tags import NO_TRAY, SIDES, Side
from plant_sim.faults import Fault
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, clear, home_again, operate_manually, press_emergency_stop
from tests.controller.program.recovery.test_disturbances import pull_the_cable
from tests.plant_sim.twin.routes import BRISK, finish, run_to
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    MACHINE,
    ChangeRecorder,
    arm_of,
    at_work,
    is_parked_loaded,
    switched_on,
    tags_of,
    undisturbed,
    until_step,
)
from tests.sampling import one_in

SLOW = MACHINE.with_values({"cups.planting_frequency_per_min": 20.0})
"""Machine whose arms reach the cups before twelve of them have passed."""


def machine() -> Twin:
    """Return a machine in Stopped with a target of one tray."""
    return switched_on({"trays_target": 1}, parameters=BRISK)


@pytest.mark.parametrize("side", SIDES)
def test_a_clamped_row_is_not_lowered_while_both_lift_switches_are_on(side: Side) -> None:
    """The lower switch welds, and the lift is raised by hand: lowering would press the row beside its cells."""
    twin = machine()
    run_to("lift from row")(twin, side)
    press_emergency_stop(twin)
    clear(twin)
    sensor = arm_of(twin, side).sensors["lift_down"]
    sensor.stuck = True
    operate_manually(twin, f"{side}.lift_retract", for_ms=2_000)
    held = len(arm_of(twin, side).grip.held)
    assert held == 12
    recorder = ChangeRecorder.of_outputs(twin)
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=40_000)
    assert f"{side}: lift switches" in twin.alarms()
    assert "lift_extend" not in {change.name for change in recorder.of(f"{side}.")}
    assert len(arm_of(twin, side).grip.held) == held
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("after_ms", one_in(2, [50, 100, 150, 200]))
def test_an_upper_switch_that_comes_on_too_early_does_not_start_the_slide(side: Side, after_ms: int) -> None:
    """It welds soon after the lower one went off, and the lift jams low: the slide would tear the row out sideways."""
    twin = machine()
    run_to("lift from row")(twin, side)
    arm, tags = arm_of(twin, side), tags_of(twin, side)
    twin.run_until(~tags.sensed_down, within_ms=2_000, what="the lower switch is off")
    twin.run_for(after_ms)
    arm.sensors["lift_up"].stuck = True
    arm.lift.jammed = True
    recorder = ChangeRecorder.of_outputs(twin)
    alarm_ms = twin.run_until(ALARM, within_ms=1_000, what="an alarm")
    assert alarm_ms <= 300
    assert twin.alarms() == [f"{side}: lift switches"]
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert "slide_outward" not in {change.name for change in recorder.of(f"{side}.")}
    arm.sensors["lift_up"].stuck = None
    arm.lift.jammed = False
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_the_slide_waits_for_the_lift_and_not_for_its_bare_upper_switch(side: Side) -> None:
    """The upper switch is on as the lift starts: the alarm names the lift at once, and nothing goes sideways."""
    twin = machine()
    run_to("lift from row")(twin, side)
    sensor = arm_of(twin, side).sensors["lift_up"]
    sensor.stuck = True
    steps = ChangeRecorder.of_steps(twin)
    assert twin.run_until(ALARM, within_ms=5_000, what="an alarm") <= 1_000
    assert twin.alarms() == [f"{side}: lift switches"]
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert "slide to feed" not in {change.name for change in steps.of(f"{side} arm: ")}
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("state", ["Stopped", "Held", "Aborted"])
def test_a_place_that_was_lost_at_rest_is_measured_again(side: Side, state: str) -> None:
    """A loaded arm is pushed in by hand, then the switch at feed welds: it would release its row beside the cups."""
    twin = Twin(trays=1, set_points={"trays_target": 1}, parameters=BRISK)  # a push by hand violates the monitors
    twin.plant.seedlings.make_typical()
    twin.scan()
    run_to("wait for cups")(twin, side)
    arm = arm_of(twin, side)
    if state == "Held":
        twin.command("hold")
        twin.run_until_state(State.HELD, within_ms=20_000)
    else:
        press_emergency_stop(twin)
    if state == "Stopped":
        clear(twin)
    arm.place(x_m=0.2, y_m=0.0)  # lifted by hand too: lowered, its plugs would hit the tray
    twin.run_for(1_000)
    arm.sensors["slide_at_feed"].stuck = True
    twin.run_for(500)
    if state == "Aborted":
        clear(twin)
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=40_000)
    assert arm.slide.x_m < 0.006, "believed at feed"
    arm.sensors["slide_at_feed"].stuck = None
    if twin.state is State.HELD:
        home_again(twin)
    assert is_parked_loaded(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_a_place_survives_a_lost_link_and_a_flicker_in_motion() -> None:
    """Assumed inputs are no positions, so that an intact machine is not driven against its end stops after a loss."""
    twin = machine()
    run_to("wait for cups")(twin, "left")
    reached = tags_of(twin, "left").reached["feed"]
    sensor = arm_of(twin, "left").sensors["slide_at_feed"]
    sensor.stuck = False
    twin.run_for(50)
    sensor.stuck = None
    twin.run_for(50)
    assert twin.state is State.EXECUTE
    assert twin.plc.read(reached)
    pull_the_cable(twin, 2_000)
    assert twin.state.name == "ABORTED"
    assert twin.plc.read(reached)


def test_cups_stated_as_empty_before_a_cup_alarm_are_not_empty_after_it() -> None:
    """The count that the statement replaced has been wrong since: the cups under the claws may be full."""
    twin = at_work({"trays_target": 1}, parameters=SLOW)
    until_step(twin, "left arm", "wait for cups", within_ms=60_000)
    assert not twin.plc.read(tags_of(twin, "left").count_valid)
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_for(2_000)
    twin.command("cups_empty")
    twin.run_for(20)
    confirmed = [tags_of(twin, side).cups_confirmed for side in SIDES]
    assert all(twin.plc.read(bit) for bit in confirmed)
    twin.plant.faults.add(Fault("doubled_pulses", "left.cup_pulse", size=0.75))
    twin.plant.planting_frequency_per_min = 60.0
    released = [tags_of(twin, side).cycles for side in SIDES]
    twin.run_until(ALARM, within_ms=20_000, what="an alarm")
    twin.run_for(20)
    assert [twin.plc.read(word) for word in released] == [0, 0]
    assert not any(twin.plc.read(bit) for bit in confirmed)


def test_a_tray_that_is_overdue_is_unknown() -> None:
    """Its front edge stays under the sensor although the belt has run long enough, in three parts: homing asks."""
    twin = at_work({"trays_target": 2}, trays=2, parameters=BRISK)
    tray = twin.machine.tags.tray
    until_step(twin, "tray feeder", "move tray out", within_ms=90_000)
    twin.plant.conveyor.beam.stuck = True
    for _ in range(2):
        twin.run_for(1_300)
        press_emergency_stop(twin)
        clear(twin)
        begin_homing(twin)
        until_step(twin, "tray feeder", "move tray out")
    assert twin.run_until(ALARM, within_ms=TRAY_OUT_LIMIT_MS, what="an alarm") < TRAY_OUT_LIMIT_MS // 2
    assert twin.alarms() == ["tray_jam"]
    twin.run_for(50)
    assert twin.plc.read(tray.phase) == NO_TRAY
    twin.plant.conveyor.beam.stuck = None
    assert home_again(twin) == {"tray"}
    finish(twin)
    assert twin.plant.counts() == undisturbed(trays=2)
