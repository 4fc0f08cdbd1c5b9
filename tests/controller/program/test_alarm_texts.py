"""Alarm texts: every alarm has a message and a check in both languages; time limit alarms name their actuator."""

from __future__ import annotations

import string

import pytest

from controller.core.sequence import Step
from controller.events.alarm_list import AlarmState
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.alarms import Alarm
from controller.program.machine import build
from controller.program.tags import SIDES
from controller.program.texts.alarms import ALARM_REFUSALS, ALARM_STATES
from controller.program.texts.operator import SIDES as SIDE_TEXTS
from controller.program.texts.operator import Text

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
MOVES = [
    (MACHINE.alarms.of(step.watch.alarm.number), step)
    for sequence in MACHINE.program.sequences()
    for _, step in sequence
    if step.watch
]
PICKS = ("pick switches 1 to 3", "取苗位 1 至 3 开关")
MOTIONS = {
    "lift_extend": (("not down", "未降到下限位"), ("arm down on?", "臂下降的输出"), ("lower switch", "下限位开关")),
    "lift_retract": (("not up", "未升到上限位"), ("arm up on?", "臂上升的输出"), ("upper switch", "上限位开关")),
    "slide_inward": (("slide did not reach the row", "滑块未到达取苗位"), ("slide inward", "滑块向内"), PICKS),
    "slide_outward": (("slide did not re", "滑块"), ("outward", "向外"), ("switch", "开关")),
    "spread": (("not spread", "未分散"), ("for spreading on?", "分散的输出"), ("spread switch", "分散开关")),
    "converge": (("not converged", "未聚合"), ("for converging on?", "聚合的输出"), ("converged switch", "聚合开关")),
    "tray_run": (
        ("Tray did not leave", "苗盘未离开"),
        ("tray conveyor", "苗盘输送带的输出"),
        ("tray sensor", "苗盘传感器"),
    ),
    "claws_open": (
        ("not opened", "未张开"),
        ("opening the claws on?", "夹爪张开的输出"),
        ("feed or pick", "取苗位 1 至 3"),
    ),
    "claws_close": (
        ("not closed", "未闭合"),
        ("closing the claws on?", "夹爪闭合的输出"),
        ("pick switch", "取苗位 1 至 3"),
    ),
}
"""Parts of the alarm message, name of the output in the check, and name of the switch at the end of its motion.

The claws have no switch of their own; their entries name the slide switches at which they move.
"""


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
    message, name, switch = MOTIONS[output]
    for part, whole in ((message, text.message), (name, text.check), (switch, text.check)):
        assert part[0] in whole.en
        assert part[1] in whole.zh


def test_states_and_refusals_have_texts_in_both_languages() -> None:
    assert [state.text for state in AlarmState] == list(ALARM_STATES.values())
    for text in (*ALARM_STATES.values(), *ALARM_REFUSALS.values()):
        assert is_bilingual(text), text
    assert len({text.zh for text in ALARM_STATES.values()}) == len(AlarmState)
