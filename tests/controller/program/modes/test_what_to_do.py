"""The line that says what to do now: its texts, and that it names no key that is refused.

That no key is refused is proved for every state (`requirements.presses`); here are the situations in which another line
would be wrong.
"""

from __future__ import annotations

import re

import pytest

from controller.events.kinds import NextPressEvent, RefusalEvent, StateEvent
from controller.program.operator.answers import Question
from controller.program.operator.next_press import NextPress, named_commands, what_to_do
from controller.program.states import Mode, State
from controller.program.texts.isolation import begins_with_isolation
from controller.program.texts.next_press import NEXT_PRESSES
from controller.program.texts.operator import MODES, NO_TEXT, Text
from plant_sim.twin.lock_step import Twin
from tests.controller.program.interlock_scene import MACHINE
from tests.controller.program.recovery.test_ways_out import power_lost_clamping, read, show_panel
from tests.plant_sim.twin.twin_rig import arm_of, switched_on
from tests.wiring import unwired

HANDS = re.compile(r"\b(?:fill|push|remove)\b|补盘|取走|推|排除", re.IGNORECASE)
"""Words of the line for what a hand does in the machine."""
ANSWERS = {"left_loaded_yes", "right_loaded_yes", "tray_same", "tray_full", "cups_empty"}
GIVEN = {"X0": {"reset", "start", "step"} | ANSWERS, "X24": {"stop", "clear", "tray_none"}}
"""Commands that the buttons can give."""


def line(twin: Twin) -> Text | None:
    """Return the line that says what to do now."""
    return what_to_do(twin.machine.tags, twin.machine.alarms, twin.plc.read)


def in_idle() -> Twin:
    """Return a homed machine."""
    twin = switched_on({})
    twin.home()
    twin.run_for(200)
    return twin


def refused(twin: Twin) -> int:
    """Return the number of refused presses."""
    return len([event for event in twin.events if isinstance(event, RefusalEvent)])


# texts


def test_a_line_that_sends_a_hand_into_the_machine_begins_with_the_isolation() -> None:
    sends = {press for press in NextPress if any(HANDS.search(text) for text in NEXT_PRESSES[press])}
    assert {NextPress.REPAIR_AND_HOME, NextPress.SEARCH_TRAY, NextPress.ANSWER_NO_TRAY} <= sends
    assert {press for press in NextPress if begins_with_isolation(NEXT_PRESSES[press])} == sends


def test_a_text_begins_with_the_isolation_in_both_languages() -> None:
    assert begins_with_isolation(Text("Isolate first. Free the jam", "先断电断气并上锁。排除卡滞"))
    assert begins_with_isolation(Text("Isolate first to free it", "先断电断气并上锁再排除"))
    assert not begins_with_isolation(Text("Isolate first. Free the jam", "排除卡滞"))
    assert not begins_with_isolation(Text("Free the jam. Isolate first.", "先断电断气并上锁。排除卡滞"))


UNPROVED = {
    NextPress.RELEASE_STOP: "a release",
    NextPress.RELEASE_EMERGENCY_STOP: "a release",
    NextPress.RELEASE_NOW: "a release",
    NextPress.REMOVE_FAULT: "accepted once the fault is gone, which CLEAR then shows",
    NextPress.CONFIRM_CONSTANTS: "X25 is never refused",
    NextPress.CLOSE_GUARD: "accepted once the guard is closed, which HOME then shows",
    NextPress.STAND_CLEAR: "X24 is never refused during the warning",
    NextPress.LEAVE_ZERO_RETURN: "names no key",
    NextPress.ANSWER_COMMAND: "names no key",
    NextPress.NONE: "names no key",
}


@pytest.mark.parametrize("press", NextPress)
def test_the_key_named_first_gives_a_command_that_is_proved_to_be_accepted(press: NextPress) -> None:
    commands = {bit.name.removeprefix("command.") for bit in named_commands(MACHINE.tags).get(press, ())}
    assert bool(commands) == (press not in UNPROVED)
    if commands:
        first = re.search(r"X\d+", NEXT_PRESSES[press].en)
        assert first is not None
        assert commands & GIVEN[first.group()]
        assert first.group() in NEXT_PRESSES[press].zh


@pytest.mark.parametrize("mode", Mode)
def test_the_mode_is_named_where_the_effect_of_the_press_depends_on_it(mode: Mode) -> None:
    twin = switched_on({})
    twin.command(f"mode_{mode.name.lower()}")
    twin.run_for(50)
    shown = line(twin)
    home = NEXT_PRESSES[NextPress.HOME]
    named = mode is not Mode.CONTINUOUS
    assert shown == (
        Text(f"{home.en} (mode: {MODES[mode].en})", f"{home.zh}（模式：{MODES[mode].zh}）") if named else home
    )


def test_the_line_names_the_alarm_that_stopped_work() -> None:
    twin = in_idle()
    twin.start()
    arm_of(twin, "left").sensors["lift_up"].stuck = True
    twin.run_until_state(State.HELD, within_ms=60_000)
    shown, first = line(twin), twin.plc.read(twin.machine.tags.machine.first_out)
    assert shown is not None
    assert first
    message = twin.machine.alarms.of(first).text.message
    assert shown.en == f"{NEXT_PRESSES[NextPress.REPAIR_AND_HOME].en}: {message.en}"
    assert shown.zh == f"{NEXT_PRESSES[NextPress.REPAIR_AND_HOME].zh}：{message.zh}"


def test_the_console_tells_every_line_once() -> None:
    """With the state or the refusal in whose scan it changes, or else in an event of its own."""
    twin = power_lost_clamping("left", unwired("lamp_amber"))
    show_panel(twin)
    twin.events.clear()
    twin.run_for(200)
    twin.press("start", for_ms=2_300)
    twin.run_for(2_600)
    told = [event for event in twin.events if isinstance(event, NextPressEvent)]
    assert [event.press for event in told] == [
        NextPress.ANSWER_LEFT_LOADED,
        NextPress.RELEASE_NOW,
        NextPress.HOME,
    ]
    assert told[0].text.en == NEXT_PRESSES[NextPress.ANSWER_LEFT_LOADED].en
    twin.press("start")
    twin.run_for(500)
    states = [event for event in twin.events if isinstance(event, StateEvent)]
    assert [(event.text.en, event.next_press) for event in states] == [("Resetting", NO_TEXT)]
    assert [event.press for event in twin.events if isinstance(event, NextPressEvent)][3:] == []


def test_the_console_tells_the_line_again_when_the_mode_changes_it() -> None:
    """Its number remains the same."""
    twin = switched_on({})
    twin.run_for(200)
    twin.events.clear()
    twin.command("mode_step")
    twin.run_for(100)
    told = [event for event in twin.events if isinstance(event, NextPressEvent)]
    assert [(event.press, event.text.en) for event in told] == [
        (NextPress.HOME, f"{NEXT_PRESSES[NextPress.HOME].en} (mode: {MODES[Mode.STEP].en})")
    ]


def test_the_console_is_silent_when_a_change_of_the_mode_leaves_the_line() -> None:
    twin = in_idle()
    twin.plant.box.stop = True
    twin.run_for(300)
    assert read(twin, "next_press") == NextPress.RELEASE_STOP
    twin.events.clear()
    twin.command("mode_step")
    twin.run_for(100)
    assert read(twin, "mode") == Mode.STEP
    assert [event for event in twin.events if isinstance(event, NextPressEvent)] == []


# no key that is refused


def test_idle_with_an_arm_that_is_not_ready_names_the_way_back() -> None:
    """X0 is refused there: the arm left home by hand, and its alarm comes only after its time limit."""
    twin = in_idle()
    assert read(twin, "next_press") == NextPress.START
    arm_of(twin, "left").place(y_m=0.1)
    twin.run_for(100)
    assert twin.state is State.IDLE
    assert read(twin, "next_press") == NextPress.STOP_AND_HOME
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=300)
    assert refused(twin) == 0


def test_held_by_the_operator_with_an_arm_that_is_not_ready_names_only_homing() -> None:
    twin = in_idle()
    twin.start()
    twin.run_for(500)
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=60_000)
    twin.run_for(200)
    assert read(twin, "next_press") == NextPress.RESUME
    arm_of(twin, "right").place(y_m=0.1)
    twin.run_for(100)
    assert twin.state is State.HELD
    assert read(twin, "next_press") == NextPress.HOME


def test_no_answer_is_asked_for_while_the_machine_still_stops() -> None:
    """X24 answers *no* in Held and stops as well: as long as anything may move, an answer is refused."""
    twin = power_lost_clamping("left")
    show_panel(twin)
    twin.command("reset")
    twin.run_until_state(State.HELD, within_ms=40_000)
    twin.run_for(200)
    assert read(twin, "next_press") == NextPress.ANSWER_LEFT_LOADED
    lines: dict[State, set[tuple[int, int]]] = {}
    twin.watch(lambda each: lines.setdefault(each.state, set()).add((read(each, "question"), read(each, "next_press"))))
    twin.press("stop", for_ms=500)
    twin.run_until_state(State.STOPPED, within_ms=5_000)
    assert lines[State.STOPPING] == {(Question.LEFT_LOADED, NextPress.NONE)}
    assert (Question.LEFT_LOADED, NextPress.ANSWER_LEFT_LOADED) in lines[State.STOPPED]


def test_a_clamped_stop_button_is_named_once_the_machine_has_stopped() -> None:
    twin = in_idle()
    twin.plant.box.stop = True
    twin.run_for(300)
    assert twin.state is State.STOPPED
    assert read(twin, "next_press") == NextPress.RELEASE_STOP
