"""What homing asks the operator because neither memory nor sensors can tell, and what each answer leads to."""

from __future__ import annotations

import pytest
from routes import BRISK, finish, power_off_and_by_hand, run_row_1, run_to
from twin_rig import (
    Recorder,
    arm_of,
    at_initial_state,
    is_parked_loaded,
    other_side,
    switched_on,
    tags_of,
    undisturbed,
    until_step,
)

from controller.hmi.production import QuestionEvent
from controller.program.states import State
from controller.program.tags import FULL, IN_DOUBT, ROWS, SIDES, TAKEN, Side
from plant_sim.bench.recovery import begin_homing, by_hand, clear, home_again, press_emergency_stop, questions
from plant_sim.bench.twin import Twin
from plant_sim.crop.seedling import Place


def machine(trays: int = 1) -> Twin:
    """Return a machine in Stopped that has one tray to empty."""
    return switched_on({"trays_target": 1}, trays=trays, parameters=BRISK)


def power_lost_clamping(side: Side, *valves: str) -> Twin:
    """Return a machine in Stopped after a loss of power while the claws closed on row 2.

    Args:
        side: Arm.
        valves: Valves of the arm worked by hand, one after another, before the power came back.
    """
    twin = machine()
    run_to("close claws")(twin, side)
    twin.run_for(150)
    power_off_and_by_hand(twin, *(f"{side}.{valve}" for valve in valves), for_ms=3_000)
    twin.power_on()
    twin.run_for(50)
    return twin


def held(twin: Twin) -> set[str]:
    """Home until Held and return what is asked there."""
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=20_000)
    return questions(twin)


def answer(twin: Twin, command: str) -> None:
    """Give an answer to what the machine has seen by now."""
    twin.run_for(200)
    twin.command(command)
    twin.run_for(200)


def rows(twin: Twin, side: Side) -> list[int]:
    """Return what memory says of the rows of an arm, 1 to 3."""
    return [twin.plc.read(tags_of(twin, side).rows[row]) for row in ROWS]


def came_on(recorder: Recorder, side: Side) -> list[str]:
    """Return the outputs of an arm in the order in which they first came on."""
    return list(dict.fromkeys(change.name for change in recorder.of(f"{side}.") if change.on))


# does the arm hold seedlings?


@pytest.mark.parametrize("side", SIDES)
def test_yes_a_row_in_doubt_goes_up_and_out_as_a_load(side: Side) -> None:
    """Given a row in doubt, the arm stands in Held until the answer; then it takes the row out, and goes on."""
    twin = power_lost_clamping(side)
    recorder = Recorder.of_outputs(twin)
    assert held(twin) == {f"{side} loaded"}
    assert came_on(recorder, side) == []
    assert rows(twin, side) == [TAKEN, IN_DOUBT, FULL]
    answer(twin, f"{side}_loaded_yes")
    assert questions(twin) == set()
    assert came_on(recorder, side) == []
    assert home_again(twin) == set()
    assert came_on(recorder, side) == ["lift_retract", "slide_outward"]
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    assert is_parked_loaded(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_no_a_row_in_doubt_is_put_back_whether_it_is_held_or_not(side: Side) -> None:
    """Given a row in doubt that is held in truth, a wrong 'no' costs nothing: it is put back and taken again."""
    twin = power_lost_clamping(side)
    assert arm_of(twin, side).grip.held
    assert held(twin) == {f"{side} loaded"}
    answer(twin, f"{side}_loaded_no")
    recorder = Recorder.of_outputs(twin)
    assert home_again(twin) == set()
    assert came_on(recorder, side)[:2] == ["claws_open", "slide_outward"]
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    assert at_initial_state(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_the_question_stays_until_it_is_answered() -> None:
    """Given no answer, X0 leads to Held again, and start does nothing; the other arm is home and stays there."""
    twin = power_lost_clamping("left")
    assert questions(twin) == {"left loaded"}
    assert held(twin) == {"left loaded"}
    recorder = Recorder.of_outputs(twin)
    twin.command("start")
    twin.run_for(1_000)
    assert twin.state is State.HELD
    assert not recorder.changes
    assert held(twin) == {"left loaded"}
    assert came_on(recorder, "left") == []
    answer(twin, "right_loaded_yes")
    assert questions(twin) == {"left loaded"}
    asked = [event for event in twin.events if isinstance(event, QuestionEvent) and event.question == "left_loaded"]
    assert [event.active for event in asked] == [True]


def test_an_answer_before_homing_is_as_good() -> None:
    twin = power_lost_clamping("right")
    answer(twin, "right_loaded_yes")
    assert home_again(twin) == set()
    assert is_parked_loaded(twin, "right")
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("command", ["loaded_yes", "loaded_no"])
def test_an_answer_without_a_question_changes_nothing(side: Side, command: str) -> None:
    """Given a load carried, and an empty arm at home, answers that nobody asked for are not listened to."""
    twin = machine()
    run_to("slide to feed")(twin, side)
    press_emergency_stop(twin)
    clear(twin)
    before = twin.plc.retained()
    answer(twin, f"{side}_{command}")
    assert twin.plc.retained() == before
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()
    before = twin.plc.retained()
    answer(twin, f"{side}_{command}")
    assert twin.plc.retained() == before


# the arm was brought to feed by hand while the power was off


@pytest.mark.parametrize("side", SIDES)
def test_no_an_arm_opened_and_brought_to_feed_by_hand_left_its_row_full(side: Side) -> None:
    twin = power_lost_clamping(side, "claws_open", "slide_outward")
    assert held(twin) == {f"{side} loaded"}
    answer(twin, f"{side}_loaded_no")
    recorder = Recorder.of_outputs(twin)
    assert home_again(twin) == set()
    assert came_on(recorder, side)[:2] == ["claws_open", "lift_retract"]
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    assert at_initial_state(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_yes_an_arm_lifted_and_brought_to_feed_by_hand_has_taken_its_row(side: Side) -> None:
    twin = power_lost_clamping(side, "lift_retract", "slide_outward")
    assert held(twin) == {f"{side} loaded"}
    answer(twin, f"{side}_loaded_yes")
    assert home_again(twin) == set()
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    assert is_parked_loaded(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


# discard


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("step", ["slide to feed", "wait for cups"])
def test_a_load_ordered_to_be_discarded_is_opened_over_the_cups(side: Side, step: str) -> None:
    """Given a load and the order, homing spreads and lowers it over the cups, opens, and ends at home, empty."""
    twin = machine()
    run_to(step)(twin, side)
    twin.run_for(300)
    press_emergency_stop(twin)
    clear(twin)
    load = list(arm_of(twin, side).grip.held)
    before = twin.plant.counts()
    recorder = Recorder.of_outputs(twin)
    twin.command(f"{side}_discard")
    assert home_again(twin) == set()
    after = twin.plant.counts()
    assert (after.in_cups + after.T) - (before.in_cups + before.T) == len(load)
    assert {seedling.place for seedling in load} <= {Place.IN_CUP, Place.LOST_THROW}
    opened_ms = next(change.at_ms for change in recorder.of(f"{side}.") if change.name == "claws_open")
    first = {change.name for change in recorder.of(f"{side}.", to_ms=opened_ms)}
    assert {"lift_retract", "lift_extend"} <= first
    assert at_initial_state(twin, side)
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    finish(twin)
    assert twin.plant.counts().in_tray == 0
    assert twin.plc.read(tags_of(twin, side).cycles) == 3  # the load assumed at first, rows 1 and 3
    assert twin.plc.read(tags_of(twin, other_side(side)).cycles) == 4


@pytest.mark.parametrize("side", SIDES)
def test_an_order_to_discard_is_for_one_load(side: Side) -> None:
    """Given a load discarded, the next one that is stopped on its way stays in the claws."""
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
    assert {seedling.place for seedling in load} <= {Place.IN_CLAW, Place.LOST_CARRY}


# which tray stands there?


def stopped_after_row_1(trays: int = 1) -> Twin:
    """Return a machine in Stopped with both arms at home and part of the tray taken."""
    twin = machine(trays)
    run_row_1(twin, "left")
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=20_000)
    twin.run_for(300)
    return twin


def push_tray(twin: Twin, *, until_seen: bool) -> None:
    """Push the trays forward by hand until the beam sees one, or sees none."""
    while twin.plant.conveyor.beam.read() != until_seen:
        by_hand(twin, "tray_run", "tray_forward", for_ms=50)


def lose_memory(twin: Twin) -> None:
    """Let the power go and come back without the retentive memory."""
    twin.store.values = None
    twin.power_cycle()
    twin.plc.write(twin.machine.tags.system.memory_lost, 1)
    twin.run_for(50)
    assert twin.alarms() == ["memory_lost"]


def test_same_a_tray_put_back_is_emptied_further() -> None:
    """Given the tray drawn from under its sensor, the machine asks; 'same' counts once it stands there again."""
    twin = stopped_after_row_1()
    by_hand(twin, "tray_run", for_ms=200)
    assert held(twin) == {"tray"}
    for wrong in ("tray_same", "tray_full"):
        answer(twin, wrong)
        assert questions(twin) == {"tray"}
    by_hand(twin, "tray_run", "tray_forward", for_ms=200)
    answer(twin, "tray_same")
    assert questions(twin) == set()
    assert home_again(twin) == set()
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_full_a_tray_exchanged_by_hand_is_taken_from_its_first_row() -> None:
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
def test_none_the_feeder_runs_out_what_is_there_and_brings_the_next(is_seen: bool) -> None:
    """Given memory lost, or a tray taken away by hand, 'none' has whatever is there run out before the next tray."""
    twin = stopped_after_row_1(trays=2)
    left_over = twin.plant.counts().in_tray - 72
    if is_seen:
        lose_memory(twin)
    else:
        push_tray(twin, until_seen=False)
    assert held(twin) == {"tray"}
    recorder = Recorder.of_steps(twin)
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
    """Given a full tray and no memory, claws count as loaded, the tray is asked for, and the whole of it is taken."""
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
def test_memory_lost_with_a_load_over_the_tray(side: Side) -> None:
    """Given a load lifted and no memory of it, it goes fully up, out, and in the end into the cups."""
    twin = machine(trays=2)
    run_to("lift from row")(twin, side)
    twin.run_for(400)
    load = list(arm_of(twin, side).grip.held)
    lose_memory(twin)
    recorder = Recorder.of_outputs(twin)
    assert held(twin) == {"tray"}
    assert came_on(recorder, side) == ["lift_retract", "slide_outward"]
    answer(twin, "tray_none")
    assert home_again(twin) == set()
    finish(twin)
    assert {seedling.place for seedling in load} == {Place.IN_CUP}
