"""Where an arm is: switches are believed when they are on alone and when the actuator had the time to get there.

A switch that sticks would otherwise let the arm go on half way: out to feed while still in the tray, or down while
not yet over the cups. What is not believed is no place, so the step waits, and an alarm names the switches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from controller.core.expr import Bit, Expr, any_of
from controller.core.rungs import OnDelay, Out, Pulse, Rst, Rung, Set, ZoneReset
from controller.program.tags import FIRST_SCAN, ROWS, ArmTags, Tags

LIFT_LEAST_MS: Final = 250
"""150 mm less both switch bands, 138 mm at 0.2 m/s: 0.7 s; 0.32 s where a jam has let the chamber ahead run empty."""
BELT_LEAST_MS: Final = 800
"""187 mm less both switch bands at 0.2 m/s: 0.9 s; a motor that is driven is hardly ever faster."""
HOP_LEAST_MS: Final = 100
"""43 mm less both switch bands, 31 mm at 0.15 m/s: 0.2 s; half of that."""
REST_MS: Final = 1_000
"""After a coil goes off the arm has come to a stand within a fraction of that."""


def places(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs that make places of switches.

    At power-up and when homing begins a switch that is on alone is believed, and of none the arm is between places.
    """
    anew = FIRST_SCAN | tags.machine.entered_resetting
    lift = {a.sensed_down: (a.down, a.was_down), a.sensed_up: (a.up, a.was_up)}
    belt = {a.sensed_spread: (a.is_spread, a.was_spread), a.sensed_converged: (a.is_converged, a.was_converged)}
    return [
        OnDelay(a.t_lift_way, LIFT_LEAST_MS, when=~any_of(*lift)),
        Set(a.lift_travelled, when=a.t_lift_way.done),
        *_places(lift, anew, a.lift_travelled),
        OnDelay(a.t_belt_way, BELT_LEAST_MS, when=~any_of(*belt)),
        Set(a.belt_travelled, when=a.t_belt_way.done),
        *_places(belt, anew, a.belt_travelled),
        *_slide(tags, a, anew),
        *_rest(a),
    ]


def _slide(tags: Tags, a: ArmTags, anew: Expr) -> list[Rung]:
    slide = {
        a.sensed_at_feed: (a.at_feed, a.was_at_feed),
        **{a.sensed_at_pick[row]: (a.at_pick[row], a.was_at_pick[row]) for row in ROWS},
    }
    between = ~any_of(*slide)
    return [
        OnDelay(a.t_slide_way, tags.sp.slide_least, when=between),
        OnDelay(a.t_slide_hop, HOP_LEAST_MS, when=between),
        Set(a.slide_travelled, when=a.t_slide_way.done),
        Rst(a.slide_hopped, when=a.was_at_feed),
        Set(a.slide_hopped, when=a.t_slide_hop.done & ~a.was_at_feed),
        *_places(slide, anew, a.slide_travelled, among_rows=a.slide_hopped),
    ]


def _places(
    places: Mapping[Expr, tuple[Bit, Bit]], anew: Expr, travelled: Bit, *, among_rows: Bit | None = None
) -> Iterator[Rung]:
    """Yield the rungs that believe a switch, and remember the last place.

    Args:
        places: By switch, the place and the memory that it was the last one; the first is apart from the others.
        anew: Begin anew with what is sensed now.
        travelled: The device had the time to get to any other place.
        among_rows: It had the time to get from one to another of those behind the first.
    """
    first = next(iter(places))
    yield Set(travelled, when=anew & ~any_of(*places))
    for switch, (here, was_here) in places.items():
        alone = switch & ~any_of(*(other for other in places if other is not switch))
        had_time = travelled if among_rows is None or switch is first else travelled | among_rows
        yield Out(here, when=alone & any_of(was_here, had_time, anew))
    anywhere = any_of(*(here for here, _ in places.values()))
    for here, was_here in places.values():
        elsewhere = any_of(*(other for other, _ in places.values() if other != here))
        yield Set(was_here, when=here)
        yield Rst(was_here, when=elsewhere | (anew & ~here))
    yield Rst(travelled, when=anywhere)
    if among_rows is not None:
        yield Rst(among_rows, when=anywhere)


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


def in_doubt(a: ArmTags) -> dict[str, Expr]:
    """Return for each device whether a switch of it is on that is not believed."""
    slide = [a.sensed_at_feed & ~a.at_feed, *(a.sensed_at_pick[row] & ~a.at_pick[row] for row in ROWS)]
    return {
        "lift": (a.sensed_down & ~a.down) | (a.sensed_up & ~a.up),
        "slide": any_of(*slide),
        "belt": (a.sensed_spread & ~a.is_spread) | (a.sensed_converged & ~a.is_converged),
    }
