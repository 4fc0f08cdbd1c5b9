"""Verdicts on the wires of inputs and outputs, from the levels before and after an operation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from controller.commissioning.axes import AXES, AXIS_OF, GROUP_OF, Change, Levels
from controller.common.modbus.io_map import Point


class WireResult(Enum):
    """Result of the check of one point."""

    OK = "ok"
    SWAPPED = "swapped"
    INVERTED = "inverted"
    DEAD = "dead"
    STUCK = "stuck"
    BRIDGED = "bridged"
    WRONG = "wrong"
    UNCOMMANDED = "uncommanded"
    NOT_TESTED = "not_tested"


@dataclass(frozen=True, slots=True)
class WireFinding:
    """Result of one point.

    Attributes:
        result: Result.
        others: Tags of the other points that reacted.
        note: Key of the text of an additional remark, or a remark of the person; empty = none.
    """

    result: WireResult
    others: tuple[str, ...] = ()
    note: str = ""


UNTESTED = WireFinding(WireResult.NOT_TESTED)


def judge_input(point: Point, released: Levels, operated: Levels) -> WireFinding:
    """Return the verdict on an input.

    When an axis is moved by hand to a sensor, the sensor that it leaves goes off; this is no fault.

    Args:
        point: Checked input.
        released: Active states while its sensor or button was not operated.
        operated: Active states while it was operated.
    """
    before, after = released[point.tag], operated[point.tag]
    axis = GROUP_OF.get(point.tag)
    left = () if axis is None else axis.sensors
    others = tuple(
        tag
        for tag in released
        if tag != point.tag and released[tag] != operated[tag] and not (tag in left and released[tag])
    )
    if before != after:
        if others:
            return WireFinding(WireResult.BRIDGED, others)
        return WireFinding(WireResult.OK if after else WireResult.INVERTED)
    if others:
        reversed_too = len(others) == 1 and not operated[others[0]]
        result = WireResult.SWAPPED if len(others) == 1 else WireResult.WRONG
        return WireFinding(result, others, "inverted_too" if reversed_too else "")
    return WireFinding(WireResult.STUCK if point.level(after) else WireResult.DEAD)


def motions(before: Levels, changes: Sequence[Change]) -> dict[str, int]:
    """Return the direction of every axis that moved; 0 = not known yet."""
    found = {axis.name: axis.direction(before, changes) for axis in AXES}
    return {name: direction for name, direction in found.items() if direction is not None}


def outputs_of(moved: Mapping[str, int]) -> tuple[str, ...]:
    """Return the outputs that cause motions of known direction."""
    return tuple(axis.output(moved[axis.name]) for axis in AXES if moved.get(axis.name))


def judge_output(tag: str, before: Levels, changes: Sequence[Change]) -> WireFinding | None:
    """Return the verdict on an output whose reaction is sensed, or None while the direction is not known.

    Args:
        tag: Checked output.
        before: Active states before it was switched on.
        changes: Changes of inputs while it was on and shortly after.
    """
    moved = motions(before, changes)
    if not moved:
        return WireFinding(WireResult.DEAD)
    causes = outputs_of(moved)
    if not causes:
        return None
    others = tuple(cause for cause in causes if cause != tag)
    if tag not in causes:
        return WireFinding(WireResult.SWAPPED if len(others) == 1 else WireResult.WRONG, others)
    return WireFinding(WireResult.BRIDGED, others) if others else WireFinding(WireResult.OK)


def is_decided(tag: str, before: Levels, changes: Sequence[Change], levels: Levels) -> bool:
    """Return True if an output can go off: another motion was seen, or its own has reached its end.

    The slide need not reach its inner end, so that it does not pass over the tray.

    Args:
        tag: Checked output.
        before: Active states before it was switched on.
        changes: Changes of inputs while it was on.
        levels: Present active states.
    """
    causes = outputs_of(motions(before, changes))
    if causes != (tag,):
        return bool(causes)
    axis, direction = AXIS_OF[tag]
    return axis.is_at_end(direction, levels) or tag.endswith("slide_inward")


def is_sensed(tag: str, findings: Mapping[str, WireFinding]) -> bool:
    """Return True if sensors show the reaction of an output and none of them has been found faulty."""
    if tag not in AXIS_OF:
        return False
    sensors = AXIS_OF[tag][0].sensors
    return all(findings.get(sensor, UNTESTED).result in (WireResult.OK, WireResult.NOT_TESTED) for sensor in sensors)
