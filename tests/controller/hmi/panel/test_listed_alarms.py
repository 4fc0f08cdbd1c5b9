"""Listed alarms from the list of the controller over the status registers to the view of the panel."""

from __future__ import annotations

from typing import Any

from controller.core.devices import ANNUNCIATOR_ON
from controller.events.alarm_list import AlarmList
from controller.events.alarm_load import STANDING_MS
from controller.hmi.access.status_registers import LastCycles, StatusSource, status_words
from controller.hmi.panel.modbus.mirror import R_WORDS, blocks
from controller.io.loop import LoopFigures
from plant_sim.twin.lock_step import Twin
from tests.controller.hmi.panel.test_chinese import MACHINE, view_builder


class Station:
    """Twin at rest with an alarm list, and the view of a panel."""

    def __init__(self) -> None:
        self.twin = Twin()
        self.twin.scan()
        machine = self.twin.machine
        self.alarms = AlarmList(machine.alarms, machine.tags.machine.first_out, lambda _: None)
        self.source = StatusSource(
            self.twin.runtime, LoopFigures(), None, self.alarms, LastCycles(), lambda: 0, lambda: 0
        )
        self.builder, self.mirror = view_builder()

    def view(self, *numbers: int, first_out: int = 0, at_ms: int) -> dict[str, Any]:
        """Set the annunciators with these numbers and return the section of the view with the alarms."""
        memory = self.twin.plc.memory
        for number in range(900, 1000):
            memory.S[number] = number in numbers
        memory.M[ANNUNCIATOR_ON] = bool(numbers)
        memory.D[self.twin.machine.tags.machine.first_out.number] = first_out
        self.alarms(at_ms, self.twin.plc)
        words = status_words(self.source, at_ms)
        polled = [block for block in blocks(MACHINE.io_map) if block.kind == "R"]
        self.mirror.update([(block, words[block.first : block.first + block.count]) for block in polled])
        section: dict[str, Any] = self.builder.view()["alarms"]
        return section


def marks(section: dict[str, Any], name: str) -> dict[int, Any]:
    return {row["number"]: row[name] for row in section["rows"]}


def test_the_polled_blocks_contain_the_alarm_load() -> None:
    ends = [block.first + block.count for block in blocks(MACHINE.io_map) if block.kind == "R"]
    assert max(ends) == R_WORDS


def test_a_consequence_names_its_first_out_alarm() -> None:
    station = Station()
    station.view(911, first_out=911, at_ms=1_000)
    section = station.view(911, 923, 990, first_out=911, at_ms=2_000)
    assert marks(section, "follows") == {911: None, 923: 911, 990: None}
    assert marks(section, "first_out") == {911: True, 923: False, 990: False}
    assert (section["recent"], section["peak"]) == (3, 3)


def test_alarms_of_ten_minutes_are_counted_until_these_have_passed() -> None:
    station = Station()
    station.view(990, at_ms=1_000)
    section = station.view(990, 991, at_ms=600_999)
    assert (section["recent"], section["peak"]) == (2, 2)
    section = station.view(990, 991, 992, at_ms=601_000)
    assert (section["recent"], section["peak"]) == (2, 2)


def test_an_alarm_chatters_from_its_third_activation_until_a_minute_has_passed() -> None:
    station = Station()
    for at_ms in (1_000, 11_000):
        assert marks(station.view(990, at_ms=at_ms), "chattering") == {990: False}
        station.view(at_ms=at_ms + 10)
    assert marks(station.view(990, at_ms=21_000), "chattering") == {990: True}
    assert marks(station.view(990, at_ms=80_999), "chattering") == {990: True}
    assert marks(station.view(990, at_ms=81_000), "chattering") == {990: False}


def test_an_alarm_stands_after_a_day() -> None:
    station = Station()
    station.view(990, at_ms=1_000)
    assert marks(station.view(990, at_ms=STANDING_MS + 999), "standing") == {990: False}
    assert marks(station.view(990, at_ms=STANDING_MS + 1_000), "standing") == {990: True}
    assert marks(station.view(at_ms=STANDING_MS + 1_010), "standing") == {990: False}
