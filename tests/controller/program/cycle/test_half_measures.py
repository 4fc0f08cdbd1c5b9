"""Incomplete operations: feeder in step mode, release in step mode, half-open claws, and a tray moved manually."""

from __future__ import annotations

import pytest

from controller.events.kinds import RefusalEvent
from controller.program.states import Mode, State
from controller.program.tags import FULL, IN_PLACE, IN_PROGRESS, ROWS, SIDES, TAKEN
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import clear, press_emergency_stop
from tests.plant_sim.twin.twin_rig import arm_of, at_work, switched_on, tags_of, until_step


def jog(twin: Twin, output: str, for_ms: int) -> None:
    """Jog an output for a given time, then release the jog."""
    until_ms = twin.now_ms + for_ms
    while twin.now_ms < until_ms:
        twin.command(f"jog_{output}")
        twin.run_for(min(100, until_ms - twin.now_ms))
    twin.command("jog_release")
    twin.run_for(20)


def to_jogging(twin: Twin) -> Twin:
    """Change from Stopped to Execute in manual mode."""
    for command in ("mode_manual", "reset", "start"):
        twin.command(command)
        twin.run_for(50)
    assert twin.plc.read(twin.machine.tags.machine.jogging)
    return twin


def test_the_feeder_in_step_mode_rests_at_the_end_of_each_step() -> None:
    """In step mode, the motion of each feeder step ends without a further press, and the next tray stops in place."""
    twin = at_work({"step_sequence": 3}, trays=2, mode=Mode.STEP)
    for side in SIDES:
        for row in ROWS:
            twin.plc.write(tags_of(twin, side).rows[row], TAKEN)
    twin.run_for(100)
    for step in ("move tray out", "index", "creep", "settle", "wait for an empty tray"):
        twin.command("step")
        until_step(twin, "tray feeder", step, within_ms=2_000)
        twin.run_for(6_000)
        assert twin.in_step("tray feeder", step)
        assert not {"tray_run", "tray_forward"} & twin.outputs()
        assert twin.alarms() == []
    assert twin.plant.conveyor.placed_tray == 1
    assert [twin.plc.read(tags_of(twin, side).rows[1]) for side in SIDES] == [FULL, FULL]


def test_one_press_covers_cup_delay_and_opening() -> None:
    """In step mode the press that starts the release delay also opens the claws, so the row falls into its cups."""
    twin = at_work({"trays_target": 1})
    until_step(twin, "left arm", "wait for cups")
    twin.run_until(lambda: bool(arm_of(twin, "left").grip.held), within_ms=60_000, what="a row is held")
    until_step(twin, "left arm", "wait for cups")
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=20_000)
    twin.command("mode_step")
    twin.run_for(50)
    twin.command("unhold")
    twin.run_for(100)
    held, in_cups = len(arm_of(twin, "left").grip.held), twin.plant.counts().in_cups
    assert held
    while not twin.in_step("left arm", "release delay"):
        if twin.now_ms % 2_000 == 0:
            twin.command("step")
        twin.scan()
    twin.run_for(1_000)
    counts = twin.plant.counts()
    assert not arm_of(twin, "left").grip.held
    assert counts.in_cups - in_cups + counts.T == held
    assert counts.T <= 2  # random losses of the crop, not a release beside the cups


def opening() -> Twin:
    """Return a machine whose left arm begins to release its first row; the load assumed before is no row."""
    twin = at_work({"trays_target": 1})
    for step in ("lift from row", "open claws"):
        until_step(twin, "left arm", step, within_ms=60_000)
    return twin


def opening_ms() -> int:
    """Return the time at which the left row of an undisturbed machine counts as released."""
    twin = opening()
    twin.run_until(~tags_of(twin, "left").loaded, within_ms=1_000)
    return twin.now_ms


@pytest.mark.parametrize("ahead_ms", [0, 10, 20])
def test_a_row_counts_as_released_if_a_switch_sticks_as_its_claws_have_opened(ahead_ms: int) -> None:
    """A second switch of the slide that turns on in the scan in which the opening dwell ends does not prevent it."""
    sticks_ms = opening_ms() - ahead_ms
    twin = opening()
    cycles = twin.plc.read(tags_of(twin, "left").cycles)
    twin.run_until(lambda: twin.now_ms >= sticks_ms, within_ms=1_000)
    arm_of(twin, "left").sensors["slide_at_pick_2"].stuck = True
    twin.run_for(100)
    assert not twin.plc.read(tags_of(twin, "left").loaded)
    assert twin.plc.read(tags_of(twin, "left").cycles) == cycles + 1


def test_claws_that_have_begun_to_open_block_the_lift() -> None:
    """If the claws that clamp a row are briefly jogged open, lifting is blocked and the row remains in progress."""
    twin = switched_on({"trays_target": 1})
    twin.home()
    twin.start()
    until_step(twin, "left arm", "close claws", within_ms=60_000)
    twin.run_for(100)
    press_emergency_stop(twin)
    clear(twin)
    to_jogging(twin)
    arm = tags_of(twin, "left")
    jog(twin, "left_claws_close", 500)
    assert twin.plc.read(arm.clamped)
    jog(twin, "left_claws_open", 30)
    twin.run_for(300)
    twin.command("jog_left_lift_retract")
    twin.run_for(100)
    assert "left.lift_retract" not in twin.outputs()
    rule = next(rule for rule in twin.machine.rules["left"] if rule.name == "lift clear")
    assert twin.plc.read(arm.blocked_by) == rule.number
    assert IN_PROGRESS in [twin.plc.read(row) for row in arm.rows.values()]


def test_a_tray_moved_manually_raises_the_question_before_an_arm_goes_in() -> None:
    """After a tray has been jogged out of place, the tray question is asked and unhold is refused."""
    twin = switched_on({"trays_target": 1}, trays=2)
    twin.home()
    twin.command("stop")
    twin.run_for(100)
    to_jogging(twin)
    jog(twin, "tray_run", 300)
    assert twin.plc.read(twin.machine.tags.tray.phase) == IN_PLACE
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=100)
    for command in ("mode_continuous", "unhold"):
        twin.command(command)
        twin.run_for(50)
    refused = [event for event in twin.events if isinstance(event, RefusalEvent)]
    assert [event.text.en for event in refused] == ["cannot resume: a question is unanswered"]
    assert twin.state is State.HELD
    assert twin.plc.read(twin.machine.tags.tray.ask)


def test_the_answer_full_does_not_change_the_row_in_progress() -> None:
    """After an emergency stop while clamping, the answer "full" does not mark the clamped row as full."""
    twin = switched_on({"trays_target": 1})
    twin.home()
    twin.start()
    until_step(twin, "left arm", "close claws", within_ms=60_000)
    twin.run_for(100)
    press_emergency_stop(twin)
    clear(twin)
    twin.plc.press(twin.machine.tags.tray.ask)
    twin.command("tray_full")
    twin.scan()
    assert not twin.plc.read(twin.machine.tags.tray.ask)
    assert IN_PROGRESS in [twin.plc.read(row) for row in tags_of(twin, "left").rows.values()]
