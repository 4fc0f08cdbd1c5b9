"""Permanent numbers: the numbers of alarms and HMI tags never change, and new entries use unused numbers."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.core.expr import Bit, leaves
from controller.core.rungs import Mov
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.alarms.table import ARM_ALARM_NUMBERS, Annunciators, Severity
from controller.program.machine import build
from controller.program.tags import Tags
from tests.controller.program.permanent_numbers import LIST, Entry, append_new, entries_of, read_list
from tests.wiring import YIELD, wired

IO_MAP = load_io_map(DEFAULT_IO_MAP)
MACHINE = build(wired(*YIELD))
WARNINGS_FROM = 990


def test_listed_numbers_do_not_change() -> None:
    current = {entry[:2]: entry for entry in entries_of(MACHINE)}
    changed = [
        f"{entry.kind} {entry.name}: listed {entry.table} {entry.number}, now {current.get(entry[:2], 'missing')}"
        for entry in read_list()
        if current.get(entry[:2]) != entry
    ]
    assert not changed, "numbers are permanent; add new devices at the end of their table"


def test_new_entries_take_numbers_that_were_never_used() -> None:
    listed = read_list()
    used = {(entry.kind, entry.table, entry.number) for entry in listed}
    names = {entry[:2] for entry in listed}
    new = [entry for entry in entries_of(MACHINE) if entry[:2] not in names]
    assert [entry for entry in new if (entry.kind, entry.table, entry.number) in used] == []


def test_new_alarms_are_appended() -> None:
    """The number of a new alarm follows those listed below S990; that of a new warning follows all listed numbers."""
    listed = read_list()
    numbers = [entry.number for entry in listed if entry.kind == "alarm"]
    last = max(number for number in numbers if number < WARNINGS_FROM)
    new = {entry.name: entry.number for entry in entries_of(MACHINE) if entry.kind == "alarm" and entry not in listed}
    assert all(last < number < WARNINGS_FROM or number > max(numbers) for number in new.values()), new


def test_list_has_no_duplicates() -> None:
    listed = read_list()
    assert len({entry[:2] for entry in listed}) == len(listed)
    assert len({(entry.kind, entry.table, entry.number) for entry in listed}) == len(listed)


def test_appending_does_not_change_existing_lines(tmp_path: Path) -> None:
    lines = LIST.read_text(encoding="utf-8").splitlines(keepends=True)
    path = tmp_path / LIST.name
    path.write_text("".join(lines[:-1]), encoding="utf-8")
    append_new(path)
    assert path.read_text(encoding="utf-8").startswith("".join(lines))
    assert {Entry("alarm", "emergency_stop", "S", 900), Entry("alarm", "hmi_silent", "S", 992)} <= set(read_list(path))


def test_a_number_that_is_no_annunciator_is_refused() -> None:
    alarms = Annunciators(Tags.of(IO_MAP))
    with pytest.raises(ValueError, match="S1000 is not an annunciator"):
        alarms.add("tray_jam", number=1000)


def test_arm_alarm_numbers_are_unique() -> None:
    numbers = [number for row in ARM_ALARM_NUMBERS.values() for number in row]
    assert len(set(numbers)) == len(numbers)
    assert set(ARM_ALARM_NUMBERS) == {alarm.key for alarm in MACHINE.alarms if alarm.side}


def test_severity_is_independent_of_the_number() -> None:
    alarms = Annunciators(Tags.of(IO_MAP))
    bit = alarms.add("tray_jam", number=989, severity=Severity.SAFETY)
    order = [alarm.bit.number for alarm in alarms.by_severity()]
    assert order.index(bit.number) < order.index(904)
    numbers = [alarm.bit.number for alarm in alarms]
    assert numbers[numbers.index(989) :] == [*range(989, 1000)]


def test_first_out_prefers_the_more_severe_alarm() -> None:
    """The rungs that set `first out` are ordered by severity, so the most severe of simultaneous alarms is stored."""
    first_out = MACHINE.tags.machine.first_out
    (block,) = (block for block in MACHINE.program.blocks if block.title == "alarms")
    values = [rung.source for rung in block.rungs() if isinstance(rung, Mov) and rung.target == first_out]
    numbers = [value for value in values if value]
    assert numbers == [alarm.bit.number for alarm in MACHINE.alarms.by_severity() if alarm.stops_work and alarm.wired]


def test_every_alarm_is_first_out_under_its_own_number_and_replaces_no_other() -> None:
    """The rung that stores a number reads the annunciator with this number, and that none has been stored yet."""
    first_out = MACHINE.tags.machine.first_out
    moves = [rung for rung in MACHINE.program.rungs() if isinstance(rung, Mov) and rung.target == first_out]
    numbered = [move for move in moves if move.source]
    assert len({move.source for move in numbered}) == len(numbered) > 50
    for move in numbered:
        assert {Bit("S", int(str(move.source))), first_out} <= set(leaves(move.when)), move.source
