"""Small test machine with an alarm list: five alarms, one of each kind."""

from __future__ import annotations

from controller.core.expr import Expr
from controller.core.rungs import Mov, Rst, Set
from controller.events.alarm_list import AlarmChange, AlarmList, AlarmRow
from controller.events.alarm_states import AlarmState
from controller.program.alarms.table import Alarm, Severity
from controller.program.texts.alarms.messages import ALARMS
from tests.controller.core.core_rig import Rig, d, s, x

NORMAL, UNACKNOWLEDGED, ACKNOWLEDGED, RETURNED, LATCHED, LATCHED_ACKNOWLEDGED, SHELVED = AlarmState

E_STOP, JAM, AIR, WARNING, EMPTY = 900, 910, 920, 990, 991
RESET = 7
CAUSES = {E_STOP: 0, JAM: 1, AIR: 2, WARNING: 3, EMPTY: 4}
"""Annunciators of the test machine and the terminals that set them."""
STOPPING = (E_STOP, JAM, AIR)
FIRST_OUT = d(0)
SHELF_MS = 1_000


def alarm(number: int, key: str, *, stops_work: bool = True, safety: bool = False, cause: Expr | None = None) -> Alarm:
    severity = Severity.SAFETY if safety else Severity.FAULT if stops_work else Severity.WARNING
    return Alarm(s(number), key, None, ALARMS[key], severity, stops_work, cause)


SMALL = [
    alarm(E_STOP, "emergency_stop", safety=True, cause=x(0)),
    alarm(JAM, "tray_jam"),
    alarm(AIR, "air_low", cause=x(2)),
    alarm(WARNING, "memory_lost", stops_work=False, cause=x(3)),
    alarm(EMPTY, "magazine_empty", stops_work=False, cause=x(4)),
]


class AlarmRig:
    """Small machine with an alarm list. The reset clears alarms whose cause is absent; EMPTY clears itself."""

    def __init__(self) -> None:
        fault = s(E_STOP) | s(JAM) | s(AIR)
        self.core = Rig(
            *(Rst(s(number), when=x(RESET) & ~x(cause)) for number, cause in CAUSES.items()),
            *(Set(s(number), when=x(cause)) for number, cause in CAUSES.items()),
            Rst(s(EMPTY), when=~x(CAUSES[EMPTY])),
            Mov(0, FIRST_OUT, when=x(RESET)),
            *(Mov(number, FIRST_OUT, when=s(number) & FIRST_OUT.equals(0)) for number in STOPPING),
            Mov(0, FIRST_OUT, when=~fault),
        )
        self.changes: list[AlarmChange] = []
        self.list = AlarmList(SMALL, FIRST_OUT, self.changes.append)

    @property
    def now_ms(self) -> int:
        return self.core.now_ms

    def scan(self, *causes: int, reset: bool = False, after_ms: int | None = None) -> None:
        """Scan with the causes of these annunciators present."""
        terminals = [CAUSES[number] for number in causes] + [RESET] * reset
        self.core.scan(*terminals, after_ms=after_ms)
        self.list(self.now_ms, self.core.plc)

    def row(self, number: int) -> AlarmRow | None:
        return next((row for row in self.list.rows() if row.alarm.bit.number == number), None)

    def state(self, number: int) -> AlarmState:
        row = self.row(number)
        return NORMAL if row is None else row.state

    def order(self) -> list[int]:
        return [row.alarm.bit.number for row in self.list.rows()]

    def first_out(self) -> list[int]:
        return [row.alarm.bit.number for row in self.list.rows() if row.first_out]
