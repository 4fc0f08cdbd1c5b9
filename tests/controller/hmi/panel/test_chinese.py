"""Chinese texts of the panel: no English words except names, and full-width punctuation."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from controller.core.clock import SimulatedClock
from controller.hmi.access.status_registers import STATUS_REGISTERS
from controller.hmi.modbus.connection import ModbusConnection
from controller.hmi.panel.modbus.mirror import Mirror
from controller.hmi.panel.modbus.telemetry import Telemetry, TelemetryTag
from controller.hmi.panel.orders.jog import Jogging
from controller.hmi.panel.orders.login import AccessLevel
from controller.hmi.panel.orders.replies import REPLIES, level_text
from controller.hmi.panel.view.describe import describe
from controller.hmi.panel.view.state import ViewBuilder
from controller.hmi.panel.view.texts import TEXTS
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.operator.refusals import refusal_text
from controller.program.states import State
from controller.program.texts.alarms.handling import ALARM_REFUSALS
from controller.program.texts.alarms.messages import ALARMS
from controller.program.texts.operator import CANNOT, MODES, ORDERS, QUESTIONS, REASONS, REFUSALS, STATES, Text
from tests.sampling import one_in

MACHINE = build(load_io_map(DEFAULT_IO_MAP))
CHINESE = re.compile(r"[\u4e00-\u9fff]")
ASCII_PUNCTUATION = re.compile(r"[,;!?()]|(?<!\d):|:(?!\d)|\.(?!\d)")
"""Punctuation of English; the point of a number and the colon of a clock time are those of both languages."""
PLACEHOLDER = re.compile(r"\{[^}]*\}")
WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

DEVICES = re.compile(r"[XYMSTCD]\d+")
"""Device addresses such as X0, S900 and D100."""
NAMES = {"FX2N", "PackML", "Modbus", "JSON"}
SYMBOLS = {"S", "P", "D", "T", "X", "Y", "n", "I", "O", "mm", "kPa", "N"}
"""Symbols of quantities in the paper, of device kinds, of I/O and of SI units."""
ALLOWED = NAMES | SYMBOLS

IDENTIFIERS = {
    "level",
    "next_command",
    "address",
    "command",
    "device",
    "group",
    "key",
    "kind",
    "languages",
    "name",
    "names",
    "output",
    "s",
    "side",
    "step",
    "tag",
    "title",
    "to",
    "unit",
    "waits_for",
    "gap_cause",
    "points",
}
"""Keys of the description and the view whose values are identifiers; the page looks up their texts by key."""


def latin_words(text: str) -> list[str]:
    words = WORD.findall(PLACEHOLDER.sub("", text))
    return [word for word in words if word not in ALLOWED and not DEVICES.fullmatch(word)]


def punctuation_errors(text: str) -> list[str]:
    return ASCII_PUNCTUATION.findall(PLACEHOLDER.sub("", text))


def static_texts() -> Iterator[tuple[str, Text]]:
    tables: dict[str, dict[Any, Text]] = {
        "texts": TEXTS,
        "replies": REPLIES,
        "states": STATES,
        "modes": MODES,
        "reasons": {number: text for number, text in REASONS.items() if number},
        "questions": QUESTIONS,
        "orders": ORDERS,
        "refusals": REFUSALS,
        "alarm refusals": ALARM_REFUSALS,
        "alarm messages": {key: text.message for key, text in ALARMS.items()},
        "alarm meanings": {key: text.meaning for key, text in ALARMS.items()},
        "status registers": {register.name: register.text for register in STATUS_REGISTERS},
    }
    for name, table in tables.items():
        for key, text in table.items():
            yield f"{name}: {key}", text
    yield "format of a refusal", CANNOT
    for level in (AccessLevel.OPERATE, AccessLevel.MAINTAIN):
        yield f"login required: {level.name}", level_text(level)


def view_builder() -> tuple[ViewBuilder, Mirror]:
    clock = SimulatedClock()
    mirror = Mirror(clock)
    jogging = Jogging(MACHINE, mirror, lambda: ModbusConnection("127.0.0.1", 1), clock)
    return ViewBuilder(MACHINE, mirror, jogging), mirror


def description() -> dict[str, Any]:
    tags = (TelemetryTag(name="left.slide_mm", table="input", address=1, meaning="slide position"),)
    return describe(MACHINE, Telemetry(ModbusConnection("127.0.0.1", 1), tags, SimulatedClock()))


def chinese_strings(value: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield every string that the page shows in Chinese; identifiers are skipped."""
    if isinstance(value, dict):
        if set(value) == {"en", "zh"}:
            yield path, value["zh"]
            return
        for key, item in value.items():
            if key not in IDENTIFIERS or not isinstance(item, str | list):
                yield from chinese_strings(item, f"{path}.{key}")
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from chinese_strings(item, f"{path}[{index}]")
    elif isinstance(value, str):
        yield path, value


def check(strings: Iterator[tuple[str, str]]) -> int:
    """Check Chinese strings; return their number."""
    strings_by_path = dict(strings)
    assert [(path, text) for path, text in strings_by_path.items() if latin_words(text)] == []
    assert [(path, text) for path, text in strings_by_path.items() if punctuation_errors(text)] == []
    return len(strings_by_path)


def test_static_texts_are_chinese() -> None:
    table = dict(static_texts())
    exempt = {"texts: series.success", "texts: format.labelled", "texts: format.note", "texts: format.comma"}
    assert [key for key, text in table.items() if not CHINESE.search(text.zh) and key not in exempt] == []
    assert check((key, text.zh) for key, text in table.items()) > 500


def test_description_is_chinese() -> None:
    strings = {path: text for path, text in chinese_strings(description()) if text}
    conditions = [text for path, text in strings.items() if path.endswith(".when")]
    assert len(conditions) > 100
    assert all(CHINESE.search(text) for text in conditions)
    assert check(iter(strings.items())) > 700


def test_a_row_that_is_empty_is_not_read_as_behaviour() -> None:
    """The last character of *row* and *is* are the word *behaviour*."""
    texts = [*chinese_strings(description()), *((key, text.zh) for key, text in static_texts())]
    assert [(path, text) for path, text in texts if "行为" in text] == []


def test_millimetres_are_a_symbol_alone_and_in_a_speed() -> None:
    """Both are in one table."""
    units = {point["unit"] for point in description()["set_points"]}
    assert units >= {"mm", "mm/s"}
    assert "unit.mm" not in TEXTS
    assert TEXTS["unit.mm/s"].zh.startswith("mm/")


@pytest.mark.parametrize("state", one_in(3, list(State)))
def test_view_is_chinese_in_every_state(state: State) -> None:
    builder, mirror = view_builder()
    control = MACHINE.tags.machine
    mirror.memory.D[control.state.number] = state
    for reason in range(len(REFUSALS)):
        mirror.memory.D[control.refused.number] = 2
        mirror.memory.D[control.refusal.number] = reason
        assert check((path, text) for path, text in chinese_strings(builder.view()) if text) > 20


@pytest.mark.parametrize("command", list(MACHINE.tags.commands), ids=lambda command: command.name)
def test_every_refusal_is_chinese(command: Any) -> None:
    reasons = [obstacle.reason for obstacle in MACHINE.orders.obstacles(command.bit)]
    check((reason.name, refusal_text(command, reason).zh) for reason in reasons)


@pytest.mark.parametrize(
    ("text", "words", "punctuation"),
    [
        ("输出 Y1 是否接通；S900", [], []),
        ("线圈 lift_extend 是否得电；S900", ["lift_extend"], []),
        ("Waiting 等待", ["Waiting"], []),
        ("等待,苗杯", [], [","]),
        ("苗杯(空)", [], ["(", ")"]),
        ("请输入 {lowest} 至 {highest}", [], []),
        ("取值 0.5 mm", [], []),
    ],
)
def test_the_checks_find_words_and_punctuation(text: str, words: list[str], punctuation: list[str]) -> None:
    assert latin_words(text) == words
    assert punctuation_errors(text) == punctuation
