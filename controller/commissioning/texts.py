"""Texts of the commissioning in English and Chinese: prompts, results, remarks and the report."""

from __future__ import annotations

from typing import Final

from controller.commissioning.judge import WireResult
from controller.common.modbus.io_map import Point
from controller.iomap.loader import POINT_NAMES
from controller.program.texts.operator import SIDES, Language, Text

PROMPTS: Final = {
    "inputs": Text(
        "Inputs: no output is written. Enter = continue, s = skip the point, q = end with a report.",
        "输入检查：不写任何输出。回车 = 继续，s = 跳过该点，q = 结束并生成报告。",
    ),
    "release": Text("{point}: do NOT operate it, then Enter", "{point}：不要动作，然后按回车"),
    "operate": Text("{point}: operate it and hold it, then Enter", "{point}：使其动作并保持，然后按回车"),
    "again": Text("r = repeat, Enter = next point", "r = 重复，回车 = 下一点"),
    "outputs": Text(
        "Outputs: each moves only while SPACE is held. One output at a time; every other key switches it off.",
        "输出检查：仅在按住空格键时动作。每次只有一个输出；任何其他键立即断开。",
    ),
    "watchdog": Text(
        "Is the output watchdog of the I/O module enabled (100 ms to 500 ms), and is the emergency stop within reach? "
        "y = yes, any other key = no outputs",
        "I/O 模块的输出看门狗是否已启用（100 ms 至 500 ms），急停按钮是否触手可及？y = 是，其他键 = 不检查输出",
    ),
    "clear": Text(
        "{point}: is the area clear of persons and obstacles? y = yes, s = skip, q = end",
        "{point}：动作区域内是否无人且无障碍？y = 是，s = 跳过，q = 结束",
    ),
    "hold": Text(
        "{point}: hold SPACE; Enter = nothing more to see, s = skip, q = end",
        "{point}：按住空格键；回车 = 观察完毕，s = 跳过，q = 结束",
    ),
    "seen": Text(
        "{point}: did exactly this happen? y = yes, n = nothing happened, o = something else",
        "{point}：是否正是该动作？y = 是，n = 无动作，o = 其他动作",
    ),
    "which": Text(
        "What moved? Address of its output, for example Y16, or empty = unknown, then Enter",
        "哪个输出动作？输入其地址（例如 Y16），空 = 未知，然后按回车",
    ),
    "refused": Text("{point}: not permitted now: {reason}", "{point}：当前不允许：{reason}"),
    "ended": Text("off: {reason}", "已断开：{reason}"),
    "reset": Text(
        "The output watchdog of {devices} had tripped; it has been reset.",
        "{devices} 的输出看门狗曾动作，现已复位。",
    ),
    "tripped": Text(
        "The output watchdog of {devices} has tripped; the check ends.", "{devices} 的输出看门狗已动作，检查结束。"
    ),
    "result": Text("{point}: {result}", "{point}：{result}"),
    "report": Text("report: {path}", "报告：{path}"),
}

REASONS: Final = {
    "emergency_stop": Text("emergency stop is active", "急停有效"),
    "arm_down": Text("the arm must be at its lower limit", "臂必须在下限位"),
    "arm_up": Text("the arm must be at its upper limit", "臂必须在上限位"),
    "arm_at_end": Text("the arm must be at its upper or lower limit", "臂必须在上限位或下限位"),
    "claws_converged": Text("the claws must be at tray pitch", "夹爪必须为盘距"),
    "at_feed": Text("the slide must be at feed", "滑块必须在投苗位"),
    "other_at_feed": Text("the slide of the other arm must be at feed", "另一臂的滑块必须在投苗位"),
    "link": Text("no response from the field I/O: {error}", "现场 I/O 无响应：{error}"),
    "stop": Text("request to stop", "请求停止"),
    "reacted": Text("the reaction has been seen", "已检测到反应"),
    "uncommanded": Text("motion without a command", "无指令动作"),
}

RESULTS: Final = {
    WireResult.OK: Text("correct", "正确"),
    WireResult.SWAPPED: Text("swapped: {others} reacts instead", "接反：{others} 反应"),
    WireResult.INVERTED: Text("inverted: polarity is opposite", "极性相反"),
    WireResult.DEAD: Text(
        "no reaction: wire, supply, valve or sensor is dead, or an opposing output is on",
        "无反应：断线、无电源、阀或传感器失效，或相反输出接通",
    ),
    WireResult.STUCK: Text("always on: short circuit or stuck sensor", "始终接通：短路或传感器卡死"),
    WireResult.BRIDGED: Text("reacts together with {others}", "与 {others} 同时反应"),
    WireResult.WRONG: Text("another reaction: {others}", "其他反应：{others}"),
    WireResult.UNCOMMANDED: Text(
        "moves while the output is off: inverted, or stuck on", "输出断开时仍动作：极性相反或始终接通"
    ),
    WireResult.NOT_TESTED: Text("not tested", "未检查"),
}

NOTES: Final = {
    "inverted_too": Text("and inverted", "且极性相反"),
    "by_eye": Text("judged by eye", "目测"),
    "sensors_untested": Text("its sensors were not tested in this run", "本次未检查其传感器"),
    "link": Text("field I/O lost", "现场 I/O 丢失"),
    **{name: text for name, text in REASONS.items() if name not in ("link", "reacted", "stop")},
}

REPORT: Final = {
    "title": Text("Check of inputs and outputs", "输入输出检查报告"),
    "machine": Text("Machine", "机器"),
    "field": Text("Field I/O", "现场 I/O"),
    "io_map": Text("I/O map (SHA-256)", "I/O 表（SHA-256）"),
    "program": Text("Program", "程序"),
    "begun": Text("Begun (UTC)", "开始（UTC）"),
    "ended": Text("Ended (UTC)", "结束（UTC）"),
    "tester": Text("Tested by", "检查人"),
    "witness": Text("Witness", "见证人"),
    "watchdog": Text("Output watchdog and emergency stop confirmed", "已确认输出看门狗与急停"),
    "yes": Text("yes", "是"),
    "no": Text("no", "否"),
    "end": Text("End of the check", "检查结束原因"),
    "complete": Text("complete", "完成"),
    "quit": Text("ended by the tester", "由检查人结束"),
    "stopped": Text("request to stop, or terminal lost", "请求停止或终端丢失"),
    "lost": Text("field I/O lost", "现场 I/O 丢失"),
    "tripped": Text("output watchdog of a module tripped", "模块的输出看门狗动作"),
    "summary": Text(
        "{ok} of {all} points correct, {faults} faulty, {left} not tested",
        "{all} 点中 {ok} 点正确，{faults} 点有误，{left} 点未检查",
    ),
    "address": Text("Address", "地址"),
    "name": Text("Point", "点"),
    "result": Text("Result", "结果"),
    "note": Text("Remark", "备注"),
    "at": Text("Time (UTC)", "时间（UTC）"),
    "date": Text("Date", "日期"),
    "signature": Text("Signature", "签名"),
}


def said(text: Text, language: Language, **values: str) -> str:
    """Return a text in a language with its placeholders filled in."""
    return str(getattr(text, language)).format(**values)


def point_name(tag: str, language: Language) -> str:
    """Return the display name of a tag, with its side."""
    side, _, name = tag.rpartition(".")
    english, chinese = POINT_NAMES[name]
    text = Text(english, chinese)
    if side:
        text = Text(f"{SIDES[side].en} {text.en}", f"{SIDES[side].zh}{text.zh}")
    return str(getattr(text, language))


def label(point: Point, language: Language) -> str:
    """Return the address and the name of a point."""
    return f"{point.address} {point_name(point.tag, language)}"
