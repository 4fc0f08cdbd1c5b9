"""Texts of the line that says what to do now, in English and Chinese."""

from __future__ import annotations

from typing import Final

from controller.common.declarations import Declared
from controller.program.texts.isolation import ISOLATE_FIRST
from controller.program.texts.operator import QUESTIONS, SIDES, Text

_HOLD: Final = Text("{question} Press X0 for 2 s: yes; X24: no", "{question} 按 X0 2 秒后松开：是；按 X24：否")


_NEXT_PRESSES: Final = {
    0: Text("no press required", "无需按钮操作"),
    1: Text("press X0 to reset and home", "按 X0 复位并回原点"),
    2: Text("press X0 to start", "按 X0 启动"),
    3: Text(f"{ISOLATE_FIRST.en} Fill the magazine, then press X0", f"{ISOLATE_FIRST.zh}苗盘仓补盘后按 X0"),
    4: Text("press X0 for the next transfer", "按 X0 执行下一步"),
    5: Text("press X24 for 3 s and release it to clear", "按住 X24 3 秒后松开以清除"),
    6: Text("release X25, then press X24 for 3 s and release it", "释放 X25，然后按住 X24 3 秒后松开"),
    7: Text(
        "correct the fault in the alarm list, then press X24 for 3 s and release it",
        "处理报警列表中的故障，然后按住 X24 3 秒后松开",
    ),
    8: Text("release X24; if it is not pressed, check its wire", "松开 X24；若未按下，检查其接线"),
    9: _HOLD.filled(question=QUESTIONS["loaded"].of(SIDES["left"])),
    10: _HOLD.filled(question=QUESTIONS["loaded"].of(SIDES["right"])),
    11: Text(
        "Isolate first to move a tray. Is it the same tray, not moved? Press X0 for 2 s: yes; otherwise put it right",
        "先断电断气并上锁再移动苗盘。原苗盘未移动？按 X0 2 秒后松开：是；否则移回原位或取走",
    ),
    12: Text(
        "Isolate first to remove the tray. Is it to be treated as full? Press X0 for 2 s: yes; otherwise remove it",
        "先断电断气并上锁再取走苗盘。是否按满盘处理？按 X0 2 秒后松开：是；否则请取走",
    ),
    13: Text(
        "Isolate first to push a tray. Is there none? Press X24 for 2 s: feed one; otherwise push it to the sensor",
        "先断电断气并上锁再推苗盘。取苗位无盘？按 X24 2 秒后松开送盘；若有，推到传感器下",
    ),
    14: Text(
        "Are the cups under the claws empty? Press X0 for 2 s: yes; otherwise wait for twelve cups",
        "夹爪下方的苗杯是否为空？按 X0 2 秒后松开：是；否则等待十二个苗杯",
    ),
    15: Text("answer the question by a command", "请用命令回答问题"),
    16: Text(
        f"{ISOLATE_FIRST.en} Remove the cause of the alarm, then press X0 to home",
        f"{ISOLATE_FIRST.zh}排除报警原因后按 X0 回原点",
    ),
    17: Text("resume by command, or press X0 to home", "用命令解除保持，或按 X0 回原点"),
    18: Text("homed; select another mode to start", "已回原点；启动前请选择其他模式"),
    19: Text("unsuspend by command, or press X24 to stop", "用命令解除暂挂，或按 X24 停止"),
    20: Text("jog by command, or press X24 to stop", "用命令点动，或按 X24 停止"),
    21: Text("release the button now", "现在松开按钮"),
    22: Text(
        "machine constants differ from their defaults; check them, press X25 and release it",
        "机器常数与默认值不同；核对后按下 X25 再释放",
    ),
    23: Text("press X24 to stop, then X0 to home", "按 X24 停止，再按 X0 回原点"),
    25: Text("stand clear: the machine is about to move; X24 prevents it", "机器即将动作，请离开；按 X24 取消"),
    24: Text(
        "nobody in the machine? Close the guard, then press X0 to home", "确认机内无人，关上安全门，然后按 X0 回原点"
    ),
}
NEXT_PRESSES: Final = Declared("NEXT_PRESSES", __name__, _NEXT_PRESSES)
"""Next useful press of the operator, by `next_press.NextPress`. A text that sends a hand into the machine begins with
the isolation."""

NEXT: Final = Text("{text}; next: {press}", "{text}；下一步：{press}")
"""Format of a refused command with the line that says what to do now."""

IN_MODE: Final = Text("{text} (mode: {mode})", "{text}（模式：{mode}）")
"""Format of a press in a mode other than continuous."""

OF_ALARM: Final = Text("{text}: {alarm}", "{text}：{alarm}")
"""Format of a press that an alarm requires, with the alarm that stopped work."""
