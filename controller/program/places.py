"""Where an arm is: switches are believed when they are on alone and when the actuator had the time to get there.

A switch that sticks would otherwise let the arm go on half way: out to feed while still in the tray, or down while
not yet over the cups. What is not believed is no place, so the step waits, and an alarm names the switches.
"""

from __future__ import annotations

from typing import Final

from controller.core.expr import Bit, Expr, any_of
from controller.core.rungs import OnDelay, Out, Pulse, Rst, Rung, Set, ZoneReset
from controller.program.tags import FIRST_SCAN, ROWS, ArmTags, Tags

LIFT_LEAST_MS: Final = 400
"""150 mm less both switch bands, 138 mm at 0.2 m/s: 0.7 s; little more than half of that."""
BELT_LEAST_MS: Final = 600
"""187 mm less both switch bands at 0.2 m/s: 0.9 s; two thirds of that."""
HOP_LEAST_MS: Final = 100
"""43 mm less both switch bands, 31 mm at 0.15 m/s: 0.2 s; half of that."""
REST_MS: Final = 1_000
"""After a coil goes off the arm has come to a stand within a fraction of that."""


def places(tags: Tags, a: ArmTags) -> list[Rung]:
    """Return the rungs that make places of switches; at power-up and when homing begins the switches are believed."""
    believed = FIRST_SCAN | tags.machine.entered_resetting
    return [*_lift(a, believed), *_slide(tags, a, believed), *_belt(a, believed), *_rest(a)]


def _lift(a: ArmTags, believed: Expr) -> list[Rung]:
    return [
        OnDelay(a.t_lift_way, LIFT_LEAST_MS, when=~a.sensed_down & ~a.sensed_up),
        Set(a.lift_travelled, when=a.t_lift_way.done | believed),
        Out(a.down, when=a.sensed_down & ~a.sensed_up & (a.was_down | a.lift_travelled)),
        Out(a.up, when=a.sensed_up & ~a.sensed_down & (a.was_up | a.lift_travelled)),
        *_last(((a.down, a.was_down), (a.up, a.was_up)), a.lift_travelled),
    ]


def _belt(a: ArmTags, believed: Expr) -> list[Rung]:
    return [
        OnDelay(a.t_belt_way, BELT_LEAST_MS, when=~a.sensed_spread & ~a.sensed_converged),
        Set(a.belt_travelled, when=a.t_belt_way.done | believed),
        Out(a.is_spread, when=a.sensed_spread & ~a.sensed_converged & (a.was_spread | a.belt_travelled)),
        Out(a.is_converged, when=a.sensed_converged & ~a.sensed_spread & (a.was_converged | a.belt_travelled)),
        *_last(((a.is_spread, a.was_spread), (a.is_converged, a.was_converged)), a.belt_travelled),
    ]


def _slide(tags: Tags, a: ArmTags, believed: Expr) -> list[Rung]:
    sensed = {0: a.sensed_at_feed, **a.sensed_at_pick}
    between = ~any_of(*sensed.values())

    def alone(place: int) -> Expr:
        return sensed[place] & ~any_of(*(switch for other, switch in sensed.items() if other != place))

    hopped = a.slide_travelled | (a.slide_hopped & ~a.was_at_feed)
    return [
        OnDelay(a.t_slide_way, tags.sp.slide_least, when=between),
        OnDelay(a.t_slide_hop, HOP_LEAST_MS, when=between),
        Set(a.slide_travelled, when=a.t_slide_way.done | believed),
        Set(a.slide_hopped, when=a.t_slide_hop.done),
        Out(a.at_feed, when=alone(0) & (a.was_at_feed | a.slide_travelled)),
        *(Out(a.at_pick[row], when=alone(row) & (a.was_at_pick[row] | hopped)) for row in ROWS),
        *_last(
            ((a.at_feed, a.was_at_feed), *((a.at_pick[row], a.was_at_pick[row]) for row in ROWS)),
            a.slide_travelled,
            a.slide_hopped,
        ),
    ]


def _last(ends: tuple[tuple[Bit, Bit], ...], *travelled: Bit) -> list[Rung]:
    """Remember the last place, and that the way to the next one has yet to be made."""
    anywhere = any_of(*(is_there for is_there, _ in ends))
    rungs: list[Rung] = []
    for is_there, was_there in ends:
        elsewhere = any_of(*(other for other, _ in ends if other != is_there))
        rungs += [Set(was_there, when=is_there), Rst(was_there, when=elsewhere)]
    return [*rungs, *(Rst(bit, when=anywhere) for bit in travelled)]


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
