"""Parts of the machine at which the causes of alarms are found; docs/machine.svg shows where they are."""

from __future__ import annotations

from typing import Final

from controller.common.declarations import Declared
from controller.program.texts.operator import Text

_ARM_LOCATIONS: Final = {
    "lift": Text("lift", "升降"),
    "slide": Text("slide", "滑块"),
    "spreader": Text("spreader of the claws", "夹爪分散机构"),
    "claws": Text("claws", "夹爪"),
    "cups": Text("cups and their counter", "苗杯及其计数器"),
    "feed_switch": Text("slide switch at feed", "滑块投苗位开关"),
    "row_switches": Text("slide switches at the rows", "滑块取苗位开关"),
}
_MACHINE_LOCATIONS: Final = {
    "tray": Text("tray", "苗盘"),
    "tray_sensor": Text("tray sensor", "苗盘传感器"),
    "conveyor": Text("tray conveyor", "苗盘输送带"),
    "magazine": Text("tray magazine", "苗盘仓"),
    "cabinet": Text("control cabinet and panel", "控制柜和操作面板"),
    "air_supply": Text("air supply", "气源"),
    "ground_wheel": Text("tractor and ground wheel", "拖拉机和地轮"),
}
ARM_LOCATIONS: Final = frozenset(_ARM_LOCATIONS)
"""Parts that each arm has."""
OUTSIDE: Final = frozenset({"cabinet", "air_supply"})
"""Parts outside the machine, at which nothing moves."""
LOCATIONS: Final = Declared("LOCATIONS", __name__, _ARM_LOCATIONS | _MACHINE_LOCATIONS)
"""Names of the parts, without the side."""
