"""Routes to every step of every sequence, and helpers that resume production afterwards.

The steps are the declared steps of the program. A step without a special route is reached by a plain run; a step that
is not reached fails the tests that use it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import pytest
from _pytest.mark import ParameterSet

from controller.common.modbus.io_map import IoMap
from controller.core.sequence import Step
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.twin.commissioning import program_of
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, clear, operate_manually, overrides, press_emergency_stop
from tests.plant_sim.twin.twin_rig import MACHINE, arm_of, switched_on, tags_of, until_step

IO_MAP = load_io_map(DEFAULT_IO_MAP)
BRISK = MACHINE.with_values({"cups.planting_frequency_per_min": 60.0})
"""Parameters with a faster tractor; the planting rate is irrelevant in these tests."""
NUDGE_M = 0.012
"""Displacement beyond a row's switch and its hysteresis, but short of the next row, m."""

RISE_MS = 300
"""Time, ms, to lift an arm beyond its lower limit switch and hysteresis; the plugs are loosened but in their cells."""

Act = Callable[[Twin, Side], None]


class Stop(NamedTuple):
    """Declared step with its kind of sequence and its side (None for the feeder)."""

    kind: str
    side: Side | None
    step: Step

    @property
    def sequence(self) -> str:
        """Name of the sequence."""
        return f"{self.side} {self.kind}" if self.side else self.kind

    @property
    def title(self) -> str:
        """Title of the step."""
        return self.step.title

    @property
    def works_claws(self) -> bool:
        """True if the step moves the claws, which have no position sensor."""
        return any("claws" in request.name for request in self.step.hold)

    def __str__(self) -> str:
        return f"{self.sequence}: {self.title}"


def declared_stops() -> list[Stop]:
    """Return every step of every sequence of the program."""
    machine = program_of(IO_MAP)
    stops: list[Stop] = []
    for side in SIDES:
        stops += [Stop("arm", side, step) for step in machine.cycles[side].steps]
        stops += [Stop("homing", side, step) for step in machine.homings[side].steps]
    return stops + [Stop("tray feeder", None, step) for step in machine.feeder.steps]


STOPS = declared_stops()


def sampled(stops: Sequence[Stop], share: int, of: int) -> list[ParameterSet]:
    """Return test parameters for every step; one fraction of them runs by default, the others with ``--nightly``.

    Corresponding steps of the two arms are never in the same fraction.

    Args:
        stops: The steps.
        share: Index of the fraction that runs by default, from 0.
        of: Number of fractions, 2 or more.
    """
    parameters = []
    passed: Counter[str] = Counter()
    for stop in stops:
        number = passed[stop.sequence] + (stop.side == "right")
        passed[stop.sequence] += 1
        marks = () if number % of == share else pytest.mark.nightly
        parameters.append(pytest.param(stop, id=str(stop), marks=marks))
    return parameters


def interrupted(share: int) -> list[ParameterSet]:
    """Return test parameters for every step, for one of three tests that interrupt every step.

    By default, a test takes at most a quarter of the steps of the arms and a third of those of the feeder; no two tests
    take the same step of an arm.

    Args:
        share: Index of the test, 0 to 2.
    """
    arms, feeder = ([stop for stop in STOPS if (stop.side is None) == alone] for alone in (False, True))
    return sampled(arms, share, of=4) + sampled(feeder, share, of=3)


@dataclass(frozen=True)
class Route:
    """Route to a step.

    Attributes:
        set_points: Set-points required to reach the step.
        trays: Number of trays in the magazine, all of which are to be emptied.
        lead: Action that brings the machine to the point from which the step follows automatically; by default a plain
            run up to the end of row 1.
        restore: Action that restores the machine after the route.
        discards: True if a held row of seedlings is discarded by command on the route.
        loosens: True if the plugs of a row are loosened on the route and the row is therefore not picked.
    """

    set_points: dict[str, int] = field(default_factory=dict)
    trays: int = 1
    lead: Act | None = None
    restore: Callable[[Twin], None] = lambda twin: None
    discards: bool = False
    loosens: bool = False

    def travel(self, stop: Stop, io_map: IoMap | None = None) -> Twin:
        """Return a machine in the step, in the scan that activated it."""
        set_points = {"trays_target": self.trays} | self.set_points
        twin = switched_on(set_points, trays=self.trays, parameters=BRISK, io_map=io_map)
        (self.lead or run_row_1)(twin, stop.side or "left")
        if not twin.in_step(stop.sequence, stop.title):
            until_step(twin, stop.sequence, stop.title, within_ms=60_000)
        return twin


def route_to(stop: Stop) -> Route:
    """Return the route to a step."""
    return ROUTES.get((stop.kind, stop.title), Route(trays=2) if stop.side is None else Route())


# routes to a step


def run_row_1(twin: Twin, side: Side) -> None:
    """Home, start, and run until the arm has thrown row 1; its first throw, of an assumed load, is not counted."""
    twin.home()
    twin.start()
    cycles = tags_of(twin, side).cycles
    twin.run_until(cycles.equals(1), within_ms=60_000, what="row 1 thrown")


def run_to(step: str) -> Act:
    """Return an action that runs to a step of the arm in row 2."""

    def act(twin: Twin, side: Side) -> None:
        run_row_1(twin, side)
        until_step(twin, f"{side} arm", step, within_ms=60_000)

    return act


def overrun(twin: Twin, side: Side) -> None:
    """Move the slide off its row position while it settles there."""
    run_to("settle at row")(twin, side)
    arm = arm_of(twin, side)
    arm.place(x_m=arm.slide.x_m + NUDGE_M)


def stop_over_standing_cups(twin: Twin, side: Side) -> None:
    """Stop the tractor, then press X24 while the arm waits over the cups."""
    run_to("wait for cups")(twin, side)
    twin.plant.planting_frequency_per_min = 0.0
    twin.press("stop")


def homing_after(step: str, into_ms: int, *, discard: bool = False) -> Act:
    """Return an action that triggers an emergency stop during a step of row 2, clears it and starts homing."""

    def act(twin: Twin, side: Side) -> None:
        run_to(step)(twin, side)
        twin.run_for(into_ms)
        press_emergency_stop(twin)
        clear(twin)
        if discard:
            twin.command(f"{side}_discard")
        begin_homing(twin)

    return act


def homing_from_between(twin: Twin, side: Side) -> None:
    """Stop over the tray, raise the empty arm halfway with the manual override of its valve, and start homing."""
    run_to("approach row")(twin, side)
    twin.run_for(1_000)
    press_emergency_stop(twin)
    clear(twin)
    operate_manually(twin, f"{side}.lift_retract", for_ms=600)
    begin_homing(twin)


def homing_from_a_row_half_closed(twin: Twin, side: Side) -> None:
    """Stop as the claws begin to close on a row, raise the arm slightly by manual override, and start homing."""
    run_to("close claws")(twin, side)
    twin.run_for(20)
    press_emergency_stop(twin)
    clear(twin)
    operate_manually(twin, f"{side}.lift_retract", for_ms=RISE_MS)
    begin_homing(twin)


def homing_in_doubt(twin: Twin, side: Side) -> None:
    """Power-cycle while the claws close, and start homing by command: X0 answers the question that is shown."""
    run_to("close claws")(twin, side)
    twin.power_cycle()
    twin.run_for(50)
    twin.command("reset")
    twin.run_until_state(State.RESETTING, within_ms=50)


def restart_tractor(twin: Twin) -> None:
    """Restart the tractor."""
    twin.plant.planting_frequency_per_min = 60.0


def empty_the_magazine(twin: Twin, side: Side) -> None:
    """Take the second tray out of the magazine before the first is empty."""
    twin.plant.conveyor.in_magazine = 0
    run_row_1(twin, side)


def fill_the_magazine(twin: Twin) -> None:
    """Put one tray into the magazine."""
    twin.plant.conveyor.in_magazine = 1


def meet_a_tray_in_the_index(twin: Twin, side: Side) -> None:
    """Make the front edge sensor read blocked while the feeder indexes over the gap behind the first tray."""
    run_row_1(twin, side)
    until_step(twin, "tray feeder", "index", within_ms=60_000)
    twin.plant.conveyor.beam.stuck = True


def clear_the_beam(twin: Twin) -> None:
    """Unblock the front edge sensor."""
    twin.plant.conveyor.beam.stuck = None


ROUTES: dict[tuple[str, str], Route] = {
    ("arm", "return to row"): Route(lead=overrun),
    ("arm", "wait to lower"): Route({"descend_at_count": 12}),
    ("arm", "raise empty"): Route({"converge_at": 1}),
    ("arm", "lower empty"): Route({"converge_at": 1}),
    ("arm", "park"): Route(lead=stop_over_standing_cups, restore=restart_tractor),
    ("arm", "parked"): Route(lead=stop_over_standing_cups, restore=restart_tractor),
    ("homing", "decide"): Route(lead=homing_in_doubt),
    ("homing", "lower to put back"): Route(lead=homing_from_a_row_half_closed, loosens=True),
    ("homing", "put back"): Route(lead=homing_after("close claws", 150)),
    ("homing", "raise loaded"): Route(lead=homing_after("lift from row", 300)),
    ("homing", "raise empty"): Route(lead=homing_from_between),
    ("homing", "out"): Route(lead=homing_after("slide to feed", 300)),
    ("homing", "out low"): Route(lead=homing_after("approach row", 1_000)),
    ("homing", "raise at feed"): Route(lead=homing_after("lower over cups", 500)),
    ("homing", "discard, spread"): Route(lead=homing_after("slide to feed", 300, discard=True), discards=True),
    ("homing", "discard, lower"): Route(lead=homing_after("slide to feed", 300, discard=True), discards=True),
    ("homing", "open at feed"): Route(lead=homing_after("converge", 300)),
    ("homing", "press down at feed"): Route(lead=homing_after("converge", 300)),
    ("homing", "raise to converge"): Route(lead=homing_after("converge", 300)),
    ("homing", "converge"): Route(lead=homing_after("converge", 300)),
    ("homing", "lower"): Route(lead=homing_after("converge", 300)),
    ("homing", "pressurise at feed"): Route(lead=homing_after("converge", 300)),
    ("homing", "homed"): Route(lead=homing_after("converge", 300)),
    ("tray feeder", "tray in the gap"): Route(trays=2, lead=meet_a_tray_in_the_index, restore=clear_the_beam),
    ("tray feeder", "no tray"): Route(trays=2, lead=empty_the_magazine, restore=fill_the_magazine),
}


# return to production


def power_off_and_operate(twin: Twin, *outputs: str, for_ms: int) -> None:
    """Switch the controller off and operate each output manually for a time, one after another."""
    twin.module.advance(1_000)
    twin.clock.advance(1_000)
    for output in outputs:
        twin.plant.step(for_ms, overrides(twin, output))
        twin.clock.advance(for_ms)


def finish(twin: Twin) -> None:
    """Start in Idle and run to Complete."""
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
