"""Alarm texts of an arm outside the time limits of its steps."""

from __future__ import annotations

from typing import Final

from controller.program.texts.alarms.help import AlarmText
from controller.program.texts.operator import Text

ARM_ALARMS: Final = {
    "overrun": AlarmText(
        Text("{side} slide moved off the pick position after arriving", "{side}滑块到位后又离开取苗位"),
        Text(
            "The slide had reached the row and then left its switch. The arm stands; the other arm goes to feed.",
            "滑块到达该行后又离开其开关。该臂已停止；另一臂回投苗位。",
        ),
        (
            "slide valve",
            "slide fast",
            "row switch off",
            "slide leak",
        ),
        comment="{side} slide left the pick position after arriving",
    ),
    "off home": AlarmText(
        Text("{side} arm moved off the home position without a command", "{side}臂自行离开原位"),
        Text(
            "An arm at rest is no longer at its home position. The machine is held.", "静止的臂已不在原位。机器已保持。"
        ),
        (
            "not in service",
            "pushed",
            "lift leak",
            "lower switch off",
            "feed switch off",
            "converged switch off",
        ),
        comment="{side} arm left home without a command",
    ),
    "unbidden": AlarmText(
        Text("{side} arm: a switch changed without a command", "{side}臂：无指令时开关状态改变"),
        Text(
            "A switch of an arm at rest has changed although no motion was commanded. The machine is held.",
            "没有动作指令，而静止臂的开关状态改变。机器已保持。",
        ),
        (
            "lift leak",
            "spread switch off",
            "feed switch off",
            "lower switch off",
            "pushed",
            "slide leak",
        ),
    ),
    "lift switches": AlarmText(
        Text("{side} lift: both switches on, or a switch on too early", "{side}升降：上、下限位开关同时接通或过早接通"),
        Text(
            "Two switches of the lift are on at the same time, or one came on sooner than the stroke can end. The "
            "arm stands.",
            "升降的两个开关同时接通，或其中一个早于行程可能结束的时间接通。该臂已停止。",
        ),
        (
            "lift leak",
            "upper switch on",
            "lower switch on",
            "feed switch off",
            "lift jammed",
        ),
        comment="{side} lift: both switches on, or one too early",
    ),
    "slide switches": AlarmText(
        Text("{side} slide: two switches on, or a switch on too early", "{side}滑块：两个位置开关同时接通或过早接通"),
        Text(
            "Two switches of the slide are on at the same time, or one came on sooner than the stroke can end. The "
            "arm stands.",
            "滑块的两个开关同时接通，或其中一个早于行程可能结束的时间接通。该臂已停止。",
        ),
        (
            "row switch on",
            "slide leak",
            "feed switch on",
            "tray sensor off",
            "slide fast",
            "slide jammed",
        ),
        comment="{side} slide: two switches on, or one too early",
    ),
    "belt switches": AlarmText(
        Text(
            "{side} claws: spread and converged both on, or on too early",
            "{side}夹爪：分散、聚合开关同时接通或过早接通",
        ),
        Text(
            "Both switches of the spreader are on at the same time, or one came on sooner than the stroke can end. "
            "The arm stands.",
            "夹爪分散机构的两个开关同时接通，或其中一个早于行程可能结束的时间接通。该臂已停止。",
        ),
        (
            "converged switch on",
            "spread switch on",
        ),
        comment="{side} claws: spread and converged at once, or too early",
    ),
    "row short": AlarmText(
        Text("{side} row: too many seedlings missing", "{side}行：缺苗过多"),
        Text(
            "More seedlings of a row are missing than permitted, in the claws or in the cups behind them. The arms "
            "complete their stroke, and the machine is held.",
            "夹爪中或其后方苗杯中，一行缺苗超过允许数。两臂完成当前行程后机器保持。",
        ),
        (
            "row not picked",
            "claw valve",
            "seedlings beside the cups",
            "yield sensor",
        ),
    ),
    "claw pressure": AlarmText(
        Text("{side} claws closed without pressure", "{side}夹爪闭合但无气压"),
        Text(
            "The claws are closed, and the air that presses them together has escaped. Seedlings may have been "
            "dropped. The arms complete their stroke, and the machine is held.",
            "夹爪已闭合，但闭合气压已失去，苗可能已掉落。两臂完成当前行程后机器保持。",
        ),
        (
            "claw leak",
            "claw valve",
            "claw pressure switch",
        ),
    ),
}
"""Texts by key of the alarm."""
