"""Operator texts of the interlocks in English and Chinese: why an output that is requested stays off."""

from __future__ import annotations

from typing import Final

from controller.common.declarations import Declared
from controller.program.texts.operator import Text

_PAIR: Final = Text("the opposite motion is requested as well", "同时要求了相反的动作")

_RULES: Final = {
    **{
        f"not with {name}": _PAIR
        for name in (
            "slide outward",
            "slide inward",
            "lift retract",
            "lift extend",
            "converge",
            "spread",
            "claws close",
            "claws open",
        )
    },
    "motion allowed": Text("the state of the machine allows no motion", "当前状态不允许动作"),
    "no arm fault": Text("an alarm of this arm is active", "该臂有报警"),
    "belt at rest": Text("slide and lift wait until the belt of the claws rests", "夹爪分合时滑块和升降不得动作"),
    "inward ready": Text(
        "inward only with the arm down and empty and the claws open and converged",
        "臂在下限位、无苗、夹爪张开且聚合时才可移入",
    ),
    "tray in place": Text("inward only over a tray at rest in its place", "苗盘到位且静止时才可移入"),
    "stop at the row": Text("the slide is at the next row; seedlings stand beyond it", "滑块已到下一苗行，其后有苗"),
    "centre is free": Text("the other arm is in the centre, or may enter it", "另一臂在中间或可能进入"),
    "outward clear": Text(
        "outward only with the arm up, or down, empty and with open claws",
        "臂在上限位，或在下限位、无苗且夹爪张开时才可移出",
    ),
    "lift clear": Text("over the tray, up only with the claws open or clamped", "在苗盘上方，夹爪张开或夹紧后才可上升"),
    "down at feed only": Text("down only at the feed position", "只可在投苗位下降"),
    "spread only when up at feed": Text(
        "spread only with the arm up at the feed position", "臂在投苗位上限位时才可分散"
    ),
    "converge only when empty at feed": Text("converge only empty at the feed position", "只可在投苗位且无苗时聚合"),
    "not yet spread": Text("the claws are spread already", "夹爪已分散"),
    "not yet converged": Text("the claws are converged already", "夹爪已聚合"),
    "close only at row or feed": Text(
        "close only at the next row with the arm down, or at the feed position", "只可在下一苗行的下限位或投苗位闭合"
    ),
    "release load only at cups or row": Text(
        "a load is released only over the cups or at its own row", "只可在苗杯上方或原苗行松开所夹的苗"
    ),
    "load down only when spread": Text("with a load, down only with spread claws", "带苗时，夹爪分散后才可下降"),
    "guard closed": Text("the guard is open", "安全门打开"),
    "in service": Text("the arm is out of service", "该臂已停用"),
    "arms at feed": Text("the tray moves only with both arms at the feed position", "两臂都在投苗位时苗盘才可移动"),
    "no feeder fault": Text("an alarm of the tray feeder is active", "供盘装置有报警"),
}
RULES: Final = Declared("RULES", __name__, _RULES)
"""Reasons for an output that stays off, by name of `interlocks.Rule`."""

AT_END: Final = Text("already at its end", "已到终点")
"""Reason for a device that does not move although its output is on."""
