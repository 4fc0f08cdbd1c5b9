"""Alarm texts: every alarm has a message and a check in both languages; time limit alarms name their actuator."""

from __future__ import annotations

import re
import string

import pytest

from controller.core.sequence import Step
from controller.events.alarm_list import AlarmState
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.alarms.table import Alarm
from controller.program.machine import build
from controller.program.tags import SIDES
from controller.program.texts.alarms import ALARM_REFUSALS, ALARM_STATES
from controller.program.texts.operator import SIDES as SIDE_TEXTS
from controller.program.texts.operator import Text

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
WIRES = (*MACHINE.io_map.inputs, *MACHINE.io_map.outputs, *MACHINE.io_map.unwired)
TAGS = {point.tag.rpartition(".")[2] for point in WIRES}
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
"""End switch of the motion of each output, and parts of the alarm message in English and Chinese.

The claws have no switch of their own; their entries name the slide switches at which they move.
"""


def tag_names(text: str) -> set[str]:
    """Return the words of a text that contain an underscore, i.e. the tag names."""
    return set(re.findall(r"[a-z]+(?:_[a-z0-9]+)+", text))


def fields(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}


def is_bilingual(text: Text) -> bool:
    chinese = any("一" <= character <= "鿿" for character in text.zh)
    return bool(text.en.strip()) and text.en.isascii() and chinese and fields(text.en) == fields(text.zh)


@pytest.mark.parametrize("alarm", list(MACHINE.alarms), ids=lambda alarm: str(alarm.bit))
def test_every_alarm_has_a_message_and_checks_in_both_languages(alarm: Alarm) -> None:
    text = alarm.text
    assert is_bilingual(text.message)
    assert is_bilingual(text.check)
    assert text.check.en != text.message.en
    assert tag_names(text.check.en) == tag_names(text.check.zh), "same tags in both languages"
    assert tag_names(text.check.en) <= TAGS | SET_POINTS, "tags of the I/O map and set-points of the program"
    assert (text.en, text.zh) == text.message


@pytest.mark.parametrize("alarm", list(MACHINE.alarms), ids=lambda alarm: str(alarm.bit))
def test_every_placeholder_is_filled_and_the_side_is_named(alarm: Alarm) -> None:
    text = alarm.text
    assert not set("{}") & set(text.message.en + text.message.zh + text.check.en + text.check.zh)
    for side in SIDES:
        assert (side in text.en) == (side == alarm.side)
        assert (SIDE_TEXTS[side].zh in text.zh) == (side == alarm.side)


@pytest.mark.parametrize(("alarm", "step"), MOVES, ids=[str(alarm.bit) for alarm, _ in MOVES])
def test_a_time_limit_alarm_names_the_motion_the_output_and_the_switch(alarm: Alarm, step: Step) -> None:
    """The alarm of a step with a time limit names the motion, its output and the switch at its end."""
    text = alarm.text
    output, *held = (hold.name.rpartition("want ")[2].replace("run", "tray_run") for hold in step.hold)
    assert held in ([], ["lift_retract"]), "only the lift is pressed against its end during another motion"
    switch, english, chinese = MOTIONS[output]
    assert english in text.message.en
    assert chinese in text.message.zh
    for check in text.check:
        assert re.search(rf"\b{output}\b", check, re.ASCII)
        assert switch in check


def test_states_and_refusals_have_texts_in_both_languages() -> None:
    assert [state.text for state in AlarmState] == list(ALARM_STATES.values())
    for text in (*ALARM_STATES.values(), *ALARM_REFUSALS.values()):
        assert is_bilingual(text), text
    assert len({text.zh for text in ALARM_STATES.values()}) == len(AlarmState)
