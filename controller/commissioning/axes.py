"""Axes of the machine: position sensors in the order of the motion, the outputs that move them, and permissions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

Levels = Mapping[str, bool]
"""Active state of every wired input by tag."""
Change = tuple[str, bool]
"""Tag of an input and its new active state."""

SIDES: Final = ("left", "right")


@dataclass(frozen=True, slots=True)
class Axis:
    """Moving part whose position is sensed.

    Attributes:
        name: Name, for example ``left.slide``.
        sensors: Tags of its sensors in the order in which a forward motion passes them.
        forward: Tag of the output that moves it towards the last sensor.
        backward: Tag of the output that moves it towards the first sensor.
    """

    name: str
    sensors: tuple[str, ...]
    forward: str
    backward: str

    def output(self, direction: int) -> str:
        """Return the output of a direction, 1 = forward, -1 = backward."""
        return self.forward if direction > 0 else self.backward

    def is_at_end(self, direction: int, levels: Levels) -> bool:
        """Return True if the axis cannot move further in a direction."""
        return levels.get(self.sensors[-1 if direction > 0 else 0], False)

    def direction(self, before: Levels, changes: Sequence[Change]) -> int | None:
        """Return the direction of a motion: 1, -1, 0 if its changes do not tell it, or None if there was none.

        Args:
            before: Active states before the motion.
            changes: Changes of inputs in their order.
        """
        last = next((index for index, tag in enumerate(self.sensors) if before.get(tag)), None)
        end = len(self.sensors) - 1
        found: int | None = None
        for tag, active in changes:
            if tag not in self.sensors:
                continue
            found = 0
            index = self.sensors.index(tag)
            if not active:
                if index in (0, end):
                    return 1 if index == 0 else -1
            elif last is not None and index != last:
                return 1 if index > last else -1
            elif index in (0, end) and index != last:
                return 1 if index == end else -1
            else:
                last = index
        return found


def _arm_axes(side: str) -> tuple[Axis, ...]:
    slide = (f"{side}.slide_at_feed", *(f"{side}.slide_at_pick_{row}" for row in (1, 2, 3)))
    return (
        Axis(f"{side}.lift", (f"{side}.lift_up", f"{side}.lift_down"), f"{side}.lift_extend", f"{side}.lift_retract"),
        Axis(f"{side}.belt", (f"{side}.claws_converged", f"{side}.claws_spread"), f"{side}.spread", f"{side}.converge"),
        Axis(f"{side}.slide", slide, f"{side}.slide_inward", f"{side}.slide_outward"),
    )


AXES: Final = tuple(axis for side in SIDES for axis in _arm_axes(side))
AXIS_OF: Final[dict[str, tuple[Axis, int]]] = {
    axis.output(direction): (axis, direction) for axis in AXES for direction in (1, -1)
}
"""Axis and direction of every output whose reaction is sensed."""
GROUP_OF: Final[dict[str, Axis]] = {tag: axis for axis in AXES for tag in axis.sensors}
"""Axis of every position sensor."""


@dataclass(frozen=True, slots=True)
class Permission:
    """Condition for an output, after the interlocks of the program that do not depend on its sequence.

    Attributes:
        reason: Key of the text that names the condition.
        allows: Function of the active states of the inputs.
    """

    reason: str
    allows: Callable[[Levels], bool]


def permissions(tag: str) -> list[Permission]:
    """Return the conditions under which an output may be on.

    Source: controller/program/interlocks.py, rules 'inward ready', 'centre is free', 'outward clear', 'down at feed
    only', 'spread only when up at feed' and 'converge only when empty at feed'.
    """
    found = [Permission("emergency_stop", lambda levels: not levels.get("emergency_stop", False))]
    side, _, motion = tag.rpartition(".")
    other = "right" if side == "left" else "left"

    def active(name: str, of: str = side) -> Callable[[Levels], bool]:
        return lambda levels: levels.get(f"{of}.{name}", False)

    match motion:
        case "slide_inward":
            found += [
                Permission("arm_down", active("lift_down")),
                Permission("claws_converged", active("claws_converged")),
                Permission("other_at_feed", active("slide_at_feed", other)),
            ]
        case "slide_outward":
            found.append(
                Permission("arm_at_end", lambda levels: active("lift_down")(levels) or active("lift_up")(levels))
            )
        case "lift_extend" | "converge":
            found.append(Permission("at_feed", active("slide_at_feed")))
        case "spread":
            found += [Permission("at_feed", active("slide_at_feed")), Permission("arm_up", active("lift_up"))]
    return found


def refusal(tag: str, levels: Levels) -> str | None:
    """Return the text key of the first condition that does not permit an output, or None."""
    return next((each.reason for each in permissions(tag) if not each.allows(levels)), None)
