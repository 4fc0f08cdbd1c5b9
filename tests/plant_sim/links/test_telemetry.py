"""Telemetry in the input registers."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
from pymodbus.client import ModbusTcpClient

from controller.hmi.panel.modbus.telemetry import TelemetryTag
from plant_sim.crop.incident import Incident
from plant_sim.crop.planting_row import PassedCup
from plant_sim.crop.seedling import Location
from plant_sim.links.modbus_server import PlantServer
from plant_sim.links.server_thread import ServerThread
from plant_sim.links.tag_file import tag_csv
from plant_sim.links.telemetry import TELEMETRY, TELEMETRY_REGISTERS, read_telemetry, telemetry_table
from plant_sim.links.write_timing import PlcState
from plant_sim.machine.plant import Event
from tests.controller.common.modbus_rig import (
    MACHINE,
    PATIENT_S,
    Client,
    Rig,
    make_module,
    read_raw_registers,
    read_registers,
)

CUPS = (
    (1, None),
    (0, None),
    (1, None),
    (1, None),
    (2, None),
    (0, None),
    (0, Location.LOST_THROW),
    (0, Location.LOST_CARRY),
    (0, Location.LOST_PICK),
)
"""Contents of successive cups: number of seedlings, and loss of the seedling that was intended for an empty cup."""


@pytest.fixture
def rig() -> Iterator[Rig]:
    with Rig() as rig:
        yield rig


@pytest.fixture
def client(rig: Rig) -> Client:
    return rig.client()


def test_the_telemetry_table_has_no_gaps_and_no_overlaps() -> None:
    offset = 0
    for point in TELEMETRY:
        assert point.offset == offset, point.name
        offset += point.words
    assert offset == TELEMETRY_REGISTERS == 64
    assert len({point.name for point in TELEMETRY}) == len(TELEMETRY)


def test_telemetry_of_a_machine_in_its_initial_state(client: Client) -> None:
    """There are two full trays; both arms are at feed against the bumpers, down and open; no output is written."""
    telemetry = read_registers(client)
    absent = {"tray_at_pick", "last_write_ms", "tripped_at_ms", "S_pct"}
    absent |= {name for name in telemetry if name.startswith(("write_", "tick_"))}
    assert len(absent) == 10
    assert all(math.isnan(telemetry.pop(name)) for name in absent)
    arm = {"slide_mm": 2.0, "lift_mm": 150.0, "spreader_mm": 0.0, "claw_deg": 30.0, "clamp_n": -7.8, "missed_cups": 0}
    arm |= dict.fromkeys(("cups_1", "cups_2", "cups_3"), 0)
    assert telemetry == {
        **{f"{side}.{name}": value for side in ("left", "right") for name, value in arm.items()},
        "in_tray": 144,
        "in_claw": 0,
        "in_cups": 0,
        "P": 0,
        "D": 0,
        "T": 0,
        "total": 144,
        "ploughed": 0,
        "time_ms": 0,
        "watchdog_state": 0,
        "y_image": 0,
        "incidents": 0,
        "planting_frequency_per_min": 45.0,
        "main_pressure_kpa": 500.0,
        "claw_pressure_kpa": 400.0,
        "refused_writes": 0,
        **dict.fromkeys(("longest_gap_ms", "gaps", "lost_after_gaps", "dropped_ms", "plc_state", "plc_losses"), 0),
    }


def test_telemetry_follows_the_plant(rig: Rig, client: Client) -> None:
    """Every value is set to a distinct number and read back."""
    plant = rig.module.plant

    def change() -> None:
        plant.left.place(x_m=0.1234, y_m=0.0456, travel_m=0.0789, is_open=False)
        plant.right.place(x_m=0.2345, y_m=0.0567, travel_m=0.0891, is_open=True)
        plant.planting_frequency_per_min = 60.5
        for place, count in enumerate([0, 0, 2, 0, 3, 4, 5, 6]):  # by number of Location
            standing = [seedling for seedling in plant.seedlings if seedling.location == Location.STANDING]
            for seedling in standing[:count]:
                plant.seedlings.move(seedling, Location(place))
        for seedling in [seedling for seedling in plant.seedlings if seedling.location == Location.STANDING][:14]:
            plant.seedlings.plough(seedling)
        plant.left.row.missed_cups, plant.right.row.missed_cups = 7, 8
        plant.left.row.recent.extend(PassedCup(cup, seedlings, cause) for cup, (seedlings, cause) in enumerate(CUPS))
        plant.right.row.recent.extend(PassedCup(cup, 1) for cup in range(100))
        plant.conveyor._seats_m[1] = plant.conveyor._seats_m[0] - plant.conveyor.offset_m(0)
        plant.events += [Event(0, Incident.TORN, "made up")] * 9
        plant.time_ms = 70_000
        rig.module.write_outputs(0, [False] * 17 + [True])
        rig.module.tripped_at_ms = 69_000
        rig.module.lease.refused = 70_000
        timing = rig.module.timing
        for now_s in (1.0, 1.01, 1.02, 1.05):
            timing.add("client", 0, 17, now_s)
        for late_s in (0.0012, 0.0034):
            timing.lateness.add(late_s)
        timing.longest_gap_ms, timing.gaps, timing.seedlings_lost_after_gaps = 80_000, 12, 13
        timing.dropped_ms, timing.plc_state, timing.plc_losses = 90_000, PlcState.LOST, 3

    rig.thread.call(change)
    telemetry = read_registers(client)
    left = {
        "slide_mm": 123.4,
        "lift_mm": 45.6,
        "spreader_mm": 78.9,
        "claw_deg": -10.0,
        "clamp_n": 7.8,
        "missed_cups": 7,
        "cups_1": 0x31123765,
        "cups_2": 0x1,
        "cups_3": 0,
    }
    right = {
        "slide_mm": 234.5,
        "lift_mm": 56.7,
        "spreader_mm": 89.1,
        "claw_deg": 30.0,
        "clamp_n": -7.8,
        "missed_cups": 8,
        **dict.fromkeys(("cups_1", "cups_2", "cups_3"), 0x11111111),
    }
    assert telemetry == {
        **{f"left.{name}": value for name, value in left.items()},
        **{f"right.{name}": value for name, value in right.items()},
        "in_tray": 124,
        "in_claw": 2,
        "in_cups": 3,
        "P": 4,
        "D": 5,
        "T": 6,
        "total": 144,
        "ploughed": 14,
        "time_ms": 70_000,
        "last_write_ms": 70_000,
        "tripped_at_ms": 69_000,
        "watchdog_state": 1,
        "y_image": 1 << 17,
        "incidents": 9,
        "tray_at_pick": 1,
        "planting_frequency_per_min": 60.5,
        "main_pressure_kpa": 500.0,
        "claw_pressure_kpa": 400.0,
        "S_pct": 16.67,
        "refused_writes": 70_000,
        "write_period_ms": pytest.approx(10, rel=0.02),
        "write_period_p99_ms": 30.0,
        "write_jitter_ms": 9.43,
        "longest_gap_ms": 80_000,
        "gaps": 12,
        "lost_after_gaps": 13,
        "tick_lateness_ms": pytest.approx(1.2, rel=0.02),
        "tick_lateness_p99_ms": 3.4,
        "tick_lateness_longest_ms": 3.4,
        "dropped_ms": 90_000,
        "plc_state": 2,
        "plc_losses": 3,
    }
    registers = read_raw_registers(client)
    assert registers[:2] == (1, 4_464), "high word first"
    assert registers[12] == 1_234, "0.1 mm"
    assert registers[15] == 65_536 - 100, "0.1 degree, two's complement"


def test_an_absent_value_is_all_bits_and_an_overflow_is_clipped(rig: Rig, client: Client) -> None:
    def change() -> None:
        rig.module.plant.planting_frequency_per_min = 1e6
        rig.module.tripped_at_ms = 1 << 40

    assert read_raw_registers(client)[22:26] == (0xFFFF,) * 4
    rig.thread.call(change)
    telemetry = read_registers(client)
    assert telemetry["planting_frequency_per_min"] == 6_553.5
    assert telemetry["tripped_at_ms"] == 0xFFFF_FFFE, "must differ from 0xFFFF_FFFF, which means never"


@pytest.mark.parametrize("count", [0, TELEMETRY_REGISTERS - 1, TELEMETRY_REGISTERS + 1])
def test_decoding_requires_all_registers(count: int) -> None:
    with pytest.raises(ValueError, match=f"64 registers, not {count}"):
        read_telemetry([0] * count)


def test_the_documentation_table_has_a_row_for_every_value() -> None:
    heading, *rows = telemetry_table()
    assert [len(row) for row in rows] == [len(heading)] * len(TELEMETRY)
    assert rows[0] == ("0", "2", "high first", "time_ms", "1", "plant time")
    assert rows[14] == ("15", "1", "", "left.claw_deg", "0.1, signed", "left finger angle, positive when open")


def test_the_limits_of_the_tag_file_are_those_of_the_machine() -> None:
    machine = replace(MACHINE, supply=replace(MACHINE.supply, pressure_ok_pa=0.45e6, pressure_ok_gap_pa=0.03e6))
    low = {tag["name"]: tag["low"] for tag in csv.DictReader(io.StringIO(tag_csv(machine))) if tag["low"]}
    assert low == {
        "main_pressure_kpa": "420",
        "claw_pressure_kpa": f"{machine.rating.claws_least_pa / 1e3:g}",
        "left.clamp_n": f"{machine.claws.holds_above_n:g}",
        "right.clamp_n": f"{machine.claws.holds_above_n:g}",
    }


def test_the_word_order_of_the_tag_file_is_that_of_the_server() -> None:
    """A foreign client and the panel read the values of two words by the file alone."""
    module = make_module()
    module.last_write_ms, module.tripped_at_ms = 0x1234_5678, 0x0ABC_0001
    rows = {row["name"]: row for row in csv.DictReader(io.StringIO(tag_csv()))}
    assert {row["word_order"] for row in rows.values() if row["words"] == "2"} == {"high first"}
    assert {row["word_order"] for row in rows.values() if row["words"] != "2"} == {""}
    server = PlantServer(module, port=0, lock_step_ms=10)
    with ServerThread(server), ModbusTcpClient("127.0.0.1", port=server.port, timeout=PATIENT_S) as client:
        for name, value in (("last_write_ms", 0x1234_5678), ("tripped_at_ms", 0x0ABC_0001)):
            row = rows[name]
            words = client.read_input_registers(int(row["address"]), count=2).registers
            high, low = {"high first": words, "low first": words[::-1]}[row["word_order"]]
            assert high << 16 | low == value
            cells = {key: cell for key, cell in row.items() if cell}
            assert TelemetryTag.model_validate(cells).decode(words) == value
            assert TelemetryTag.model_validate(cells | {"word_order": "low first"}).decode(words[::-1]) == value
