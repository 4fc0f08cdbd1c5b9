"""Checked-in list of permanent numbers: S numbers of the alarms, and Modbus tables and addresses of the HMI tags.

Append new entries after adding an alarm or a tag:

    .venv/bin/python -m tests.controller.program.permanent_numbers
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Final, NamedTuple

from controller.hmi.access.tag_list import tags
from controller.program.machine import Transplanter, build
from tests.wiring import YIELD, wired

LIST: Final = Path(__file__).with_name("permanent_numbers.csv")


class Entry(NamedTuple):
    """One permanent number.

    Attributes:
        kind: "alarm" or "tag".
        name: Alarm key, prefixed with the side for an arm alarm, or HMI tag name.
        table: "S" for an alarm; the Modbus table for a tag.
        number: S number or zero-based Modbus address.
    """

    kind: str
    name: str
    table: str
    number: int


def read_list(path: Path = LIST) -> list[Entry]:
    """Return the checked-in entries in file order."""
    with path.open(encoding="utf-8", newline="") as file:
        return [Entry(row["kind"], row["name"], row["table"], int(row["number"])) for row in csv.DictReader(file)]


def entries_of(machine: Transplanter) -> list[Entry]:
    """Return an entry for each alarm and HMI tag of a program."""
    alarms = [
        Entry("alarm", f"{alarm.side}.{alarm.key}" if alarm.side else alarm.key, "S", alarm.bit.number)
        for alarm in machine.alarms
    ]
    return [*alarms, *(Entry("tag", tag.name, tag.table, tag.address) for tag in tags(machine))]


def append_new(path: Path = LIST) -> None:
    """Append the program entries that are missing from the list; existing lines are not changed."""
    listed = {(entry.kind, entry.name) for entry in read_list(path)} if path.exists() else set()
    new = [entry for entry in entries_of(build(wired(*YIELD))) if entry[:2] not in listed]
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not listed:
            writer.writerow(Entry._fields)
        writer.writerows(new)


if __name__ == "__main__":
    append_new()
