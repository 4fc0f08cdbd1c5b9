"""Conservative positions of the devices of one arm, for the proof.

A device is *certainly* at a place only if its switch is on and the switch has been verified since the device was last
driven away: either it came on while the device was driven between two places, not sooner than at the highest speed, or
the device was then driven to its end stop there for the time of a full stroke. Everything else that the switches report
may be false. The monitors read terminals, coils and times; they do not read what the program concludes from them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from controller.core.expr import FALSE, Bit, Expr, Timer, all_of, any_of
from controller.core.rungs import Out, Rst, Rung, Set
from controller.program.areas import Area
from controller.program.interlocks import BELT, LIFT, SLIDE
from controller.program.tags import DEVICES, PLACES, ROWS, SIDES, ArmTags, Side, Tags

_COILS = {"lift": LIFT, "slide": SLIDE, "belt": BELT}
_PICKS = tuple(f"pick {row}" for row in ROWS)
_AT = {"lift": ("down", "up"), "slide": ("feed", *_PICKS), "belt": ("spread", "converged")}
_END_COIL = {
    "down": "lift_extend",
    "up": "lift_retract",
    "feed": "slide_outward",
    "spread": "spread",
    "converged": "converge",
}
"""Coil that drives a device against its end stop at a place."""
FIRST_BIT, BITS = 2000, 32


@dataclass(frozen=True)
class _Device:
    """One device of the arm.

    Attributes:
        switches: Switch of each place.
        coils: Its coils.
        least: Timer of the shortest time between two places.
    """

    switches: Mapping[str, Expr]
    coils: Mapping[str, Expr]
    least: Timer

    @property
    def nowhere(self) -> Expr:
        return ~any_of(*self.switches.values())

    def alone(self, place: str) -> Expr:
        """Return the condition that only the switch of this place is on."""
        return self.switches[place] & ~any_of(*(on for name, on in self.switches.items() if name != place))


class PositionMonitor:
    """Monitor of the places at which the devices of one arm certainly are."""

    def __init__(self, tags: Tags, side: Side) -> None:
        first = FIRST_BIT + BITS * SIDES.index(side)
        m = Area("M", first, first + BITS - 1, f"{side} position")
        self._arm: ArmTags = tags.arms[side]
        self._restarts = tags.machine.places_anew
        self.verified = {
            place: m.bit(f"verified {place}", f"the switch of {place} was verified, and no coil drove away since")
            for place in PLACES
        }
        self.near = {place: m.bit(f"near {place}", f"too short a time since {place}") for place in PLACES}
        self.near_row = m.bit("near a row", "too short a time since a row to be at another row")
        self.between = {
            name: m.bit(f"{name} between", f"the {name} has been between two places while driven") for name in DEVICES
        }
        self.pressed = {
            place: m.bit(f"pressed {place}", f"at {place} by a full stroke against the end stop") for place in _END_COIL
        }
        self.may_be_at_rows = m.bit("may be at rows", "the slide has had the time to reach a row since it left feed")
        self.driven = {coil: m.bit(f"{coil} on", "on in the last scan") for name in DEVICES for coil in _COILS[name]}

    @property
    def remembered(self) -> tuple[Bit, ...]:
        """Bits that are retained through a loss of power."""
        return (*self.verified.values(), *self.between.values(), *self.driven.values())

    def certainly(self, place: str) -> Expr:
        """Return the condition that the device is certainly at a place."""
        device = next(name for name, places in _AT.items() if place in places)
        return self._device(device).switches[place] & self.verified[place]

    def driven_away(self, place: str) -> Expr:
        """Return the condition that a coil drove the device away from a place in the last scan."""
        name = next(name for name, places in _AT.items() if place in places)
        return any_of(*(self.driven[coil] for coil in _COILS[name] if coil != _END_COIL.get(place)))

    def places(self) -> Iterator[Rung]:
        """Yield the rungs of the places; they follow the outputs in the scan and do not yet include their effect."""
        for name, place in self._places():
            device = self._device(name)
            passing = FALSE if place in _END_COIL else self.between[name]
            yield Rst(self.verified[place], when=self.driven_away(place) & ~passing)
            yield Set(self.verified[place], when=device.alone(place) & self._arrived(name, place))
            if place in self.pressed:
                yield Rst(self.pressed[place], when=~self.verified[place])
                yield Set(self.pressed[place], when=device.alone(place) & self._pressed(name, place))

    def motion(self) -> Iterator[Rung]:
        """Yield the rungs that record the motion begun in this scan; they follow all other monitors."""
        for name in DEVICES:
            device = self._device(name)
            moving = any_of(*device.coils.values())
            yield Rst(self.between[name], when=~moving)
            yield Set(self.between[name], when=moving & device.nowhere)
            yield from (Out(self.driven[coil], when=on) for coil, on in device.coils.items())
        for name, place in self._places():
            elapsed, here = self._device(name).least.done, self._here(name)
            yield Rst(self.near[place], when=any_of(self._restarts, elapsed, *here.values()))
            yield Set(self.near[place], when=here[place])
        yield Rst(self.may_be_at_rows, when=self.certainly("feed"))
        yield Set(self.may_be_at_rows, when=self._arm.t_slide_way.done)
        yield Rst(self.near_row, when=self._restarts | self._arm.t_slide_hop.done)
        yield Set(self.near_row, when=any_of(*self._arm.at_pick.values()))

    @staticmethod
    def _places() -> Iterator[tuple[str, str]]:
        return ((name, place) for name in DEVICES for place in _AT[name])

    def _arrived(self, name: str, place: str) -> Expr:
        """Return the condition that a switch that is on is verified in this scan."""
        others: list[Expr] = [self.near[other] for other in _AT[name] if other != place]
        if place in _PICKS:
            rows = any_of(*(self.near[other] for other in _PICKS if other != place))
            others = [self.near["feed"], rows & self.near_row]
        came = self.between[name] & ~any_of(*others)
        if place not in _END_COIL:
            return came
        return came | self._pressed(name, place)

    def _pressed(self, name: str, place: str) -> Expr:
        """Return the condition that the device has been driven to its end stop at a place for a full stroke."""
        return all_of(self._arm.t_pressed[name].done, self.driven[_END_COIL[place]])

    def _device(self, name: str) -> _Device:
        a = self._arm
        switches: dict[str, dict[str, Expr]] = {
            "lift": {"down": a.sensed_down, "up": a.sensed_up},
            "slide": {"feed": a.sensed_at_feed, **{f"pick {row}": a.sensed_at_pick[row] for row in ROWS}},
            "belt": {"spread": a.sensed_spread, "converged": a.sensed_converged},
        }
        least = {"lift": a.t_lift_way, "slide": a.t_slide_way, "belt": a.t_belt_way}
        return _Device(switches[name], {coil: a.coils[coil] for coil in _COILS[name]}, least[name])

    def _here(self, name: str) -> Mapping[str, Bit]:
        a = self._arm
        return {
            "lift": {"down": a.down, "up": a.up},
            "slide": {"feed": a.at_feed, **{f"pick {row}": a.at_pick[row] for row in ROWS}},
            "belt": {"spread": a.is_spread, "converged": a.is_converged},
        }[name]
