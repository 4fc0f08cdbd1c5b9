"""Safety monitors: what must hold after every scan, whatever is broken.

A monitor is a factory: it looks its wires up once and returns a check that names what is wrong, or None.
`guard` puts them on a twin and stops it at once; `keep_watch` lets it go on and takes note.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol

from controller.io_map import Point
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.tags import SIDES
from plant_sim.bench.twin import Twin
from plant_sim.parameters import Machine
from plant_sim.plant import Event

Check = Callable[[], str | None]

INDICATORS = ("horn", "lamp_red", "lamp_amber", "lamp_green")
"""Outputs that move nothing."""
CREEP_M = 0.002
"""What trapped air may move a slide before it stands."""


class Monitor(Protocol):
    """Returns the check for a twin."""

    __name__: str

    def __call__(self, twin: Twin, /) -> Check:
        """Look the wires up."""


class UnsafeError(AssertionError):
    """A monitor found something that must never be; the message tells what, when and where."""


def opposite_coils(twin: Twin) -> Check:
    """Two coils of one valve or motor are never on together."""
    io_map = twin.io_map
    pairs = [
        (io_map[f"{side}.{one}"], io_map[f"{side}.{two}"]) for side in SIDES for one, two in (SLIDE, LIFT, BELT, CLAWS)
    ]

    safe = io_map.safe_outputs()

    def check() -> str | None:
        if twin.runtime.released == safe:
            return None
        for one, two in pairs:
            if is_on(twin, one) and is_on(twin, two):
                return f"{one.tag} and {two.tag} are on together"
        return None

    return check


def dead_in_emergency_stop(twin: Twin) -> Check:
    """In the scan that sees the emergency stop, and in all that follow, no coil is on."""
    button = twin.io_map["emergency_stop"]
    coils = [point for point in twin.io_map.outputs if point.tag not in INDICATORS]

    def check() -> str | None:
        if not button.active(twin.plc.memory.X[button.number]):
            return None
        on = [point.tag for point in coils if is_on(twin, point)]
        return f"in emergency stop {', '.join(on)} on" if on else None

    return check


def gentle_inward(twin: Twin) -> Check:
    """A slide goes inward only with the arm down, claws open and converged: as it is, not as it is sensed.

    What trapped air moves it by before it stands is no inward motion, nor is a rebound within the switch at feed.
    """
    outermost_m: dict[str, float] = {}
    seen_m: dict[str, float] = {}
    at_feed_m = twin.parameters.slide.switch_band_m + twin.parameters.slide.switch_hysteresis_m
    spec = twin.parameters.handling
    low_m = twin.parameters.lift.switch_band_m + twin.parameters.lift.switch_hysteresis_m

    def check() -> str | None:
        for side, arm in twin.plant.arms.items():
            x_m = arm.slide.x_m
            if seen_m.get(side) == x_m:
                continue
            seen_m[side] = x_m
            why = None
            if arm.lift.rise_m > low_m:
                why = f"{arm.lift.rise_m * 1000:.1f} mm above the lower limit"
            elif not arm.claws.free or arm.spreader.travel_m > spec.pitch_tolerance_m:
                why = "with claws not open and converged"
            if why is None:
                outermost_m.pop(side, None)
                continue
            outermost_m[side] = min(outermost_m.get(side, x_m), x_m)
            if x_m > max(outermost_m[side] + CREEP_M, at_feed_m):
                return f"{side} slide goes inward {why}"
        return None

    return check


def tray_between_arms_at_feed(twin: Twin) -> Check:
    """The tray moves only while both arms stand at feed."""
    feed_m = twin.parameters.handling.feed_tolerance_m

    def check() -> str | None:
        if not twin.plant.conveyor.speed_m_s:
            return None
        away = [side for side, arm in twin.plant.arms.items() if arm.slide.x_m > feed_m]
        return f"the tray moves while the {away[0]} arm is away from feed" if away else None

    return check


def one_in_the_centre(twin: Twin) -> Check:
    """The arms are never both inward of pick 2."""
    inward_m = centre_from_m(twin.parameters)

    def check() -> str | None:
        inside = all(arm.slide.x_m > inward_m for arm in twin.plant.arms.values())
        return "both arms are in the centre" if inside else None

    return check


def no_incident(twin: Twin) -> Check:
    """Nothing collides, nothing is dropped, torn, cut or thrown into a full cup."""

    def check() -> str | None:
        events = twin.plant.events
        return f"{events[0].kind}: {events[0].text}" if events else None

    return check


def every_seedling_somewhere(twin: Twin) -> Check:
    """Every seedling is in exactly one place."""
    total = twin.plant.counts().total

    def check() -> str | None:
        c = twin.plant.counts()
        found = c.in_tray + c.in_claw + c.in_cups + c.P + c.D + c.T
        return None if found == c.total == total else f"{found} of {total} seedlings accounted for: {c}"

    return check


MONITORS: tuple[Monitor, ...] = (
    opposite_coils,
    dead_in_emergency_stop,
    gentle_inward,
    tray_between_arms_at_feed,
    one_in_the_centre,
    no_incident,
    every_seedling_somewhere,
)


def guard(twin: Twin, monitors: Iterable[Monitor] = MONITORS) -> Twin:
    """Put monitors on a twin and return it.

    Args:
        twin: The machine; the scan in which a monitor finds something raises `UnsafeError`.
        monitors: Which; all of them if nothing is said.
    """
    checks = [monitor(twin) for monitor in monitors]

    def see(twin: Twin) -> None:
        for wrong in found(checks):
            raise UnsafeError(f"{wrong}; {twin.situation()}")

    twin.watch(see)
    return twin


def keep_watch(twin: Twin) -> dict[str, str]:
    """Put every monitor on a twin and let it go on, whatever they find.

    Returns:
        What has been found so far, the first of each kind: the kind of incident, or the name of the monitor, and
        what is wrong; it is filled while the twin runs.
    """
    checks = {monitor.__name__: monitor(twin) for monitor in MONITORS if monitor is not no_incident}
    trips: dict[str, str] = {}
    seen: list[Event] = []

    def see(twin: Twin) -> None:
        for name, check in checks.items():
            if name not in trips and (wrong := check()) is not None:
                trips[name] = f"{wrong}, at {twin.now_ms} ms"
        for event in twin.plant.events[len(seen) :]:
            seen.append(event)
            trips.setdefault(event.kind.value, f"{event.text}, at {event.time_ms} ms")

    twin.watch(see)
    return trips


def found(checks: list[Check]) -> Iterator[str]:
    """Yield what the checks find wrong."""
    return (wrong for check in checks if (wrong := check()) is not None)


def is_on(twin: Twin, output: Point) -> bool:
    """Tell whether an output is on in the image last written."""
    return output.active(twin.runtime.released[output.number])


def centre_from_m(machine: Machine) -> float:
    """Slide position from which on an arm is in the centre: pick 2 and its switch lie outside, m."""
    slide = machine.slide
    return machine.picks_m[1] + slide.switch_band_m + slide.switch_hysteresis_m
