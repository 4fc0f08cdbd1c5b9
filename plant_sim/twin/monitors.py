"""Safety monitors: conditions that must hold after every scan, under any fault.

A monitor is a factory: it resolves its terminals once and returns rules, whose conditions are compiled. `guard`
attaches monitors to a twin and stops it at the first violation; `collect_violations` lets it continue and collects the
violations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import NamedTuple, Protocol

from controller.common.modbus.io_map import Point
from controller.core.expr import Bit, Expr, all_of, any_of
from controller.program.interlocks import BELT, CLAWS, LIFT, SLIDE
from controller.program.tags import SIDES
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.machine.parameters import Machine
from plant_sim.machine.plant import ArmPlant, Event
from plant_sim.twin.conditions import Advances, Quantity
from plant_sim.twin.lock_step import Twin

STOP_ALARMS = ("emergency_stop", "link_lost")
"""Alarms of the stops themselves: they tell the operator nothing of a fault that occurs during the stop."""
INDICATORS = ("horn", "lamp_red", "lamp_amber", "lamp_green")
"""Outputs that do not drive an actuator."""
CREEP_M = 0.002
"""Permitted travel of a slide on trapped air before it stops, m."""


class SafetyRule(NamedTuple):
    """Condition that must never become true, and the description of the violation.

    The condition is compiled. A rule about seedlings or incidents has a function instead, which is called after every
    scan that follows a move of a seedling or an incident.
    """

    violated: Expr | Callable[[], bool]
    text: Callable[[], str]


class Monitor(Protocol):
    """Factory of the rules for a twin."""

    __name__: str

    def __call__(self, twin: Twin, /) -> Iterable[SafetyRule]:
        """Resolve the terminals and positions and return the rules."""


class UnsafeError(AssertionError):
    """Violation found by a monitor; the message contains its description, the time and the state of the machine."""


def opposite_coils(twin: Twin) -> Iterator[SafetyRule]:
    """Require that the two coils of a valve or motor are never on together."""
    for side in SIDES:
        for pair in (SLIDE, LIFT, BELT, CLAWS):
            one, two = (twin.io_map[f"{side}.{tag}"] for tag in pair)
            yield SafetyRule(all_of(_on(one), _on(two)), partial("{} and {} are on together".format, one.tag, two.tag))


def dead_in_emergency_stop(twin: Twin) -> Iterator[SafetyRule]:
    """Require that no coil is on in any scan that reads the emergency stop as pressed."""
    button = twin.io_map["emergency_stop"]
    coils = [point for point in twin.io_map.outputs if point.tag not in INDICATORS]

    def text() -> str:
        return f"{', '.join(point.tag for point in coils if is_on(twin, point))} on in emergency stop"

    yield SafetyRule(all_of(_active(Bit("X", button.number), button), any_of(*map(_on, coils))), text)


def dead_with_the_guard_open(twin: Twin) -> Iterator[SafetyRule]:
    """Require that no coil is on in any scan that reads the guard as open; no rule without a guard."""
    guard = twin.io_map.get("guard")
    if guard is not None:
        coils = [point for point in twin.io_map.outputs if point.tag not in INDICATORS]
        open_ = _active(Bit("X", guard.number), guard)
        yield SafetyRule(open_ & any_of(*map(_on, coils)), lambda: "a coil is on with the guard open")


def gentle_inward(twin: Twin) -> Iterator[SafetyRule]:
    """Require that a slide moves inward only while its arm is down and its claws are open and converged.

    The rules use actual positions, not sensors. Neither travel on trapped air before a slide stops nor a rebound
    within the feed switch band counts as inward motion.
    """
    machine = twin.parameters
    at_feed_m = machine.slide.switch_band_m + machine.slide.switch_hysteresis_m
    low_m = machine.lift.switch_band_m + machine.lift.switch_hysteresis_m
    for number, (side, arm) in enumerate(twin.plant.arms.items()):
        slide, lift, claws = (Quantity(f"arms.{number}.{drive}.position_m") for drive in ("slide", "lift", "claws"))
        raised = lift < machine.lift.stroke_m - low_m
        rough = (claws < arm.claws.frees_above_m) | (
            Quantity(f"arms.{number}.spreader.travel_m") > machine.handling.pitch_tolerance_m
        )
        moves = Advances(slide, CREEP_M, during=raised | rough) & (slide > at_feed_m)

        def text(side: str = side, arm: ArmPlant = arm) -> str:
            if arm.lift.rise_m > low_m:
                return f"{side} slide moves inward {arm.lift.rise_m * 1000:.1f} mm above the lower limit"
            return f"{side} slide moves inward with claws not open and converged"

        yield SafetyRule(moves, text)


def tray_between_arms_at_feed(twin: Twin) -> Iterator[SafetyRule]:
    """Require that the tray moves only while both arms are at feed."""
    belt = Quantity("conveyor.belt_m_s")
    feed_m = twin.parameters.handling.feed_tolerance_m
    for number, side in enumerate(twin.plant.arms):
        away = Quantity(f"arms.{number}.slide.position_m") > feed_m
        moves = (belt > 0.0) | (belt < 0.0)
        yield SafetyRule(moves & away, partial("the tray moves while the {} arm is away from feed".format, side))


def one_in_the_centre(twin: Twin) -> Iterator[SafetyRule]:
    """Require that the arms are never both inward of pick 2."""
    inward_m = centre_from_m(twin.parameters)
    inside = (Quantity(f"arms.{number}.slide.position_m") > inward_m for number in range(len(SIDES)))
    yield SafetyRule(all_of(*inside), lambda: "both arms are in the centre")


def no_incident(twin: Twin) -> Iterator[SafetyRule]:
    """Require that there is no collision, and that no seedling is dropped, torn, cut or released over a full cup."""
    events = twin.plant.events
    yield SafetyRule(lambda: bool(events), lambda: f"{events[0].kind}: {events[0].text}")


def every_seedling_somewhere(twin: Twin) -> Iterator[SafetyRule]:
    """Require that every seedling is at exactly one location."""
    total = twin.plant.counts().total

    def accounted(counts: SeedlingCounts) -> int:
        return counts.in_tray + counts.in_claw + counts.in_cups + counts.P + counts.D + counts.T

    def violated() -> bool:
        counts = twin.plant.counts()
        return not accounted(counts) == counts.total == total

    def text() -> str:
        counts = twin.plant.counts()
        return f"{accounted(counts)} of {total} seedlings accounted for: {counts}"

    yield SafetyRule(violated, text)


MONITORS: tuple[Monitor, ...] = (
    opposite_coils,
    dead_in_emergency_stop,
    dead_with_the_guard_open,
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

    def stop(text: Callable[[], str]) -> None:
        raise UnsafeError(f"{text()}; {twin.situation()}")

    for monitor in monitors:
        for rule in monitor(twin):
            _attach(twin, rule, partial(stop, rule.text))
    return twin


def collect_violations(twin: Twin) -> dict[str, str]:
    """Attach every monitor to a twin and collect the violations without stopping it.

    Returns:
        Description of the first violation of each kind, by kind of incident or name of the monitor. The dictionary is
        filled while the twin runs.
    """
    trips: dict[str, str] = {}
    seen: list[Event] = [*twin.plant.events]

    def note(name: str, text: Callable[[], str]) -> None:
        if name not in trips:
            trips[name] = f"{text()}, at {twin.now_ms} ms"

    for monitor in MONITORS:
        if monitor is not no_incident:
            for rule in monitor(twin):
                _attach(twin, rule, partial(note, monitor.__name__, rule.text))

    def collect(twin: Twin) -> None:
        del seen[len(twin.plant.events) :]  # after a restore
        for event in twin.plant.events[len(seen) :]:
            seen.append(event)
            trips.setdefault(event.kind.value, f"{event.text}, at {event.time_ms} ms")

    twin.watch(collect, devices=())
    return trips


def _attach(twin: Twin, rule: SafetyRule, action: Callable[[], None]) -> None:
    """Execute an action after every scan in which a rule begins to be violated."""
    violated = rule.violated
    if isinstance(violated, Expr):
        twin.when(violated, action)
        return

    def check(_twin: Twin) -> None:
        if violated():
            action()

    twin.watch(check, devices=())


def _on(output: Point) -> Expr:
    """Return the condition that the program sets an output on; the runtime can only suppress it."""
    return _active(Bit("Y", output.number), output)


def _active(bit: Bit, point: Point) -> Expr:
    return ~bit if point.inverted else bit


def is_on(twin: Twin, output: Point) -> bool:
    """Return True if an output is on in the image last written."""
    return output.active(twin.runtime.released[output.number])


def centre_from_m(machine: Machine) -> float:
    """Return the slide position beyond which an arm is in the centre, m: just inward of pick 2 and its switch."""
    slide = machine.slide
    return machine.picks_m[1] + slide.switch_band_m + slide.switch_hysteresis_m
