"""Causes of alarms in the drives of an arm: air, valves, cylinders, motor and mechanics."""

from __future__ import annotations

from typing import Final

from controller.program.texts.alarms.help import Cause
from controller.program.texts.operator import Text

_LIFT_COILS: Final = ("lift_extend", "lift_retract")
_SLIDE_COILS: Final = ("slide_inward", "slide_outward")
_CLAW_COILS: Final = ("claws_open", "claws_close")
_SPREADER_OUTPUTS: Final = ("spread", "converge")
_SLOW_ONE_WAY: Final = Text("Output on, and the motion is slow one way only", "输出接通，仅一个方向动作缓慢")
_THROTTLE: Final = Text(
    "Isolate first. Setting of the throttles; tube bent or blocked", "先断电断气并上锁。检查节流阀开度、气管弯折或堵塞"
)
_LEAK: Final = Text(
    "Isolate first. Tubes, fittings, check valves and seals of the cylinder",
    "先断电断气并上锁。检查气管、接头、单向阀和气缸密封",
)
_VALVE: Final = Text(
    "Isolate first. Plug of the coil, spool, silencers", "先断电断气并上锁。检查线圈插头、阀芯、消声器"
)
_COIL: Final = Text(
    "Output and lamp of the coil on, and no motion or a late one", "输出和线圈指示灯均亮，但不动作或动作迟缓"
)
_NO_MOTION: Final = Text(
    "Output on, air pressure normal, and no motion; an object in the way?",
    "输出接通，气压正常，但不动作；是否有异物阻挡",
)

MOTION_CAUSES: Final = {
    "lift throttle": Cause(
        Text("Throttle of the lift closed too far", "升降节流阀关得过小"), _SLOW_ONE_WAY, "lift", _THROTTLE, _LIFT_COILS
    ),
    "lift leak": Cause(
        Text("Lift loses air", "升降漏气"),
        Text("The arm rises or sinks with both outputs off; sound of escaping air", "两输出断开时臂自行升降；有漏气声"),
        "lift",
        _LEAK,
        _LIFT_COILS,
    ),
    "lift valve": Cause(Text("Valve of the lift sticks", "升降电磁阀卡滞"), _COIL, "lift", _VALVE, _LIFT_COILS),
    "lift jammed": Cause(
        Text("Lift jammed, or its load caught", "升降卡滞或载荷受阻"),
        _NO_MOTION,
        "lift",
        Text(
            "Isolate first. Guide, load, object below the arm; both chambers must be vented before a jam is freed",
            "先断电断气并上锁。检查导向、载荷和臂下方异物；排除卡滞前气缸两腔必须已排空",
        ),
        _LIFT_COILS,
    ),
    "slide throttle": Cause(
        Text("Throttle of the slide closed too far", "滑块节流阀关得过小"),
        _SLOW_ONE_WAY,
        "slide",
        _THROTTLE,
        _SLIDE_COILS,
    ),
    "slide leak": Cause(
        Text("Slide loses air", "滑块漏气"),
        Text("The slide creeps with both outputs off; sound of escaping air", "两输出断开时滑块爬行；有漏气声"),
        "slide",
        _LEAK,
        _SLIDE_COILS,
    ),
    "slide valve": Cause(
        Text("Valve of the slide sticks or switches late", "滑块电磁阀卡滞或换向迟缓"),
        _COIL,
        "slide",
        _VALVE,
        _SLIDE_COILS,
    ),
    "slide jammed": Cause(
        Text("Slide jammed, or its claws caught", "滑块卡滞或夹爪受阻"),
        _NO_MOTION,
        "slide",
        Text(
            "Isolate first. Rail, objects, claws; both chambers must be vented before a jam is freed",
            "先断电断气并上锁。检查导轨、异物和夹爪；排除卡滞前气缸两腔必须已排空",
        ),
        _SLIDE_COILS,
    ),
    "slide magnet": Cause(
        Text("Magnetic coupling of the slide has let go", "滑块磁耦脱开"),
        Text("The piston is heard at its end, and the slide stands", "听到活塞到端声，而滑块不动"),
        "slide",
        Text(
            "Isolate first. Push the slide back over the piston; rail, load, air pressure too high",
            "先断电断气并上锁。将滑块推回活塞位置；检查导轨、载荷、气压是否过高",
        ),
        _SLIDE_COILS,
    ),
    "slide fast": Cause(
        Text("Slide too fast: throttle open too far, brake worn", "滑块过快：节流阀开得过大、制动器磨损"),
        Text("Air pressure above its normal value? Does the slide stop hard?", "气压是否高于正常值；滑块是否急停"),
        "slide",
        Text("Isolate first. Throttles, brake and its check valves", "先断电断气并上锁。检查节流阀、制动器及其单向阀"),
        _SLIDE_COILS,
        ("slide_least",),
    ),
    "spreader belt": Cause(
        Text("Belt of the spreader slips", "夹爪同步带打滑"),
        Text("The motor is heard, and the claws do not move or move late", "听到电机转动，而夹爪不动或动作迟缓"),
        "spreader",
        Text("Isolate first. Tension and teeth of the belt", "先断电断气并上锁。检查同步带张力和齿形"),
        _SPREADER_OUTPUTS,
    ),
    "spreader jammed": Cause(
        Text("Spreader jammed: claws caught, or an object between them", "夹爪分散机构卡滞：夹爪勾住或之间有异物"),
        Text("Output on, and the claws stand; motor hums?", "输出接通，而夹爪不动；电机是否嗡嗡作响"),
        "spreader",
        Text(
            "Isolate first. Claws, guide, objects between the claws", "先断电断气并上锁。检查夹爪、导向、夹爪之间的异物"
        ),
        _SPREADER_OUTPUTS,
    ),
    "spreader drive": Cause(
        Text("Motor of the spreader without power", "夹爪分散电机无电"),
        Text("Lamps of the motor drive, fuse", "电机驱动器指示灯、熔断器"),
        "cabinet",
        Text("Isolate first. Cable and plug of the motor", "先断电断气并上锁。检查电机电缆和插头"),
        _SPREADER_OUTPUTS,
    ),
    "claw valve": Cause(
        Text("Valve of the claws sticks, or claws without air", "夹爪电磁阀卡滞或夹爪无气"),
        Text(
            "Output and lamp of the coil on, and the claws stand; pressure of the claw regulator",
            "输出和线圈指示灯均亮，而夹爪不动；夹爪减压阀压力",
        ),
        "claws",
        _VALVE,
        _CLAW_COILS,
    ),
    "claw leak": Cause(
        Text("Claws lose air", "夹爪漏气"),
        Text(
            "Sound of escaping air with the claws closed; pressure of the claw regulator",
            "夹爪闭合时有漏气声；夹爪减压阀压力",
        ),
        "claws",
        Text(
            "Isolate first. Hoses, fittings and grippers of this arm",
            "先断电断气并上锁。检查该臂夹爪的气管、接头和气爪",
        ),
        ("claws_close", "claw_pressure"),
    ),
    "claw pressure switch": Cause(
        Text("Pressure switch of the claws set wrongly or failed", "夹爪压力开关设定错误或失效"),
        Text(
            "Its display against the gauge of the claw regulator; lamp on with the claws closed, off with them open",
            "对照夹爪减压阀压力表查看其显示；夹爪闭合时灯亮、张开时灯灭",
        ),
        "claws",
        Text("Isolate first. Hose, wire and terminal of the switch", "先断电断气并上锁。检查开关的气管、接线和端子"),
        ("claw_pressure",),
    ),
    "claws blocked": Cause(
        Text("Output of the claws blocked or delayed", "夹爪输出被联锁或延迟"),
        Text(
            "Output off (I/O page): arm down and slide in position? Message about a slow disk?",
            "输出断开（见输入输出页面）：臂是否在下限位、滑块是否到位；有无磁盘过慢的消息",
        ),
        "cabinet",
        points=_CLAW_COILS,
    ),
    "not in service": Cause(
        Text("Arm out of service, and not at feed", "臂已停用而不在投苗位"),
        Text(
            "Shown as out of service (Recovery page)? Homing does not move it: return it to service in Stopped",
            "是否显示为停用（见恢复页面）；回原位时该臂不动，应在停止状态启用",
        ),
        "slide",
    ),
    "pushed": Cause(
        Text("Arm moved by a person, or by the load", "臂受外力或载荷带动"),
        Text(
            "Was anybody at the arm? Does it stand where the panel shows it?",
            "是否有人碰过该臂；实际位置与面板显示是否一致",
        ),
        "slide",
    ),
    "air supply": Cause(
        Text("Main air pressure too low", "主气压过低"),
        Text(
            "Gauge; compressor on, shut-off valve open, regulator, filter; several motions slow?",
            "压力表；空压机是否运行、截止阀是否打开、减压阀、过滤器；是否多个动作缓慢",
        ),
        "air_supply",
        Text(
            "Isolate first. Hoses and fittings from the compressor to the valves",
            "先断电断气并上锁。检查空压机至电磁阀的软管和接头",
        ),
        ("air_pressure_ok",),
    ),
}
"""Causes in the drives, by key."""
