"""Operator texts of the program in English and Chinese: states, modes, reasons, questions and refusals."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

from controller.common.declarations import Declared

Language = Literal["en", "zh"]
LANGUAGES: Final[tuple[Language, Language]] = ("en", "zh")


class Text(NamedTuple):
    """Text in both languages; a name in braces is a placeholder, ``{side}`` that for the name of the side."""

    en: str
    zh: str

    @classmethod
    def plain(cls, value: object) -> Text:
        """Return a value that is the same in both languages, such as a number or a name."""
        return cls(str(value), str(value))

    def of(self, side: Text | None) -> Text:
        """Return the text with the side name filled in, or the unchanged text if `side` is None."""
        return self if side is None else self.filled(side=side)

    def filled(self, **texts: Text) -> Text:
        """Return the text with its placeholders filled in."""
        en, zh = ({name: getattr(text, language) for name, text in texts.items()} for language in LANGUAGES)
        return Text(self.en.format(**en), self.zh.format(**zh))


NO_TEXT: Final = Text("", "")
SIDES: Final = {"left": Text("left", "左"), "right": Text("right", "右")}

_STATES: Final = {
    1: Text("Clearing", "清除中"),
    2: Text("Stopped", "已停止"),
    3: Text("Starting", "启动中"),
    4: Text("Idle", "待机"),
    5: Text("Suspended", "已暂挂"),
    6: Text("Execute", "运行"),
    7: Text("Stopping", "停止中"),
    8: Text("Aborting", "中止中"),
    9: Text("Aborted", "已中止"),
    10: Text("Holding", "保持中"),
    11: Text("Held", "已保持"),
    12: Text("Unholding", "解除保持中"),
    13: Text("Suspending", "暂挂中"),
    14: Text("Unsuspending", "解除暂挂中"),
    15: Text("Resetting", "复位中"),
    16: Text("Completing", "完成中"),
    17: Text("Complete", "已完成"),
}
STATES: Final = Declared("STATES", __name__, _STATES)
"""PackML states by number (docs/sources/fx2n.md 5: numbers as used in several public implementations)."""

_REASONS: Final = {
    0: Text("", ""),
    1: Text("no tray", "无苗盘"),
    2: Text("no cups at the left row", "左行无苗杯"),
    3: Text("no cups at the right row", "右行无苗杯"),
    4: Text("no cups", "无苗杯"),
    5: Text("suspended by the operator", "操作员暂挂"),
    6: Text("alarm", "有报警"),
    7: Text("operator answer required", "等待操作员回答"),
    8: Text("held by the operator", "操作员保持"),
    9: Text("operator panel not responding", "操作面板无响应"),
    10: Text("guard open", "安全门打开"),
    11: Text("nothing moved within 10 s after the start warning", "启动警告后 10 秒内无动作"),
}
REASONS: Final = Declared("REASONS", __name__, _REASONS)
"""Reasons for Suspended and Held, by `states.Reason`."""

_MODES: Final = {
    1: Text("continuous", "连续运行"),
    3: Text("manual", "手动"),
    4: Text("one cycle", "单周期"),
    5: Text("step", "单步"),
    6: Text("zero return", "回原点"),
}
MODES: Final = Declared("MODES", __name__, _MODES)
"""Operating modes, by `states.Mode`."""

_QUESTIONS: Final = {
    "loaded": Text("Is the {side} arm holding seedlings?", "{side}臂是否夹有苗？"),
    "tray": Text(
        "Which tray is at the pick position: the same one, not moved; a full one; or no usable one?",
        "取苗位的苗盘是未移动的原盘、满盘，还是没有可用的苗盘？",
    ),
    "cups": Text(
        "Are the cups under the claws of both arms empty? If not confirmed, twelve cups must pass first",
        "两臂夹爪下方的苗杯是否都为空？如不确认，须先转过十二个苗杯",
    ),
}
QUESTIONS: Final = Declared("QUESTIONS", __name__, _QUESTIONS)
"""Questions to the operator when homing cannot determine the state from the sensors."""


def question_text(name: str) -> Text:
    """Return the text of a question, given its name: ``tray``, or side and kind, as in ``left_loaded``.

    Raises:
        DeclarationError: There is no such question.
    """
    side, _, kind = name.rpartition("_")
    return QUESTIONS[kind].of(SIDES.get(side))


_ORDERS: Final = {
    "reset": Text("reset", "复位"),
    "start": Text("start", "启动"),
    "stop": Text("stop", "停止"),
    "hold": Text("hold", "保持"),
    "unhold": Text("resume", "解除保持"),
    "suspend": Text("suspend", "暂挂"),
    "unsuspend": Text("unsuspend", "解除暂挂"),
    "abort": Text("abort", "中止"),
    "clear": Text("clear", "清除"),
    "complete": Text("complete", "结束生产"),
    "mode": Text("change the mode", "切换模式"),
    "step": Text("step", "单步"),
    "acknowledge": Text("acknowledge", "确认"),
    "answer": Text("accept the answer", "接受回答"),
    "discard": Text("discard the load", "弃苗"),
    "count": Text("reset the counters", "清零计数"),
    "jog": Text("jog", "点动"),
    "rows": Text("change the rows", "更改苗行状态"),
    "service": Text("take the arm out of service or return it", "停用或启用机械臂"),
    "empty_line": Text("empty the line", "清空生产线"),
    "new_machine": Text("declare the machine as new", "声明为新机器"),
}
ORDERS: Final = Declared("ORDERS", __name__, _ORDERS)
"""Names of commands in refusals, by command group."""

_REFUSALS: Final = {
    "NOT_AT_REST": Text("the machine is not in Stopped, Held or Complete", "机器不在停止、保持或完成状态"),
    "NOT_IDLE": Text("the machine is not in Idle or Suspended", "机器不在待机或暂挂状态"),
    "NOT_RUNNING": Text("the machine is not running", "机器未在运行"),
    "NOT_HELD": Text("the machine is not in Held", "机器未处于保持状态"),
    "NOT_SUSPENDED": Text("the machine was not suspended by the operator", "机器未被操作员暂挂"),
    "NOT_ABORTED": Text("the machine is not in Aborted", "机器未处于中止状态"),
    "NO_MODE_CHANGE": Text(
        "the mode can be changed only in Stopped, Idle, Held or Complete", "只能在停止、待机、保持或完成状态切换模式"
    ),
    "MANUAL_ONLY_AT_REST": Text(
        "manual mode can be entered or left only in Stopped, Held or Complete",
        "只能在停止、保持或完成状态进入或退出手动模式",
    ),
    "NOT_STEPPING": Text("step mode is not running", "未在单步模式下运行"),
    "NOT_JOGGING": Text("manual mode is not started", "手动模式未启动"),
    "MODE_MANUAL": Text("manual mode is selected", "当前为手动模式"),
    "MODE_ZERO_RETURN": Text("zero return mode is selected", "当前为回原点模式"),
    "STOP_PRESSED": Text("the stop button is pressed or its wire is broken", "停止按钮按下或线路断开"),
    "EMERGENCY_STOP": Text("the emergency stop is pressed", "急停按钮按下"),
    "LINK_LOST": Text("the field link is lost", "现场通信中断"),
    "SCAN_FAULT": Text("a scan fault is active", "存在扫描故障"),
    "STORE_FAULT": Text("retentive memory cannot be stored", "保持数据无法保存"),
    "ALARM": Text("an alarm is active", "有报警未复位"),
    "QUESTION": Text("a question is unanswered", "有待回答的问题"),
    "NOT_ASKED": Text("this question is not open", "当前没有此提问"),
    "NO_TRAY_SEEN": Text("no matching tray is detected at the pick position", "取苗位未检测到相应的苗盘"),
    "MOVING": Text("the machine is moving", "机器正在运动"),
    **{
        f"{side.upper()}_{name}": text.of(SIDES[side])
        for side in SIDES
        for name, text in {
            "NOT_AT_FEED": Text("{side} slide not at feed", "{side}滑块不在投苗位"),
            "NOT_DOWN": Text("{side} lift not down", "{side}升降缸不在下限位"),
            "NOT_UP": Text("{side} lift not up while loaded", "{side}臂带苗时不在上限位"),
            "NOT_CONVERGED": Text("{side} claws not converged", "{side}夹爪未聚合"),
            "NOT_OPEN": Text("{side} claws closed but not loaded", "{side}夹爪空载但未张开"),
            "NOT_LOADED": Text("{side} arm not loaded", "{side}臂未夹苗"),
        }.items()
    },
    "OUTPUTS_TAKEN": Text("another controller owns the outputs", "输出被另一控制器占用"),
    "NOT_STOPPABLE": Text("the machine is stopped or stopping already", "机器已停止或正在停止"),
    "RELEASED_EARLY": Text("the button was released too early", "按钮松开过早"),
    "TRAY_SEEN": Text(
        "a tray is detected that may hold seedlings; it can be accepted as full, and its empty rows stated",
        "检测到可能带苗的苗盘；可按满盘接受，再标明空行",
    ),
    "ROW_IN_PROGRESS": Text("a row is clamped but not lifted", "苗行已夹紧但未提起"),
    "NOT_STOPPED": Text("the machine is not in Stopped", "机器未处于停止状态"),
    "OTHER_ARM_OUT": Text("the other arm is out of service", "另一臂已停用"),
    "CONSTANTS": Text(
        "machine constants differ from their defaults and are not confirmed with X25",
        "机器常数与默认值不同，尚未用急停按钮确认",
    ),
    "GUARD_OPEN": Text("the guard is open", "安全门打开"),
    "TRAY_UNKNOWN": Text("the tray may have been moved; home first", "苗盘可能被移动过；请先回原点"),
    "MEMORY_VALID": Text("the memory is valid, or its loss has been answered", "保持数据有效，或已回答其丢失"),
}
REFUSALS: Final = Declared("REFUSALS", __name__, _REFUSALS)
"""Reasons for refusing a command, by name of `refusals.Refusal`."""

CONSTANT: Final = Text("{name} {value} (default {default})", "{name} {value}（默认值 {default}）")
"""Format of a machine constant that differs from its default."""

CONSTANTS: Final = Text("{warning}: {constants}", "{warning}：{constants}")
"""Format of the warning of machine constants with those that differ from their defaults."""

CANNOT: Final = Text("cannot {order}: {reason}", "无法{order}：{reason}")
"""Format of a refusal."""
