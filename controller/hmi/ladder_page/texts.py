"""Texts of the ladder page in English and Chinese; the page fills in ``{name}``."""

from __future__ import annotations

from typing import Final

from controller.common.declarations import Declared
from controller.program.texts.operator import Text

NOT_SERVED: Final = Text(
    "the ladder page is not served at this address; use the address that was printed when it was started",
    "梯形图页面不通过此地址提供服务，请使用启动时显示的地址",
)

_TEXTS: Final = {
    "scan": Text("Scan", "扫描"),
    "view.end": Text("END values", "END 值"),
    "view.executed": Text("As executed", "执行时的值"),
    "freeze": Text("Freeze", "冻结"),
    "live": Text("Live", "实时"),
    "state.live": Text("live", "实时"),
    "state.frozen": Text("frozen", "已冻结"),
    "state.recorded": Text("recorded", "已记录"),
    "state.branch": Text("branch", "分支"),
    "state.starting": Text("program is being prepared: no values yet", "正在准备程序，暂无数值"),
    "state.lost": Text("no connection: values are outdated", "连接中断，数值已过时"),
    "state.gone": Text("this scan is no longer kept; go on live", "此扫描已不再保存，请返回实时"),
    "differs": Text(
        "This scan cannot be shown as executed, because these devices were written during it: {devices}",
        "无法显示此扫描执行时的值，以下软元件在扫描中被写入：{devices}",
    ),
    "hidden": Text(
        "This scan cannot be shown as executed, because no client can read a state of these instructions (step):"
        " {instructions}",
        "无法显示此扫描执行时的值，以下指令（步）的内部状态无法读取：{instructions}",
    ),
    "few": Text(
        "This scan cannot be shown as executed: fewer than three scans are known",
        "无法显示此扫描执行时的值：已知的扫描不足三个",
    ),
    "ladder": Text("Ladder", "梯形图"),
    "charts": Text("Steps", "步进图"),
    "machine": Text("Machine", "机器"),
    "search": Text("Find device, tag or comment", "查找软元件、标签或注释"),
    "search.none": Text("nothing found", "未找到"),
    "search.more": Text("and {count} more: write a longer text", "另有 {count} 项，请输入更长的文字"),
    "panel": Text("Panel", "侧栏"),
    "tab.device": Text("Device", "软元件"),
    "tab.why": Text("Why", "原因"),
    "tab.alarms": Text("Alarms", "报警"),
    "tab.outputs": Text("Outputs", "输出"),
    "tab.find": Text("Find", "查找"),
    "tab.run": Text("Run", "运行记录"),
    "written": Text("Written", "写入"),
    "read": Text("Read", "读取"),
    "behind": Text("Rungs behind", "相关梯级"),
    "rung": Text("rung {rung}", "梯级 {rung}"),
    "step": Text("step {step}", "步 {step}"),
    "value": Text("Value", "数值"),
    "on": Text("on", "接通"),
    "off": Text("off", "断开"),
    "choose": Text("Select a symbol in the ladder.", "请在梯形图中选择符号。"),
    "why.none": Text("no explanation is available", "没有可用的说明"),
    "why.ask": Text("Why is {device} so?", "{device} 为何如此？"),
    "none": Text("none", "无"),
    "larger": Text("Larger", "放大"),
    "smaller": Text("Smaller", "缩小"),
    "move.change": Text("change", "变化"),
    "move.step": Text("step", "步"),
    "move.scan": Text("scan", "扫描"),
    "move.rung": Text("rung", "梯级"),
    "mark.alarm": Text("alarm", "报警"),
    "run.watch": Text("Watch", "监视"),
    "run.until": Text("Stop when", "停止条件"),
    "run.change": Text("Branch with", "分支条件"),
    "run.command": Text("Command", "命令"),
    "run.same": Text("branch: no difference", "分支：无差异"),
    "run.differs": Text("branch: differs from scan {scan} on", "分支：自扫描 {scan} 起不同"),
    "language": Text("中文", "English"),
    "legend": Text(
        "thick: power; thin: none; dashed: unknown; pale and dotted: not executed",
        "粗线：导通；细线：断开；虚线：未知；淡色点线：未执行",
    ),
}
TEXTS: Final = Declared("TEXTS", __name__, _TEXTS)
"""Text of each key."""
