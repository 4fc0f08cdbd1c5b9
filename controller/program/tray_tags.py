"""Tags of the tray feeder."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap
from controller.core.expr import Timer, Word
from controller.program.areas import Area
from controller.program.inputs import Inputs, driven


class TrayTags:
    """Relays, registers and timers of the tray feeder."""

    def __init__(self, io_map: IoMap) -> None:
        m = Area("M", 300, 329, "tray")
        t10 = Area("T", 220, 223, "tray")
        x = Inputs(io_map)
        self.edge = x.tray_front_edge
        self.driven = {name: driven(io_map[name]) for name in ("tray_run", "tray_forward")}
        self.first_step = 180
        self.phase = Word("D", 561, "tray.phase", "0 none, 1 in place, 2 moving out, 3 coming in, 4 unknown")
        self.want_run = m.bit("want run", "request: conveyor at full speed")
        self.want_creep = m.bit("want creep", "request: conveyor in short pulses")
        self.needed = m.bit("needed", "the tray is empty or missing, and another one is required")
        self.permit = m.bit("permit", "the feeder may move")
        self.emptied = m.bit("emptied", "the last row has been taken, this scan")
        self.ask = m.bit("ask tray", "question to the operator: which tray is at the pick position?")
        self.ready = m.bit("ready", "feeding is complete, or no tray is available")
        self.at_rest = m.bit("at rest", "no tray is being moved")
        self.missing = m.bit("missing", "no tray arrived")
        self.ungranted = m.bit("request blocked", "a requested conveyor output is blocked by an interlock, this scan")
        self.blocked_by = Word(
            "D", 112, "tray.blocked by", "number of the interlock that blocks the conveyor; 0 = none"
        )
        self.fault = m.bit("fault", "an alarm of the feeder is set")
        self.met = m.bit(
            "unexpected", "a tray reached the front edge sensor while the belt was not creeping, this scan"
        )
        self.leaves = m.bit("leaves", "the tray is released to be conveyed out, this scan")
        self.place_known = m.bit(
            "place known",
            "the tray in place has been measured, or confirmed by the operator, since the last Aborted, manual mode, "
            "power-up, open guard and alarm of a lost tray",
        )
        self.t_index = t10.timer("index", "full speed into the gap behind a tray")
        self.t_settle = t10.timer("settle", "tray at rest")
        self.t_on = t10.timer("creep on", "creep: run time of a pulse")
        self.t_off = t10.timer("creep off", "creep: pause after a pulse")
        self.t_met = Timer(234, "tray.in gap", "front edge sensor on in the gap behind a tray")
        self.t_no_tray = Timer(103, "tray.no tray", "creeping without a tray")
        self.t_lost = Timer(106, "tray.lost", "front edge sensor off while a tray should be in place")
        self.exit_time = Word(
            "D", 564, "tray.exit time x100 ms", "run time of the belt with a leaving tray, over all stops"
        )
        self.t_exit = Timer(134, "tray.exit", "unit of the exit time")
        self.overdue = m.bit("overdue", "the belt has run longer than a tray needs to leave, this scan")
        self.t_jam = Timer(104, "tray.jam", "front edge sensor still on while a tray moves out")
