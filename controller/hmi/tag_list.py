"""The tag list for panel builders: every number worth showing or writing, with its Modbus address, from the program.

The same list makes `docs/hmi-tags.md`, a CSV for the import of HMI projects, and the names our own panel uses.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

from controller.core.expr import Bit, Word
from controller.hmi import own_registers as own
from controller.hmi.fx3u import Table, coil_address, discrete_address, register_address
from controller.program.machine import Transplanter
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
    "access",
    "lowest",
    "highest",
    "unit",
    "meaning",
)

_UNIT_OF_TEN: Final = "10 ms"
_UNIT_OF_HUNDRED: Final = "100 ms"


@dataclass(frozen=True, slots=True)
class Tag:
    """One number or bit.

    Attributes:
        name: Name, as "left.row_1".
        table: Modbus table; what is holding can be read as input register too, a coil as discrete input too.
        address: Zero-based Modbus address.
        device: FX name; R devices are the server's own.
        kind: How the registers are read; uint32 is low word first.
        words: Registers taken; 0 for a bit.
        access: Whether it can be written.
        meaning: What it says.
        lowest: Least value that is taken when written.
        highest: Greatest.
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


def tags(machine: Transplanter) -> tuple[Tag, ...]:
    """Return every tag, the most used first."""
    return (
        *_machine_tags(machine),
        *(tag for side in SIDES for tag in _arm_tags(machine, side)),
        *_own_tags(),
        *_command_tags(machine),
        *_set_point_tags(machine),
        *_alarm_tags(machine),
        *_point_tags(machine),
    )


def tag_csv(machine: Transplanter) -> str:
    """Return the tags as CSV, one a line, heading first."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(_row(tag) for tag in tags(machine))
    return text.getvalue()


def tag_rows(machine: Transplanter) -> list[tuple[object, ...]]:
    """Return the tags as rows of a table, without heading; the columns are `COLUMNS`."""
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
        tag.access,
        *limits,
        tag.unit,
        tag.meaning,
    )


def _word(name: str, word: Word, meaning: str = "") -> Tag:
    kind = word.kind if word.kind == "D" else f"{word.kind}N"
    device = f"{kind}{word.number}"
    return Tag(name, "holding", register_address(kind, word.number), device, "int16", 1, "read",
               meaning or word.comment)  # fmt: skip


def _bit(name: str, bit: Bit, meaning: str = "") -> Tag:
    table: Table = "discrete" if bit.kind == "X" else "coil"
    return Tag(name, table, discrete_address(bit.kind, bit.number), str(bit), "bool", 0, "read",
               meaning or bit.comment)  # fmt: skip


def _own(name: str, number: int, words: int, meaning: str, *, access: Access = "read", kind: Kind | None = None,
         limits: tuple[int | None, int | None] = (None, None), unit: str = "") -> Tag:  # fmt: skip
    chosen: Kind = kind or ("uint32" if words == 2 else "uint16")
    return Tag(name, "holding", register_address("R", number), f"R{number}", chosen, words, access, meaning, *limits,
               unit)  # fmt: skip


def _machine_tags(machine: Transplanter) -> Iterator[Tag]:
    tags = machine.tags.machine
    for name in ("state", "mode", "reason", "trays_done", "refused", "refusal", "refusals", "jog", "first_out"):
        yield _word(f"machine.{name}", getattr(tags, name))
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
    yield _word(f"{side}.cycles", arm.cycles)
    yield _word(f"{side}.cups", arm.cup_counter.value, "cups since the last release")
    yield _word(f"{side}.blocked_by", arm.blocked_by)
    for name in ("down", "up", "at_feed", "is_spread", "is_converged", "loaded", "claws_closed", "ask", "ask_cups",
                 "fault"):  # fmt: skip
        yield _bit(f"{side}.{name}", getattr(arm, name))
    first = own.R_CYCLES + own.CYCLE_WORDS * SIDES.index(side)
    yield _own(f"{side}.cycle.row", first, 1, "row of the last cycle")
    yield _own(f"{side}.cycle.ms", first + 2, 2, "time of the last cycle, from leaving feed to home again", unit="ms")
    yield _own(f"{side}.cycle.waiting_ms", first + 4, 2, "part of it spent waiting for cups", unit="ms")
    causes = ", ".join(f"{number} {cause}" for number, cause in enumerate(own.GAP_CAUSES))
    yield _own(f"{side}.cycle.gap_cause", first + 6, 1, f"why cups were missed in it: {causes}")
    yield _own(f"{side}.cycle.seen", first + 7, 1, "cycles seen; another one, another number")


def _own_tags() -> Iterator[Tag]:
    for register in own.OWN_REGISTERS:
        yield _own(f"controller.{register.name}", register.number, register.words, register.text.en,
                   unit=register.unit)  # fmt: skip
    yield _own("controller.time_ms", own.R_TIME_MS, 2, "time of the last scan", unit="ms")
    for bucket, name in enumerate(own.bucket_names()):
        yield _own(f"controller.scan_time.{bucket}", own.R_DURATIONS + 2 * bucket, 2, f"scans that took {name}")
    for bucket, name in enumerate(own.bucket_names()):
        yield _own(f"controller.late.{bucket}", own.R_LATENESS + 2 * bucket, 2, f"scans that began late by {name}")
    states = ", ".join(f"{number} {state}" for number, state in enumerate(own.ALARM_STATES))
    for row in range(own.ALARM_ROWS):
        first = own.R_ALARMS + own.ALARM_WORDS * row
        yield _own(f"alarm.{row}.number", first, 1, "annunciator in this row of the list; 0 = none")
        yield _own(f"alarm.{row}.state", first + 1, 1, states)
        yield _own(f"alarm.{row}.first_out", first + 2, 1, "1 = it stopped work first")
        yield _own(f"alarm.{row}.came_ms", first + 4, 2, "when it came, by the controller's time", unit="ms")
        yield _own(f"alarm.{row}.shelved_until_ms", first + 6, 2, "end of its shelf; 0 = not shelved", unit="ms")
    yield _own("alarm.action", own.R_ALARM_ACTION, 1, f"{own.ACKNOWLEDGE} acknowledge, {own.SHELVE} shelve, "
               f"{own.UNSHELVE} unshelve; write the three registers in one request", access="write",
               limits=(own.ACKNOWLEDGE, own.UNSHELVE))  # fmt: skip
    yield _own("alarm.action_number", own.R_ALARM_ACTION + 1, 1, "annunciator; 0 = all (acknowledge)", access="write")
    yield _own("alarm.action_minutes", own.R_ALARM_ACTION + 2, 1, "how long to shelve", access="write", unit="min")
    yield _own("operator.name", own.R_NAME, own.NAME_WORDS, "who is at this panel, for the audit: ASCII, two "
               "characters a register, high byte first; all registers in one request", access="write",
               kind="ascii")  # fmt: skip
    yield _own("simulation.pace", own.R_PACE, 1, "speed of simulated time: 0 = paused, 100 = real time, 65535 = as "
               "fast as it can; refused on a real clock", access="read/write", unit="%")  # fmt: skip
    yield _own(
        "force.x",
        own.R_FORCE,
        1,
        "X number (octal value) to force; write both registers in one request",
        access="write",
    )
    yield _own(
        "force.level", own.R_FORCE + 1, 1, f"0 or 1; {own.LET_GO} = let go", access="write", limits=(0, own.LET_GO)
    )


def _command_tags(machine: Transplanter) -> Iterator[Tag]:
    for command in machine.tags.commands:
        yield Tag(f"command.{command.name}", "coil", coil_address("M", command.bit.number), str(command.bit), "bool", 0,
                  "write", command.meaning)  # fmt: skip


def _set_point_tags(machine: Transplanter) -> Iterator[Tag]:
    sp = machine.tags.sp
    for name in sp.names():
        word: Word = getattr(sp, name)
        lowest, highest = sp.limits[word]
        access: Access = "read" if word in sp.at_start else "read/write"
        yield Tag(f"set.{name}", "holding", register_address("D", word.number), str(word), "int16", 1, access,
                  word.comment, lowest, highest, unit_of(word))  # fmt: skip


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
            yield Tag(f"io.{point.tag}", table, address, point.address, "bool", 0, "read",
                      f"raw level: {point.meaning}{' (normally closed)' if point.inverted else ''}")  # fmt: skip


def unit_of(set_point: Word) -> str:
    """Return the unit of one count of a set-point, as its name tells."""
    if set_point.name.endswith("x10 ms"):
        return _UNIT_OF_TEN
    return _UNIT_OF_HUNDRED if set_point.name.endswith("x100 ms") else ""
