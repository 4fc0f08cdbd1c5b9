"""What the page calls the parts of the program: commands, jogs, set-points, sequences, steps, waits and wires.

A key ends in the program's own name of the part; the page puts it together from that name.
"""

from __future__ import annotations

from typing import Final

from controller.program.texts import Text

_COMMANDS: Final = {
    f"command.{name}": text
    for name, text in {
        "reset": Text("Reset and home", "复位回原点"),
        "start": Text("Start", "启动"),
        "stop": Text("Stop", "停止"),
        "hold": Text("Hold", "保持"),
        "unhold": Text("Go on", "解除保持"),
        "suspend": Text("Suspend", "暂挂"),
        "unsuspend": Text("End suspension", "解除暂挂"),
        "abort": Text("Abort", "中止"),
        "clear": Text("Clear", "清除"),
        "complete": Text("Complete", "结束生产"),
        "mode_continuous": Text("Continuous", "连续运行"),
        "mode_manual": Text("Manual", "手动"),
        "mode_one_cycle": Text("One cycle", "单周期"),
        "mode_step": Text("Step", "单步"),
        "mode_zero_return": Text("Zero return", "回原点"),
        "step": Text("Next step", "下一步"),
        "acknowledge": Text("Silence horn", "消音"),
        "cups_empty": Text("The cups are empty", "苗杯已空"),
        "tray_same": Text("The same tray", "原苗盘"),
        "tray_full": Text("A full tray", "满苗盘"),
        "tray_none": Text("No usable tray", "无可用苗盘"),
        "count_reset": Text("Clear the counts", "计数清零"),
        "left_loaded_yes": Text("Left holds seedlings", "左臂有苗"),
        "left_loaded_no": Text("Left holds none", "左臂无苗"),
        "left_discard": Text("Discard left", "左臂弃苗"),
        "right_loaded_yes": Text("Right holds seedlings", "右臂有苗"),
        "right_loaded_no": Text("Right holds none", "右臂无苗"),
        "right_discard": Text("Discard right", "右臂弃苗"),
    }.items()
}

_JOGS: Final = {
    "jog.lift_extend": Text("Arm down", "臂下降"),
    "jog.lift_retract": Text("Arm up", "臂上升"),
    "jog.slide_inward": Text("Slide inward", "滑块向内"),
    "jog.slide_outward": Text("Slide outward", "滑块向外"),
    "jog.converge": Text("Claws converge", "夹爪聚合"),
    "jog.spread": Text("Claws spread", "夹爪分散"),
    "jog.claws_open": Text("Claws open", "夹爪张开"),
    "jog.claws_close": Text("Claws close", "夹爪闭合"),
    "jog.tray_run": Text("Tray forward", "苗盘前进"),
}

_SET_POINTS: Final = {
    f"set.{name}": text
    for name, text in {
        "trays_target": Text("Trays to empty (0 = endless)", "目标苗盘数(0 = 不限)"),
        "step_sequence": Text("Step mode moves (1 left, 2 right, 3 tray)", "单步对象(1 左臂,2 右臂,3 送盘)"),
        "descend_at_count": Text("Cups counted before the arm goes down", "下降前的苗杯计数"),
        "converge_at": Text("Converge (0 down, 1 up)", "聚合位置(0 下,1 上)"),
        "arms_may_meet": Text("Both arms inward of pick 2 (1 = allowed)", "两臂同时进入取苗位 2 以内(1 = 允许)"),
        "release_delay": Text("Release delay after the cup", "苗杯到位后的投苗延时"),
        "no_cups": Text("Waiting without a cup until Suspended", "无苗杯等待时间(之后暂挂)"),
        "pulse_interval": Text("Shortest time between two cups", "两苗杯最短间隔"),
        "settle": Text("Slide at rest before clamping", "夹紧前滑块静止时间"),
        "clamp": Text("Claw closing dwell", "夹爪闭合时间"),
        "release": Text("Claw opening dwell", "夹爪张开时间"),
        "pause_at_feed": Text("Pause at feed before spreading", "投苗位分散前停顿"),
        "tray_index": Text("Tray index at full speed", "苗盘全速送进时间"),
        "slide_least": Text("Shortest time from a row to feed", "苗行到投苗位的最短时间"),
        "no_tray": Text("Creeping without a tray until Suspended", "无苗盘爬行时间(之后暂挂)"),
    }.items()
}

_SEQUENCES: Final = {
    f"sequence.{name}": text
    for name, text in {
        "left arm": Text("Left arm", "左臂循环"),
        "right arm": Text("Right arm", "右臂循环"),
        "left homing": Text("Left homing", "左臂回原点"),
        "right homing": Text("Right homing", "右臂回原点"),
        "tray feeder": Text("Tray feeder", "送盘"),
    }.items()
}

_STEPS: Final = {
    f"step.{title}": Text(title, chinese)
    for title, chinese in {
        "wait at feed": "投苗位等待",
        "approach row": "移向苗行",
        "settle at row": "苗行处稳定",
        "return to row": "返回苗行",
        "close claws": "夹爪闭合",
        "lift from row": "提苗",
        "slide to feed": "移向投苗位",
        "pause at feed": "投苗位停顿",
        "spread": "分散",
        "wait to lower": "等待下降",
        "lower over cups": "下降到苗杯上方",
        "wait for cups": "等待苗杯",
        "release delay": "投苗延时",
        "open claws": "夹爪张开",
        "raise empty": "空载上升",
        "converge": "聚合",
        "lower empty": "空载下降",
        "park": "停放",
        "parked": "已停放",
        "decide": "判断",
        "lower to put back": "下降放回",
        "put back": "放回",
        "raise loaded": "带苗上升",
        "out": "上位移出",
        "out low": "下位移出",
        "raise at feed": "投苗位上升",
        "discard, spread": "弃苗,分散",
        "discard, lower": "弃苗,下降",
        "open at feed": "投苗位张开",
        "raise to converge": "上升以聚合",
        "lower": "下降",
        "press to feed": "压向投苗位",
        "homed": "已回原点",
        "wait for an empty tray": "等待空盘",
        "move tray out": "移出苗盘",
        "index": "送进",
        "met in the index": "送进中遇盘",
        "creep": "爬行",
        "no tray": "无苗盘",
        "settle": "稳定",
    }.items()
}

_WAITS: Final = {
    f"waits.{what}": Text(what, chinese)
    for what, chinese in {
        "a full row": "满苗行",
        "cups": "苗杯",
        "twelve empty cups": "十二个空苗杯",
        "reset and start": "复位和启动",
        "an answer of the operator": "操作员回答",
        "start": "启动",
        "the tray to be empty, arms at feed": "苗盘取空且两臂在投苗位",
        "a tray in the magazine, then start": "盘仓有盘,然后启动",
    }.items()
}

_POINTS: Final = {
    f"point.{tag}": text
    for tag, text in {
        "start": Text("start button pressed", "启动按钮按下"),
        "stop": Text("stop button pressed", "停止按钮按下"),
        "emergency_stop": Text("emergency stop pressed", "急停按下"),
        "reset": Text("reset button pressed", "复位按钮按下"),
        "air_pressure_ok": Text("main air pressure is high enough", "主气压足够"),
        "magazine_empty": Text("no tray left in the magazine", "盘仓无盘"),
        "tray_front_edge": Text("front edge of a tray is seen", "检测到苗盘前沿"),
        "tray_run": Text("tray stepper runs", "苗盘步进电机运行"),
        "tray_forward": Text("tray stepper turns forward", "苗盘步进电机正转"),
        "horn": Text("horn sounds", "蜂鸣器响"),
        "lamp_red": Text("tower lamp red", "塔灯红"),
        "lamp_amber": Text("tower lamp amber", "塔灯黄"),
        "lamp_green": Text("tower lamp green", "塔灯绿"),
        "lift_down": Text("lift at its lower limit", "升降在下限位"),
        "lift_up": Text("lift at its upper limit", "升降在上限位"),
        "slide_at_feed": Text("slide at feed, over the cups", "滑块在投苗位"),
        "slide_at_pick_1": Text("slide at pick 1, nearest the cups", "滑块在取苗位 1(最外行)"),
        "slide_at_pick_2": Text("slide at pick 2", "滑块在取苗位 2"),
        "slide_at_pick_3": Text("slide at pick 3, innermost", "滑块在取苗位 3(最内行)"),
        "claws_spread": Text("claws at cup pitch", "夹爪为杯距"),
        "claws_converged": Text("claws at tray pitch", "夹爪为盘距"),
        "cup_pulse": Text("a cup passes the counter", "苗杯经过计数器"),
        "lift_extend": Text("lift cylinder extends: arm down", "升降缸伸出:臂下降"),
        "lift_retract": Text("lift cylinder retracts: arm up", "升降缸缩回:臂上升"),
        "slide_inward": Text("slide moves to the tray", "滑块移向苗盘"),
        "slide_outward": Text("slide moves to the cups", "滑块移向苗杯"),
        "converge": Text("motor brings claws to tray pitch", "电机使夹爪聚合"),
        "spread": Text("motor brings claws to cup pitch", "电机使夹爪分散"),
        "claws_open": Text("claws open", "夹爪张开"),
        "claws_close": Text("claws close", "夹爪闭合"),
    }.items()
}
"""Wires by their tag; those of an arm without the side, which the page puts in front."""

NAMES: Final = {**_COMMANDS, **_JOGS, **_SET_POINTS, **_SEQUENCES, **_STEPS, **_WAITS, **_POINTS}
"""All of them by key."""
