"""Alarm texts: message and checks, in English and Chinese."""

from __future__ import annotations

from typing import Final

from controller.common.declarations import Declared
from controller.program.texts.operator import AlarmText, Text

# The checks depend on the actuator and its direction, so all steps with the same motion share one text. Outputs,
# switches and set-points are named in words, because an operator does not know the names of the program.
_LIFT_UP: Final = Text(
    "Output for arm up on? Lift valve, tubes, throttle; air pressure; guide jammed or load caught? With the arm up: "
    "LED, position and wire of the upper switch. Vent both chambers by hand before freeing a jam",
    "臂上升的输出是否接通；升降电磁阀、气管、节流阀；气压；导向卡滞或负载受阻；臂在上限位时上限位开关的指示灯、"
    "安装位置和接线；排除卡滞前先手动排空气缸两腔",
)
_LIFT_DOWN: Final = Text(
    "Output for arm down on? Lift valve, tubes, throttle; air pressure; guide jammed or something below? With the arm "
    "down: LED, position and wire of the lower switch. Vent both chambers by hand before freeing a jam",
    "臂下降的输出是否接通；升降电磁阀、气管、节流阀；气压；导向卡滞或下方有异物；臂在下限位时下限位开关的指示灯、"
    "安装位置和接线；排除卡滞前先手动排空气缸两腔",
)
_SLIDE_TO_ROW: Final = Text(
    "Output for slide inward (back: outward) on? Slide valve, tubes, throttle; air pressure; rail jammed, magnetic "
    "coupling lost? At the row: LED, position and wire of the pick switches 1 to 3. Vent both chambers by hand before "
    "freeing a jam",
    "滑块向内（退回时为向外）的输出是否接通；滑块电磁阀、气管、节流阀；气压；导轨卡滞或磁耦脱开；在取苗位时取苗位 1 至 "
    "3 开关的指示灯、安装位置和接线；排除卡滞前先手动排空气缸两腔",
)
_SLIDE_TO_FEED: Final = Text(
    "Output for slide outward on? Slide valve, tubes, throttle; air pressure; rail jammed, magnetic coupling lost, "
    "claws caught? At feed: LED, position and wire of the feed switch. Vent both chambers by hand before freeing a jam",
    "滑块向外的输出是否接通；滑块电磁阀、气管、节流阀；气压；导轨卡滞、磁耦脱开或夹爪受阻；"
    "在投苗位时投苗位开关的指示灯、安装位置和接线；排除卡滞前先手动排空气缸两腔",
)
_SPREAD: Final = Text(
    "Output for spreading on? Motor drive, fuse and cable; belt tension; a claw jammed or two claws caught? With the "
    "claws spread: LED, position and wire of the spread switch",
    "夹爪分散的输出是否接通；电机驱动器、熔断器和电缆；同步带张力；夹爪卡滞或相互勾住；夹爪分散后分散开关的指示灯、"
    "安装位置和接线",
)
_CONVERGE: Final = Text(
    "Output for converging on? Motor drive, fuse and cable; belt tension; something between the claws? With the claws "
    "converged: LED, position and wire of the converged switch",
    "夹爪聚合的输出是否接通；电机驱动器、熔断器和电缆；同步带张力；夹爪之间有异物；夹爪聚合后聚合开关的指示灯、"
    "安装位置和接线",
)
_CLAWS_CLOSE: Final = Text(
    "Output for closing the claws on? If on: claw valve, tubes. If off: slide still on its pick switch (1 to 3)? Arm "
    "down? Outputs delayed by a slow disk?",
    "夹爪闭合的输出是否接通；已接通：夹爪电磁阀、气管；未接通：滑块是否仍在取苗位 1 至 3 的相应开关上，臂是否在下限位，"
    "输出是否因磁盘写入慢而被延迟",
)
_CLAWS_OPEN: Final = Text(
    "Output for opening the claws on? If on: claw valve, tubes. If off: slide still on its switch (feed or pick 1 to "
    "3)? Arm down? Outputs delayed by a slow disk?",
    "夹爪张开的输出是否接通；已接通：夹爪电磁阀、气管；未接通：滑块是否仍在投苗位或取苗位 1 至 3 的开关上，"
    "臂是否在下限位，输出是否因磁盘写入慢而被延迟",
)

_ALARMS: Final = {
    "emergency_stop": AlarmText(
        Text("Emergency stop pressed", "急停按钮已按下"),
        Text(
            "Make sure the machine is clear of people and release the button; if it was not pressed: safety relay, "
            "wire of the button",
            "确认机内无人后释放按钮；若无人按下：检查安全继电器和按钮接线",
        ),
    ),
    "link_lost": AlarmText(
        Text("Field link lost; outputs off", "现场通信中断，输出已切断"),
        Text(
            "Power supply and LEDs of the I/O module; network cable and switch; address and port of the field I/O",
            "I/O 模块电源和指示灯；网线和交换机；现场设备的地址和端口",
        ),
    ),
    "scan_fault": AlarmText(
        Text("Scan time exceeded or scan failed; outputs off", "扫描超时或出错，输出已切断"),
        Text(
            "Controller log; CPU load of other programs; computer in sleep mode? If it recurs: restart the controller; "
            "FX2N: scan time in D8010 to D8012",
            "控制器日志；是否有其他程序占用计算机，是否进入过休眠；再次出现时重启控制器；FX2N：查看 D8010 至 D8012 "
            "的扫描时间",
        ),
    ),
    "store_fault": AlarmText(
        Text("Retentive memory cannot be stored", "保持数据无法保存"),
        Text(
            "Disk full, slow or read-only? Write permission for the memory file and its folder; controller log",
            "磁盘是否已满、过慢或只读；保持数据文件及其文件夹的写权限；控制器日志",
        ),
    ),
    "memory_lost": AlarmText(
        Text("Retentive memory lost", "保持数据丢失"),
        Text(
            "Check the claws, the rows and the tray; the set-points have been reset to their defaults: enter them "
            "again; both arms are in service, the mode is continuous",
            "查看夹爪、苗行和苗盘的实际情况；设定值已恢复为默认值，请重新设定；两臂均已启用，模式为连续运行",
        ),
    ),
    "air_low": AlarmText(
        Text("Air pressure low", "气压过低"),
        Text(
            "Compressor on, shut-off valve open? Regulator, filter, leaks; wire of the air pressure switch",
            "空压机是否运行，截止阀是否打开；减压阀、过滤器、漏气；气压开关接线",
        ),
    ),
    "overrun": AlarmText(
        Text("{side} slide moved off the pick position after arriving", "{side}滑块到位后又离开取苗位"),
        Text(
            "Slide too fast: throttle, air pressure; brake or check valves of the slide; position of the pick switches "
            "1 to 3",
            "滑块过快：节流阀、气压；滑块制动器或单向阀；取苗位 1 至 3 开关的安装位置",
        ),
        comment="{side} slide left the pick position after arriving",
    ),
    "off home": AlarmText(
        Text("{side} arm moved off the home position without a command", "{side}臂自行离开原位"),
        Text(
            "Moved manually? Leak at valve, check valve or tube of the lift or slide; lower switch of the lift, feed "
            "switch, converged switch: LED and wire",
            "是否被人推动；升降或滑块的电磁阀、单向阀、气管漏气；升降下限位、投苗位和聚合开关的指示灯和接线",
        ),
        comment="{side} arm left home without a command",
    ),
    "unbidden": AlarmText(
        Text("{side} arm: a switch changed without a command", "{side}臂：无指令时开关状态改变"),
        Text(
            "Did the arm move? If so: moved manually, or leak at valve, check valve or tube. If not: position, LED and "
            "wire of the switch that changed",
            "臂是否移动过；已移动：被人推动，或电磁阀、单向阀、气管漏气；未移动：状态改变的开关的安装位置、"
            "指示灯和接线",
        ),
    ),
    "lift switches": AlarmText(
        Text("{side} lift: both switches on, or a switch on too early", "{side}升降：上、下限位开关同时接通或过早接通"),
        Text(
            "Upper and lower switch: which LED is wrong? Stuck switch, position on the cylinder, wires shorted or "
            "swapped; after a jam the lift may have moved too fast: reset again. Both right? An interlock has stopped "
            "the lift just before its end: check the other switches of the arm",
            "上限位和下限位开关：哪个指示灯不对；开关粘连、在气缸上的位置、接线短路或接反；卡滞排除后升降可能动作过快，"
            "请再次复位；两开关均正常：升降在到位前被联锁停止，检查该臂其他开关",
        ),
        comment="{side} lift: both switches on, or one too early",
    ),
    "slide switches": AlarmText(
        Text("{side} slide: two switches on, or a switch on too early", "{side}滑块：两个位置开关同时接通或过早接通"),
        Text(
            "Feed switch and pick switches 1 to 3: which LED is wrong? Stuck switch, metal in front of it, wires "
            "shorted or swapped. After a jam the slide may have moved too fast: reset again. Row spacing changed? "
            "Set-point of the minimum slide time. All right? An interlock has stopped the slide just before the row: "
            "check the other switches of the arm and of the tray",
            "投苗位开关和取苗位 1 至 3 开关：哪个指示灯不对；开关粘连、前方有金属物、接线短路或接反；"
            "卡滞排除后滑块可能移动过快，请再次复位；行距改变时检查滑块最短移动时间的设定值；开关均正常："
            "滑块在到位前被联锁停止，检查该臂其他开关和苗盘开关",
        ),
        comment="{side} slide: two switches on, or one too early",
    ),
    "belt switches": AlarmText(
        Text(
            "{side} claws: spread and converged both on, or on too early",
            "{side}夹爪：分散、聚合开关同时接通或过早接通",
        ),
        Text(
            "Spread and converged switch: which LED is wrong? Stuck switch, metal in front of it, wires shorted or "
            "swapped",
            "分散开关和聚合开关：哪个指示灯不对；开关粘连、前方有金属物、接线短路或接反",
        ),
        comment="{side} claws: spread and converged at once, or too early",
    ),
    "cup counts": AlarmText(
        Text("{side} row has counted two cups, the other row none", "{side}行已计两个苗杯，另一行没有计数"),
        Text(
            "Both cup counters: LED as cups pass, distance to the flags, wire; chain of the other row broken or flags "
            "missing? Does a counter count a flag twice? Cups under the claws empty?",
            "两个苗杯计数器：苗杯经过时的指示灯、与感应片的距离、接线；另一行链条断裂或感应片丢失；计数器是否重复计数；"
            "夹爪下方苗杯是否为空",
        ),
    ),
    "cups_fast": AlarmText(
        Text("Cups pass faster than permitted", "苗杯通过速度超过允许值"),
        Text(
            "Tractor too fast? Cup counters: two pulses for one cup? Set-point of the shortest cup time. Cups under "
            "the claws empty?",
            "拖拉机是否过快；苗杯计数器是否对一个苗杯计两次；苗杯最短间隔时间的设定值；夹爪下方苗杯是否为空",
        ),
    ),
    "cups_implausible": AlarmText(
        Text("Cup pulses follow faster than the cups can", "苗杯脉冲间隔小于苗杯可能的间隔"),
        Text(
            "Tractor accelerated abruptly? Both cup counters: two pulses for one cup, distance to the flags, "
            "interference, shielding of the wires? Cups under the claws empty?",
            "拖拉机是否急加速；两个苗杯计数器：是否对一个苗杯计两次、与感应片的距离、干扰、电缆屏蔽；"
            "夹爪下方苗杯是否为空",
        ),
    ),
    "cups_ground": AlarmText(
        Text("Cups do not agree with the ground travel", "苗杯计数与地轮行程不符"),
        Text(
            "Both cup counters: pulses doubled or missing? Ground wheel, its sensor and wire; drive wheel slipping? "
            "Set-points of the ground pulses from cup to cup. Cups under the claws empty?",
            "两个苗杯计数器：脉冲是否重复或缺失；地轮及其传感器和接线；驱动轮是否打滑；相邻苗杯间地轮脉冲数的设定值；"
            "夹爪下方苗杯是否为空",
        ),
    ),
    "cups_slow": AlarmText(
        Text("Cups pass more slowly than permitted; the arms wait", "苗杯通过速度低于允许值，机械臂等待"),
        Text("Drive faster; set-point of the longest cup time", "提高行驶速度；苗杯最长间隔时间的设定值"),
    ),
    "approach row": AlarmText(Text("{side} slide did not reach the row", "{side}滑块未到达取苗位"), _SLIDE_TO_ROW),
    "return to row": AlarmText(Text("{side} slide did not return to the row", "{side}滑块未退回取苗位"), _SLIDE_TO_ROW),
    "close claws": AlarmText(
        Text("{side} claws not closed: position or outputs lost", "{side}夹爪未闭合：位置或输出丢失"),
        _CLAWS_CLOSE,
    ),
    "lift from row": AlarmText(Text("{side} arm not up after clamping", "{side}臂夹苗后未升到上限位"), _LIFT_UP),
    "slide to feed": AlarmText(
        Text("{side} slide did not reach feed while loaded", "{side}滑块带苗未到达投苗位"),
        _SLIDE_TO_FEED,
        comment="{side} slide did not reach feed, loaded",
    ),
    "spread": AlarmText(Text("{side} claws not spread", "{side}夹爪未分散到位"), _SPREAD),
    "lower over cups": AlarmText(
        Text("{side} arm not down over the cups", "{side}臂在苗杯上方未降到下限位"), _LIFT_DOWN
    ),
    "open claws": AlarmText(
        Text("{side} claws not opened: position or outputs lost", "{side}夹爪未张开：位置或输出丢失"),
        _CLAWS_OPEN,
    ),
    "raise empty": AlarmText(
        Text("{side} arm not up after the release", "{side}臂投苗后未升到上限位"),
        _LIFT_UP,
    ),
    "converge": AlarmText(Text("{side} claws not converged", "{side}夹爪未聚合到位"), _CONVERGE),
    "lower empty": AlarmText(Text("{side} arm not down after converging", "{side}臂聚合后未降到下限位"), _LIFT_DOWN),
    "park": AlarmText(Text("{side} arm not up while parking", "{side}臂停放时未升到上限位"), _LIFT_UP),
    "home: lower to put back": AlarmText(
        Text("Homing: {side} arm not down at the row", "回原点：{side}臂在取苗位未降到下限位"), _LIFT_DOWN
    ),
    "home: put back": AlarmText(
        Text("Homing: {side} claws not opened at the row", "回原点：{side}夹爪在取苗位未张开"), _CLAWS_OPEN
    ),
    "home: raise loaded": AlarmText(
        Text("Homing: {side} arm not up while loaded", "回原点：{side}臂带苗未升到上限位"),
        _LIFT_UP,
        comment="Homing: {side} arm not up, loaded",
    ),
    "home: raise empty": AlarmText(
        Text("Homing: {side} arm not up while empty", "回原点：{side}臂空载未升到上限位"),
        _LIFT_UP,
        comment="Homing: {side} arm not up, empty",
    ),
    "home: out": AlarmText(
        Text("Homing: {side} slide did not reach feed", "回原点：{side}滑块未到达投苗位"), _SLIDE_TO_FEED
    ),
    "home: out low": AlarmText(
        Text("Homing: {side} slide did not reach feed with the arm down", "回原点：{side}滑块低位未到达投苗位"),
        _SLIDE_TO_FEED,
        comment="Homing: {side} slide did not reach feed with the arm down",
    ),
    "home: raise at feed": AlarmText(
        Text("Homing: {side} arm not up at feed", "回原点：{side}臂在投苗位未升到上限位"), _LIFT_UP
    ),
    "home: discard, spread": AlarmText(Text("Discard: {side} claws not spread", "弃苗：{side}夹爪未分散到位"), _SPREAD),
    "home: discard, lower": AlarmText(
        Text("Discard: {side} arm not down over the cups", "弃苗：{side}臂未降到下限位"), _LIFT_DOWN
    ),
    "home: open at feed": AlarmText(
        Text("Homing: {side} claws not opened at feed", "回原点：{side}夹爪在投苗位未张开"), _CLAWS_OPEN
    ),
    "home: raise to converge": AlarmText(
        Text("Homing: {side} arm not up before converging", "回原点：{side}臂聚合前未升到上限位"),
        _LIFT_UP,
        comment="Homing: {side} arm not up before converging",
    ),
    "home: converge": AlarmText(Text("Homing: {side} claws not converged", "回原点：{side}夹爪未聚合到位"), _CONVERGE),
    "home: lower": AlarmText(Text("Homing: {side} arm not down", "回原点：{side}臂未降到下限位"), _LIFT_DOWN),
    "tray_jam": AlarmText(
        Text("Tray did not leave the pick position", "苗盘未离开取苗位"),
        Text(
            "Outputs of the tray conveyor on (run and forward)? Stepper drive and its supply; belt slipping, tray "
            "caught; next tray less than 40 mm behind, or inserted under the sensor; tray sensor dirty or covered: "
            "LED, wire",
            "苗盘输送带的输出（运行和正转）是否接通；步进驱动器及其电源；输送带打滑、苗盘卡住；后一苗盘间距不足 40 mm，"
            "或被放在传感器下；苗盘传感器脏污或被遮挡：指示灯、接线",
        ),
    ),
    "tray_lost": AlarmText(
        Text("Tray missing at the pick position", "取苗位苗盘丢失"),
        Text(
            "Tray removed or pushed? Tray sensor: alignment, dirt, LED, wire",
            "苗盘是否被取走或推动；苗盘传感器：对准、脏污、指示灯、接线",
        ),
    ),
    "magazine_empty": AlarmText(
        Text("Tray magazine empty", "苗盘仓已空"),
        Text(
            "Fill the magazine; if it is not empty: its sensor and wire",
            "补充苗盘；若仍有苗盘：检查苗盘仓传感器及其接线",
        ),
    ),
    "stop_stuck": AlarmText(
        Text("Stop button pressed or its wire broken: start not possible", "停止按钮或其线路断开，无法启动"),
        Text(
            "Stop button released? Contact block, wire and terminal of the button (normally closed: on while released)",
            "停止按钮是否释放；按钮的触点、接线和端子（常闭：释放时接通）",
        ),
    ),
    "start_stuck": AlarmText(
        Text(
            "Start button closed for more than 10 s: no effect until it opens",
            "启动按钮接通超过 10 秒：断开前无效",
        ),
        Text(
            "Start button released? Contact block welded or jammed; its wire and terminal",
            "启动按钮是否释放；触点是否粘连或卡住；其接线和端子",
        ),
    ),
    "reset_stuck": AlarmText(
        Text(
            "Reset button closed for more than 10 s: no effect until it opens",
            "复位按钮接通超过 10 秒：断开前无效",
        ),
        Text(
            "Reset button released? Contact block welded or jammed; its wire and terminal",
            "复位按钮是否释放；触点是否粘连或卡住；其接线和端子",
        ),
    ),
    "constants": AlarmText(
        Text("A machine constant differs from its default", "机器常数与默认值不同"),
        Text(
            "Intended for this machine? The parameter page and the messages at the start name it; it is given at each "
            "start of the controller",
            "是否适用于本机；参数页面和启动信息列出该常数；每次启动时须重新给定",
        ),
    ),
    "hmi_silent": AlarmText(
        Text("Operator panel not responding: holding after the current cycle", "操作面板无响应：完成当前循环后保持"),
        Text(
            "Panel powered on? Network cable and address of the panel; CPU load of the panel computer",
            "面板是否通电；面板的网线和地址；面板计算机的负载",
        ),
    ),
    "lambda": AlarmText(
        Text(
            "Planter chain too slow or too fast for the ground speed (lambda outside its limits)",
            "栽植器链条速度与前进速度不匹配（λ 超出范围）",
        ),
        Text(
            "Slip of the drive wheel? Gear or speed of the planter; set-points: planter pitch, ground pulse, limits of "
            "lambda; sensor of the ground wheel and its wire",
            "驱动轮是否打滑；栽植器传动比或速度；栽植器间距、地轮脉冲和 λ 范围的设定值；地轮传感器及其接线",
        ),
    ),
    "outputs_taken": AlarmText(
        Text("Outputs taken over by another controller; nothing is written", "输出被另一控制器占用，已停止写输出"),
        Text(
            "Its address: message of the controller. Stop the other controller, panel or tool; use the write lock or "
            "the list of permitted addresses of the I/O module; then clear",
            "对方地址见控制器消息；停止另一控制器、面板或工具；启用 I/O 模块的写锁定或允许地址表；然后清除中止",
        ),
        comment="Outputs taken over by another controller",
    ),
    "outputs_contested": AlarmText(
        Text("Another controller tried to write the outputs and was refused", "另一控制器试图写输出，已被拒绝"),
        Text(
            "Its address: message of the controller. Stop the other controller or tool",
            "对方地址见控制器消息；停止另一控制器或工具",
        ),
        comment="Another controller tried to write the outputs",
    ),
    "planting_fast": AlarmText(
        Text("Planting faster than the arms: gaps in the rows", "栽植频率超过机械臂能力，将出现漏苗"),
        Text(
            "Drive more slowly: see the advised planting frequency; air pressure and throttles if the arms are slow",
            "降低车速，参见建议栽植频率；若机械臂动作慢，检查气压和节流阀",
        ),
    ),
}
ALARMS: Final = Declared("ALARMS", __name__, _ALARMS)
"""Alarm texts, by key."""

ALARM_STATES: Final = {
    "normal": Text("normal", "正常"),
    "unacknowledged": Text("unacknowledged", "未确认"),
    "acknowledged": Text("acknowledged", "已确认"),
    "returned_unacknowledged": Text("returned to normal, unacknowledged", "已恢复，未确认"),
    "latched_unacknowledged": Text("latched, unacknowledged", "锁存，未确认"),
    "latched_acknowledged": Text("latched, acknowledged", "锁存，已确认"),
    "shelved": Text("shelved", "已搁置"),
}
"""Names of the ISA-18.2 alarm states, by value of `AlarmState`."""

ALARM_REFUSALS: Final = {
    "unknown": Text(
        "unknown alarm S{number}; use a number in the alarm list", "没有报警 S{number}，请使用报警表中的编号"
    ),
    "safety": Text(
        "S{number} is a safety alarm and cannot be shelved; remove its cause and reset",
        "S{number} 是安全报警，不得搁置；请排除原因后复位",
    ),
    "stops_work": Text(
        "S{number} stops the machine and cannot be shelved; remove its cause and reset",
        "S{number} 会使机器停止，不得搁置；请排除原因后复位",
    ),
    "time": Text(
        "the shelving time must be 1 ms to {limit} h, not {for_ms} ms",
        "搁置时间须为 1 毫秒至 {limit} 小时，不能是 {for_ms} 毫秒",
    ),
    "nobody": Text("operator name required for the journal", "请注明操作人：姓名将记入日志"),
}
"""Reasons for refusing an alarm list action."""
