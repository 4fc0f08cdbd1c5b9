"""Events in words, in both languages."""

from __future__ import annotations

import pytest

from controller.events.kinds import (
    AlarmEvent,
    CycleEvent,
    Event,
    ModeEvent,
    NextPressEvent,
    QuestionEvent,
    RefusalEvent,
    RowEvent,
    StateEvent,
    TrayEvent,
    as_sentence,
)
from controller.program.texts.operator import NO_TEXT, Text

START = Text("press X0 to start", "按 X0 启动")
WORDS = Text("words", "文字")


@pytest.mark.parametrize(
    ("event", "en", "zh"),
    [
        (StateEvent(0, 4, Text("Idle", "待机")), "state Idle", "状态 待机"),
        (
            StateEvent(0, 11, Text("Held", "已保持"), Text("alarm", "有报警"), START),
            "state Held, reason alarm; now: press X0 to start",
            "状态 已保持，原因：有报警；下一步：按 X0 启动",
        ),
        (AlarmEvent(0, 911, True, WORDS), "alarm S911 on: words", "报警 S911 出现：文字"),
        (AlarmEvent(0, 911, False, WORDS), "alarm S911 off: words", "报警 S911 消失：文字"),
        (QuestionEvent(0, "tray", True, WORDS), "question asked: words", "提问：文字"),
        (QuestionEvent(0, "tray", False, WORDS), "question answered: words", "已回答：文字"),
        (
            CycleEvent(0, "left", 2, 8_010, 1_500, 3),
            "cycle of the left arm with row 2 completed in 8.01 s, of which 1.50 s waiting for cups",
            "左臂第 2 行循环完成，用时 8.01 秒，其中等待苗杯 1.50 秒",
        ),
        (
            CycleEvent(0, "right", 1, 8_000, 0, 3, "centre"),
            "cycle of the right arm with row 1 completed in 8.00 s, of which 0.00 s waiting for cups, "
            "3 cups missed so far (centre)",
            "右臂第 1 行循环完成，用时 8.00 秒，其中等待苗杯 0.00 秒，已漏投苗杯 3 个（中间区占用）",
        ),
        (RowEvent(0, "right", 5), "row 5 of the right arm released over the cups", "右臂已向苗杯投放第 5 行"),
        (TrayEvent(0, 2), "tray 2 emptied", "第 2 盘已取空"),
        (ModeEvent(0, 3, Text("manual", "手动")), "mode manual", "模式 手动"),
        (RefusalEvent(0, "start", 2, WORDS), "refused: words", "已拒绝：文字"),
        (
            RefusalEvent(0, "start", 2, WORDS, START),
            "refused: words; now: press X0 to start",
            "已拒绝：文字；下一步：按 X0 启动",
        ),
        (NextPressEvent(0, 1, START), "now: press X0 to start", "下一步：按 X0 启动"),
        (NextPressEvent(0, 0, NO_TEXT), "now: no press is required", "下一步：无需按键"),
    ],
)
def test_an_event_in_words(event: Event, en: str, zh: str) -> None:
    assert as_sentence(event) == (en, zh)
