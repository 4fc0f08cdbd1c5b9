"""Confirmed positions of an arm ("places"), derived from the switches and from the motion that led to them.

A switch alone does not confirm a place, because it can fail on at any time, also while the machine rests. A place is
*reached* if its switch comes on while the device is driven and not sooner than the device can be there, or if the
device has been driven to that end for the time of a full stroke. It remains reached until a coil drives the device
away, or until its switch is not on at rest, because a person has moved the device. A place is confirmed while it is
reached and its switch is the only one of its device that is on. Without this check a stuck switch would end a motion
halfway: the arm would move out to feed while still in the tray, or down before it is over the cups. An implausible
switch confirms no place, so the step waits and an alarm names the switches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from controller.core.expr import FALSE, Bit, Expr, all_of, any_of
from controller.core.rungs import OnDelay, Out, Pulse, Rst, Rung, Set, ZoneReset
from controller.program.interlocks import BELT, LIFT, SLIDE
from controller.program.tags import ROWS, ArmTags, MachineTags, Tags

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
class Place:
    """One place of a device.

    Attributes:
        here: Relay: the place is confirmed.
        was_here: Relay: the last confirmed place of the device.
        reached: Retentive relay: the device has reached the place and has not been driven away since.
        away: Coils that drive the device away from the place.
        towards: Coil that drives the device against its end stop at the place; None if there is no end stop.
    """

    here: Bit
    was_here: Bit
    reached: Bit
    away: Expr
    towards: Expr | None = None


@dataclass(frozen=True, slots=True)
class SwitchedDevice:
    """One device of an arm and its switches.

    Attributes:
        arm: Arm of the device.
        name: One of `DEVICES`; part of the names of its relays.
        coils: Condition that a coil drives the device.
        places: Places by switch, beginning with the place farthest from the others.
        whole_ms: Time for the full stroke with margin, ms.
        travelled: Relay: the shortest travel time to any other place has elapsed.
        among_rows: Relay: the shortest travel time between two places other than the first has elapsed.
    """

    arm: ArmTags
    name: str
    coils: Expr
    places: Mapping[Expr, Place]
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

    def rungs(self, machine: MachineTags, driven: Expr) -> Iterator[Rung]:
        """Yield the rungs that confirm the places of the device and store the last place.

        Args:
            machine: Tags of the machine.
            driven: Condition that the coils in the output image are on at the terminals.
        """
        under_way, placed = self.arm.under_way[self.name], self.arm.placed[self.name]
        pressed = self.arm.t_pressed[self.name]
        pressing = any_of(
            *(self.alone(s) & ~p.reached & p.towards for s, p in self.places.items() if p.towards is not None)
        )
        yield OnDelay(pressed, self.whole_ms, when=pressing & driven)
        yield Set(self.travelled, when=machine.places_anew & self.nowhere)
        yield Set(under_way, when=all_of(self.nowhere, self.coils, driven))
        yield Rst(under_way, when=~self.coils)
        first = next(iter(self.places))
        for switch, place in self.places.items():
            plausible = [place.was_here, self.travelled]
            if self.among_rows is not None and switch is not first:
                plausible.append(self.among_rows)
            arrived = under_way & any_of(*plausible)
            if place.towards is not None:
                arrived = arrived | (pressed.done & place.towards)
            yield Rst(place.reached, when=machine.places_checked & ~self.alone(switch))
            yield Set(place.reached, when=self.alone(switch) & arrived)
            yield Out(place.here, when=self.alone(switch) & place.reached)
        for switch, place in self.places.items():
            elsewhere = any_of(*(self.alone(other) for other in self._others(switch)))
            yield Rst(place.was_here, when=machine.places_anew & elsewhere)
            yield Set(place.was_here, when=place.here)
            yield Rst(place.was_here, when=any_of(*(self.places[other].here for other in self._others(switch))))
        yield Out(placed, when=any_of(*(place.here for place in self.places.values())))
        yield Rst(self.travelled, when=placed)
        if self.among_rows is not None:
            yield Rst(self.among_rows, when=placed)
        elsewhere = any_of(
            *(self.alone(s) & self.places[other].was_here for s in self.places for other in self._others(s))
        )
        several = any_of(*self.places) & ~any_of(*(self.alone(switch) for switch in self.places))
        yield Out(self.arm.doubt[self.name], when=~placed & (elsewhere | several))

    def leaving(self) -> Iterator[Rung]:
        """Yield the rungs that end a place when a coil drives the device away; they follow the outputs in the scan.

        A slide that reaches a row is still driven in that scan.
        """
        for place in self.places.values():
            passing = FALSE if place.towards is not None else self.arm.under_way[self.name]
            yield Rst(place.reached, when=place.away & ~passing)

    def _others(self, switch: Expr) -> list[Expr]:
        return [other for other in self.places if other is not switch]


def devices(a: ArmTags) -> tuple[SwitchedDevice, SwitchedDevice, SwitchedDevice]:
    """Return the lift, the belt and the slide of an arm."""
    coils = a.coils
    extend, retract, spread, converge, inward, outward = (coils[name] for name in (*LIFT, *BELT, *SLIDE))
    lift = SwitchedDevice(
        a,
        "lift",
        extend | retract,
        {
            a.sensed_down: Place(a.down, a.was_down, a.reached["down"], retract, extend),
            a.sensed_up: Place(a.up, a.was_up, a.reached["up"], extend, retract),
        },
        LIFT_WHOLE_MS,
        a.lift_travelled,
    )
    belt = SwitchedDevice(
        a,
        "belt",
        spread | converge,
        {
            a.sensed_spread: Place(a.is_spread, a.was_spread, a.reached["spread"], converge, spread),
            a.sensed_converged: Place(a.is_converged, a.was_converged, a.reached["converged"], spread, converge),
        },
        BELT_WHOLE_MS,
        a.belt_travelled,
    )
    at_rows = {
        a.sensed_at_pick[row]: Place(a.at_pick[row], a.was_at_pick[row], a.reached[f"pick {row}"], inward | outward)
        for row in ROWS
    }
    slide = SwitchedDevice(
        a,
        "slide",
        inward | outward,
        {a.sensed_at_feed: Place(a.at_feed, a.was_at_feed, a.reached["feed"], inward, outward), **at_rows},
        SLIDE_WHOLE_MS,
        a.slide_travelled,
        a.slide_hopped,
    )
    return lift, belt, slide


def places(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs that confirm the places of an arm.

    At the start of homing any place is plausible next for a device that is not at the place last confirmed. A switch
    that came on at rest confirms a place at an end only after the device has been driven towards that end for the time
    of a full stroke, and a row not at all.
    """
    machine, driven = tags.machine, ~tags.system.outputs_held
    lift, belt, slide = devices(a)
    return [
        OnDelay(a.t_lift_way, LIFT_LEAST_MS, when=lift.nowhere),
        Set(a.lift_travelled, when=a.t_lift_way.done),
        *lift.rungs(machine, driven),
        OnDelay(a.t_belt_way, BELT_LEAST_MS, when=belt.nowhere),
        Set(a.belt_travelled, when=a.t_belt_way.done),
        *belt.rungs(machine, driven),
        OnDelay(a.t_slide_way, tags.sp.slide_least, when=slide.nowhere),
        OnDelay(a.t_slide_hop, HOP_LEAST_MS, when=slide.nowhere),
        Set(a.slide_travelled, when=a.t_slide_way.done),
        Rst(a.slide_hopped, when=a.was_at_feed),
        Set(a.slide_hopped, when=a.t_slide_hop.done & ~a.was_at_feed),
        *slide.rungs(machine, driven),
        *_rest(a, machine),
    ]


def leaving(a: ArmTags) -> list[Rung]:
    """Return the rungs that end a place when a coil drives its device away; they follow the outputs in the scan."""
    return [rung for device in devices(a) for rung in device.leaving()]


def _rest(a: ArmTags, machine: MachineTags) -> list[Rung]:
    """Return the rungs that store the places of an arm when it comes to rest and detect changes without a command.

    Homing begins with the places at which the arm then is, because it may have been moved by hand.
    """
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
        OnDelay(a.t_rest, REST_MS, when=~moved & ~machine.places_anew),
        Pulse(a.begins_rest, when=a.t_rest.done),
        ZoneReset(first, last, when=~a.t_rest.done),
        *(Set(rested, when=a.begins_rest & now) for rested, now in states.items()),
        Out(a.unbidden, when=a.t_rest.done & differs),
    ]
