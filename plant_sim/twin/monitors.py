"""Safety monitors: conditions that must hold after every scan, under any fault.

A monitor is a factory: it resolves its terminals once and returns a check. The check returns a description of the
violation, or None. `guard` attaches monitors to a twin and stops it at the first violation; `collect_violations` lets
it continue and collects the violations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

from controller.iomap.loader import Point
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.tags import SIDES
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import Event
from plant_sim.twin.lock_step import Twin

Check = Callable[[], str | None]

INDICATORS = ("horn", "lamp_red", "lamp_amber", "lamp_green")
"""Outputs that do not drive an actuator."""
CREEP_M = 0.002
"""Permitted travel of a slide on trapped air before it stops, m."""


class Monitor(Protocol):
    """Factory of the check for a twin."""

    __name__: str

    def __call__(self, twin: Twin, /) -> Check:
        """Resolve the terminals and return the check."""


class UnsafeError(AssertionError):
    """Violation found by a monitor; the message contains its description, the time and the state of the machine."""


def opposite_coils(twin: Twin) -> Check:
    """Check that the two coils of a valve or motor are never on together."""
    io_map = twin.io_map
    pairs = [
        (io_map[f"{side}.{one}"], io_map[f"{side}.{two}"]) for side in SIDES for one, two in (SLIDE, LIFT, BELT, CLAWS)
    ]

    allowed = io_map.safe_outputs()

    def check() -> str | None:
        nonlocal allowed
        if twin.runtime.released == allowed:
            return None
        for one, two in pairs:
            if is_on(twin, one) and is_on(twin, two):
                return f"{one.tag} and {two.tag} are on together"
        allowed = list(twin.runtime.released)
        return None

    return check


def dead_in_emergency_stop(twin: Twin) -> Check:
    """Check that no coil is on in any scan that reads the emergency stop as pressed."""
    button = twin.io_map["emergency_stop"]
    coils = [point for point in twin.io_map.outputs if point.tag not in INDICATORS]

    def check() -> str | None:
        if not button.active(twin.plc.memory.X[button.number]):
            return None
        on = [point.tag for point in coils if is_on(twin, point)]
        return f"{', '.join(on)} on in emergency stop" if on else None

    return check


def gentle_inward(twin: Twin) -> Check:
    """Check that a slide moves inward only while its arm is down and its claws are open and converged.

    The check uses actual positions, not sensors. Neither travel on trapped air before a slide stops nor a rebound
    within the feed switch band counts as inward motion.
    """
    outermost_m: dict[str, float] = {}
    last_m: dict[str, float] = {}
    at_feed_m = twin.parameters.slide.switch_band_m + twin.parameters.slide.switch_hysteresis_m
    spec = twin.parameters.handling
    low_m = twin.parameters.lift.switch_band_m + twin.parameters.lift.switch_hysteresis_m

    def check() -> str | None:
        for side, arm in twin.plant.arms.items():
            x_m = arm.slide.x_m
            if last_m.get(side) == x_m:
                continue
            last_m[side] = x_m
            reason = None
            if arm.lift.rise_m > low_m:
                reason = f"{arm.lift.rise_m * 1000:.1f} mm above the lower limit"
            elif not arm.claws.free or arm.spreader.travel_m > spec.pitch_tolerance_m:
                reason = "with claws not open and converged"
            if reason is None:
                outermost_m.pop(side, None)
                continue
            outermost_m[side] = min(outermost_m.get(side, x_m), x_m)
            if x_m > max(outermost_m[side] + CREEP_M, at_feed_m):
                return f"{side} slide moves inward {reason}"
        return None

    return check


def tray_between_arms_at_feed(twin: Twin) -> Check:
    """Check that the tray moves only while both arms are at feed."""
    feed_m = twin.parameters.handling.feed_tolerance_m

    def check() -> str | None:
        if not twin.plant.conveyor.speed_m_s:
            return None
        away = [side for side, arm in twin.plant.arms.items() if arm.slide.x_m > feed_m]
        return f"the tray moves while the {away[0]} arm is away from feed" if away else None

    return check


def one_in_the_centre(twin: Twin) -> Check:
    """Check that the arms are never both inward of pick 2."""
    inward_m = centre_from_m(twin.parameters)

    def check() -> str | None:
        inside = all(arm.slide.x_m > inward_m for arm in twin.plant.arms.values())
        return "both arms are in the centre" if inside else None

    return check


def no_incident(twin: Twin) -> Check:
    """Check that there is no collision, and that no seedling is dropped, torn, cut or released over an occupied cup."""

    def check() -> str | None:
        events = twin.plant.events
        return f"{events[0].kind}: {events[0].text}" if events else None

    return check


def every_seedling_somewhere(twin: Twin) -> Check:
    """Check that every seedling is at exactly one location."""
    total = twin.plant.counts().total

    def check() -> str | None:
        c = twin.plant.counts()
        accounted = c.in_tray + c.in_claw + c.in_cups + c.P + c.D + c.T
        return None if accounted == c.total == total else f"{accounted} of {total} seedlings accounted for: {c}"

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
    """Attach monitors to a twin and return the twin.

    Args:
        twin: The machine; a scan with a violation raises `UnsafeError`.
        monitors: Monitors to attach; all by default.
    """
    checks = [monitor(twin) for monitor in monitors]

    def stop(twin: Twin) -> None:
        for check in checks:
            if (violation := check()) is not None:
                raise UnsafeError(f"{violation}; {twin.situation()}")

    twin.watch(stop)
    return twin


def collect_violations(twin: Twin) -> dict[str, str]:
    """Attach every monitor to a twin and collect the violations without stopping it.

    Returns:
        Description of the first violation of each kind, by kind of incident or name of the monitor. The dictionary is
        filled while the twin runs.
    """
    checks = {monitor.__name__: monitor(twin) for monitor in MONITORS if monitor is not no_incident}
    trips: dict[str, str] = {}
    seen: list[Event] = []

    def collect(twin: Twin) -> None:
        for name, check in checks.items():
            if name not in trips and (violation := check()) is not None:
                trips[name] = f"{violation}, at {twin.now_ms} ms"
        for event in twin.plant.events[len(seen) :]:
            seen.append(event)
            trips.setdefault(event.kind.value, f"{event.text}, at {event.time_ms} ms")

    twin.watch(collect)
    return trips


def is_on(twin: Twin, output: Point) -> bool:
    """Return True if an output is on in the image last written."""
    return output.active(twin.runtime.released[output.number])


def centre_from_m(machine: Machine) -> float:
    """Return the slide position beyond which an arm is in the centre, m: just inward of pick 2 and its switch."""
    slide = machine.slide
    return machine.picks_m[1] + slide.switch_band_m + slide.switch_hysteresis_m
