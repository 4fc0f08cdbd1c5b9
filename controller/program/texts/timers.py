"""Chinese names of the timers. Their tags are English; a time limit of a step is named by the step."""

from __future__ import annotations

from typing import Final

LIMIT: Final = "limit: "
"""Beginning of the tag of a time limit, without the side."""
LIMIT_ZH: Final = "限时："
HOME: Final = "home: "
"""Beginning of the title of a homing step in such a tag."""
HOME_ZH: Final = "回原点："

TIMERS: Final = {
    "belt in doubt": "夹爪间距存疑",
    "belt pressed": "夹爪间距压紧",
    "belt travel": "夹爪间距行程时间",
    "cup": "苗杯周期",
    "cups slow": "苗杯过慢",
    "jog lease": "点动续期",
    "lift in doubt": "升降位置存疑",
    "lift pressed": "升降压紧",
    "lift travel": "升降行程时间",
    "limit: off home": "限时：离开原点",
    "no cups": "无苗杯",
    "no motion": "无动作",
    "planting.cups gap": "苗杯间隔",
    "planting.cups timer": "苗杯计时",
    "planting.left row": "左臂苗行计时",
    "planting.left wait": "左臂等待计时",
    "planting.right row": "右臂苗行计时",
    "planting.right wait": "右臂等待计时",
    "planting.too fast": "栽植过快",
    "pulse interval": "脉冲间隔",
    "question lamp": "提问指示灯",
    "raising": "上升",
    "refusal lamp": "拒绝指示灯",
    "rest": "静止",
    "slide in doubt": "滑块位置存疑",
    "slide pressed": "滑块压紧",
    "slide travel": "滑块行程时间",
    "slide travel between rows": "滑块行间行程时间",
    "start closed": "启动按钮闭合",
    "step press": "单步按键",
    "stop closed": "停止按钮闭合",
    "switch changed at rest": "静止时开关变化",
    "tray.creep off": "爬行断开",
    "tray.creep on": "爬行接通",
    "tray.exit": "苗盘移出",
    "tray.jam": "苗盘卡住",
    "tray.lost": "苗盘丢失",
}
"""Name of each timer whose tag is in no other table; tags of an arm are listed without the side."""
