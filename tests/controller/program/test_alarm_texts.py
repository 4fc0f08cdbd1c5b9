"""Alarm texts: every alarm has a message, a meaning and causes; a hand goes in after the isolation."""

from __future__ import annotations

import re
import string
import xml.etree.ElementTree as Xml
from collections.abc import Iterator

import pytest

from controller.common.declarations import DeclarationError
from controller.core.sequence import Step
from controller.events.alarm_states import AlarmState
from controller.program.alarms.guide import likely_causes
from controller.program.alarms.table import Alarm
from controller.program.machine import build
from controller.program.tags import SIDES
from controller.program.texts.alarms.causes import CAUSES
from controller.program.texts.alarms.handling import ALARM_REFUSALS, ALARM_STATES
from controller.program.texts.alarms.help import Cause
from controller.program.texts.alarms.locations import ARM_LOCATIONS, LOCATIONS, OUTSIDE
from controller.program.texts.alarms.messages import ALARMS
from controller.program.texts.isolation import ISOLATE_FIRST, ISOLATION
from controller.program.texts.operator import SIDES as SIDE_TEXTS
from controller.program.texts.operator import Text
from tests.paths import DOCS
from tests.wiring import YIELD, wired

MACHINE = build(wired(*YIELD))
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
HANDS = re.compile(
    r"\b(?:adjust|bend|clean|clear|fill|free|grease|hold|loosen|measure|move back|pull|push|put|refit|remove|"
    r"replace|swap|tension|tighten|wipe)\b",
    re.IGNORECASE,
)
HANDS_CHINESE = re.compile(
    r"清(?!除中止)|(?<!被)(?<!或)推(?!板)|拉(?!机)|[擦拧拆拨扳装紧]|更换|调整|取出|取下|移回|放回|补充|排除|用手"
)
"""Words for what a hand does to the machine."""
PROGRAM_NAMES = re.compile(r"[a-z0-9]+_[a-z0-9_]+|\b[a-z]+\.[a-z]+", re.IGNORECASE)
LATIN = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
ADDRESS = re.compile(r"[XYS]\d+")


def fields(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}


def is_bilingual(text: Text) -> bool:
    chinese = any("一" <= character <= "鿿" for character in text.zh)
    return bool(text.en.strip()) and text.en.isascii() and chinese and fields(text.en) == fields(text.zh)


def texts() -> Iterator[tuple[str, Text]]:
    """Yield all alarm texts that the operator reads."""
    for key, text in ALARMS.items():
        yield f"{key}: message", text.message
        yield f"{key}: meaning", text.meaning
    for key, cause in CAUSES.items():
        yield f"{key}: name", cause.name
        yield f"{key}: look", cause.look
        if cause.reach is not None:
            yield f"{key}: reach", cause.reach
    yield from LOCATIONS.items()
    for number, step in enumerate(ISOLATION, 1):
        yield f"isolation {number}", step


@pytest.mark.parametrize("alarm", list(MACHINE.alarms), ids=lambda alarm: str(alarm.bit))
def test_every_alarm_has_message_meaning_and_causes(alarm: Alarm) -> None:
    text = alarm.text
    causes = likely_causes(alarm, MACHINE.io_map)
    assert text.meaning.en != text.message.en
    assert causes
    assert len({cause.key for cause in causes}) == len(causes)
    assert (text.en, text.zh) == text.message


def test_every_text_has_both_languages() -> None:
    table = dict(texts())
    assert len(table) > 250
    assert [key for key, text in table.items() if not is_bilingual(text)] == []


def test_no_text_contains_the_name_of_a_tag_or_set_point() -> None:
    """An operator reads terminals and words; tags and set-points are shown by their display names."""
    assert [(key, text.en) for key, text in texts() if PROGRAM_NAMES.search(text.en)] == []
    assert [(key, text.zh) for key, text in texts() if PROGRAM_NAMES.search(text.zh)] == []


def test_chinese_texts_contain_no_latin_words() -> None:
    found = [
        (key, word)
        for key, text in texts()
        for word in LATIN.findall(text.zh.replace("{side}", ""))
        if not ADDRESS.fullmatch(word)
    ]
    assert found == []


@pytest.mark.parametrize("alarm", list(MACHINE.alarms), ids=lambda alarm: str(alarm.bit))
def test_every_placeholder_is_filled_and_the_side_is_named(alarm: Alarm) -> None:
    text = alarm.text
    assert not set("{}") & set("".join((*text.message, *text.meaning)))
    for side in SIDES:
        assert (side in text.en) == (side == alarm.side)
        assert (SIDE_TEXTS[side].zh in text.zh) == (side == alarm.side)


@pytest.mark.parametrize(("alarm", "step"), MOVES, ids=[str(alarm.bit) for alarm, _ in MOVES])
def test_a_time_limit_alarm_names_the_motion_the_output_and_the_switch(alarm: Alarm, step: Step) -> None:
    """The alarm of a step with a time limit names the motion, its output and the switch at its end, with terminals."""
    text = alarm.text
    output, *held = (hold.name.rpartition("want ")[2].replace("run", "tray_run") for hold in step.hold)
    assert held in ([], ["lift_retract"]), "only the lift is pressed against its end during another motion"
    switch, english, chinese = MOTIONS[output]
    assert english in text.message.en
    assert chinese in text.message.zh
    tags = [tag for cause in likely_causes(alarm, MACHINE.io_map) for tag, _ in cause.points]
    prefix = "" if alarm.side is None else f"{alarm.side}."
    assert f"{prefix}{output}" in tags
    assert any(tag.startswith(f"{prefix}{switch}") for tag in tags)


# --- isolation ----------------------------------------------------------------------------------


def hands(text: Text) -> list[str]:
    """Return the words that send a hand into the machine."""
    return HANDS.findall(text.en) + HANDS_CHINESE.findall(text.zh)


def test_a_text_that_sends_a_hand_into_the_machine_begins_with_the_isolation() -> None:
    """Texts of parts outside the machine may name work; every other text that names work begins with the isolation."""
    outside = {f"{key}: look" for key, cause in CAUSES.items() if cause.location in OUTSIDE}
    steps = {f"isolation {number}" for number in range(1, len(ISOLATION) + 1)}
    found = [
        (key, hands(text))
        for key, text in texts()
        if hands(text)
        and key not in outside | steps
        and not (text.en.startswith(ISOLATE_FIRST.en) and text.zh.startswith(ISOLATE_FIRST.zh))
    ]
    assert found == []


def test_the_search_for_hands_finds_work_at_the_machine() -> None:
    assert hands(Text("Free the jam", "")) == ["Free"]
    assert hands(Text("", "清洁传感器")) == ["清"]
    assert hands(Text("", "排空气缸")) == []
    assert hands(Text("Lamp of the switch", "开关指示灯")) == []


def test_a_check_with_a_hand_in_the_machine_is_refused_without_the_isolation() -> None:
    look = Text("Lamp", "指示灯")
    with pytest.raises(DeclarationError, match=r"cause 'Belt slips': begin the text with 'Isolate first.'"):
        Cause(Text("Belt slips", "打滑"), look, "spreader", Text("Tighten the belt", "先断电断气并上锁。张紧同步带"))
    with pytest.raises(DeclarationError, match="begin the text with '先断电断气并上锁。'"):
        Cause(Text("Belt slips", "打滑"), look, "spreader", Text("Isolate first. Tighten the belt", "张紧同步带"))


def test_the_isolation_is_that_of_the_hazard_page() -> None:
    page = (DOCS / "safety.md").read_text(encoding="utf-8").partition("## Before reaching into the machine\n")[2]
    assert re.findall(r"^\d\. (.+)$", page, re.MULTILINE) == [step.en for step in ISOLATION]


# --- parts --------------------------------------------------------------------------------------


def test_the_picture_shows_every_part_of_the_causes_once() -> None:
    picture = Xml.parse(DOCS / "machine.svg").getroot()  # noqa: S314 - our own file
    shown = sorted(node.attrib["data-location"] for node in picture.iter() if "data-location" in node.attrib)
    declared = [
        name
        for location in LOCATIONS
        for name in ([f"{side}.{location}" for side in SIDES] if location in ARM_LOCATIONS else [location])
    ]
    assert shown == sorted(declared)
    used = {
        name for alarm in MACHINE.alarms for cause in likely_causes(alarm, MACHINE.io_map) for name in cause.locations
    }
    assert sorted(set(shown) - used) == []


def test_every_cause_belongs_to_an_alarm_and_names_existing_set_points() -> None:
    used = {key for text in ALARMS.values() for key in text.causes}
    assert used == CAUSES.keys()
    assert {name for cause in CAUSES.values() for name in cause.set_points} <= set(MACHINE.tags.sp.names())


def test_an_alarm_of_one_arm_names_the_terminals_of_this_arm() -> None:
    """An alarm of the cup counters names both, because it does not tell which one is wrong."""
    for alarm in MACHINE.alarms:
        for cause in likely_causes(alarm, MACHINE.io_map):
            sides = {tag.partition(".")[0] for tag, _ in cause.points if "." in tag}
            both = alarm.side is None or cause.cause.both_sides
            assert sides in ([set(), set(SIDES)] if both else [set(), {alarm.side}]), (alarm.bit, cause.key)


def test_states_and_refusals_have_texts_in_both_languages() -> None:
    assert [state.text for state in AlarmState] == list(ALARM_STATES.values())
    for text in (*ALARM_STATES.values(), *ALARM_REFUSALS.values()):
        assert is_bilingual(text), text
    assert len({text.zh for text in ALARM_STATES.values()}) == len(AlarmState)
