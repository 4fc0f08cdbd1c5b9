"""I/O map of the machine with optional points wired."""

from __future__ import annotations

from dataclasses import replace

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map

DELIVERED = load_io_map(DEFAULT_IO_MAP)


def wired(*tags: str) -> IoMap:
    """Return the delivered I/O map with the given optional points and output registers wired."""
    points = [replace(point, wired=True) for point in DELIVERED.unwired if point.tag in tags]
    registers = [replace(register, wired=True) for register in DELIVERED.unwired_registers if register.tag in tags]
    assert len(points) + len(registers) == len(tags)
    inputs = (*DELIVERED.inputs, *(point for point in points if point.device == "X"))
    return replace(
        DELIVERED,
        inputs=tuple(sorted(inputs, key=lambda point: point.number)),
        outputs=(*DELIVERED.outputs, *(point for point in points if point.device == "Y")),
        registers=tuple(registers),
    )
