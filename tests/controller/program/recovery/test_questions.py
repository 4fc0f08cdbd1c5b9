"""Questions that homing asks if memory and sensors do not determine the state, and the effect of each answer."""

from __future__ import annotations

import pytest

from controller.events.kinds import QuestionEvent
from controller.program.states import State
from controller.program.tags import FULL, IN_DOUBT, ROWS, SIDES, TAKEN, Side
from plant_sim.crop.seedling import Location
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import clear, home_again, operate_manually, press_emergency_stop, questions
from tests.plant_sim.twin.routes import BRISK, finish, power_off_and_operate, run_row_1, run_to
from tests.plant_sim.twin.twin_rig import (
    ChangeRecorder,
    arm_of,
    at_initial_state,
    is_parked_loaded,
    other_side,
    switched_on,
    tags_of,
    undisturbed,
    until_step,
)


def machine(trays: int = 1) -> Twin:
    """Return a machine in Stopped with a target of one tray."""
    return switched_on({"trays_target": 1}, trays=trays, parameters=BRISK)


def power_lost_clamping(side: Side, *valves: str) -> Twin:
    """Return a machine in Stopped after a power loss while the claws were closing on row 2.

    Args:
        side: Arm.
        valves: Valves of the arm that are operated manually, one after another, before the power returns.
    """
    twin = machine()
    run_to("close claws")(twin, side)
    twin.run_for(150)
    power_off_and_operate(twin, *(f"{side}.{valve}" for valve in valves), for_ms=3_000)
    twin.power_on()
    twin.run_for(50)
    return twin


def held(twin: Twin) -> set[str]:
    """Begin homing by command, wait for Held and return the open questions; X0 answers a question that is shown."""
    twin.run_for(50)
    twin.command("reset")
    twin.run_until_state(State.HELD, within_ms=20_000)
    return questions(twin)


def answer(twin: Twin, command: str) -> None:
    """Give an answer after the inputs have settled."""
    twin.run_for(200)
    twin.command(command)
    twin.run_for(200)


def rows(twin: Twin, side: Side) -> list[int]:
    """Return the stored states of rows 1 to 3 of an arm."""
    return [twin.plc.read(tags_of(twin, side).rows[row]) for row in ROWS]


def came_on(recorder: ChangeRecorder, side: Side) -> list[str]:
    """Return the outputs of an arm in the order in which they first turned on."""
    return list(dict.fromkeys(change.name for change in recorder.of(f"{side}.") if change.on))


# does the arm hold seedlings?


@pytest.mark.parametrize("side", SIDES)
def test_answer_yes_takes_the_row_in_doubt_up_and_out(side: Side) -> None:
    """The arm stays at rest until the answer 'yes' is given; homing then moves the row up and out, and work resumes."""
    twin = power_lost_clamping(side)
    recorder = ChangeRecorder.of_outputs(twin)
    assert held(twin) == {f"{side} loaded"}
    assert came_on(recorder, side) == []
    assert rows(twin, side) == [TAKEN, IN_DOUBT, FULL]
    answer(twin, f"{side}_loaded_yes")
    assert questions(twin) == set()
    assert came_on(recorder, side) == []
    assert home_again(twin) == {"tray"}
    assert came_on(recorder, side) == ["lift_retract", "slide_outward"]
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    assert is_parked_loaded(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_answer_no_puts_the_row_in_doubt_back_whether_it_is_held_or_not(side: Side) -> None:
    """If 'no' is answered although the row is held, the row is put back and taken again."""
    twin = power_lost_clamping(side)
    assert arm_of(twin, side).grip.held
    assert held(twin) == {f"{side} loaded"}
    answer(twin, f"{side}_loaded_no")
    recorder = ChangeRecorder.of_outputs(twin)
    assert home_again(twin) == {"tray"}
    assert came_on(recorder, side)[:2] == ["claws_open", "slide_outward"]
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    assert at_initial_state(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_the_question_stays_until_it_is_answered() -> None:
    """Until the question is answered, X0 leads to Held again, start is refused, and the arm does not move."""
    twin = power_lost_clamping("left")
    assert questions(twin) == {"left loaded"}
    assert held(twin) == {"left loaded"}
    recorder = ChangeRecorder.of_outputs(twin)
    twin.command("start")
    twin.run_for(1_000)
    assert twin.state is State.HELD
    assert not [*recorder.of("left."), *recorder.of("right.")]
    assert held(twin) == {"left loaded"}
    assert came_on(recorder, "left") == []
    answer(twin, "right_loaded_yes")
    assert questions(twin) == {"left loaded"}
    asked = [event for event in twin.events if isinstance(event, QuestionEvent) and event.question == "left_loaded"]
    assert [event.active for event in asked] == [True]


def test_an_answer_before_homing_is_accepted() -> None:
    twin = power_lost_clamping("right")
    answer(twin, "right_loaded_yes")
    assert home_again(twin) == {"tray"}
    assert is_parked_loaded(twin, "right")
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("command", ["loaded_yes", "loaded_no"])
def test_an_answer_without_a_question_has_no_effect(side: Side, command: str) -> None:
    """While no question is open, answers are ignored, both for an arm that holds a row and for an empty arm at home."""
    twin = machine()
    run_to("slide to feed")(twin, side)
    press_emergency_stop(twin)
    clear(twin)
    twin.run_for(500)  # places whose switches are off at rest are lost
    before = twin.plc.retained()
    answer(twin, f"{side}_{command}")
    assert twin.plc.retained() == before
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()
    twin.run_for(500)
    before = twin.plc.retained()
    answer(twin, f"{side}_{command}")
    assert twin.plc.retained() == before


# the arm was pushed away from its row before its claws had gripped


def pushed_away(side: Side, claws: str) -> Twin:
    """Return a machine in Stopped: emergency stop while the claws closed on row 2, then the arm moved manually.

    Args:
        side: Arm.
        claws: Valve of the claws that is operated first.
    """
    twin = machine()
    run_to("close claws")(twin, side)
    twin.run_for(50)
    press_emergency_stop(twin)
    clear(twin)
    for valve, for_ms in ((claws, 1_000), ("lift_retract", 2_000), ("slide_outward", 1_000)):
        operate_manually(twin, f"{side}.{valve}", for_ms=for_ms)
    twin.run_for(1_000)
    return twin


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("claws", ["claws_open", "claws_close"])
def test_an_arm_pushed_away_before_it_has_gripped_is_asked_about(side: Side, claws: str) -> None:
    """After the true answer, the machine is homed, and no seedling is lost. Without the question, it never is."""
    twin = pushed_away(side, claws)
    holds = bool(arm_of(twin, side).grip.held)
    assert holds == (claws == "claws_close")
    assert home_again(twin) == {f"{side} loaded", "tray"}
    assert is_parked_loaded(twin, side) if holds else at_initial_state(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


# the arm was moved to feed manually without power


@pytest.mark.parametrize("side", SIDES)
def test_answer_no_for_an_arm_opened_and_moved_to_feed_manually_leaves_its_row_full(side: Side) -> None:
    twin = power_lost_clamping(side, "claws_open", "slide_outward")
    assert held(twin) == {f"{side} loaded"}
    answer(twin, f"{side}_loaded_no")
    recorder = ChangeRecorder.of_outputs(twin)
    assert home_again(twin) == {"tray"}
    assert came_on(recorder, side)[:2] == ["claws_open", "slide_outward"]
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    assert at_initial_state(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_answer_yes_for_an_arm_lifted_and_moved_to_feed_manually_marks_its_row_as_taken(side: Side) -> None:
    twin = power_lost_clamping(side, "lift_retract", "slide_outward")
    assert held(twin) == {f"{side} loaded"}
    answer(twin, f"{side}_loaded_yes")
    assert home_again(twin) == {"tray"}
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    assert is_parked_loaded(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


# discard


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("step", ["slide to feed", "wait for cups"])
def test_a_discarded_row_is_released_over_the_cups(side: Side, step: str) -> None:
    """After a discard command, homing spreads the row, releases it over the cups and moves the arm home."""
    twin = machine()
    run_to(step)(twin, side)
    twin.run_for(300)
    press_emergency_stop(twin)
    clear(twin)
    load = list(arm_of(twin, side).grip.held)
    before = twin.plant.counts()
    recorder = ChangeRecorder.of_outputs(twin)
    twin.command(f"{side}_discard")
    assert home_again(twin) == {"tray"}
    after = twin.plant.counts()
    assert (after.in_cups + after.T) - (before.in_cups + before.T) == len(load)
    assert {seedling.location for seedling in load} <= {Location.IN_CUP, Location.LOST_THROW}
    opened_ms = next(change.at_ms for change in recorder.of(f"{side}.") if change.name == "claws_open")
    first = {change.name for change in recorder.of(f"{side}.", to_ms=opened_ms)}
    assert {"lift_retract", "lift_extend"} <= first
    assert at_initial_state(twin, side)
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    finish(twin)
    assert twin.plant.counts().in_tray == 0
    assert twin.plc.read(tags_of(twin, side).cycles) == 2  # rows 1 and 3
    assert twin.plc.read(tags_of(twin, other_side(side)).cycles) == 3


@pytest.mark.parametrize("side", SIDES)
def test_a_discard_command_applies_to_one_row(side: Side) -> None:
    """After a row has been discarded, the next row stays in the claws even after an emergency stop."""
    twin = machine()
    run_to("slide to feed")(twin, side)
    press_emergency_stop(twin)
    clear(twin)
    twin.command(f"{side}_discard")
    home_again(twin)
    twin.start()
    until_step(twin, f"{side} arm", "slide to feed")
    load = list(arm_of(twin, side).grip.held)
    press_emergency_stop(twin)
    clear(twin)
    home_again(twin)
    assert is_parked_loaded(twin, side)
    assert {seedling.location for seedling in load} <= {Location.IN_CLAW, Location.LOST_CARRY}


# which tray is in place?


def stopped_after_row_1(trays: int = 1) -> Twin:
    """Return a machine in Stopped with both arms at home and a partly emptied tray."""
    twin = machine(trays)
    run_row_1(twin, "left")
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=20_000)
    twin.run_for(300)
    return twin


def push_tray(twin: Twin, *, until_seen: bool) -> None:
    """Push the trays forward manually until the beam is interrupted or, if `until_seen` is False, clear."""
    while twin.plant.conveyor.beam.read() != until_seen:
        operate_manually(twin, "tray_run", "tray_forward", for_ms=50)


def lose_memory(twin: Twin) -> None:
    """Switch the power off and on with the retentive memory lost."""
    twin.store.values = None
    twin.power_cycle()
    twin.plc.write(twin.machine.tags.system.memory_lost, 1)
    twin.run_for(50)
    assert twin.alarms() == ["memory_lost"]


def test_answer_same_continues_with_a_tray_that_was_put_back() -> None:
    """If the tray leaves its sensor, the tray question is asked; 'same' is accepted only when the tray is back."""
    twin = stopped_after_row_1()
    operate_manually(twin, "tray_run", for_ms=200)
    assert held(twin) == {"tray"}
    for wrong in ("tray_same", "tray_full"):
        answer(twin, wrong)
        assert questions(twin) == {"tray"}
    operate_manually(twin, "tray_run", "tray_forward", for_ms=200)
    answer(twin, "tray_same")
    assert questions(twin) == set()
    assert home_again(twin) == set()
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_answer_full_starts_an_exchanged_tray_at_its_first_row() -> None:
    twin = stopped_after_row_1(trays=2)
    left_over = twin.plant.counts().in_tray - 72
    push_tray(twin, until_seen=False)
    assert held(twin) == {"tray"}
    push_tray(twin, until_seen=True)
    answer(twin, "tray_full")
    assert [rows(twin, side) for side in SIDES] == [[FULL] * 3] * 2
    assert home_again(twin) == set()
    assert twin.plant.conveyor.placed_tray == 1
    finish(twin)
    assert twin.plant.counts().in_tray == left_over
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 1


@pytest.mark.parametrize("is_seen", [True, False])
def test_answer_none_conveys_the_tray_out_and_brings_in_the_next(is_seen: bool) -> None:
    """If the tray is exchanged or removed, 'none' conveys out any tray present and brings in the next."""
    twin = stopped_after_row_1(trays=2)
    left_over = twin.plant.counts().in_tray - 72
    push_tray(twin, until_seen=False)
    if is_seen:
        assert held(twin) == {"tray"}
        operate_manually(twin, "tray_run", for_ms=200)
    assert held(twin) == {"tray"}
    recorder = ChangeRecorder.of_steps(twin)
    answer(twin, "tray_none")
    assert [rows(twin, side) for side in SIDES] == [[TAKEN] * 3] * 2
    assert home_again(twin) == set()
    ran_out = "move tray out" in {change.name for change in recorder.of("tray feeder: ")}
    assert ran_out == is_seen
    assert twin.plant.conveyor.placed_tray == 1
    assert [rows(twin, side) for side in SIDES] == [[FULL] * 3] * 2
    finish(twin)
    assert twin.plant.counts().in_tray == left_over
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 1


def test_memory_lost_with_a_full_tray_in_place() -> None:
    """After a memory loss both arms are assumed to hold a row; after the answer 'full' the tray is emptied."""
    twin = machine()
    twin.home()
    lose_memory(twin)
    assert all(twin.plc.read(tags_of(twin, side).loaded) for side in SIDES)
    assert held(twin) == {"tray"}
    answer(twin, "tray_full")
    assert home_again(twin) == set()
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_memory_lost_with_a_held_row_over_the_tray(side: Side) -> None:
    """If the memory is lost while a row is lifted, the arm moves fully up, then out, and finally releases the row."""
    twin = machine(trays=2)
    run_to("lift from row")(twin, side)
    twin.run_for(400)
    load = list(arm_of(twin, side).grip.held)
    lose_memory(twin)
    recorder = ChangeRecorder.of_outputs(twin)
    assert held(twin) == {"tray"}
    assert came_on(recorder, side) == ["lift_retract", "slide_outward"]
    answer(twin, "tray_full")
    assert home_again(twin) == set()
    finish(twin)
    assert {seedling.location for seedling in load} == {Location.IN_CUP}
