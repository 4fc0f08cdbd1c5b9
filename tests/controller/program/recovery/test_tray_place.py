"""Place of the tray: it ends with Aborted, manual mode and power-up, and is then measured again or asked about."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from controller.common.modbus.io_map import IoMap
from controller.events.kinds import RefusalEvent
from controller.program.operator.refusals import Refusal
from controller.program.states import Mode, State
from controller.program.tags import COMING, IN_PLACE, SIDES
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import (
    MARK_M,
    answer_truly,
    begin_homing,
    clear,
    home_again,
    press_emergency_stop,
    questions,
)
from tests.controller.program.modes.hands import change_mode, to_continuous, to_manual
from tests.plant_sim.twin.routes import BRISK, finish, run_row_1, run_to
from tests.plant_sim.twin.twin_rig import (
    ChangeRecorder,
    at_work,
    moved_from_now_on,
    switched_on,
    tags_of,
    undisturbed,
    until_step,
)
from tests.sampling import one_in
from tests.wiring import unwired

STOP_MS = 20_000
ANSWER_MS = 2_200


def one_row_taken(io_map: IoMap | None = None) -> Twin:
    """Return a machine at work on one tray whose first row has been released, with a second tray in the magazine."""
    twin = switched_on({"trays_target": 1}, trays=2, parameters=BRISK, io_map=io_map)
    run_row_1(twin, "left")
    return twin


def stopped(twin: Twin) -> None:
    """Press X24 and wait for Stopped."""
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=STOP_MS)
    twin.run_for(300)


def aborted(twin: Twin) -> None:
    press_emergency_stop(twin)
    clear(twin)


def powered_down(twin: Twin) -> None:
    stopped(twin)
    twin.power_cycle()
    twin.run_for(300)


def moved_manually(twin: Twin) -> None:
    stopped(twin)
    to_manual(twin)
    stopped(twin)
    change_mode(twin, Mode.CONTINUOUS)


def last_refusal(twin: Twin) -> tuple[str, Refusal]:
    """Return the command that was refused last, and the reason."""
    event = [each for each in twin.events if isinstance(each, RefusalEvent)][-1]
    return event.command, Refusal(event.reason)


def asked_in_homing(twin: Twin) -> set[str]:
    """Home until the machine is Idle or Held and return the open questions."""
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=40_000)
    return questions(twin)


@pytest.mark.parametrize("end", [aborted, powered_down, moved_manually])
def test_what_could_have_moved_the_tray_is_followed_by_the_question(end: Callable[[Twin], None]) -> None:
    """The arms are at home when the tray is asked about; nothing moves after the answer until X0 is pressed."""
    twin = one_row_taken()
    end(twin)
    assert asked_in_homing(twin) == {"tray"}
    assert all(twin.plc.read(tags_of(twin, side).at_feed) for side in SIDES)
    twin.command("tray_same")
    twin.run_for(100)
    assert questions(twin) == set()
    moved = moved_from_now_on(twin)
    twin.run_for(5_000)
    assert (twin.state, moved) == (State.HELD, set())
    assert home_again(twin) == set()
    finish(twin)
    assert twin.plant.counts().in_tray == 72
    assert twin.plant.counts().P == undisturbed().P


def test_a_stop_at_the_end_of_the_cycle_asks_nothing() -> None:
    twin = one_row_taken()
    stopped(twin)
    assert asked_in_homing(twin) == set()


def test_a_tray_that_leaves_empty_is_not_asked_about() -> None:
    """The last row has left the tray when the emergency stop is pressed: no row is left to be lost."""
    twin = at_work({"trays_target": 2}, trays=2, parameters=BRISK)
    until_step(twin, "tray feeder", "move tray out", within_ms=90_000)
    twin.run_for(100)
    aborted(twin)
    assert twin.plc.read(twin.machine.tags.tray.phase) != IN_PLACE
    assert asked_in_homing(twin) == set()


def test_the_tray_is_asked_about_when_both_arms_are_at_home() -> None:
    """With an arm over it, the tray cannot be compared with its mark, and putting a row back may still move it."""
    twin = switched_on({"trays_target": 1}, parameters=BRISK)
    run_to("close claws")(twin, "left")
    twin.run_for(150)
    aborted(twin)
    at_feed = [tags_of(twin, side).at_feed for side in SIDES]
    home: list[bool] = []

    def note(each: Twin) -> None:
        if each.plc.read(each.machine.tags.tray.ask):
            home.append(all(each.plc.read(bit) for bit in at_feed))

    twin.watch(note)
    assert asked_in_homing(twin) == {"tray"}
    assert set(home) == {True}


@pytest.mark.parametrize("way_mm", one_in(2, [4, 6, 12, 20, -8]))
def test_a_tray_pushed_in_an_emergency_stop_loses_no_seedling(way_mm: int) -> None:
    """The operator compares the tray with its mark; a tray that was moved is fed again, and its rows are taken."""
    twin = one_row_taken()
    press_emergency_stop(twin)
    twin.plant.conveyor.push(way_mm / 1000)
    clear(twin)
    before = twin.plant.counts()
    assert home_again(twin) == {"tray"}
    assert abs(twin.plant.conveyor.offset_m(0)) <= MARK_M
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
    after = twin.plant.counts()
    assert after.in_tray == 72
    assert (after.P - before.P, after.D - before.D) == (undisturbed().P, undisturbed().D)
    assert after.T - before.T <= undisturbed().T


def test_the_question_is_answered_with_the_buttons_alone() -> None:
    """After an emergency stop: X24 clears, X0 homes, X0 for 2 s answers, X0 homes, X0 starts; no panel is needed."""
    twin = one_row_taken()
    aborted(twin)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    lamp, levels = twin.io_map["lamp_amber"].number, [False]
    twin.watch(lambda each: levels.append(each.plc.memory.Y[lamp]))
    twin.run_for(7_000)
    flashes = sum(now and not before for before, now in itertools.pairwise(levels))
    assert flashes in {3, 4}  # one cycle of 7 s may contain the begin of the next
    twin.press("start")
    twin.run_for(500)
    assert twin.state is State.HELD
    assert last_refusal(twin) == ("reset", Refusal.RELEASED_EARLY)
    twin.press("start", for_ms=ANSWER_MS)
    twin.run_for(ANSWER_MS + 200)
    assert questions(twin) == set()
    assert asked_in_homing(twin) == set()
    twin.start()


def test_without_lamp_and_panel_x0_homes_to_the_same_question() -> None:
    """Nothing shows the question, so that X0 does not answer; the command does."""
    twin = one_row_taken(io_map=unwired("lamp_amber"))
    aborted(twin)
    for _ in range(2):
        assert asked_in_homing(twin) == {"tray"}
    twin.command("tray_same")
    twin.run_for(100)
    assert asked_in_homing(twin) == set()


def test_a_tray_that_may_have_been_moved_in_manual_mode_is_not_worked_on_without_homing() -> None:
    """From Held, manual mode and back: resuming is refused, and homing asks."""
    twin = one_row_taken()
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=STOP_MS)
    twin.run_for(200)
    change_mode(twin, Mode.MANUAL)
    twin.plant.conveyor.push(0.012)
    change_mode(twin, Mode.CONTINUOUS)
    twin.command("unhold")
    twin.run_for(200)
    assert twin.state is State.HELD
    assert last_refusal(twin) == ("unhold", Refusal.TRAY_UNKNOWN)
    assert home_again(twin) == {"tray"}
    assert abs(twin.plant.conveyor.offset_m(0)) <= MARK_M


def test_manual_mode_itself_moves_in_over_a_tray_whose_place_is_unknown() -> None:
    """The operator watches what he jogs; the interlocks of the arms still apply."""
    twin = one_row_taken()
    stopped(twin)
    to_manual(twin)
    twin.command("jog_left_slide_inward")
    twin.run_for(50)
    assert "left.slide_inward" in twin.outputs()
    to_continuous(twin)


def test_a_tray_pushed_to_the_sensor_before_the_belt_moves_is_not_accepted() -> None:
    """The belt has not measured its front edge: the alarm of a tray in the wrong place, and the question, follow."""
    twin = at_work({"trays_target": 2}, trays=2, parameters=BRISK)
    until_step(twin, "tray feeder", "creep", within_ms=90_000)
    twin.run_for(200)
    aborted(twin)
    tags = twin.machine.tags.tray
    assert twin.plc.read(tags.phase) == COMING
    begin_homing(twin)
    twin.run_for(500)
    assert not twin.plant.conveyor.beam.read()
    missing_m = -twin.plant.conveyor.front_m[1]
    twin.plant.conveyor.push(missing_m + 0.030)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=40_000)
    assert (twin.state, twin.alarms()) == (State.HELD, ["tray_jam"])
    assert twin.plc.read(tags.phase) != IN_PLACE
    assert home_again(twin) == {"tray"}
    finish(twin)
    assert twin.plant.counts() == undisturbed(trays=2)


def test_the_question_follows_the_question_about_an_arm() -> None:
    """A power loss while the claws close: the arm is asked about at once, the tray when the arms are at home."""
    twin = switched_on({"trays_target": 1}, parameters=BRISK)
    twin.home()
    twin.start()
    until_step(twin, "left arm", "close claws")
    twin.run_for(150)
    twin.power_cycle()
    twin.run_for(100)
    recorder = ChangeRecorder.of_steps(twin)
    assert questions(twin) == {"left loaded"}
    answer_truly(twin)
    assert asked_in_homing(twin) == {"tray"}
    assert [change.name for change in recorder.of("tray feeder: ") if change.on][1:] == []
    assert home_again(twin) == {"tray"}
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_a_tray_whose_sensor_fails_in_aborted_is_asked_about() -> None:
    """Without the front edge the answers are *full* and *same* only after the sensor sees the tray again."""
    twin = one_row_taken()
    press_emergency_stop(twin)
    twin.plant.conveyor.beam.stuck = False
    clear(twin)
    assert asked_in_homing(twin) == {"tray"}
    twin.command("tray_same")
    twin.run_for(100)
    assert questions(twin) == {"tray"}
    twin.plant.conveyor.beam.stuck = None
    twin.run_for(100)
    assert home_again(twin) == {"tray"}
    finish(twin)
