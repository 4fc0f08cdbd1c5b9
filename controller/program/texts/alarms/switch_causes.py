"""Causes of alarms in the switches and sensors: each does not come on, or stays on."""

from __future__ import annotations

from typing import Final, NamedTuple

from controller.program.texts.alarms.help import Cause
from controller.program.texts.operator import Text


class _Switch(NamedTuple):
    """Switch or group of equal switches.

    Attributes:
        name: Name of the switch.
        reached: Situation in which it must be on.
        location: Key in `LOCATIONS`.
        points: Tags, without the side.
        both_sides: True if the switch of the other arm may be the cause, too.
    """

    name: Text
    reached: Text
    location: str
    points: tuple[str, ...]
    both_sides: bool = False


_SWITCHES: Final = {
    "upper switch": _Switch(
        Text("Upper switch of the lift", "升降上限位开关"), Text("the arm up", "臂在上限位"), "lift", ("lift_up",)
    ),
    "lower switch": _Switch(
        Text("Lower switch of the lift", "升降下限位开关"), Text("the arm down", "臂在下限位"), "lift", ("lift_down",)
    ),
    "feed switch": _Switch(
        Text("Feed switch of the slide", "滑块投苗位开关"),
        Text("the slide at feed", "滑块在投苗位"),
        "feed_switch",
        ("slide_at_feed",),
    ),
    "row switch": _Switch(
        Text("Row switch of the slide", "滑块取苗位开关"),
        Text("the slide at the row", "滑块在该行"),
        "row_switches",
        ("slide_at_pick_1", "slide_at_pick_2", "slide_at_pick_3"),
    ),
    "spread switch": _Switch(
        Text("Switch for spread claws", "夹爪分散开关"),
        Text("the claws spread", "夹爪分散"),
        "spreader",
        ("claws_spread",),
    ),
    "converged switch": _Switch(
        Text("Switch for converged claws", "夹爪聚合开关"),
        Text("the claws converged", "夹爪聚合"),
        "spreader",
        ("claws_converged",),
    ),
    "cup counter": _Switch(
        Text("Cup counter", "苗杯计数器"),
        Text("a flag at the counter", "感应片在计数器处"),
        "cups",
        ("cup_pulse",),
        both_sides=True,
    ),
    "tray sensor": _Switch(
        Text("Tray sensor", "苗盘传感器"), Text("a tray in position", "苗盘在位"), "tray_sensor", ("tray_front_edge",)
    ),
}


def _off(switch: _Switch) -> Cause:
    """Return the cause of a switch that does not come on."""
    return Cause(
        Text(f"{switch.name.en} does not come on, or its wire is broken", f"{switch.name.zh}不接通或断线"),
        Text(
            f"With {switch.reached.en}, the input must be on (I/O page); lamp of the switch lit and input off: wire",
            f"{switch.reached.zh}时，输入应接通（见输入输出页面）；开关指示灯亮而输入断开：断线",
        ),
        switch.location,
        Text(
            "Isolate first. Position of the switch, dirt, plug, wire, terminal",
            "先断电断气并上锁。检查开关位置、脏污、插头、接线和端子",
        ),
        switch.points,
        both_sides=switch.both_sides,
    )


def _on(switch: _Switch) -> Cause:
    """Return the cause of a switch that stays on."""
    return Cause(
        Text(f"{switch.name.en} stays on, or goes off late", f"{switch.name.zh}一直接通或断开过晚"),
        Text(
            f"Without {switch.reached.en}, the input must be off (I/O page); compare with the lamp of the switch",
            f"不是{switch.reached.zh}时，输入应断开（见输入输出页面）；与开关指示灯对照",
        ),
        switch.location,
        Text(
            "Isolate first. Welded contact, metal or dirt in front of the switch, wires shorted or swapped",
            "先断电断气并上锁。检查触点粘连、开关前的金属物或脏污、接线短路或接反",
        ),
        switch.points,
        both_sides=switch.both_sides,
    )


SWITCH_CAUSES: Final = {
    f"{key} {state}": make(switch) for key, switch in _SWITCHES.items() for state, make in (("off", _off), ("on", _on))
}
"""Causes by the key of the switch and "off" or "on"."""
