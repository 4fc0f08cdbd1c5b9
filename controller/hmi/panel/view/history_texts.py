"""Texts of the history page."""

from __future__ import annotations

from typing import Final

from controller.program.texts.operator import Text

HISTORY_TEXTS: Final = {
    "page.history": Text("History", "历史记录"),
    "history.none": Text("No history file", "无历史文件"),
    "history.empty": Text("No records", "暂无记录"),
    "history.all": Text("All", "全部"),
    "history.last": Text("Last {n} min", "最近 {n} 分钟"),
    "history.around": Text("± {n} min", "前后 {n} 分钟"),
    "history.kind": Text("Record", "记录"),
    "history.text": Text("Text", "文字"),
    "history.older": Text("Older", "较早"),
    "history.newer": Text("Newer", "较晚"),
    "history.cycle": Text(
        "{side}, row {row}: {time}, waiting for cups {waiting}", "{side}，第 {row} 行：{time}，等待苗杯时间 {waiting}"
    ),
    "history.asked": Text("asked", "待回答"),
    "history.answered": Text("answered", "已回答"),
    "history.kind.alarm": Text("Alarm", "报警"),
    "history.kind.cycle": Text("Cycle", "循环"),
    "history.kind.state": Text("State", "状态"),
    "history.kind.mode": Text("Mode", "模式"),
    "history.kind.question": Text("Question", "问题"),
    "history.kind.refusal": Text("Refusal", "拒绝"),
    "history.kind.tray": Text("Tray", "苗盘"),
    "history.kind.row": Text("Row", "行"),
    "history.kind.next": Text("What to do now", "操作"),
    "history.kind.history": Text("Records lost", "丢失记录"),
}
