"""Texts of the alarms: message and what to check, in English and Chinese, for the actuator that is meant."""

from __future__ import annotations

import re
import string

import pytest

from controller.core.sequence import Step
from controller.hmi.alarm_list import AlarmState
from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.alarm_texts import ALARM_REFUSALS, ALARM_STATES, ALARMS, AlarmText
from controller.program.alarms import Alarm
from controller.program.machine import build
from controller.program.tags import SIDES
from controller.program.texts import SIDES as SIDE_TEXTS
from controller.program.texts import Text

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
TAGS = {point.tag.rpartition(".")[2] for point in (*MACHINE.io_map.inputs, *MACHINE.io_map.outputs)} | {
    "air_pressure_ok",
    "magazine_empty",
}
SET_POINTS = set(MACHINE.tags.sp.names())
MOVES = [
    (MACHINE.alarms.of(step.watch.alarm.number), step)
    for sequence in MACHINE.program.sequences()
    for _, step in sequence
    if step.watch
]
MOTIONS = {
    "lift_extend": ("lift_down", "not down", "未降到下限位"),
    "lift_retract": ("lift_up", "not up", "未升到上限位"),
    "slide_inward": ("slide_at_pick_", "slide did not reach the row", "滑块未到达取苗位"),
    "slide_outward": ("slide_at_", "slide did not re", "滑块"),
    "spread": ("claws_spread", "not spread", "未分散"),
    "converge": ("claws_converged", "not converged", "未聚合"),
    "tray_run": ("tray_front_edge", "Tray did not leave", "苗盘未离开"),
    "claws_open": ("slide_at_", "not opened", "未张开"),
    "claws_close": ("slide_at_pick_", "not closed", "未闭合"),
}
"""By output: the switch that tells the end of its motion, and what the message says of it. Claws have no switch; they
move only while the slide is on its own."""


def filled(alarm: Alarm) -> AlarmText:
    """The text as the operator of this alarm reads it."""
    return ALARMS[alarm.key].of(SIDE_TEXTS[alarm.side] if alarm.side else None)


def words(text: str) -> set[str]:
    """Words with an underscore: tags."""
    return set(re.findall(r"[a-z]+(?:_[a-z0-9]+)+", text))


def fields(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}


def is_bilingual(text: Text) -> bool:
    chinese = any("一" <= character <= "鿿" for character in text.zh)
    return bool(text.en.strip()) and text.en.isascii() and chinese and fields(text.en) == fields(text.zh)


@pytest.mark.parametrize("key", list(ALARMS))
def test_every_alarm_says_what_is_wrong_and_what_to_check_in_both_languages(key: str) -> None:
    text = ALARMS[key]
    assert is_bilingual(text.message)
    assert is_bilingual(text.check)
    assert text.check.en != text.message.en
    assert words(text.check.en) == words(text.check.zh), "the same wires in both languages"
    assert words(text.check.en) <= TAGS | SET_POINTS, "wires of the I/O map, set-points of the program"
    assert (text.en, text.zh) == text.message


def test_messages_are_told_apart() -> None:
    assert len({text.en for text in ALARMS.values()}) == len({text.zh for text in ALARMS.values()}) == len(ALARMS)


@pytest.mark.parametrize("alarm", list(MACHINE.alarms), ids=lambda alarm: str(alarm.bit))
def test_no_blank_is_left_and_the_side_is_named(alarm: Alarm) -> None:
    text = filled(alarm)
    assert not set("{}") & set(text.message.en + text.message.zh + text.check.en + text.check.zh)
    for side in SIDES:
        assert (side in text.en) == (side == alarm.side)
        assert (SIDE_TEXTS[side].zh in text.zh) == (side == alarm.side)


@pytest.mark.parametrize(("alarm", "step"), MOVES, ids=[str(alarm.bit) for alarm, _ in MOVES])
def test_a_motion_that_does_not_end_is_named_with_its_output_and_its_switch(alarm: Alarm, step: Step) -> None:
    """Given a step with a limit, then its alarm names the motion, the output that drives it, the switch at its end."""
    text = filled(alarm)
    output, *held = (hold.name.rpartition("want ")[2].replace("run", "tray_run") for hold in step.hold)
    assert held in ([], ["lift_retract"]), "only the lift is pressed to its end while something else moves"
    switch, english, chinese = MOTIONS[output]
    assert english in text.message.en
    assert chinese in text.message.zh
    for check in text.check:
        assert re.search(rf"\b{output}\b", check, re.ASCII)
        assert switch in check


def test_states_and_refusals_are_told_in_both_languages() -> None:
    assert [state.text for state in AlarmState] == list(ALARM_STATES.values())
    for text in (*ALARM_STATES.values(), *ALARM_REFUSALS.values()):
        assert is_bilingual(text), text
    assert len({text.zh for text in ALARM_STATES.values()}) == len(AlarmState)
