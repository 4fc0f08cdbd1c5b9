"""Replies of the panel to orders, in English and Chinese."""

from __future__ import annotations

from typing import Final

from pymodbus.constants import ExcCodes

from controller.hmi.panel.orders.login import AccessLevel
from controller.program.texts.operator import Text

LEVELS: Final = {
    "none": Text("Not logged in", "未登录"),
    "view": Text("View, stop, hold", "查看、停止、保持"),
    "operate": Text("Operator", "操作员"),
    "maintain": Text("Maintenance", "维护人员"),
}
"""Access levels by name."""

REPLIES: Final = {
    "done": Text("done", "已执行"),
    "not yet": Text("accepted; takes effect in the next scan", "已接受，下一扫描周期生效"),
    "released": Text("released", "已松开"),
    "welcome": Text("logged in", "已登录"),
    "bye": Text("logged out", "已退出登录"),
    "set up": Text("passwords set", "密码已设置"),
    "malformed": Text("invalid request: {what}", "无效请求：{what}"),
    "busy": Text("too many pending orders; wait for the replies", "待处理的指令过多，请等待答复"),
    "level": Text("{level} login required", "需要{level}登录"),
    "wrong password": Text("wrong user or password", "用户或密码错误"),
    "too many tries": Text(
        "too many wrong passwords of this user at this address; wait {seconds} s",
        "此用户在此地址的密码错误次数过多，请等待 {seconds} 秒",
    ),
    "too slow": Text("the request did not arrive completely within {seconds} s", "请求未在 {seconds} 秒内完整到达"),
    "first run": Text("no passwords are set; set them on the panel computer", "尚未设置密码，请在面板所在计算机上设置"),
    "first only here": Text(
        "the first passwords can only be set on the panel computer",
        "首次密码只能在面板所在计算机上设置",
    ),
    "first is over": Text("the passwords are already set; log in", "密码已设置，请登录"),
    "password length": Text(
        "a password must have {least} to {most} characters", "密码长度须为 {least} 至 {most} 个字符"
    ),
    "same password": Text("the two passwords must differ", "两个密码不得相同"),
    "not stored": Text("the passwords cannot be stored: {why}", "无法保存密码：{why}"),
    "no history": Text("no history available", "没有历史记录"),
    "not served": Text(
        "the panel is not served at this address; use an address specified when the panel was started",
        "面板不通过此地址提供服务，请使用面板启动时指定的地址",
    ),
    "no controller": Text(
        "the controller does not respond; check that it is running", "控制器无应答，请检查其是否运行"
    ),
    "closed": Text(
        "not executed: the controller closed the connection; it has too many connections, or it is stopping",
        "未执行：控制器关闭了连接；连接过多，或控制器正在停止",
    ),
    "unsure": Text("no response; check whether the order was executed", "未收到应答，请确认指令是否已执行"),
    "refused": Text(
        "refused by the controller (Modbus exception {code:02d})", "被控制器拒绝（Modbus 异常码 {code:02d}）"
    ),
    "no scan": Text(
        "not executed: the controller does not scan; it is paused or stopping",
        "未执行：控制器未在扫描，已暂停或正在停止",
    ),
    "no command": Text("unknown command {name!r}", "未知命令 {name!r}"),
    "jog only": Text("this output can only be jogged", "此输出只能点动操作"),
    "no set-point": Text("unknown set-point {name!r}", "未知设定值 {name!r}"),
    "range": Text("enter {lowest} to {highest}", "请输入 {lowest} 至 {highest}"),
    "at start": Text(
        "machine constant: can only be given when the controller starts",
        "此值为机器常数，只能在控制器启动时给定",
    ),
    "no output": Text("output {name!r} cannot be jogged", "输出 {name!r} 不可点动"),
    "jog taken": Text("another operator is jogging an output", "其他操作员正在点动"),
    "press again": Text("release the button and press it again", "请松开按钮后重新按下"),
    "jog closed": Text(
        "the controller closed the connection of the jog: too many connections, or it is stopping; release the button "
        "and press it again",
        "控制器关闭了点动的连接：连接过多，或控制器正在停止；请松开按钮后重新按下",
    ),
    "jog unanswered": Text(
        "the controller did not respond to the jog in time; release the button and press it again",
        "控制器未及时应答点动，请松开按钮后重新按下",
    ),
    "jog late": Text(
        "the page did not renew the jog in time; release the button and press it again",
        "页面未及时续点动，请松开按钮后重新按下",
    ),
    "no box": Text("no simulated operator box available", "没有可用的仿真操作盒"),
    "no box answer": Text("the operator box does not respond", "操作盒无应答"),
    "no pace": Text("not a simulation: the speed cannot be changed", "非仿真运行，不能变速"),
    "no forcing": Text("the controller does not allow forcing", "控制器不允许强制"),
    "too late": Text("the order arrived too late and was not executed", "命令到达过晚，未执行"),
    "horn is off": Text("the horn is off", "蜂鸣器未响"),
    "no input": Text("unknown input {name!r}", "未知输入点 {name!r}"),
    "force only at rest": Text(
        "inputs can be forced only in Stopped, in manual mode", "只能在停止状态且手动模式下强制输入"
    ),
}
"""Reply texts by key."""


def reply_text(key: str, **values: object) -> Text:
    """Return a reply with its placeholders filled in."""
    text = REPLIES[key]
    return Text(text.en.format(**values), text.zh.format(**values)) if values else text


def exception_text(code: int) -> Text:
    """Return the reply to an order that the controller refused with a Modbus exception."""
    return reply_text("no scan") if code == ExcCodes.DEVICE_BUSY else reply_text("refused", code=code)


def level_text(level: AccessLevel) -> Text:
    """Return the reply to an order that requires a higher access level."""
    name, reply = LEVELS[level.name.lower()], REPLIES["level"]
    return Text(reply.en.format(level=name.en), reply.zh.format(level=name.zh))
