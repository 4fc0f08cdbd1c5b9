"""Assumptions of the proof, and what no program with the inputs of this machine can exclude."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from controller.core.expr import Expr, any_of
from controller.core.specification import Limit
from controller.program.requirements.safety import Safety
from controller.program.requirements.travel_times import TravelTimes
from controller.program.tags import SIDES, Side, Tags

_ASSUMPTIONS: Final = (
    "at most one switch of an arm is false and has neither been detected nor verified since",
    "a switch that comes on while its device is driven between two places, not sooner than at the highest speed of the "
    "device, is true at that moment (what follows if it is not: see the limits)",
    "a device that is driven towards an end stop for the time of its full stroke reaches it",
    "a device whose coils are off stays where it is, unless a person moves it",
    "retentive memory is that of the last complete scan; outputs reach the terminals in the scan after the image",
)

_LATE = (
    "{switch} fails on while its device is driven towards it, after the shortest travel time: until the other switch "
    "comes on or the time limit expires, this cannot be told from an arrival"
)
_DEAD = (
    "the switch of the next row is dead: until the slide should have arrived, this cannot be told from a slower slide"
)


def assumptions(times: TravelTimes) -> tuple[str, ...]:
    """Return the statements about the machine on which the requirements rely.

    Args:
        times: Travel times of the machine.
    """
    travel = (
        f"the devices travel in these times: lift {times.lift_shortest_ms} to {times.lift_ms} ms, "
        f"belt {times.belt_shortest_ms} to {times.belt_ms} ms, slide from feed to row 1 {times.row_1_shortest_ms} to "
        f"{times.row_1_ms} ms and from row to row {times.row_shortest_ms} to {times.row_ms} ms, "
        f"claws at most {times.claws_ms} ms"
    )
    return (*_ASSUMPTIONS, travel)


def limits(tags: Tags, safety: Safety) -> Iterator[Limit]:
    """Yield the conditions that the program cannot exclude, each with the sensor that would tell."""
    for side in SIDES:
        for name, reason, remedy, condition in _of_arm(tags, safety, side):
            yield Limit(f"{side}: {name}", reason, remedy, condition)


def _of_arm(tags: Tags, safety: Safety, side: Side) -> Iterator[tuple[str, str, str, Expr]]:
    monitor, y = safety.arms[side], tags.arms[side].coils
    at, a = monitor.positions, tags.arms[side]
    second = "a second switch at this place, read by a program that compares both"
    position = "a position sensor of the slide, or a second switch just before each row"

    def unpressed(place: str) -> Expr:
        """Return the condition that only the arrival of a moving device verifies the switch of a place."""
        return at.certainly(place) & ~at.pressed[place]

    late = {
        "down": ("inward, down only by a switch", y["slide_inward"]),
        "up": ("outward with a load, up only by a switch", y["slide_outward"] & monitor.holds),
        "feed": ("spread, at feed only by a switch", y["spread"]),
        "spread": ("load released, spread only by a switch", y["claws_open"] & monitor.holds & at.certainly("feed")),
        "converged": ("inward, converged only by a switch", y["slide_inward"]),
    }
    for place, (name, motion) in late.items():
        yield name, _LATE.format(switch=f"the switch of {place}"), second, motion & unpressed(place)
    rows = any_of(*a.at_pick.values())
    yield (
        "close at a row, there only by a switch",
        _LATE.format(switch="the switch of the row"),
        position,
        (y["claws_close"] & rows & ~at.certainly("feed")),
    )
    yield "inward, possibly past a row", _DEAD, position, y["slide_inward"] & at.may_be_at_rows
