"""Alarm texts of the machine as a whole."""

from __future__ import annotations

from typing import Final

from controller.program.texts.alarms.help import AlarmText
from controller.program.texts.operator import Text

MACHINE_ALARMS: Final = {
    "emergency_stop": AlarmText(
        Text("Emergency stop pressed", "急停按钮已按下"),
        Text(
            "The emergency stop is pressed. All outputs are off until the abort is cleared.",
            "急停已按下。清除中止前所有输出保持断开。",
        ),
        (
            "emergency button",
            "emergency wire",
        ),
    ),
    "guard_open": AlarmText(
        Text("Guard opened during motion", "运动中安全门被打开"),
        Text(
            "The guard was opened while the machine worked. All outputs went off, and the arms may have stopped in "
            "mid-stroke. Nothing moves when it is closed.",
            "机器工作时安全门被打开。所有输出已断开，机械臂可能停在行程中间。关门后不会自行动作。",
        ),
        ("guard", "guard wire"),
    ),
    "link_lost": AlarmText(
        Text("Field link lost; outputs off", "现场通信中断，输出已切断"),
        Text(
            "The controller no longer exchanges inputs and outputs with the I/O module. All outputs are off.",
            "控制器与输入输出模块的通信中断。所有输出已断开。",
        ),
        ("field link",),
    ),
    "scan_fault": AlarmText(
        Text("Scan time exceeded or scan failed; outputs off", "扫描超时或出错，输出已切断"),
        Text(
            "The controller took too long for one scan, or its program failed. All outputs are off.",
            "控制器一次扫描超时或程序出错。所有输出已断开。",
        ),
        ("computer busy",),
    ),
    "store_fault": AlarmText(
        Text("Retentive memory cannot be stored", "保持数据无法保存"),
        Text(
            "The state of arms, rows and tray can no longer be saved. All outputs are off.",
            "机械臂、苗行和苗盘的状态无法保存。所有输出已断开。",
        ),
        ("disk",),
    ),
    "memory_lost": AlarmText(
        Text("Retentive memory lost", "保持数据丢失"),
        Text(
            "The saved state is lost. The controller assumes loaded claws and asks; set-points have their "
            "defaults, both arms are in service, the mode is continuous.",
            "已保存的状态丢失。控制器假定夹爪有苗并询问；设定值恢复为默认值，两臂均已启用，模式为连续运行。",
        ),
        ("memory file",),
    ),
    "air_low": AlarmText(
        Text("Air pressure low", "气压过低"),
        Text(
            "The switch for the main air pressure has been off for half a second. The machine is held.",
            "主气压开关断开已超过半秒。机器已保持。",
        ),
        ("air supply",),
    ),
    "tray_jam": AlarmText(
        Text("Tray did not leave the pick position", "苗盘未离开取苗位"),
        Text(
            "The tray did not leave the pick position within its time limit, or another one came under the sensor. "
            "The conveyor is off.",
            "苗盘未在规定时间内离开取苗位，或另一苗盘进入传感器下方。输送带已停止。",
        ),
        (
            "tray sensor on",
            "stepper",
            "conveyor jammed",
            "tray follows",
            "feed switch off",
        ),
    ),
    "tray_lost": AlarmText(
        Text("Tray missing at the pick position", "取苗位苗盘丢失"),
        Text(
            "The tray at the pick position is no longer detected. The machine is held.",
            "取苗位的苗盘不再被检测到。机器已保持。",
        ),
        (
            "tray sensor off",
            "tray moved",
        ),
    ),
    "magazine_empty": AlarmText(
        Text("Tray magazine empty", "苗盘仓已空"),
        Text(
            "The magazine contains no more trays. Work continues with the tray on the conveyor.",
            "苗盘仓内已无苗盘。输送带上的苗盘继续作业。",
        ),
        ("magazine empty",),
    ),
    "stop_stuck": AlarmText(
        Text("Stop button pressed or its wire broken: start not possible", "停止按钮或其线路断开，无法启动"),
        Text(
            "The input of the stop button reads pressed. The machine cannot be started.",
            "停止按钮输入显示为按下。机器不能启动。",
        ),
        (
            "stop button",
            "stop wire",
        ),
    ),
    "start_stuck": AlarmText(
        Text("Start button closed for more than 10 s: no effect until it opens", "启动按钮接通超过 10 秒：断开前无效"),
        Text(
            "The start button has been closed for more than 10 s. It has no effect until it opens.",
            "启动按钮接通超过 10 秒。断开前无效。",
        ),
        ("start button",),
    ),
    "reset_stuck": AlarmText(
        Text("Reset button closed for more than 10 s: no effect until it opens", "复位按钮接通超过 10 秒：断开前无效"),
        Text(
            "The reset button has been closed for more than 10 s. It has no effect until it opens.",
            "复位按钮接通超过 10 秒。断开前无效。",
        ),
        ("reset button",),
    ),
    "constants": AlarmText(
        Text("A machine constant differs from its default", "机器常数与默认值不同"),
        Text("A machine constant differs from its default. Work continues.", "某个机器常数与默认值不同。作业继续。"),
        ("constants",),
    ),
    "hmi_silent": AlarmText(
        Text("Operator panel not responding: holding after the current cycle", "操作面板无响应：完成当前循环后保持"),
        Text(
            "The panel no longer answers. The machine is held after the current cycle.",
            "操作面板不再应答。当前循环完成后机器保持。",
        ),
        ("panel off",),
    ),
    "lambda": AlarmText(
        Text(
            "Planter chain too slow or too fast for the ground speed (lambda)",
            "栽植器链条速度与前进速度不匹配（λ 超出范围）",
        ),
        Text(
            "The ratio of chain speed to ground speed is outside its limits: seedlings may tip. Work continues.",
            "链条速度与前进速度之比超出范围：苗可能倾倒。作业继续。",
        ),
        (
            "planter drive",
            "ground wheel",
        ),
    ),
    "outputs_taken": AlarmText(
        Text("Outputs taken over by another controller; nothing is written", "输出被另一控制器占用，已停止写输出"),
        Text(
            "Another controller has written the outputs. This controller no longer writes any.",
            "另一控制器写了输出。本控制器已停止写输出。",
        ),
        ("second master",),
        comment="Outputs taken over by another controller",
    ),
    "outputs_contested": AlarmText(
        Text("Another controller tried to write the outputs and was refused", "另一控制器试图写输出，已被拒绝"),
        Text(
            "Another controller tried to write the outputs. It was refused, and work continues.",
            "另一控制器试图写输出，已被拒绝，作业继续。",
        ),
        ("second master",),
        comment="Another controller tried to write the outputs",
    ),
    "planting_fast": AlarmText(
        Text("Planting faster than the arms: gaps in the rows", "栽植频率超过机械臂能力，将出现漏苗"),
        Text(
            "The planting frequency is higher than the arms can follow: gaps in the rows. Work continues.",
            "栽植频率超过机械臂能力：会漏苗。作业继续。",
        ),
        (
            "tractor fast",
            "air supply",
            "slide throttle",
            "lift throttle",
        ),
    ),
}
"""Texts by key of the alarm."""
