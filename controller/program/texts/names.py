"""Display names of the parts of the program: commands, jogs, set-points, sequences, steps, conditions and I/O points.

A key consists of a prefix and the name that the program uses for the part.
"""

from __future__ import annotations

from typing import Final

from controller.iomap.loader import POINT_NAMES
from controller.program.operator.commands import TRAY_ROWS
from controller.program.texts.operator import SIDES, Text

_COMMANDS: Final = {
    f"command.{name}": text
    for name, text in {
        "reset": Text("Reset and home", "复位并回原点"),
        "start": Text("Start", "启动"),
        "stop": Text("Stop after cycle", "循环后停止"),
        "hold": Text("Hold", "保持"),
        "unhold": Text("Resume", "解除保持"),
        "suspend": Text("Suspend", "暂挂"),
        "unsuspend": Text("Unsuspend", "解除暂挂"),
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
        "cups_empty": Text("Cups empty", "苗杯为空"),
        "tray_same": Text("Same tray", "原苗盘"),
        "tray_full": Text("Full tray", "满苗盘"),
        "tray_none": Text("No usable tray", "无可用苗盘"),
        "count_reset": Text("Reset counters", "计数清零"),
        "left_loaded_yes": Text("Left arm loaded", "左臂有苗"),
        "left_loaded_no": Text("Left arm empty", "左臂无苗"),
        "left_discard": Text("Discard left", "左臂弃苗"),
        "right_loaded_yes": Text("Right arm loaded", "右臂有苗"),
        "right_loaded_no": Text("Right arm empty", "右臂无苗"),
        "right_discard": Text("Discard right", "右臂弃苗"),
        "jog_release": Text("End jog", "结束点动"),
        **{
            f"{side}_row_{row}_empty": Text(f"{name.en.capitalize()} row {row} empty", f"{name.zh}臂苗行 {row} 为空")
            for side, name in SIDES.items()
            for row in TRAY_ROWS
        },
        "rows_full": Text("All rows full", "各行均满"),
        "left_out_of_service": Text("Left arm out of service", "停用左臂"),
        "left_in_service": Text("Left arm in service", "启用左臂"),
        "right_out_of_service": Text("Right arm out of service", "停用右臂"),
        "right_in_service": Text("Right arm in service", "启用右臂"),
        "empty_line": Text("Empty the line", "清空生产线"),
        "new_machine": Text("New machine", "新机器"),
    }.items()
}

_REMARKS: Final = {
    "remark.new_machine": Text(
        "The memory is lost. Only for a new machine, at its installation: the next homing conveys out any tray, with "
        "its seedlings.",
        "保持数据丢失。仅用于新机器安装时：下次回原点时送出苗盘和盘中的苗。",
    ),
}
"""Remarks beside commands."""

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
        "trays_target": Text("Target number of trays (0 = unlimited)", "目标苗盘数（0 = 不限）"),
        "step_sequence": Text(
            "Sequence of step mode (1 left arm, 2 right arm, 3 tray)", "单步对象（1 左臂，2 右臂，3 送盘）"
        ),
        "descend_at_count": Text("Cup count at which the arm goes down", "臂开始下降时的苗杯计数"),
        "converge_at": Text("Converge position (0 = down, 1 = up)", "聚合位置（0 = 下，1 = 上）"),
        "arms_may_meet": Text("Both arms inward of pick 2 (1 = allowed)", "两臂同时进入取苗位 2 以内（1 = 允许）"),
        "release_delay": Text("Release delay after the cup (0 = measured)", "苗杯到位后的投苗延时（0 = 实测）"),
        "no_cups": Text("Cup timeout until Suspended", "无苗杯超时（之后暂挂）"),
        "pulse_interval": Text("Minimum time between two cups", "两苗杯最短间隔"),
        "settle": Text("Slide settling time before clamping", "夹紧前滑块静止时间"),
        "clamp": Text("Claw closing dwell", "夹爪闭合时间"),
        "release": Text("Claw opening dwell", "夹爪张开时间"),
        "pause_at_feed": Text("Pause at feed before spreading", "投苗位分散前停顿"),
        "tray_index": Text("Tray index time at full speed", "苗盘全速送进时间"),
        "slide_least": Text("Minimum slide time between row and feed", "苗行与投苗位之间的最短移动时间"),
        "ground_pulse": Text("Travel per ground pulse", "每个地轮脉冲的行程"),
        "planter_pitch": Text("Distance of the planters on the chain", "链条上栽植器间距"),
        "lambda_lowest": Text("Lowest lambda", "λ 下限"),
        "lambda_highest": Text("Highest lambda", "λ 上限"),
        "planter_lambda": Text("Lambda of a driven planter", "自带电机栽植器的 λ"),
        "planter_speed": Text("Chain speed of a driven planter", "自带电机栽植器的链条速度"),
        "cup_time_shortest": Text("Shortest permitted time from cup to cup", "苗杯最短允许间隔时间"),
        "cup_time_longest": Text("Longest time from cup to cup with a release", "允许投苗的苗杯最长间隔时间"),
        "ground_pulses_least": Text("Least ground pulses from cup to cup", "相邻苗杯间最少地轮脉冲数"),
        "ground_pulses_most": Text("Most ground pulses from cup to cup", "相邻苗杯间最多地轮脉冲数"),
        "missing_most": Text("Largest number of seedlings missing in a row", "一行允许的最多缺苗数"),
        "no_tray": Text("Tray timeout at creep speed until Suspended", "无苗盘爬行超时（之后暂挂）"),
        "release_lead": Text("Release ahead of the cup", "投苗提前时间"),
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
        "out": "高位移出",
        "out low": "低位移出",
        "raise at feed": "投苗位上升",
        "discard, spread": "弃苗：分散",
        "discard, lower": "弃苗：下降",
        "open at feed": "投苗位张开",
        "raise to converge": "上升以聚合",
        "lower": "下降",
        "pressurise at feed": "压向投苗位",
        "press down at feed": "投苗位下压",
        "homed": "已回原点",
        "wait for an empty tray": "等待空盘",
        "move tray out": "移出苗盘",
        "index": "送进",
        "tray in the gap": "送进中遇盘",
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
        "an answer from the operator": "操作员回答",
        "start": "启动",
        "an empty tray and both arms at feed": "苗盘取空且两臂在投苗位",
        "a tray in the magazine, then start": "苗盘仓补盘，然后启动",
    }.items()
}

_POINTS: Final = {f"point.{tag}": Text(*name) for tag, name in POINT_NAMES.items()}

_CONDITIONS: Final = {
    f"condition.{name}": Text(english, chinese)
    for name, (english, chinese) in {
        "converge at": ("converge position", "聚合位置设定"),
        "descend at count": ("cup count for lowering", "下降计数设定"),
        "emptying": ("emptying the line", "正在清空苗盘线"),
        "entered Starting": ("entering Starting", "进入启动状态"),
        "holding": ("in Holding", "处于保持中状态"),
        "stopping": ("in Stopping", "处于停止中状态"),
        "start requested": ("start requested", "有启动请求"),
        "ask loaded": ("load in question", "待确认是否持苗"),
        "at feed": ("slide at feed", "滑块在投苗位"),
        "at next row": ("slide at the next row", "滑块在目标苗行"),
        "claws closed": ("last claw command: close", "夹爪指令为闭合"),
        "clamped": ("clamping dwell elapsed", "夹紧时间到"),
        "claws closing": ("closing dwell elapsed", "闭合时间到"),
        "claws opening": ("opening dwell elapsed", "张开时间到"),
        "count good": ("twelve empty cups in position", "十二个空苗杯到位"),
        "cups": ("cup count", "苗杯计数"),
        "cycle permit": ("cycle permitted", "允许循环"),
        "discard": ("discard requested", "要求弃苗"),
        "down": ("arm down", "臂在下限位"),
        "is converged": ("claws converged", "夹爪已聚合"),
        "is spread": ("claws spread", "夹爪已分散"),
        "lift_down": ("lower switch of the lift on", "升降下限位开关接通"),
        "lift_up": ("upper switch of the lift on", "升降上限位开关接通"),
        "loaded": ("arm loaded", "臂带苗"),
        "on row": ("claws closed at the row", "夹爪在苗行闭合"),
        "park": ("park requested", "要求停放"),
        "pause at feed": ("pause at feed elapsed", "投苗位停顿时间到"),
        "pressurise at feed": ("pressurising time elapsed", "压紧时间到"),
        "press down at feed": ("pressing time elapsed", "下压时间到"),
        "release delay": ("release delay elapsed", "投苗延时到"),
        "release due": ("cup in position, release now", "苗杯到位，投苗"),
        "release missed": ("cup left empty, its pulse is in doubt", "脉冲可疑，空过此杯"),
        "release edge": ("release cup detected", "检测到投苗苗杯"),
        "retried": ("row retried", "已重新返回苗行"),
        "row in progress": ("row in progress", "苗行取苗中"),
        "settle": ("settling time elapsed", "稳定时间到"),
        "slide_at_feed": ("feed switch on", "投苗位开关接通"),
        "up": ("arm up", "臂在上限位"),
        "tray.index": ("index time elapsed", "送进时间到"),
        "tray.in gap": ("tray in the gap too long", "间隙内遇盘超时"),
        "tray.no tray": ("tray timeout elapsed", "无苗盘超时"),
        "tray.permit": ("feeder permitted", "允许送盘"),
        "tray.phase": ("tray", "苗盘状态"),
        "tray.place known": ("place of the tray known", "苗盘位置已确认"),
        "tray.settle": ("settling time elapsed", "稳定时间到"),
        "tray_front_edge": ("tray front edge detected", "检测到苗盘前沿"),
    }.items()
}
"""Tags in the transitions of the step charts; tags of an arm are listed without the side."""

NAMES: Final = {
    **_COMMANDS,
    **_REMARKS,
    **_JOGS,
    **_SET_POINTS,
    **_SEQUENCES,
    **_STEPS,
    **_WAITS,
    **_POINTS,
    **_CONDITIONS,
}
"""All display names by key."""
