"""Free devices: their table contains no device in use, and together with the devices in use it covers each range."""

from __future__ import annotations

import re

from controller.cli.docs import device_table
from controller.core.devices import PROGRAM_RANGES, next_free
from controller.program.machine import build
from controller.program.requirements.proof import specification
from tests.controller.verify.proof_rig import MACHINE
from tests.wiring import DELIVERED, wired

USED = {
    (device.kind, device.number)
    for machine in (MACHINE, build(wired(*(point.tag for point in DELIVERED.unwired), "planter_speed")))
    for device in specification(machine).watched.devices()
}
"""Devices of the delivered machine, and of one with all optional points wired."""


def numbers(text: str) -> set[tuple[str, int]]:
    """Return the devices in a text such as "M9, M57 to M99"."""
    spans = re.findall(r"([MTCDS])(\d+)(?: to [MTCDS](\d+))?", text)
    return {(kind, number) for kind, first, last in spans for number in range(int(first), int(last or first) + 1)}


def test_the_table_divides_each_range_into_devices_in_use_and_free_ones() -> None:
    rows = [row.split("|")[1:4] for row in device_table(MACHINE).partition("## Free numbers")[2].splitlines()[6:]]
    assert len(rows) == sum(map(len, PROGRAM_RANGES.values()))
    for within, _, free in rows:
        assert numbers(within) & USED == numbers(within) - numbers(free), within


def test_the_next_free_number_is_of_the_same_range() -> None:
    assert next_free("T", 199, set(range(200))) == "none"
    assert next_free("T", 5, {0, 1, 3}) == "T2"
    assert next_free("D", 600, {512}) == "D513"
    assert next_free("X", 0, set()) == "none"
