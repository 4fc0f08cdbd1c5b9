"""Modbus tag list for HMI projects, generated from the program.

The list is published as `docs/hmi-tags.md` and as a CSV file for import into HMI projects.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final, Literal

from controller.common.document.rendering import csv_text
from controller.core.expr import Bit, Word
from controller.hmi.access import status_registers as status
from controller.hmi.modbus.fx3u_map import Table, coil_address, discrete_address, register_address
from controller.program.machine import Transplanter
from controller.program.operator.next_press import press_meanings, question_meanings
from controller.program.tags import ROWS, SIDES, Side

Access = Literal["read", "write", "read/write"]
Kind = Literal["bool", "int16", "uint16", "uint32", "ascii"]

COLUMNS: Final = (
    "name",
    "table",
    "address",
    "device",
    "type",
    "words",
    "word_order",
    "access",
    "lowest",
    "highest",
    "unit",
    "meaning",
)

WORD_ORDER: Final = "low first"
"""Order of the words of every 32-bit number of the server."""
_UNIT_OF_TEN: Final = "10 ms"
_UNIT_OF_HUNDRED: Final = "100 ms"


@dataclass(frozen=True, slots=True)
class Tag:
    """One Modbus tag.

    Attributes:
        name: Tag name, for example "left.row_1".
        table: Modbus table; holding registers can also be read as input registers, coils as discrete inputs.
        address: Zero-based Modbus address.
        device: FX device name; R devices belong to the server, not to the program.
        kind: Data type.
        words: Number of registers; 0 for a bit.
        access: Read or write access.
        meaning: Meaning of the value.
        lowest: Lowest value accepted by a write.
        highest: Highest value accepted by a write.
        unit: Unit of one count.
    """

    name: str
    table: Table
    address: int
    device: str
    kind: Kind
    words: int
    access: Access
    meaning: str
    lowest: int | None = None
    highest: int | None = None
    unit: str = ""

    @property
    def word_order(self) -> str:
        """Order of the words of a 32-bit number, by ascending address; empty for other tags."""
        return WORD_ORDER if self.kind == "uint32" else ""


def tags(machine: Transplanter) -> tuple[Tag, ...]:
    """Return all tags, most frequently used first."""
    return (
        *_machine_tags(machine),
        *(tag for side in SIDES for tag in _arm_tags(machine, side)),
        *_status_tags(),
        *_command_tags(machine),
        *_set_point_tags(machine),
        *_alarm_tags(machine),
        *_point_tags(machine),
        *_planting_tags(machine),
    )


def tag_csv(machine: Transplanter) -> str:
    """Return the tags as CSV with a header line, one tag per line."""
    return csv_text(COLUMNS, tag_rows(machine))


def tag_rows(machine: Transplanter) -> list[tuple[object, ...]]:
    """Return the tags as table rows without the header; the columns are `COLUMNS`."""
    return [_row(tag) for tag in tags(machine)]


def _row(tag: Tag) -> tuple[object, ...]:
    limits = ["" if limit is None else limit for limit in (tag.lowest, tag.highest)]
    return (
        tag.name,
        tag.table,
        tag.address,
        tag.device,
        tag.kind,
        tag.words,
        tag.word_order,
        tag.access,
        *limits,
        tag.unit,
        tag.meaning,
    )


def _word(name: str, word: Word, meaning: str = "") -> Tag:
    kind = word.kind if word.kind == "D" else f"{word.kind}N"
    device = f"{kind}{word.number}"
    return Tag(
        name, "holding", register_address(kind, word.number), device, "int16", 1, "read", meaning or word.comment
    )


def _bit(name: str, bit: Bit, meaning: str = "") -> Tag:
    table: Table = "discrete" if bit.kind == "X" else "coil"
    return Tag(name, table, discrete_address(bit.kind, bit.number), str(bit), "bool", 0, "read", meaning or bit.comment)


def _status(
    name: str,
    number: int,
    words: int,
    meaning: str,
    *,
    access: Access = "read",
    kind: Kind | None = None,
    limits: tuple[int | None, int | None] = (None, None),
    unit: str = "",
) -> Tag:
    chosen: Kind = kind or ("uint32" if words == 2 else "uint16")
    return Tag(
        name, "holding", register_address("R", number), f"R{number}", chosen, words, access, meaning, *limits, unit
    )


def _machine_tags(machine: Transplanter) -> Iterator[Tag]:
    tags = machine.tags.machine
    for name in ("state", "mode", "reason", "trays_done", "refused", "refusal", "refusals", "jog", "first_out"):
        yield _word(f"machine.{name}", getattr(tags, name))
    yield _word("machine.next_press", tags.next_press, press_meanings())
    yield _word("machine.question", tags.question, question_meanings())
    yield _word("machine.rows_left", tags.rows_left)
    for name in ("running", "manual", "stepping", "fault", "horn", "suspend", "motion"):
        yield _bit(f"machine.{name}", getattr(tags, name))
    tray = machine.tags.tray
    yield _word("tray.phase", tray.phase)
    yield _bit("tray.ask", tray.ask)


def _arm_tags(machine: Transplanter, side: Side) -> Iterator[Tag]:
    arm = machine.tags.arms[side]
    for row in ROWS:
        yield _word(f"{side}.row_{row}", arm.rows[row])
        yield _bit(f"{side}.row_{row}_is_next", arm.row_is[row])
    yield _word(f"{side}.missed_cups", arm.missed_cups)
    if arm.yields.planted is not None:
        yield _word(f"{side}.empty_cups", arm.yields.planted.empty_cups)
    yield _word(f"{side}.cycles", arm.cycles)
    yield _word(f"{side}.cups", arm.cup_counter.value, "cups since the last release")
    yield _word(f"{side}.blocked_by", arm.blocked_by)
    for name in (
        "down",
        "up",
        "at_feed",
        "is_spread",
        "is_converged",
        "loaded",
        "claws_closed",
        "ask",
        "ask_cups",
        "fault",
        "out_of_service",
    ):
        yield _bit(f"{side}.{name}", getattr(arm, name))
    first = status.R_CYCLES + status.CYCLE_WORDS * SIDES.index(side)
    yield _status(f"{side}.cycle.row", first, 1, "row of the last cycle")
    yield _status(
        f"{side}.cycle.ms",
        first + 2,
        2,
        "duration of the last cycle, from leaving the feed position to the return home",
        unit="ms",
    )
    yield _status(f"{side}.cycle.waiting_ms", first + 4, 2, "waiting time for cups in the last cycle", unit="ms")
    causes = ", ".join(f"{number} {cause}" for number, cause in enumerate(status.GAP_CAUSES))
    yield _status(f"{side}.cycle.gap_cause", first + 6, 1, f"cause of the cups missed in the last cycle: {causes}")
    yield _status(f"{side}.cycle.seen", first + 7, 1, "cycle counter: incremented by each completed cycle")


def _status_tags() -> Iterator[Tag]:
    for register in status.STATUS_REGISTERS:
        yield _status(
            f"controller.{register.name}", register.number, register.words, register.text.en, unit=register.unit
        )
    yield _status("controller.time_ms", status.R_TIME_MS, 2, "time of the last scan", unit="ms")
    for bucket, name in enumerate(status.bucket_names()):
        yield _status(f"controller.scan_time.{bucket}", status.R_DURATIONS + 2 * bucket, 2, f"scans that took {name}")
    for bucket, name in enumerate(status.bucket_names()):
        yield _status(
            f"controller.late.{bucket}", status.R_LATENESS + 2 * bucket, 2, f"scans with a start delay of {name}"
        )
    states = ", ".join(f"{number} {state}" for number, state in enumerate(status.ALARM_STATES))
    for row in range(status.ALARM_ROWS):
        first = status.R_ALARMS + status.ALARM_WORDS * row
        yield _status(f"alarm.{row}.number", first, 1, "number of the annunciator in this row of the list; 0 = none")
        yield _status(f"alarm.{row}.state", first + 1, 1, states)
        yield _status(f"alarm.{row}.first_out", first + 2, 1, "1 = first-out alarm, the alarm that stopped work first")
        yield _status(
            f"alarm.{row}.follows",
            first + 3,
            1,
            "number of the first-out alarm whose consequence this alarm is; 0 = it stands for itself",
        )
        yield _status(
            f"alarm.{row}.came_ms", first + 4, 2, "controller time at which the alarm became active", unit="ms"
        )
        yield _status(
            f"alarm.{row}.shelved_until_ms",
            first + 6,
            2,
            "controller time at which shelving ends; 0 = not shelved",
            unit="ms",
        )
        yield _status(
            f"alarm.{row}.activations",
            status.R_ALARM_ACTIVATIONS + row,
            1,
            "activations of this alarm within a minute up to the last one",
        )
    yield _status("alarm.recent", status.R_ALARMS_RECENT, 1, "activations of all alarms within the last 10 minutes")
    yield _status("alarm.peak", status.R_ALARMS_PEAK, 1, "most activations within 10 minutes since the start")
    yield _status(
        "alarm.action",
        status.R_ALARM_ACTION,
        1,
        f"{status.ACKNOWLEDGE} acknowledge, {status.SHELVE} shelve, "
        f"{status.UNSHELVE} unshelve; write the three registers in one request",
        access="write",
        limits=(status.ACKNOWLEDGE, status.UNSHELVE),
    )
    yield _status(
        "alarm.action_number",
        status.R_ALARM_ACTION + 1,
        1,
        "number of the annunciator; 0 = all (acknowledge only)",
        access="write",
    )
    yield _status("alarm.action_minutes", status.R_ALARM_ACTION + 2, 1, "shelving period", access="write", unit="min")
    yield _status(
        "operator.name",
        status.R_NAME,
        status.NAME_WORDS,
        "operator name at this panel, for the audit log: ASCII, "
        "two characters per register, high byte first; write all registers in one request",
        access="write",
        kind="ascii",
    )
    yield _status(
        "simulation.pace",
        status.R_PACE,
        1,
        "speed of simulated time: 0 = paused, 100 = real time, 65535 = maximum; writes are refused in real time",
        access="read/write",
        unit="%",
    )
    yield _status(
        "force.x",
        status.R_FORCE,
        1,
        "number of the X input to force (value of the octal address); write both registers in one request",
        access="write",
    )
    yield _status(
        "force.level",
        status.R_FORCE + 1,
        1,
        f"0 or 1; {status.RELEASE_FORCE} = end forcing",
        access="write",
        limits=(0, status.RELEASE_FORCE),
    )


def _command_tags(machine: Transplanter) -> Iterator[Tag]:
    for command in machine.tags.commands:
        yield Tag(
            f"command.{command.name}",
            "coil",
            coil_address("M", command.bit.number),
            str(command.bit),
            "bool",
            0,
            "write",
            command.meaning,
        )


def _set_point_tags(machine: Transplanter) -> Iterator[Tag]:
    sp = machine.tags.sp
    for name in sp.names():
        word: Word = getattr(sp, name)
        lowest, highest = sp.limits[word]
        access: Access = "read" if word in sp.constants else "read/write"
        yield Tag(
            f"set.{name}",
            "holding",
            register_address("D", word.number),
            str(word),
            "int16",
            1,
            access,
            word.comment,
            lowest,
            highest,
            unit_of(word),
        )
    for word, relay in sp.differs.items():
        name = next(name for name in sp.names() if getattr(sp, name) is word)
        yield _bit(f"constant.{name}.differs", relay)


def _alarm_tags(machine: Transplanter) -> Iterator[Tag]:
    for alarm in machine.alarms:
        name = f"{alarm.side}.{alarm.key}" if alarm.side else alarm.key
        yield _bit(f"annunciator.{name}", alarm.bit, alarm.text.en)


def _point_tags(machine: Transplanter) -> Iterator[Tag]:
    io_map = machine.io_map
    for kind, points in (("X", io_map.inputs), ("Y", io_map.outputs)):
        for point in points:
            table: Table = "discrete" if kind == "X" else "coil"
            address = discrete_address(kind, point.number)
            yield Tag(
                f"io.{point.tag}",
                table,
                address,
                point.address,
                "bool",
                0,
                "read",
                f"raw level: {point.meaning}{' (normally closed)' if point.inverted else ''}",
            )


def _planting_tags(machine: Transplanter) -> Iterator[Tag]:
    planting = machine.tags.planting
    for name in ("frequency", "fastest", "gapless", "chain_speed", "ground_speed", "ratio"):
        word: Word = getattr(planting, name)
        yield replace(_word(f"planting.{name}", word), unit=unit_of(word))
    if planting.planter_speed is not None:
        yield replace(_word("planting.planter_speed", planting.planter_speed), unit="mm/s")


def unit_of(set_point: Word) -> str:
    """Return the unit of one count of a set-point or a register, derived from its name."""
    if set_point.name.endswith("x10 ms"):
        return _UNIT_OF_TEN
    for unit in ("0.1/min", "mm/s", "mm", "0.01"):
        if set_point.name.endswith((f" {unit}", f" x{unit}")):
            return unit
    return _UNIT_OF_HUNDRED if set_point.name.endswith("x100 ms") else ""
