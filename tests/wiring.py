"""I/O map of the machine with other optional points wired."""

from __future__ import annotations

from dataclasses import replace

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map

DELIVERED = load_io_map(DEFAULT_IO_MAP)
YIELD = tuple(f"{side}.{tag}" for side in ("left", "right") for tag in ("claw_pressure", "seedling_beam", "cup_filled"))
"""Optional inputs that show whether a row is held and planted, with alarms, set-points and tags of their own."""


def wired(*tags: str) -> IoMap:
    """Return the delivered I/O map with the given optional points and output registers wired as well."""
    points = [replace(point, wired=True) for point in DELIVERED.unwired if point.tag in tags]
    registers = [replace(register, wired=True) for register in DELIVERED.unwired_registers if register.tag in tags]
    added = {point.tag for point in points} | {register.tag for register in registers}
    assert added == {tag for tag in tags if tag not in DELIVERED}
    inputs = (*DELIVERED.inputs, *(point for point in points if point.device == "X"))
    outputs = (*DELIVERED.outputs, *(point for point in points if point.device == "Y"))
    return replace(
        DELIVERED,
        inputs=tuple(sorted(inputs, key=lambda point: point.number)),
        outputs=tuple(sorted(outputs, key=lambda point: point.number)),
        registers=tuple(registers),
    )


def unwired(*tags: str) -> IoMap:
    """Return the delivered I/O map with the given optional points not wired."""
    points = (*DELIVERED.inputs, *DELIVERED.outputs)
    assert {point.tag for point in points} >= {*tags}
    return replace(
        DELIVERED,
        inputs=tuple(point for point in DELIVERED.inputs if point.tag not in tags),
        outputs=tuple(point for point in DELIVERED.outputs if point.tag not in tags),
        unwired=(*DELIVERED.unwired, *(replace(point, wired=False) for point in points if point.tag in tags)),
    )
