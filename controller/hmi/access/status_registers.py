"""Status registers (R area): controller diagnostics, cycle data, the alarm list and panel requests.

An FX2N has no R devices, so these registers do not overlap with devices of the program. 32-bit values are stored low
word first, as in the FX. The writable registers are not devices of the program either; they are for alarm
acknowledgement and shelving, the operator name for the audit log, the pace of simulated time, and forced inputs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from controller.common.supervision.failures import dropped, failures
from controller.events.alarm_list import AlarmList, AlarmRow
from controller.events.alarm_states import AlarmState
from controller.events.kinds import CycleEvent, GapCause
from controller.io.loop import BOUNDS_US, LoopFigures
from controller.io.pace import Pace
from controller.io.runtime import Runtime
from controller.program.tags import SIDES, Side
from controller.program.texts.operator import Text

STATUS_WORDS: Final = 330
"""Length of the R area, words."""

ALARM_ROWS: Final = 16
ALARM_WORDS: Final = 8
R_ALARMS: Final = 100

R_CYCLES: Final = 60
CYCLE_WORDS: Final = 8

R_DURATIONS: Final = 20
R_DURATION_SUM: Final = 50
R_LATENESS: Final = 240
R_LATENESS_SUM: Final = 270

R_FAILURES: Final = 18
DROPPED: Final = {
    "events": (52, Text("events that could not be written to standard output", "无法写入标准输出的消息数")),
    "history": (54, Text("records that could not be written to the history", "无法写入历史文件的记录数")),
    "capture": (56, Text("lines that could not be written to the capture", "无法写入记录文件的行数")),
    "log": (58, Text("lines that could not be written to standard error", "无法写入标准错误输出的行数")),
}
"""First register and meaning of the counts of lost items, `failures.ITEMS`, of the controller."""

R_ALARM_ACTIVATIONS: Final = 272
"""First of `ALARM_ROWS` registers: activations of the alarm in each row within a minute up to the last one."""
R_ALARMS_RECENT: Final = 288
R_ALARMS_PEAK: Final = 289

R_ALARM_ACTION: Final = 300
ALARM_ACTION_WORDS: Final = 3
ACKNOWLEDGE, SHELVE, UNSHELVE = 1, 2, 3
R_NAME: Final = 310
NAME_WORDS: Final = 8
R_PACE: Final = 320
R_FORCE: Final = 322
FORCE_WORDS: Final = 2
RELEASE_FORCE: Final = 2
"""Level that ends the forcing of an input."""

ALARM_STATES: Final = tuple(AlarmState)
"""Alarm states, indexed by the number in an alarm row."""
GAP_CAUSES: Final[tuple[GapCause, ...]] = ("none", "tray", "centre", "row")
"""Causes of missed cups, indexed by their register value."""


@dataclass(frozen=True, slots=True)
class StatusSource:
    """Sources of the status registers.

    Attributes:
        runtime: PLC on its field link.
        figures: Timing of the scan loop.
        pace: Speed of simulated time; None in real time.
        alarms: The operator's alarm list.
        cycles: Last cycle and cycle count of each arm.
        connections: Function that returns the number of connected Modbus clients.
        refused_writes: Function that returns the number of refused writes since the start.
    """

    runtime: Runtime
    figures: LoopFigures
    pace: Pace | None
    alarms: AlarmList
    cycles: LastCycles
    connections: Callable[[], int]
    refused_writes: Callable[[], int]


class LastCycles:
    """Store of the last cycle of each arm.

    Attributes:
        last: Last cycle by arm; arms that have not completed a cycle are absent.
        counts: Number of cycles by arm since the start.
    """

    def __init__(self) -> None:
        self.last: dict[Side, CycleEvent] = {}
        self.counts: dict[Side, int] = dict.fromkeys(SIDES, 0)

    def record(self, event: object) -> None:
        """Store a cycle event; other production events are ignored."""
        if isinstance(event, CycleEvent):
            self.counts[event.side] += 1
            self.last[event.side] = event


@dataclass(frozen=True, slots=True)
class StatusRegister:
    """One value of the R area.

    Attributes:
        number: Number of the first R register.
        words: Number of registers: 1, or 2 for a 32-bit value.
        name: Tag name.
        text: Meaning.
        read: Function that returns the value from its source.
        unit: Unit; empty if none.
    """

    number: int
    words: int
    name: str
    text: Text
    read: Callable[[StatusSource], int]
    unit: str = ""


STATUS_REGISTERS: Final = (
    StatusRegister(0, 2, "scans", Text("scan counter (heartbeat)", "扫描计数（心跳）"), lambda f: f.runtime.plc.scans),
    StatusRegister(4, 1, "link_lost", Text("field link lost", "现场通信中断"), lambda f: f.runtime.link_lost),
    StatusRegister(
        5,
        1,
        "simulated",
        Text("simulated time: can be paused and sped up", "仿真时间：可暂停和调速"),
        lambda f: f.pace is not None,
    ),
    StatusRegister(
        6,
        1,
        "pace_percent",
        Text("speed of simulated time; 0 = paused, 65535 = maximum", "仿真速度；0 = 暂停，65535 = 最快"),
        lambda f: 100 if f.pace is None else f.pace.percent,
        "%",
    ),
    StatusRegister(
        7,
        1,
        "forcing_allowed",
        Text("forcing of inputs is allowed", "允许强制输入"),
        lambda f: f.runtime.forcing.allowed,
    ),
    StatusRegister(
        8,
        2,
        "forced",
        Text("bit n: X input n (value of the octal address) is forced", "第 n 位：X n（八进制值）被强制"),
        lambda f: sum(1 << number for number in f.runtime.forcing.levels),
    ),
    StatusRegister(
        10,
        2,
        "overruns",
        Text("overruns: scans that ended after the next one was due", "超时扫描次数"),
        lambda f: f.figures.overruns,
    ),
    StatusRegister(
        12,
        1,
        "longest_ms",
        Text("longest scan since the start", "最长扫描时间"),
        lambda f: min(f.figures.longest_ms, 0xFFFF),
        "ms",
    ),
    StatusRegister(
        14, 2, "refused_writes", Text("refused Modbus writes", "被拒绝的 Modbus 写入次数"), lambda f: f.refused_writes()
    ),
    StatusRegister(
        16, 1, "connections", Text("connected Modbus clients", "已连接的 Modbus 客户端数"), lambda f: f.connections()
    ),
    StatusRegister(
        R_FAILURES,
        2,
        "failures",
        Text("unexpected exceptions in threads and tasks", "线程和任务的异常次数"),
        lambda _: sum(failures().values()),
    ),
    *(
        StatusRegister(number, 2, f"dropped_{item}", text, lambda _, item=item: dropped(item))  # type: ignore[misc]
        for item, (number, text) in DROPPED.items()
    ),
    StatusRegister(
        R_DURATION_SUM,
        2,
        "scan_sum_us",
        Text("sum of all scan times", "扫描时间总和"),
        lambda f: f.figures.durations.sum_us,
        "us",
    ),
    StatusRegister(
        R_LATENESS_SUM,
        2,
        "late_sum_us",
        Text("sum of all scan start delays", "扫描启动延迟总和"),
        lambda f: f.figures.lateness.sum_us,
        "us",
    ),
)
"""Registers with single values; blocks (histograms, cycles, alarm list) are defined by their first register."""

R_TIME_MS: Final = 2
"""Time of the last scan, 32 bits, ms: time of the snapshot, not of the read request."""


def status_words(source: StatusSource, at_ms: int) -> list[int]:
    """Return the complete R area as unsigned words.

    Args:
        source: Sources of the values.
        at_ms: Time of the last scan, ms.
    """
    words = [0] * STATUS_WORDS
    for register in STATUS_REGISTERS:
        _put(words, register.number, int(register.read(source)), register.words)
    _put(words, R_TIME_MS, at_ms, 2)
    for first, histogram in ((R_DURATIONS, source.figures.durations), (R_LATENESS, source.figures.lateness)):
        for bucket, count in enumerate(histogram.counts):
            _put(words, first + 2 * bucket, count, 2)
    for index, side in enumerate(SIDES):
        _put_cycle(words, R_CYCLES + CYCLE_WORDS * index, source.cycles.last.get(side), source.cycles.counts[side])
    for index, row in enumerate(source.alarms.rows()[:ALARM_ROWS]):
        _put_alarm(words, R_ALARMS + ALARM_WORDS * index, row)
        words[R_ALARM_ACTIVATIONS + index] = min(row.activations, 0xFFFF)
    words[R_ALARMS_RECENT] = min(source.alarms.load.recent(at_ms), 0xFFFF)
    words[R_ALARMS_PEAK] = min(source.alarms.load.peak, 0xFFFF)
    words[R_PACE] = words[6]
    return words


def bucket_names() -> Iterator[str]:
    """Yield the names of the histogram buckets."""
    for bound in BOUNDS_US:
        yield f"up to {bound / 1000:g} ms"
    yield f"more than {BOUNDS_US[-1] / 1000:g} ms"


def _put(words: list[int], first: int, value: int, count: int) -> None:
    for index in range(count):
        words[first + index] = value >> 16 * index & 0xFFFF


def _put_cycle(words: list[int], first: int, cycle: CycleEvent | None, count: int) -> None:
    if cycle is None:
        return
    words[first], words[first + 1] = cycle.row, cycle.missed_cups & 0xFFFF
    _put(words, first + 2, cycle.cycle_ms, 2)
    _put(words, first + 4, cycle.waiting_ms, 2)
    words[first + 6], words[first + 7] = GAP_CAUSES.index(cycle.gap_cause), count & 0xFFFF


def _put_alarm(words: list[int], first: int, row: AlarmRow) -> None:
    words[first : first + 3] = row.alarm.bit.number, ALARM_STATES.index(row.state), int(row.first_out)
    words[first + 3] = row.follows or 0
    _put(words, first + 4, row.came_ms or 0, 2)
    _put(words, first + 6, row.shelved_until_ms or 0, 2)
