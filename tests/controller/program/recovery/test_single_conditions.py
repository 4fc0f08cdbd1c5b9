"""Stories in which one condition of one rung decides between a whole tray and a loss.

Without the condition that the docstring of a test names, the machine raises no alarm, or one that comes too late.
"""

from __future__ import annotations

import pytest

from controller.program.states import Mode, State
from controller.program.tags import IN_PLACE, SIDES, Side
from plant_sim.twin.lock_step import CLEAR_MS, Twin
from plant_sim.twin.recovery import begin_homing, clear, home_again, press_emergency_stop
from tests.controller.program.modes.hands import RENEWED_MS, in_manual, jog, jog_command
from tests.plant_sim.twin.routes import BRISK, finish, power_off_and_operate, run_row_1, run_to
from tests.plant_sim.twin.twin_rig import (
    ChangeRecorder,
    arm_of,
    at_work,
    moving_outputs,
    other_side,
    switched_on,
    undisturbed,
    until_picking,
    until_step,
)

COASTS_MS = 260
"""Time after the beginning of "lift from row" at which the lift is just below the end of its lower switch, ms: it is
stopped there, and coasts past the end."""


def machine() -> Twin:
    """Return a machine in Stopped with a target of one tray."""
    return switched_on({"trays_target": 1}, parameters=BRISK)


@pytest.mark.parametrize("side", SIDES)
def test_a_dead_lower_switch_at_power_up_takes_no_row(side: Side) -> None:
    """Rows at power-up, `~reached down`: the claws were freed by hand, and the lift is still down on its row."""
    twin = machine()
    run_to("close claws")(twin, side)
    twin.run_for(60)
    sensor = arm_of(twin, side).sensors["lift_down"]
    sensor.stuck = False
    power_off_and_operate(twin, f"{side}.claws_open", for_ms=500)
    twin.power_on()
    twin.run_for(1_000)
    sensor.stuck = None
    assert home_again(twin) == {f"{side} loaded", "tray"}
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_a_row_pulled_up_by_an_arm_that_coasts_and_sinks_back_is_not_put_back(side: Side) -> None:
    """Rows, `sank`: the plugs have left their cells, and putting them back would lose the row when it is picked again.

    The emergency stop is pressed while the lower switch is still on; the lift passes its end without a coil.
    """
    twin = machine()
    run_to("lift from row")(twin, side)
    twin.run_for(COASTS_MS)
    arm = arm_of(twin, side)
    switch = arm.sensors["lift_down"]
    assert switch.read()
    press_emergency_stop(twin, for_ms=3_000)
    assert not switch.read()
    arm.place(y_m=1.0)  # down to its end
    twin.run_for(1_000)
    assert switch.read(), "sunk back"
    clear(twin)
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_the_centre_is_left_at_a_confirmed_row_2_and_not_at_its_bare_switch() -> None:
    """Centre, `at pick 2`: the switch of row 2 welds as an arm leaves row 3, and the other arm waits for the centre."""
    twin = at_work({"trays_target": 1}, parameters=BRISK)
    other = other_side("right")
    until_picking(twin, "right", 3)
    until_step(twin, "right arm", "slide to feed")
    assert twin.in_step(f"{other} arm", "wait at feed")
    sensor = arm_of(twin, "right").sensors["slide_at_pick_2"]
    sensor.stuck = True
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert twin.alarms() == ["right: slide switches"]
    assert arm_of(twin, other).slide.x_m < 0.006, "moved in beside the arm in the centre"
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("stop", ["stop", "emergency stop"])
def test_an_order_to_empty_the_line_ends_with_a_stop(stop: str) -> None:
    """Emptying, reset at each end of a run: a later order to complete leaves the full rows at the pick position."""
    twin = switched_on(trays=2, parameters=BRISK)
    run_row_1(twin, "left")
    twin.command("empty_line")
    twin.scan()
    if stop == "stop":
        twin.press("stop")
        twin.run_until_state(State.STOPPED, within_ms=60_000)
    else:
        press_emergency_stop(twin)
        clear(twin)
    home_again(twin)
    twin.start()
    twin.run_for(2_000)
    twin.command("complete")
    twin.run_until_state(State.COMPLETE, within_ms=60_000)
    twin.run_for(5_000)
    assert twin.plc.read(twin.machine.tags.machine.rows_left) == 0
    assert twin.plc.read(twin.machine.tags.tray.phase) == IN_PLACE


def test_a_press_of_x24_that_began_in_the_emergency_stop_does_not_clear() -> None:
    """Clear press, `abort`: the press that ends after the release of X25 was no order to clear when it began."""
    twin = at_work({"trays_target": 1}, parameters=BRISK)
    until_step(twin, "left arm", "lift from row")
    press_emergency_stop(twin)
    twin.press("stop", for_ms=CLEAR_MS)
    twin.run_for(600)
    twin.plant.box.emergency_stop = False
    twin.run_for(2 * CLEAR_MS)
    assert twin.state is State.ABORTED
    clear(twin)
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def without_cups() -> Twin:
    """Return a machine in Suspended, with a row taken and another one waiting for cups."""
    twin = at_work({"trays_target": 1}, parameters=BRISK)
    until_picking(twin, "left", 2)
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_until_state(State.SUSPENDED, within_ms=60_000)
    twin.run_for(3_000)
    return twin


def test_a_tray_that_is_taken_in_suspended_raises_an_alarm() -> None:
    """Lost tray, `running`: a tray pushed off its sensor and back beside its mark is not worked on as if untouched."""
    twin = without_cups()
    conveyor = twin.plant.conveyor
    conveyor.push(-0.030)
    twin.run_for(1_000)
    conveyor.push(0.030)
    twin.plant.planting_frequency_per_min = 60.0
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert twin.alarms() == ["tray_lost"]
    assert home_again(twin) == {"tray"}


def test_nothing_moves_by_itself_after_an_order_for_manual_mode_in_suspended() -> None:
    """States of a mode change, Suspended: with cups, the rows would go on in manual mode, in which no alarm holds."""
    twin = without_cups()
    twin.command("mode_manual")
    twin.scan()
    mode = twin.plc.read(twin.machine.tags.machine.mode)
    twin.plant.planting_frequency_per_min = 60.0
    moves = ChangeRecorder.of_outputs(twin)
    twin.run_for(20_000)
    assert "claws_open" in {change.name for change in moves.of("left.")}
    assert mode == Mode.CONTINUOUS, "moved in manual mode without a jog"


@pytest.mark.parametrize("side", SIDES)
def test_a_lift_that_is_reversed_without_a_pause_is_no_longer_up(side: Side) -> None:
    """Places, `under way` of a row only: a jog turns the lift round at its end, and its upper switch welds later."""
    twin = in_manual(side)
    for output, for_ms in (("lift_retract", 2_500), ("lift_extend", 700)):
        for _ in range(for_ms // RENEWED_MS):
            twin.command(jog_command(f"{side}.{output}"))
            twin.run_for(RENEWED_MS)
    assert arm_of(twin, side).lift.rise_m < 0.12
    arm_of(twin, side).sensors["lift_up"].stuck = True
    moves = ChangeRecorder.of_outputs(twin)
    jog(twin, f"{side}.spread", 500)
    assert "spread" not in {change.name for change in moves.of(f"{side}.")}, "spread among the cups"


@pytest.mark.parametrize("side", SIDES)
def test_a_feed_switch_that_welds_at_rest_is_no_arrival_of_a_slide_that_was_stopped_on_its_way(side: Side) -> None:
    """Places, `under way` until the coils are off: the arm would release its row beside the cups."""
    twin = machine()
    run_to("slide to feed")(twin, side)
    twin.run_for(500)
    press_emergency_stop(twin, for_ms=2_500)
    arm = arm_of(twin, side)
    arm.sensors["slide_at_feed"].stuck = True
    clear(twin)
    twin.run_for(500)
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=40_000)
    assert arm.slide.x_m < 0.006, "believed at feed"


@pytest.mark.parametrize("side", SIDES)
def test_a_jog_order_ends_with_its_mode_and_not_only_with_its_lease(side: Side) -> None:
    """Jog, `~jogging`: homing begins before the lease has ended, and a lift that it does not order would rise."""
    twin = in_manual(side)
    for _ in range(3):
        twin.command(jog_command(f"{side}.lift_retract"))
        twin.run_for(RENEWED_MS)
    twin.command(jog_command(f"{side}.lift_retract"))
    twin.scan()
    for command in ("stop", "mode_continuous", "reset"):
        twin.command(command)
        twin.run_for(20)
    assert twin.state is State.RESETTING
    for _ in range(10):
        twin.scan()
        assert f"{side}.lift_retract" not in moving_outputs(twin)
