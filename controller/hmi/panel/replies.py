"""How the panel answers an order, in English and Chinese."""

from __future__ import annotations

from typing import Final

from controller.program.texts import Text

REPLIES: Final = {
    "done": Text("done", "已执行"),
    "not yet": Text("taken; it takes effect with the next scan", "已接受;下一扫描周期生效"),
    "let go": Text("let go", "已松开"),
    "welcome": Text("logged in", "已登录"),
    "bye": Text("logged out", "已注销"),
    "set up": Text("the passwords are set", "密码已设置"),
    "malformed": Text("not understood: {what}", "无法识别:{what}"),
    "busy": Text("too many orders at once; wait for the answers", "指令过多;请等待答复"),
    "level": Text("log in as {level} for this", "此操作需以 {level} 身份登录"),
    "wrong password": Text("wrong user or password", "用户或密码错误"),
    "too many tries": Text("too many wrong passwords; wait {seconds} s", "密码错误次数过多;请等待 {seconds} 秒"),
    "first run": Text("no passwords are set yet; set them on this computer", "尚未设置密码;请在本机设置"),
    "first only here": Text(
        "the first passwords are set on the computer of the panel",
        "首次密码只能在面板所在计算机上设置",
    ),
    "first is over": Text("the passwords are set already; log in", "密码已设置;请登录"),
    "password length": Text("a password has {least} to {most} characters", "密码长度须为 {least} 至 {most} 个字符"),
    "same password": Text("give two different passwords", "两个密码不得相同"),
    "not stored": Text("the passwords cannot be stored: {why}", "无法保存密码:{why}"),
    "no history": Text("there is no history here", "此处没有历史记录"),
    "not served": Text(
        "this address is not served here; use one the panel was started with",
        "此地址不受理;请使用面板启动时的地址",
    ),
    "no controller": Text("the controller does not answer; see that it runs", "控制器无应答;请检查其是否运行"),
    "unsure": Text("no answer came; look whether it was done", "未收到应答;请查看是否已执行"),
    "refused": Text("the controller refused it (Modbus exception {code:02d})", "控制器拒绝(Modbus 异常码 {code:02d})"),
    "no command": Text("there is no command {name!r}", "没有命令 {name!r}"),
    "by hand": Text("this output is held by hand: use jog", "此输出须按住操作:请使用点动"),
    "no set-point": Text("there is no set-point {name!r}", "没有设定值 {name!r}"),
    "range": Text("give {lowest} to {highest}", "请输入 {lowest} 至 {highest}"),
    "at start": Text(
        "it belongs to the machine; give it at the start with --set",
        "此值属于机器;请在启动时用 --set 给定",
    ),
    "no output": Text("no output {name!r} is held by hand", "没有可点动的输出 {name!r}"),
    "jog taken": Text("somebody else holds an output by hand", "他人正在点动"),
    "press again": Text("let go of the button and press again", "请松开按钮后重新按下"),
    "no box": Text("there is no operator box to be pressed from here", "此处没有可操作的按钮盒"),
    "no box answer": Text("the operator box does not answer", "按钮盒无应答"),
    "no pace": Text("time is real here; it has no other speed", "此处为真实时间,不能变速"),
    "no forcing": Text("this controller allows no forcing", "此控制器不允许强制"),
    "no input": Text("there is no input {name!r}", "没有输入点 {name!r}"),
    "force only at rest": Text(
        "inputs are forced in Stopped, mode manual, only", "只能在停止状态且手动模式下强制输入"
    ),
}  # fmt: skip
"""How the panel answers an order, by key."""


def reply_text(key: str, **values: object) -> Text:
    """Return an answer with its values put in."""
    text = REPLIES[key]
    return Text(text.en.format(**values), text.zh.format(**values)) if values else text
