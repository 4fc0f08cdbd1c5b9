"""Every text an operator reads, in English and Chinese, in one table."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

Language = Literal["en", "zh"]


class Text(NamedTuple):
    """One text in both languages; ``{side}`` stands for the side's name."""

    en: str
    zh: str

    def of(self, side: Text | None) -> Text:
        """Return the text with the side's name put in."""
        return self if side is None else Text(self.en.format(side=side.en), self.zh.format(side=side.zh))


SIDES: Final = {"left": Text("left", "左"), "right": Text("right", "右")}

STATES: Final = {
    1: Text("Clearing", "清除中"),
    2: Text("Stopped", "已停止"),
    3: Text("Starting", "启动中"),
    4: Text("Idle", "待机"),
    5: Text("Suspended", "已暂挂"),
    6: Text("Execute", "运行"),
    7: Text("Stopping", "停止中"),
    8: Text("Aborting", "急停中"),
    9: Text("Aborted", "已急停"),
    10: Text("Holding", "保持中"),
    11: Text("Held", "已保持"),
    13: Text("Suspending", "暂挂中"),
    14: Text("Unsuspending", "恢复中"),
    15: Text("Resetting", "复位中"),
    16: Text("Completing", "完成中"),
    17: Text("Complete", "已完成"),
}
"""PackML states by their number (FX.md 5: numbers as used in several public implementations)."""

ALARMS: Final = {
    "emergency_stop": Text("Emergency stop pressed", "急停按钮已按下"),
    "link_lost": Text("Field link lost; outputs off", "现场通信中断,输出已切断"),
    "scan_fault": Text("Scan over its limit or failed; outputs off", "扫描超时或出错,输出已切断"),
    "store_fault": Text("Retentive memory cannot be stored: check disk and file", "保持数据无法保存:检查磁盘和文件"),
    "stop_stuck": Text("Stop button or its wire open: nothing can start", "停止按钮或其线路断开,无法启动"),
    "memory_lost": Text("Retentive memory lost: check claws, rows and tray", "保持数据丢失:检查夹爪、苗排和苗盘"),
    "air_low": Text("Air pressure low", "气压过低"),
    "overrun": Text("{side} slide left the pick position after arriving", "{side}滑块到位后又离开取苗位"),
    "off home": Text("{side} arm has left home by itself", "{side}臂自行离开原位"),
    "close claws": Text("{side} claws not closed: place or outputs lost", "{side}夹爪未闭合:位置或输出丢失"),
    "open claws": Text("{side} claws not opened: place or outputs lost", "{side}夹爪未张开:位置或输出丢失"),
    "home: put back": Text("Homing: {side} claws not opened at the row", "复位:{side}夹爪在取苗位未张开"),
    "home: open at feed": Text("Homing: {side} claws not opened at feed", "复位:{side}夹爪在投苗位未张开"),
    "approach row": Text("{side} slide did not reach the row", "{side}滑块未到达取苗位"),
    "return to row": Text("{side} slide did not return to the row", "{side}滑块未退回取苗位"),
    "lift from row": Text("{side} arm not up after clamping", "{side}臂夹苗后未升到上限位"),
    "slide to feed": Text("{side} slide did not reach feed, loaded", "{side}滑块带苗未到达投苗位"),
    "spread": Text("{side} claws not spread", "{side}夹爪未分散到位"),
    "lower over cups": Text("{side} arm not down over the cups", "{side}臂在转杯上方未降到下限位"),
    "raise empty": Text("{side} arm not up after the throw", "{side}臂投苗后未升到上限位"),
    "converge": Text("{side} claws not converged", "{side}夹爪未聚合到位"),
    "lower empty": Text("{side} arm not down after converging", "{side}臂聚合后未降到下限位"),
    "park": Text("{side} arm not up while parking", "{side}臂停放时未升到上限位"),
    "home: raise loaded": Text("Homing: {side} arm not up, loaded", "复位:{side}臂带苗未升到上限位"),
    "home: raise empty": Text("Homing: {side} arm not up, empty", "复位:{side}臂空载未升到上限位"),
    "home: out": Text("Homing: {side} slide did not reach feed", "复位:{side}滑块未到达投苗位"),
    "home: out low": Text("Homing: {side} slide did not reach feed, arm low", "复位:{side}滑块低位未到达投苗位"),
    "home: raise at feed": Text("Homing: {side} arm not up at feed", "复位:{side}臂在投苗位未升到上限位"),
    "home: discard, spread": Text("Discard: {side} claws not spread", "弃苗:{side}夹爪未分散到位"),
    "home: discard, lower": Text("Discard: {side} arm not down over the cups", "弃苗:{side}臂未降到下限位"),
    "home: raise to converge": Text("Homing: {side} arm not up to converge", "复位:{side}臂聚合前未升到上限位"),
    "home: converge": Text("Homing: {side} claws not converged", "复位:{side}夹爪未聚合到位"),
    "home: lower": Text("Homing: {side} arm not down", "复位:{side}臂未降到下限位"),
    "tray_jam": Text("Tray did not leave the pick position", "苗盘未离开取苗位"),
    "tray_lost": Text("Tray at the pick position has gone", "取苗位苗盘丢失"),
    "magazine_empty": Text("Tray magazine empty", "苗盘仓已空"),
}
"""Alarm texts by key."""

REASONS: Final = {
    0: Text("", ""),
    1: Text("no tray", "无苗盘"),
    2: Text("no cups at the left row", "左行无苗杯"),
    3: Text("no cups at the right row", "右行无苗杯"),
    4: Text("no cups", "无苗杯"),
}
"""Why the machine is Suspended, by `modes.Reason`."""

QUESTIONS: Final = {
    "loaded": Text("Does the {side} arm hold seedlings?", "{side}臂是否夹有苗?"),
    "tray": Text(
        "Is the tray at the pick position the same, a full one, or none?", "取苗位的苗盘是原盘、满盘还是无盘?"
    ),
}
"""What the operator is asked when homing cannot tell."""
