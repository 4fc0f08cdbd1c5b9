"""Likely causes of the alarms of a machine, with the parts and the terminals concerned."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from controller.common.modbus.io_map import IoMap
from controller.program.alarms.table import Alarm
from controller.program.tags import SIDES
from controller.program.texts.alarms.causes import CAUSES
from controller.program.texts.alarms.help import Cause
from controller.program.texts.alarms.locations import ARM_LOCATIONS, LOCATIONS


@dataclass(frozen=True, slots=True)
class LikelyCause:
    """Likely cause of an alarm on a machine.

    Attributes:
        key: Key in `CAUSES`; for a cause of one alarm alone, its English name.
        cause: The cause.
        locations: Parts concerned; those of an arm with the side, for example ``left.lift``.
        points: Tag and terminal of each point concerned.
    """

    key: str
    cause: Cause
    locations: tuple[str, ...]
    points: tuple[tuple[str, str], ...]


def likely_causes(alarm: Alarm, io_map: IoMap) -> list[LikelyCause]:
    """Return the likely causes of an alarm, in the order in which to look.

    Args:
        alarm: The alarm.
        io_map: I/O map that contains the terminals.

    Raises:
        DeclarationError: A cause or the location of a cause is not declared.
    """
    terminals = {
        point.tag: point.address
        for points in (io_map.inputs, io_map.outputs, io_map.unwired, io_map.registers, io_map.unwired_registers)
        for point in points
    }
    found = []
    for named in alarm.text.causes:
        key, cause = (named, CAUSES[named]) if isinstance(named, str) else (named.name.en, named)
        sides = SIDES if cause.both_sides or alarm.side is None else (alarm.side,)
        tags = [tag for name in cause.points for tag in _with_sides(name, sides, of_arm=name not in terminals)]
        LOCATIONS.require([cause.location])
        locations = tuple(_with_sides(cause.location, sides, of_arm=cause.location in ARM_LOCATIONS))
        found.append(LikelyCause(key, cause, locations, tuple((tag, terminals[tag]) for tag in tags)))
    return found


def _with_sides(name: str, sides: tuple[str, ...], *, of_arm: bool) -> Iterator[str]:
    """Yield a name with each side, or alone if it does not belong to an arm."""
    if of_arm:
        yield from (f"{side}.{name}" for side in sides)
    else:
        yield name
