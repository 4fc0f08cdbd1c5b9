"""Confirmed positions of an arm ("places"), derived from plausible switches.

A switch is plausible if it is the only switch of its device that is on and the travel time has elapsed. Without this
check a stuck switch would end a motion halfway: the arm would move out to feed while still in the tray, or down before
it is over the cups. An implausible switch confirms no position, so the step waits and an alarm names the switches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from controller.core.expr import Bit, Expr, any_of
from controller.core.rungs import OnDelay, Out, Pulse, Rst, Rung, Set, ZoneReset
from controller.program.tags import ROWS, ArmTags, Tags

LIFT_LEAST_MS: Final = 250
"""Shortest plausible travel time of the lift, ms. 138 mm (150 mm less both switch bands) take 0.7 s at 0.2 m/s, or
0.32 s if a jam has vented the chamber ahead of the piston."""
BELT_LEAST_MS: Final = 800
"""Shortest plausible travel time of the belt, ms. 187 mm less both switch bands take 0.9 s at 0.2 m/s; the motor
cannot run much faster."""
HOP_LEAST_MS: Final = 100
"""Shortest plausible travel time between two rows, ms: half of the 0.2 s that 31 mm (43 mm less both switch bands) take
at 0.15 m/s."""
LIFT_WHOLE_MS: Final = 1_500
"""Time for the full lift stroke with margin, ms: twice the travel time of 0.75 s at 0.2 m/s."""
SLIDE_WHOLE_MS: Final = 3_500
"""Time for the full slide stroke with margin, ms: a third more than the 2.6 s of the longest stroke, 378.5 mm at 800 mm
row spacing, at 0.143 m/s."""
BELT_WHOLE_MS: Final = 1_300
"""Time for the full belt travel with margin, ms: a third more than the travel time of 0.94 s at 0.2 m/s."""
REST_MS: Final = 1_000
"""Delay from the last coil going off until the arm counts as at rest, ms; the arm stops in a fraction of this time."""


@dataclass(frozen=True, slots=True)
class SwitchedDevice:
    """One device of an arm and its switches.

    Attributes:
        arm: Arm of the device.
        name: One of `DEVICES`; part of the names of its relays.
        places: Relays for the place and the last place, by switch, beginning with the place farthest from the others.
        to_end: Coil that drives the device to an end of its stroke, by the switch at that end.
        whole_ms: Time for the full stroke with margin, ms.
        travelled: Relay: the shortest travel time to any other place has elapsed.
        among_rows: Relay: the shortest travel time between two places other than the first has elapsed.
    """

    arm: ArmTags
    name: str
    places: Mapping[Expr, tuple[Bit, Bit]]
    to_end: Mapping[Expr, Expr]
    whole_ms: int
    travelled: Bit
    among_rows: Bit | None = None

    @property
    def nowhere(self) -> Expr:
        """Condition that no switch is on."""
        return ~any_of(*self.places)

    def alone(self, switch: Expr) -> Expr:
        """Return the condition that only this switch of the device is on."""
        return switch & ~any_of(*(other for other in self.places if other is not switch))

    def rungs(self, restart: Bit) -> Iterator[Rung]:
        """Yield the rungs that check the switches for plausibility and store the last place.

        Args:
            restart: Relay that restarts the check from the current switch states.
        """
        placed, distrusted = self.arm.placed[self.name], self.arm.distrusted[self.name]
        pressed = self.arm.t_pressed[self.name]
        driven = any_of(*(self.alone(switch) & coil for switch, coil in self.to_end.items()))
        yield OnDelay(pressed, self.whole_ms, when=distrusted & driven)
        yield Set(self.travelled, when=restart & self.nowhere)
        for switch, (_, was_here) in self.places.items():
            yield Rst(was_here, when=restart & any_of(*(self.alone(other) for other in self._others(switch))))
        first = next(iter(self.places))
        for switch, (here, was_here) in self.places.items():
            trusted = [was_here, self.travelled, restart & ~distrusted]
            if self.among_rows is not None and switch is not first:
                trusted.append(self.among_rows)
            if switch in self.to_end:
                trusted.append(pressed.done)
            yield Out(here, when=self.alone(switch) & any_of(*trusted))
        for switch, (here, was_here) in self.places.items():
            yield Set(was_here, when=here)
            yield Rst(was_here, when=any_of(*(self.places[other][0] for other in self._others(switch))))
        yield Out(placed, when=any_of(*(here for here, _ in self.places.values())))
        yield Rst(self.travelled, when=placed)
        if self.among_rows is not None:
            yield Rst(self.among_rows, when=placed)
        yield Rst(distrusted, when=placed)
        known = any_of(*(was_here for _, was_here in self.places.values()))
        sensed = ~placed & any_of(*self.places)
        yield Out(
            self.arm.doubt[self.name], when=sensed & (known | ~any_of(*(self.alone(switch) for switch in self.places)))
        )

    def _others(self, switch: Expr) -> list[Expr]:
        return [other for other in self.places if other is not switch]


def places(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs that derive the places of an arm from its switches.

    At power-up and at the start of homing, a switch is trusted if it is the only one of its device that is on. If none
    is on, the device is between two places. If a switch of the device has been found implausible, a switch at
    an end is trusted only after the device has been driven towards that end for the time of a full stroke.
    """
    restart, coils = tags.machine.places_anew, a.coils
    at_rows = {a.sensed_at_pick[row]: (a.at_pick[row], a.was_at_pick[row]) for row in ROWS}
    lift = SwitchedDevice(
        a,
        "lift",
        {a.sensed_down: (a.down, a.was_down), a.sensed_up: (a.up, a.was_up)},
        {a.sensed_down: coils["lift_extend"], a.sensed_up: coils["lift_retract"]},
        LIFT_WHOLE_MS,
        a.lift_travelled,
    )
    belt = SwitchedDevice(
        a,
        "belt",
        {a.sensed_spread: (a.is_spread, a.was_spread), a.sensed_converged: (a.is_converged, a.was_converged)},
        {a.sensed_spread: coils["spread"], a.sensed_converged: coils["converge"]},
        BELT_WHOLE_MS,
        a.belt_travelled,
    )
    slide = SwitchedDevice(
        a,
        "slide",
        {a.sensed_at_feed: (a.at_feed, a.was_at_feed), **at_rows},
        {a.sensed_at_feed: coils["slide_outward"]},
        SLIDE_WHOLE_MS,
        a.slide_travelled,
        a.slide_hopped,
    )
    return [
        OnDelay(a.t_lift_way, LIFT_LEAST_MS, when=lift.nowhere),
        Set(a.lift_travelled, when=a.t_lift_way.done),
        *lift.rungs(restart),
        OnDelay(a.t_belt_way, BELT_LEAST_MS, when=belt.nowhere),
        Set(a.belt_travelled, when=a.t_belt_way.done),
        *belt.rungs(restart),
        OnDelay(a.t_slide_way, tags.sp.slide_least, when=slide.nowhere),
        OnDelay(a.t_slide_hop, HOP_LEAST_MS, when=slide.nowhere),
        Set(a.slide_travelled, when=a.t_slide_way.done),
        Rst(a.slide_hopped, when=a.was_at_feed),
        Set(a.slide_hopped, when=a.t_slide_hop.done & ~a.was_at_feed),
        *slide.rungs(restart),
        *_rest(a),
    ]


def _rest(a: ArmTags) -> list[Rung]:
    """Return the rungs that store the places of an arm when it comes to rest and detect changes without a command."""
    moved = any_of(*(coil for name, coil in a.coils.items() if not name.startswith("claws")))
    states = {
        a.rests_down: a.down,
        a.rests_up: a.up,
        a.rests_at_feed: a.at_feed,
        a.rests_spread: a.is_spread,
        a.rests_converged: a.is_converged,
    }
    first, *_, last = states
    differs = any_of(*((rested & ~now) | (~rested & now) for rested, now in states.items()))
    return [
        OnDelay(a.t_rest, REST_MS, when=~moved),
        Pulse(a.begins_rest, when=a.t_rest.done),
        ZoneReset(first, last, when=~a.t_rest.done),
        *(Set(rested, when=a.begins_rest & now) for rested, now in states.items()),
        Out(a.unbidden, when=a.t_rest.done & differs),
    ]
