"""Alarm texts of the time limits of the steps: steps with the same motion share meaning and causes."""

from __future__ import annotations

from typing import Final

from controller.program.texts.alarms.help import AlarmText
from controller.program.texts.operator import Text

_LIFT_UP: Final = (
    Text(
        "The lift did not reach its upper switch within its time limit. Its output is off, the arm stands; the "
        "other arm goes to feed.",
        "升降未在规定时间内到达上限位开关。其输出已断开，该臂已停止；另一臂回投苗位。",
    ),
    (
        "lift throttle",
        "upper switch off",
        "lift leak",
        "lift jammed",
        "lift valve",
        "air supply",
    ),
)
_LIFT_DOWN: Final = (
    Text(
        "The lift did not reach its lower switch within its time limit. Its output is off, the arm stands; the "
        "other arm goes to feed.",
        "升降未在规定时间内到达下限位开关。其输出已断开，该臂已停止；另一臂回投苗位。",
    ),
    (
        "lift throttle",
        "lower switch off",
        "lift valve",
        "lift jammed",
        "lift leak",
        "air supply",
    ),
)
_LIFT_DOWN_OVER_CUPS: Final = (_LIFT_DOWN[0], (*_LIFT_DOWN[1], "spread switch off"))
_SLIDE_TO_ROW: Final = (
    Text(
        "The slide did not reach the switch of the row within its time limit. Its output is off, the arm stands; "
        "the other arm goes to feed.",
        "滑块未在规定时间内到达该行开关。其输出已断开，该臂已停止；另一臂回投苗位。",
    ),
    (
        "row switch off",
        "slide leak",
        "slide throttle",
        "air supply",
        "slide valve",
        "slide magnet",
        "slide jammed",
        "lower switch off",
        "lift leak",
        "converged switch off",
    ),
)
_SLIDE_TO_FEED: Final = (
    Text(
        "The slide did not reach its feed switch within its time limit. Its output is off, the arm stands; the "
        "other arm goes to feed.",
        "滑块未在规定时间内到达投苗位开关。其输出已断开，该臂已停止；另一臂回投苗位。",
    ),
    (
        "slide throttle",
        "feed switch off",
        "slide jammed",
        "slide leak",
        "upper switch off",
        "slide valve",
        "slide magnet",
        "air supply",
    ),
)
_SPREAD: Final = (
    Text(
        "The claws did not reach the switch for spread claws within its time limit. Its output is off, the arm "
        "stands; the other arm goes to feed.",
        "夹爪未在规定时间内到达分散开关。其输出已断开，该臂已停止；另一臂回投苗位。",
    ),
    (
        "spread switch off",
        "spreader belt",
        "spreader jammed",
        "feed switch off",
        "upper switch off",
        "spreader drive",
    ),
)
_CONVERGE: Final = (
    Text(
        "The claws did not reach the switch for converged claws within its time limit. Its output is off, the arm "
        "stands; the other arm goes to feed.",
        "夹爪未在规定时间内到达聚合开关。其输出已断开，该臂已停止；另一臂回投苗位。",
    ),
    (
        "converged switch off",
        "spreader jammed",
        "spreader belt",
        "feed switch off",
        "spreader drive",
    ),
)
_CLAWS_CLOSE: Final = (
    Text(
        "The output that closes the claws was not on for its full time: it is blocked, or outputs are delayed. The "
        "arm stands.",
        "夹爪闭合输出未达到规定的接通时间：被联锁或输出被延迟。该臂已停止。",
    ),
    (
        "lower switch off",
        "row switch off",
        "claws blocked",
        "claw valve",
    ),
)
_CLAWS_OPEN: Final = (
    Text(
        "The output that opens the claws was not on for its full time: it is blocked, or outputs are delayed. The "
        "arm stands.",
        "夹爪张开输出未达到规定的接通时间：被联锁或输出被延迟。该臂已停止。",
    ),
    (
        "feed switch off",
        "lower switch off",
        "spread switch off",
        "claws blocked",
        "claw valve",
    ),
)
_CLAWS_OPEN_AT_ROW: Final = (_CLAWS_OPEN[0], _CLAWS_CLOSE[1])

STEP_ALARMS: Final = {
    "approach row": AlarmText(
        Text("{side} slide did not reach the row", "{side}滑块未到达取苗位"),
        *_SLIDE_TO_ROW,
    ),
    "return to row": AlarmText(
        Text("{side} slide did not return to the row", "{side}滑块未退回取苗位"),
        *_SLIDE_TO_ROW,
    ),
    "close claws": AlarmText(
        Text("{side} claws not closed: position or outputs lost", "{side}夹爪未闭合：位置或输出丢失"),
        *_CLAWS_CLOSE,
    ),
    "lift from row": AlarmText(
        Text("{side} arm not up after clamping", "{side}臂夹苗后未升到上限位"),
        *_LIFT_UP,
    ),
    "slide to feed": AlarmText(
        Text("{side} slide did not reach feed while loaded", "{side}滑块带苗未到达投苗位"),
        *_SLIDE_TO_FEED,
        comment="{side} slide did not reach feed, loaded",
    ),
    "spread": AlarmText(
        Text("{side} claws not spread", "{side}夹爪未分散到位"),
        *_SPREAD,
    ),
    "lower over cups": AlarmText(
        Text("{side} arm not down over the cups", "{side}臂在苗杯上方未降到下限位"),
        *_LIFT_DOWN_OVER_CUPS,
    ),
    "open claws": AlarmText(
        Text("{side} claws not opened: position or outputs lost", "{side}夹爪未张开：位置或输出丢失"),
        *_CLAWS_OPEN,
    ),
    "raise empty": AlarmText(
        Text("{side} arm not up after the release", "{side}臂投苗后未升到上限位"),
        *_LIFT_UP,
    ),
    "converge": AlarmText(
        Text("{side} claws not converged", "{side}夹爪未聚合到位"),
        *_CONVERGE,
    ),
    "lower empty": AlarmText(
        Text("{side} arm not down after converging", "{side}臂聚合后未降到下限位"),
        *_LIFT_DOWN,
    ),
    "park": AlarmText(
        Text("{side} arm not up while parking", "{side}臂停放时未升到上限位"),
        *_LIFT_UP,
    ),
    "home: lower to put back": AlarmText(
        Text("Homing: {side} arm not down at the row", "回原点：{side}臂在取苗位未降到下限位"),
        *_LIFT_DOWN,
    ),
    "home: put back": AlarmText(
        Text("Homing: {side} claws not opened at the row", "回原点：{side}夹爪在取苗位未张开"),
        *_CLAWS_OPEN_AT_ROW,
    ),
    "home: raise loaded": AlarmText(
        Text("Homing: {side} arm not up while loaded", "回原点：{side}臂带苗未升到上限位"),
        *_LIFT_UP,
        comment="Homing: {side} arm not up, loaded",
    ),
    "home: raise empty": AlarmText(
        Text("Homing: {side} arm not up while empty", "回原点：{side}臂空载未升到上限位"),
        *_LIFT_UP,
        comment="Homing: {side} arm not up, empty",
    ),
    "home: out": AlarmText(
        Text("Homing: {side} slide did not reach feed", "回原点：{side}滑块未到达投苗位"),
        *_SLIDE_TO_FEED,
    ),
    "home: out low": AlarmText(
        Text("Homing: {side} slide did not reach feed with the arm down", "回原点：{side}滑块低位未到达投苗位"),
        *_SLIDE_TO_FEED,
        comment="Homing: {side} slide did not reach feed with the arm down",
    ),
    "home: raise at feed": AlarmText(
        Text("Homing: {side} arm not up at feed", "回原点：{side}臂在投苗位未升到上限位"),
        *_LIFT_UP,
    ),
    "home: discard, spread": AlarmText(
        Text("Discard: {side} claws not spread", "弃苗：{side}夹爪未分散到位"),
        *_SPREAD,
    ),
    "home: discard, lower": AlarmText(
        Text("Discard: {side} arm not down over the cups", "弃苗：{side}臂未降到下限位"),
        *_LIFT_DOWN_OVER_CUPS,
    ),
    "home: open at feed": AlarmText(
        Text("Homing: {side} claws not opened at feed", "回原点：{side}夹爪在投苗位未张开"),
        *_CLAWS_OPEN,
    ),
    "home: raise to converge": AlarmText(
        Text("Homing: {side} arm not up before converging", "回原点：{side}臂聚合前未升到上限位"),
        *_LIFT_UP,
        comment="Homing: {side} arm not up before converging",
    ),
    "home: converge": AlarmText(
        Text("Homing: {side} claws not converged", "回原点：{side}夹爪未聚合到位"),
        *_CONVERGE,
    ),
    "home: lower": AlarmText(
        Text("Homing: {side} arm not down", "回原点：{side}臂未降到下限位"),
        *_LIFT_DOWN,
    ),
}
"""Texts by key of the alarm."""
