"""Texts about the devices of the field I/O in English and Chinese; ``{device}`` is a name with an address."""

from __future__ import annotations

from typing import Final, Literal

from controller.program.texts.operator import Text

FieldChange = Literal["lost", "back", "tripped", "reset", "gap", "slow", "prompt"]

FIELD_CHANGES: Final[dict[FieldChange, Text]] = {
    "lost": Text("field device {device} lost; all outputs off", "现场设备 {device} 通信中断，全部输出已切断"),
    "back": Text("field device {device} responds again", "现场设备 {device} 通信恢复"),
    "tripped": Text(
        "output watchdog of field device {device} has tripped; it is reset when the abort is cleared",
        "现场设备 {device} 的输出看门狗已动作，清除中止后复位",
    ),
    "reset": Text("output watchdog of field device {device} reset", "现场设备 {device} 的输出看门狗已复位"),
    "gap": Text(
        "field device {device} was not written within the time of its output watchdog; all outputs off",
        "现场设备 {device} 未在其输出看门狗时间内被写入，全部输出已切断",
    ),
    "slow": Text("field device {device} answers too slowly; scans are late", "现场设备 {device} 应答过慢，扫描延迟"),
    "prompt": Text("field device {device} answers in time again", "现场设备 {device} 应答恢复正常"),
}
NAMED: Final = Text("{message}: {devices}", "{message}：{devices}")
"""Message of the alarm of the field link with the names of the devices."""
