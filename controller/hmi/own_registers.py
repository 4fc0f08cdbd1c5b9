"""The R area: what the operator's side itself knows, as registers for any panel.

An FX2N has no R devices, so nothing of its memory is hidden by them. Words of 32 bits lie low word first, as in the
FX. What can be written here is no device of the program: alarms acknowledged and shelved, the name for the audit, the
pace of a simulation, forced inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from controller.hmi.alarm_list import AlarmRow, AlarmState
from controller.hmi.production import CycleEvent, GapCause
from controller.io.loop import BOUNDS_US, LoopFigures
from controller.io.pace import Pace
from controller.io.runtime import Runtime
from controller.program.tags import SIDES, Side
from controller.program.texts import Text

OWN_WORDS: Final = 330

ALARM_ROWS: Final = 16
ALARM_WORDS: Final = 8
R_ALARMS: Final = 100

R_CYCLES: Final = 60
CYCLE_WORDS: Final = 8

R_DURATIONS: Final = 20
R_DURATION_SUM: Final = 50
R_LATENESS: Final = 240
R_LATENESS_SUM: Final = 270

R_ALARM_ACTION: Final = 300
ALARM_ACTION_WORDS: Final = 3
ACKNOWLEDGE, SHELVE, UNSHELVE = 1, 2, 3
R_NAME: Final = 310
NAME_WORDS: Final = 8
R_PACE: Final = 320
R_FORCE: Final = 322
FORCE_WORDS: Final = 2
LET_GO: Final = 2

ALARM_STATES: Final = tuple(AlarmState)
"""State of an alarm row by its number."""
GAP_CAUSES: Final[tuple[GapCause, ...]] = ("none", "tray", "centre", "row")
"""Cause of missed cups by its number."""


@dataclass(frozen=True, slots=True)
class Facts:
    """Where the numbers come from.

    Attributes:
        runtime: The PLC on its link.
        figures: Timing of the scan loop.
        pace: Speed of simulated time; None on a real clock.
        alarm_rows: The operator's alarm list, first row first.
        cycles: Last cycle of each arm, and how many there were.
        connections: Modbus clients connected now.
        refused_writes: Writes refused since the start.
    """

    runtime: Runtime
    figures: LoopFigures
    pace: Pace | None
    alarm_rows: Callable[[], Sequence[AlarmRow]]
    cycles: LastCycles
    connections: Callable[[], int]
    refused_writes: Callable[[], int]


class LastCycles:
    """Keeps the last cycle of each arm."""

    def __init__(self) -> None:
        self.last: dict[Side, CycleEvent] = {}
        self.seen: dict[Side, int] = dict.fromkeys(SIDES, 0)

    def take(self, event: object) -> None:
        """Take an event of production; only the end of a cycle is kept."""
        if isinstance(event, CycleEvent):
            self.seen[event.side] += 1
            self.last[event.side] = event


@dataclass(frozen=True, slots=True)
class OwnRegister:
    """One number of the R area.

    Attributes:
        number: First R.
        words: 1, or 2 for 32 bits.
        name: Tag.
        text: What it says.
        read: Takes the number.
        unit: Unit, if it has one.
    """

    number: int
    words: int
    name: str
    text: Text
    read: Callable[[Facts], int]
    unit: str = ""


OWN_REGISTERS: Final = (
    OwnRegister(0, 2, "scans", Text("scans since the start (sign of life)", "扫描次数(心跳)"),
                lambda f: f.runtime.plc.scans),
    OwnRegister(4, 1, "link_lost", Text("the field is silent", "现场通信中断"), lambda f: f.runtime.link_lost),
    OwnRegister(5, 1, "simulated", Text("time is simulated: pause and speed can be set", "仿真时间,可暂停和调速"),
                lambda f: f.pace is not None),
    OwnRegister(6, 1, "pace_percent", Text("speed of simulated time, 0 = paused, 65535 = as fast as it can",
                                           "仿真速度,0=暂停,65535=最快"),
                lambda f: 100 if f.pace is None else f.pace.percent, "%"),
    OwnRegister(7, 1, "forcing_allowed", Text("inputs may be forced", "允许强制输入"),
                lambda f: f.runtime.forcing.allowed),
    OwnRegister(8, 2, "forced", Text("bit n: X n (octal value) is forced", "第n位:X n(八进制值)被强制"),
                lambda f: sum(1 << number for number in f.runtime.forcing.levels)),
    OwnRegister(10, 2, "overruns", Text("scans that ended after the next was due", "超时扫描次数"),
                lambda f: f.figures.overruns),
    OwnRegister(12, 1, "longest_ms", Text("longest scan since the start", "最长扫描时间"),
                lambda f: min(f.figures.longest_ms, 0xFFFF), "ms"),
    OwnRegister(14, 2, "refused_writes", Text("Modbus writes refused", "被拒绝的Modbus写入次数"),
                lambda f: f.refused_writes()),
    OwnRegister(16, 1, "connections", Text("Modbus clients connected", "Modbus客户端数"), lambda f: f.connections()),
    OwnRegister(R_DURATION_SUM, 2, "scan_sum_us", Text("sum of all scan times", "扫描时间总和"),
                lambda f: f.figures.durations.sum_us, "us"),
    OwnRegister(R_LATENESS_SUM, 2, "late_sum_us", Text("sum of all late begins", "扫描延迟总和"),
                lambda f: f.figures.lateness.sum_us, "us"),
)  # fmt: skip
"""Single numbers; the blocks (histograms, cycles, alarm list) follow from their first R."""

R_TIME_MS: Final = 2
"""Time of the last scan, 32 bits, ms: of the snapshot, not of the reading."""


def own_words(facts: Facts, at_ms: int) -> list[int]:
    """Return the whole R area, unsigned.

    Args:
        facts: Where the numbers come from.
        at_ms: Time of the last scan, ms.
    """
    words = [0] * OWN_WORDS
    for register in OWN_REGISTERS:
        _put(words, register.number, int(register.read(facts)), register.words)
    _put(words, R_TIME_MS, at_ms, 2)
    for first, histogram in ((R_DURATIONS, facts.figures.durations), (R_LATENESS, facts.figures.lateness)):
        for bucket, count in enumerate(histogram.counts):
            _put(words, first + 2 * bucket, count, 2)
    for index, side in enumerate(SIDES):
        _put_cycle(words, R_CYCLES + CYCLE_WORDS * index, facts.cycles.last.get(side), facts.cycles.seen[side])
    for index, row in enumerate(facts.alarm_rows()[:ALARM_ROWS]):
        _put_alarm(words, R_ALARMS + ALARM_WORDS * index, row)
    words[R_PACE] = words[6]
    return words


def bucket_names() -> Iterator[str]:
    """Name the buckets of the histograms."""
    for bound in BOUNDS_US:
        yield f"up to {bound / 1000:g} ms"
    yield "longer"


def _put(words: list[int], first: int, value: int, count: int) -> None:
    for index in range(count):
        words[first + index] = value >> 16 * index & 0xFFFF


def _put_cycle(words: list[int], first: int, cycle: CycleEvent | None, seen: int) -> None:
    if cycle is None:
        return
    words[first], words[first + 1] = cycle.row, cycle.missed_cups & 0xFFFF
    _put(words, first + 2, cycle.cycle_ms, 2)
    _put(words, first + 4, cycle.waiting_ms, 2)
    words[first + 6], words[first + 7] = GAP_CAUSES.index(cycle.gap_cause), seen & 0xFFFF


def _put_alarm(words: list[int], first: int, row: AlarmRow) -> None:
    words[first : first + 3] = row.alarm.bit.number, ALARM_STATES.index(row.state), int(row.first_out)
    _put(words, first + 4, row.came_ms or 0, 2)
    _put(words, first + 6, row.shelved_until_ms or 0, 2)
