"""Alarm texts of the cup counters."""

from __future__ import annotations

from typing import Final

from controller.program.texts.alarms.help import AlarmText
from controller.program.texts.operator import Text

CUP_ALARMS: Final = {
    "cup counts": AlarmText(
        Text("{side} row has counted two cups, the other row none", "{side}行已计两个苗杯，另一行没有计数"),
        Text(
            "The counters of the two rows contradict each other, so the controller does not know where the cups "
            "are. The arms complete their stroke, and the machine is held.",
            "两行计数器相互矛盾，控制器无法确定苗杯位置。两臂完成当前行程后机器保持。",
        ),
        (
            "cup counter off",
            "cup flags",
            "cups stopped",
            "cup counter on",
        ),
    ),
    "cups_fast": AlarmText(
        Text("Cups pass faster than permitted", "苗杯通过速度超过允许值"),
        Text(
            "The cups pass faster than the set limit. The arms complete their stroke, and the machine is held.",
            "苗杯通过速度超过设定限值。两臂完成当前行程后机器保持。",
        ),
        (
            "tractor fast",
            "cup counter on",
            "cup flags",
        ),
    ),
    "cups_implausible": AlarmText(
        Text("Cup pulses follow faster than the cups can", "苗杯脉冲间隔小于苗杯可能的间隔"),
        Text(
            "Pulses of the cups follow faster than cups can. The arms complete their stroke, and the machine is held.",
            "苗杯脉冲间隔小于苗杯可能的间隔。两臂完成当前行程后机器保持。",
        ),
        (
            "cup flags",
            "cup counter on",
            "tractor fast",
        ),
    ),
    "cups_ground": AlarmText(
        Text("Cups do not agree with the ground travel", "苗杯计数与地轮行程不符"),
        Text(
            "The number of cups does not fit the distance travelled. The arms complete their stroke, and the "
            "machine is held.",
            "苗杯数与行驶距离不符。两臂完成当前行程后机器保持。",
        ),
        (
            "ground wheel",
            "cup flags",
        ),
    ),
    "cups_slow": AlarmText(
        Text("Cups pass more slowly than permitted; the arms wait", "苗杯通过速度低于允许值，机械臂等待"),
        Text(
            "The cups pass more slowly than the limit for a release. The loaded arms wait.",
            "苗杯通过速度低于允许投苗的限值。带苗的臂等待。",
        ),
        ("tractor slow",),
    ),
}
"""Texts by key of the alarm."""
