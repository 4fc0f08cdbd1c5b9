"""I/O map of the machine with other optional points wired."""

from __future__ import annotations

from controller.common.modbus.io_map import IoMap
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map

DELIVERED = load_io_map(DEFAULT_IO_MAP)
YIELD = tuple(f"{side}.{tag}" for side in ("left", "right") for tag in ("claw_pressure", "seedling_beam", "cup_filled"))
"""Optional inputs that show whether a row is held and planted, with alarms, set-points and tags of their own."""


def wired(*tags: str) -> IoMap:
    """Return the delivered I/O map with the given optional points and output registers wired as well."""
    return DELIVERED.with_wired(tags)


def unwired(*tags: str) -> IoMap:
    """Return the delivered I/O map with the given optional points not wired."""
    return DELIVERED.with_unwired(tags)
