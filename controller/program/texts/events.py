"""Sentences about production events in English and Chinese."""

from __future__ import annotations

from typing import Final

from controller.program.texts.operator import Text

EVENTS: Final = {
    "state": Text("state {state}", "状态 {state}"),
    "reason": Text(", reason {reason}", "，原因：{reason}"),
    "alarm_on": Text("alarm {number} on: {message}", "报警 {number} 出现：{message}"),
    "alarm_off": Text("alarm {number} off: {message}", "报警 {number} 消失：{message}"),
    "asked": Text("question asked: {message}", "提问：{message}"),
    "answered": Text("question answered: {message}", "已回答：{message}"),
    "cycle": Text(
        "cycle of the {side} arm with row {row} completed in {cycle} s, of which {waiting} s waiting for cups",
        "{side}臂第 {row} 行循环完成，用时 {cycle} 秒，其中等待苗杯 {waiting} 秒",
    ),
    "missed": Text(", {count} cups missed so far ({cause})", "，已漏投苗杯 {count} 个（{cause}）"),
    "row": Text("row {row} of the {side} arm released over the cups", "{side}臂已向苗杯投放第 {row} 行"),
    "tray": Text("tray {number} emptied", "第 {number} 盘已取空"),
    "mode": Text("mode {mode}", "模式 {mode}"),
    "refused": Text("refused: {message}", "已拒绝：{message}"),
    "now": Text("now: {press}", "下一步：{press}"),
    "nothing": Text("now: no press is required", "下一步：无需按键"),
    "then": Text("; ", "；"),
}
"""Sentences and parts of sentences; a name in braces is a placeholder."""
CAUSES: Final = {
    "tray": Text("tray", "苗盘"),
    "centre": Text("centre", "中间区占用"),
    "row": Text("row", "苗行"),
}
"""Causes of missed cups, by `GapCause` except for "none"."""
