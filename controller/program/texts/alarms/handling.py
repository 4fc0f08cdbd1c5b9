"""Texts of the alarm list: names of the ISA-18.2 states and reasons for refusing an action."""

from __future__ import annotations

from typing import Final

from controller.program.texts.operator import Text

ALARM_STATES: Final = {
    "normal": Text("normal", "正常"),
    "unacknowledged": Text("unacknowledged", "未确认"),
    "acknowledged": Text("acknowledged", "已确认"),
    "returned_unacknowledged": Text("returned to normal, unacknowledged", "已恢复，未确认"),
    "latched_unacknowledged": Text("latched, unacknowledged", "锁存，未确认"),
    "latched_acknowledged": Text("latched, acknowledged", "锁存，已确认"),
    "shelved": Text("shelved", "已搁置"),
}
"""Names of the ISA-18.2 alarm states, by value of `AlarmState`."""

ALARM_REFUSALS: Final = {
    "unknown": Text(
        "unknown alarm S{number}; use a number in the alarm list", "没有报警 S{number}，请使用报警表中的编号"
    ),
    "safety": Text(
        "S{number} is a safety alarm and cannot be shelved; remove its cause and reset",
        "S{number} 是安全报警，不得搁置；请排除原因后复位",
    ),
    "stops_work": Text(
        "S{number} stops the machine and cannot be shelved; remove its cause and reset",
        "S{number} 会使机器停止，不得搁置；请排除原因后复位",
    ),
    "time": Text(
        "the shelving time must be 1 ms to {limit} h, not {for_ms} ms",
        "搁置时间须为 1 毫秒至 {limit} 小时，不能是 {for_ms} 毫秒",
    ),
    "nobody": Text("operator name required for the journal", "请注明操作人：姓名将记入日志"),
}
"""Reasons for refusing an alarm list action."""
