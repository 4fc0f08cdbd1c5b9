"""Sentences of the answers in English and Chinese."""

from __future__ import annotations

from typing import Final

from controller.program.texts.operator import Text

ON: Final = Text("on", "接通")
OFF: Final = Text("off", "断开")
TRUE: Final = Text("true", "成立")
FALSE: Final = Text("false", "不成立")
NEEDS: Final = Text("needs", "需要")
HELD_BY: Final = Text("cause", "原因")
RUNG: Final = Text("rung", "梯级")
MORE_SETS: Final = Text("further sets are not shown", "其余组合未列出")
CAUSE: Final = Text("Cause", "原因")
ALSO: Final = Text("Also", "另有")

SENTENCES: Final = {
    # questions
    "why": Text("Why is {name} {level} after scan {scan}, {time}?", "{name} 在扫描 {scan}（{time}）之后为何{level}？"),
    "why step": Text(
        "Why has step {name} not left by scan {scan}, {time}?", "步 {name} 到扫描 {scan}（{time}）为何未转移？"
    ),
    "why word": Text(
        "Why is {name} = {value} after scan {scan}, {time}?", "{name} 在扫描 {scan}（{time}）之后为何等于 {value}？"
    ),
    # steps
    "went": Text("{name} went {level} in scan {scan}, {time}", "{name} 在扫描 {scan}（{time}）{level}"),
    "went always": Text(
        "{name} is {level} in all recorded scans up to scan {scan}", "{name} 在扫描 {scan} 以前的全部记录中均{level}"
    ),
    "went earlier": Text("{name} is {level}, as before this scan", "{name} {level}，与本扫描之前相同"),
    "step waits": Text(
        "step {name} is active since scan {scan}, {time}, and its transition is not met",
        "步 {name} 自扫描 {scan}（{time}）起激活，转移条件未满足",
    ),
    "step waits always": Text(
        "step {name} is active in all recorded scans, and its transition is not met",
        "步 {name} 在全部记录中均激活，转移条件未满足",
    ),
    "step waits earlier": Text(
        "step {name} is active, and its transition is not met", "步 {name} 已激活，转移条件未满足"
    ),
    "step left": Text(
        "step {name} was left in scan {scan}, {time}, to {other}", "步 {name} 在扫描 {scan}（{time}）转移到 {other}"
    ),
    "elapsed": Text(
        "timer {name} elapsed in scan {scan}, {time}: its rung was on for {preset}",
        "定时器 {name} 在扫描 {scan}（{time}）到时：其梯级已接通 {preset}",
    ),
    "elapsed always": Text(
        "timer {name} has elapsed in all recorded scans: its rung is on for {preset}",
        "定时器 {name} 在全部记录中均已到时：其梯级已接通 {preset}",
    ),
    "elapsed earlier": Text(
        "timer {name} has elapsed: its rung is on for {preset}", "定时器 {name} 已到时：其梯级已接通 {preset}"
    ),
    "written": Text(
        "{name} = {value}, written in scan {scan}, {time}", "{name} = {value}，于扫描 {scan}（{time}）写入"
    ),
    "not executed": Text(
        "the rungs that turn {name} on are not executed: {other}", "接通 {name} 的梯级未执行：{other}"
    ),
    "rule": Text("{name} is requested and not granted by the rule {rule}", "{name} 已请求，但规则{rule}不允许"),
    # causes
    "input": Text("{name} is {level}, since scan {scan}, {time}", "{name} {level}，自扫描 {scan}（{time}）起"),
    "input always": Text("{name} is {level} in all recorded scans", "{name} 在全部记录中均{level}"),
    "input earlier": Text("{name} is {level}, as before this scan", "{name} {level}，与本扫描之前相同"),
    "safeguard": Text(
        "{name} acts since scan {scan}, {time}; a safeguard, and the cause to be found out",
        "{name} 自扫描 {scan}（{time}）起动作；这是安全措施，应查明其原因",
    ),
    "rule cause": Text("rule {rule}", "规则{rule}"),
    "timer": Text("{name} runs: {value} of {preset}", "{name} 正在计时：{value}／{preset}"),
    "counter": Text("{name} counts: {value} of {preset}", "{name} 正在计数：{value}／{preset}"),
    "command": Text(
        "{name} is {level} since scan {scan}, {time}; the program does not write it: a command or a bit of the system",
        "{name} 自扫描 {scan}（{time}）起{level}；程序不写该软元件：命令或系统位",
    ),
    "command always": Text("{name} is {level} since the first recorded scan", "{name} 自第一个记录的扫描起一直{level}"),
    "command earlier": Text(
        "{name} is {level}; the program does not write it: a command or a bit of the system",
        "{name} {level}；程序不写该软元件：命令或系统位",
    ),
    "set-point": Text("{name} = {value}, a value that the program does not write", "{name} = {value}，程序不写该数值"),
    "word always": Text(
        "{name} = {value} since the first recorded scan", "{name} 自第一个记录的扫描起一直等于 {value}"
    ),
    "word earlier": Text(
        "{name} = {value}, written in an earlier scan; record the run to see it",
        "{name} = {value}，在较早的扫描中写入；记录运行后可查明",
    ),
    "kept always": Text("{name} is {level} since the first recorded scan", "{name} 自第一个记录的扫描起一直{level}"),
    "kept earlier": Text(
        "{name} is {level} since an earlier scan; record the run to see why",
        "{name} 自较早的扫描起{level}；记录运行后可查明原因",
    ),
    "fault": Text("{fault}, {span}; {plant}", "{fault}，{span}；{plant}"),
    "active": Text("active", "存在"),
    "is": Text("is {level}", "{level}"),
    "equals": Text("is {level}", "为 {level}"),
    "actuated": Text("{name} is actuated", "{name} 已操作"),
    "not actuated": Text("{name} is not actuated", "{name} 未操作"),
    "part": Text("{part} {at} mm (on: {low}..{high} mm)", "{part} {at} mm（接通范围：{low}..{high} mm）"),
    "part with air": Text(
        "{part} {at} mm (on: {low}..{high} mm), {plus}/{minus} bar, supply {supply} bar",
        "{part} {at} mm（接通范围：{low}..{high} mm），{plus}/{minus} bar，气源 {supply} bar",
    ),
    "plant": Text(
        "{name} is {level} since scan {scan}, {time}; {plant}", "{name} 自扫描 {scan}（{time}）起{level}；{plant}"
    ),
    "button": Text(
        "{name}: the button is {level} since scan {scan}, {time}", "{name}：按钮自扫描 {scan}（{time}）起{level}"
    ),
    # proof
    "proved": Text(
        "Proved by replay: with {change}, {name} {state} in scan {scan}",
        "重放证明：施加 {change} 后，{name} 在扫描 {scan} {state}",
    ),
    "not proved": Text(
        "Not proved: with {change}, {name} still {state} in scan {scan}; then: {reason}",
        "未证明：施加 {change} 后，{name} 在扫描 {scan} 仍{state}；此时：{reason}",
    ),
    "no change": Text("Not proved by replay: {reason}", "未经重放证明：{reason}"),
    "no replay": Text("the branch is not possible ({reason})", "无法分支（{reason}）"),
    "is safeguard": Text("a safeguard or an interlock is not removed for a trial", "安全措施和联锁不为试验而解除"),
    "no input": Text("no single input or fault is named", "未指明单一的输入或故障"),
    "too early": Text("the cause is older than the recorded run", "原因早于记录的起点"),
    "same": Text("the same contacts", "相同的触点"),
    "not recorded": Text("the scans before are not recorded", "此前的扫描未记录"),
}


def sentence(key: str, **values: Text | str | int) -> Text:
    """Return a sentence with its placeholders filled in.

    Args:
        key: Key in the table.
        values: Values; a `Text` has one for each language.
    """
    return SENTENCES[key].filled(
        **{name: value if isinstance(value, Text) else Text(str(value), str(value)) for name, value in values.items()}
    )


def level(on: object) -> Text:
    """Return the word for on or off."""
    return ON if on else OFF


def truth(holds: object) -> Text:
    """Return the word for a comparison that is true or false."""
    return TRUE if holds else FALSE
