"""Causes of alarms in the tray feeder, the cups, the control cabinet, and in what people do."""

from __future__ import annotations

from typing import Final

from controller.program.texts.alarms.help import Cause
from controller.program.texts.operator import Text

_FEEDER: Final = ("tray_run", "tray_forward")

_TRAY_CAUSES: Final = {
    "stepper": Cause(
        Text("Motor of the conveyor without power or too weak", "输送带步进电机无电或力矩不足"),
        Text(
            "Both outputs on, and the belt stands; lamps of the motor drive, its supply",
            "两输出接通，而输送带不动；步进驱动器指示灯及其电源",
        ),
        "cabinet",
        Text("Isolate first. Cable, plug and coupling of the motor", "先断电断气并上锁。检查电机电缆、插头和联轴器"),
        _FEEDER,
    ),
    "conveyor jammed": Cause(
        Text("Conveyor jammed, or tray caught", "输送带卡滞或苗盘卡住"),
        Text("Motor heard, and the tray stands or is askew?", "听到电机转动，而苗盘不动或歪斜"),
        "conveyor",
        Text("Isolate first. Tray, guides, belt, pushers", "先断电断气并上锁。检查苗盘、导向、输送带和推板"),
        _FEEDER,
    ),
    "tray follows": Cause(
        Text("Next tray follows too closely", "后一苗盘跟得过近"),
        Text(
            "Less than 40 mm between the two trays, or a second tray under the sensor?",
            "两苗盘间距是否不足 40 毫米，或传感器下有另一苗盘",
        ),
        "magazine",
        Text("Isolate first. Move the next tray back to the magazine", "先断电断气并上锁。将后一苗盘移回苗盘仓"),
        ("tray_front_edge",),
    ),
    "tray moved": Cause(
        Text("Tray taken out or pushed", "苗盘被取走或推动"),
        Text("Is a tray at the pick position? The panel asks which one it is", "取苗位是否有苗盘；面板会询问是哪一盘"),
        "tray",
        Text("Isolate first. Put the tray back against its stop", "先断电断气并上锁。将苗盘放回并靠紧定位"),
        ("tray_front_edge",),
    ),
    "magazine empty": Cause(
        Text("No tray left in the magazine", "苗盘仓无苗盘"),
        Text("Trays in the magazine? Otherwise the sensor and its wire", "仓内是否有苗盘；若有，则为传感器或其接线"),
        "magazine",
        Text(
            "Isolate first. Fill the magazine; sensor, wire, terminal",
            "先断电断气并上锁。补充苗盘；检查传感器、接线和端子",
        ),
        ("magazine_empty",),
    ),
}
_CUP_CAUSES: Final = {
    "cup flags": Cause(
        Text("Counter misses flags or counts them twice", "计数器漏计或重复计数"),
        Text(
            "Lamp of each counter as cups pass: one pulse for each cup? Cups under the claws empty?",
            "苗杯经过时各计数器指示灯是否每杯闪一次；夹爪下方苗杯是否为空",
        ),
        "cups",
        Text(
            "Isolate first. Distance to the flags, bent or missing flags, shielding of the wires",
            "先断电断气并上锁。检查与感应片的距离、感应片弯曲或缺失、电缆屏蔽",
        ),
        ("cup_pulse",),
        both_sides=True,
    ),
    "cups stopped": Cause(
        Text("Cups of one row stand: chain broken or jammed", "一行苗杯不动：链条断裂或卡滞"),
        Text("Do the cups of both rows move while the tractor drives?", "拖拉机行驶时两行苗杯是否都在转动"),
        "cups",
        Text(
            "Isolate first. Chain, sprockets, object between the cups", "先断电断气并上锁。检查链条、链轮、苗杯间的异物"
        ),
        ("cup_pulse",),
        both_sides=True,
    ),
    "row not picked": Cause(
        Text("Seedlings not gripped, cut or dropped on the way", "苗未夹住、被夹断或途中掉落"),
        Text(
            "Seedlings left in the tray, cut stems, plugs on the machine? Does the tray stand straight at its place?",
            "苗盘内是否留有苗、苗茎是否夹断、机上是否有掉落的苗；苗盘是否正对到位",
        ),
        "tray",
        Text("Isolate first. Claws, pads, tray guides", "先断电断气并上锁。检查夹爪、衬垫、苗盘导向"),
    ),
    "seedlings beside the cups": Cause(
        Text("Seedlings thrown beside the cups", "苗投到苗杯外"),
        Text(
            "Plugs beside the cups? Are the claws over the cups when they open?",
            "苗杯旁是否有苗；张开时夹爪是否对准苗杯",
        ),
        "cups",
        points=("cup_pulse",),
        set_points=("release_lead", "release_delay"),
    ),
    "yield sensor": Cause(
        Text("Beam or cup sensor dirty, moved or failed", "光电开关或苗杯传感器脏污、移位或失效"),
        Text(
            "Seedlings in the claws, cups behind them filled? Lamp of the cup sensor: on at a filled cup, off between "
            "two cups; lamp of the beam: changes with each stem",
            "夹爪和其后方苗杯是否有苗；苗杯传感器指示灯应在有苗杯处亮、两杯之间灭，光电开关指示灯应随每株苗变化",
        ),
        "cups",
        Text(
            "Isolate first. Wipe the sensors; holder, wire, terminal",
            "先断电断气并上锁。擦净传感器，检查支架、接线和端子",
        ),
        ("cup_filled", "seedling_beam"),
        ("missing_most",),
    ),
    "tractor fast": Cause(
        Text("Tractor too fast, or accelerated abruptly", "拖拉机过快或急加速"),
        Text(
            "Speed of the tractor; advised planting frequency on the overview page",
            "拖拉机速度；总览页面的建议栽植频率",
        ),
        "ground_wheel",
        set_points=("cup_time_shortest",),
    ),
    "tractor slow": Cause(
        Text("Tractor too slow", "拖拉机过慢"),
        Text("Drive faster; the arms go on by themselves", "提高行驶速度；机械臂会自行继续"),
        "ground_wheel",
        set_points=("cup_time_longest",),
    ),
    "ground wheel": Cause(
        Text("Ground wheel slips, or its sensor misses pulses", "地轮打滑或其传感器漏计"),
        Text("Does the wheel turn evenly? Lamp of the sensor while it turns", "地轮转动是否均匀；转动时传感器指示灯"),
        "ground_wheel",
        Text("Isolate first. Distance of the sensor, wire, terminal", "先断电断气并上锁。检查传感器距离、接线和端子"),
        ("ground_pulse",),
        ("ground_pulses_least", "ground_pulses_most"),
    ),
    "planter drive": Cause(
        Text("Speed of the planter chain does not fit the ground speed", "栽植器链条速度与前进速度不符"),
        Text("Gear or speed of the planter; slip of the drive wheel", "栽植器传动比或速度；驱动轮是否打滑"),
        "ground_wheel",
        points=("planter_speed",),
        set_points=("planter_pitch", "ground_pulse", "lambda_lowest", "lambda_highest"),
    ),
}
_CABINET_CAUSES: Final = {
    "emergency button": Cause(
        Text("Emergency stop pressed", "急停被按下"),
        Text("Why was it pressed? Release it only with nobody in the machine", "为何按下；确认机内无人后再释放"),
        "cabinet",
        points=("emergency_stop",),
    ),
    "emergency wire": Cause(
        Text("Wire of the emergency stop broken, or safety relay without power", "急停回路断线或安全继电器无电"),
        Text(
            "Button released, and its input still off? Lamps of the safety relay",
            "按钮已释放而输入仍断开；安全继电器指示灯",
        ),
        "cabinet",
        Text("Isolate first. Contacts, wire and terminal of the button", "先断电断气并上锁。检查按钮触点、接线和端子"),
        ("emergency_stop",),
    ),
    "guard": Cause(
        Text("Guard opened", "安全门被打开"),
        Text(
            "Nobody in the machine? Close the guard, then press X0 to home",
            "确认机内无人；关上安全门，然后按 X0 回原点",
        ),
        "cabinet",
        points=("guard",),
    ),
    "guard wire": Cause(
        Text(
            "Switch or wire of the guard, or its safety relay without power", "安全门开关或接线断开，或安全继电器无电"
        ),
        Text(
            "Guard closed: the input must be on (normally closed). Lamps of the safety relay",
            "安全门关闭时输入应接通（常闭）；安全继电器指示灯",
        ),
        "cabinet",
        Text("Isolate first. Switch, wire and terminal of the guard", "先断电断气并上锁。检查安全门开关、接线和端子"),
        ("guard",),
    ),
    "stop button": Cause(
        Text("Stop button held or jammed", "停止按钮被按住或卡住"),
        Text("Does the button spring back?", "按钮是否弹回"),
        "cabinet",
        points=("stop",),
    ),
    "stop wire": Cause(
        Text("Wire of the stop button broken", "停止按钮断线"),
        Text("Button released: the input must be on (normally closed)", "按钮释放时输入应接通（常闭）"),
        "cabinet",
        Text("Isolate first. Contacts, wire and terminal of the button", "先断电断气并上锁。检查按钮触点、接线和端子"),
        ("stop",),
    ),
    "start button": Cause(
        Text("Start button held, jammed or its contact welded", "启动按钮被按住、卡住或触点粘连"),
        Text("Does the button spring back? Released: the input must be off", "按钮是否弹回；释放时输入应断开"),
        "cabinet",
        Text("Isolate first. Contacts and wire of the button", "先断电断气并上锁。检查按钮触点和接线"),
        ("start",),
    ),
    "reset button": Cause(
        Text("Reset button held, jammed or its contact welded", "复位按钮被按住、卡住或触点粘连"),
        Text("Does the button spring back? Released: the input must be off", "按钮是否弹回；释放时输入应断开"),
        "cabinet",
        Text("Isolate first. Contacts and wire of the button", "先断电断气并上锁。检查按钮触点和接线"),
        ("reset",),
    ),
    "field link": Cause(
        Text("I/O module without power or without network", "输入输出模块无电或网络中断"),
        Text("Lamps of the module; network cable, switch; address of the module", "模块指示灯；网线、交换机；模块地址"),
        "cabinet",
    ),
    "computer busy": Cause(
        Text("Computer overloaded or in sleep mode", "计算机过载或休眠"),
        Text(
            "Log of the controller; other programs; restart the controller if it recurs",
            "控制器日志；其他程序；再次出现时重启控制器",
        ),
        "cabinet",
    ),
    "disk": Cause(
        Text("Disk full, slow or write-protected", "磁盘已满、过慢或写保护"),
        Text(
            "Space and permissions of the folder of the memory file; log of the controller",
            "保持数据文件夹的空间和权限；控制器日志",
        ),
        "cabinet",
    ),
    "memory file": Cause(
        Text("File of the retentive memory missing or damaged", "保持数据文件缺失或损坏"),
        Text(
            "Look at claws, rows and tray; enter the set-points again: they have their defaults",
            "查看夹爪、苗行和苗盘；设定值已恢复为默认值，请重新设定",
        ),
        "cabinet",
    ),
    "second master": Cause(
        Text("A second controller, panel or tool writes the outputs", "另一控制器、面板或工具在写输出"),
        Text(
            "Its address is in the message of the controller: stop it; write lock or address list of the module",
            "其地址见控制器消息：停止该设备；启用模块的写锁定或允许地址表",
        ),
        "cabinet",
    ),
    "panel off": Cause(
        Text("Panel off or without network", "面板关机或网络中断"),
        Text("Power and network cable of the panel; load of its computer", "面板电源和网线；面板计算机负载"),
        "cabinet",
    ),
    "constants": Cause(
        Text("Constants of another machine or of another row spacing", "其他机器或其他行距的常数"),
        Text(
            "Parameter page: are the marked values meant for this machine? They are given at each start",
            "参数页面：标出的数值是否适用于本机；每次启动时须重新给定",
        ),
        "cabinet",
    ),
}
MACHINE_CAUSES: Final = _TRAY_CAUSES | _CUP_CAUSES | _CABINET_CAUSES
"""Causes outside the drives and switches of an arm, by key."""
