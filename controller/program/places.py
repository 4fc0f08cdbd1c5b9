"""Where an arm is: switches are believed when they are on alone and when the actuator had the time to get there.

A switch that sticks would otherwise let the arm go on half way: out to feed while still in the tray, or down while
not yet over the cups. What is not believed is no place, so the step waits, and an alarm names the switches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from controller.core.expr import Bit, Expr, any_of
from controller.core.rungs import OnDelay, Out, Pulse, Rst, Rung, Set, ZoneReset
from controller.program.tags import ROWS, ArmTags, Tags

LIFT_LEAST_MS: Final = 250
"""150 mm less both switch bands, 138 mm at 0.2 m/s: 0.7 s; 0.32 s where a jam has let the chamber ahead run empty."""
BELT_LEAST_MS: Final = 800
"""187 mm less both switch bands at 0.2 m/s: 0.9 s; a motor that is driven is hardly ever faster."""
HOP_LEAST_MS: Final = 100
"""43 mm less both switch bands, 31 mm at 0.15 m/s: 0.2 s; half of that."""
LIFT_WHOLE_MS: Final = 1_500
"""The whole stroke takes 0.75 s at 0.2 m/s; twice that."""
SLIDE_WHOLE_MS: Final = 3_500
"""The longest stroke, 378.5 mm at 800 mm row spacing, takes 2.6 s at 0.143 m/s; a third more."""
BELT_WHOLE_MS: Final = 1_300
"""The whole travel takes 0.94 s at 0.2 m/s; a third more."""
REST_MS: Final = 1_000
"""After a coil goes off the arm has come to a stand within a fraction of that."""


@dataclass(frozen=True, slots=True)
class Device:
    """One device of an arm and its switches.

    Attributes:
        arm: Its arm.
        name: One of `DEVICES`; its relays have this name.
        places: By switch, the place and the memory that it was the last one; the first is apart from the others.
        to_end: By switch at an end, the coil that drives there.
        whole_ms: Time in which it gets from one end to the other for certain.
        travelled: It had the time to get to any other place.
        among_rows: It had the time to get from one to another of the places behind the first.
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
        """No switch is on."""
        return ~any_of(*self.places)

    def alone(self, switch: Expr) -> Expr:
        """Return the condition that this switch is on, and no other of the device."""
        return switch & ~any_of(*(other for other in self.places if other is not switch))

    def rungs(self, anew: Bit) -> Iterator[Rung]:
        """Yield the rungs that believe a switch, and remember the last place.

        Args:
            anew: Begin anew with what is sensed now.
        """
        placed, lied, pressed = self.arm.placed[self.name], self.arm.lied[self.name], self.arm.t_pressed[self.name]
        driven = any_of(*(self.alone(switch) & coil for switch, coil in self.to_end.items()))
        yield OnDelay(pressed, self.whole_ms, when=lied & driven)
        yield Set(self.travelled, when=anew & self.nowhere)
        for switch, (_, was_here) in self.places.items():
            yield Rst(was_here, when=anew & any_of(*(self.alone(other) for other in self._others(switch))))
        first = next(iter(self.places))
        for switch, (here, was_here) in self.places.items():
            believed = [was_here, self.travelled, anew & ~lied]
            if self.among_rows is not None and switch is not first:
                believed.append(self.among_rows)
            if switch in self.to_end:
                believed.append(pressed.done)
            yield Out(here, when=self.alone(switch) & any_of(*believed))
        for switch, (here, was_here) in self.places.items():
            yield Set(was_here, when=here)
            yield Rst(was_here, when=any_of(*(self.places[other][0] for other in self._others(switch))))
        yield Out(placed, when=any_of(*(here for here, _ in self.places.values())))
        yield Rst(self.travelled, when=placed)
        if self.among_rows is not None:
            yield Rst(self.among_rows, when=placed)
        yield Rst(lied, when=placed)
        known = any_of(*(was_here for _, was_here in self.places.values()))
        sensed = ~placed & any_of(*self.places)
        yield Out(
            self.arm.doubt[self.name], when=sensed & (known | ~any_of(*(self.alone(switch) for switch in self.places)))
        )

    def _others(self, switch: Expr) -> list[Expr]:
        return [other for other in self.places if other is not switch]


def places(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs that make places of switches.

    At power-up and when homing begins a switch that is on alone is believed, and of none the arm is between places.
    Not so where a switch of the device has lied: there the device is first driven against its end for the time of
    the whole stroke, whatever the switch says.
    """
    anew, coils = tags.machine.places_anew, a.coils
    at_rows = {a.sensed_at_pick[row]: (a.at_pick[row], a.was_at_pick[row]) for row in ROWS}
    lift = Device(
        a, "lift",
        {a.sensed_down: (a.down, a.was_down), a.sensed_up: (a.up, a.was_up)},
        {a.sensed_down: coils["lift_extend"], a.sensed_up: coils["lift_retract"]},
        LIFT_WHOLE_MS, a.lift_travelled,
    )  # fmt: skip
    belt = Device(
        a, "belt",
        {a.sensed_spread: (a.is_spread, a.was_spread), a.sensed_converged: (a.is_converged, a.was_converged)},
        {a.sensed_spread: coils["spread"], a.sensed_converged: coils["converge"]},
        BELT_WHOLE_MS, a.belt_travelled,
    )  # fmt: skip
    slide = Device(
        a, "slide",
        {a.sensed_at_feed: (a.at_feed, a.was_at_feed), **at_rows},
        {a.sensed_at_feed: coils["slide_outward"]},
        SLIDE_WHOLE_MS, a.slide_travelled, a.slide_hopped,
    )  # fmt: skip
    return [
        OnDelay(a.t_lift_way, LIFT_LEAST_MS, when=lift.nowhere),
        Set(a.lift_travelled, when=a.t_lift_way.done),
        *lift.rungs(anew),
        OnDelay(a.t_belt_way, BELT_LEAST_MS, when=belt.nowhere),
        Set(a.belt_travelled, when=a.t_belt_way.done),
        *belt.rungs(anew),
        OnDelay(a.t_slide_way, tags.sp.slide_least, when=slide.nowhere),
        OnDelay(a.t_slide_hop, HOP_LEAST_MS, when=slide.nowhere),
        Set(a.slide_travelled, when=a.t_slide_way.done),
        Rst(a.slide_hopped, when=a.was_at_feed),
        Set(a.slide_hopped, when=a.t_slide_hop.done & ~a.was_at_feed),
        *slide.rungs(anew),
        *_rest(a),
    ]


def _rest(a: ArmTags) -> list[Rung]:
    """Note where the arm has come to rest; what changes from then on has not been ordered."""
    moved = any_of(*(coil for name, coil in a.coils.items() if not name.startswith("claws")))
    kept = {
        a.rests_down: a.down,
        a.rests_up: a.up,
        a.rests_at_feed: a.at_feed,
        a.rests_spread: a.is_spread,
        a.rests_converged: a.is_converged,
    }
    first, *_, last = kept
    differs = any_of(*((rested & ~now) | (~rested & now) for rested, now in kept.items()))
    return [
        OnDelay(a.t_rest, REST_MS, when=~moved),
        Pulse(a.begins_rest, when=a.t_rest.done),
        ZoneReset(first, last, when=~a.t_rest.done),
        *(Set(rested, when=a.begins_rest & now) for rested, now in kept.items()),
        Out(a.unbidden, when=a.t_rest.done & differs),
    ]
