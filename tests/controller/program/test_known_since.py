"""Beliefs: each event of the table ends those that it says it ends, and no other, on the running machine."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.common.declarations import DeclarationError
from controller.common.modbus.io_map import IoMap
from controller.core.expr import Expr
from controller.program.known_since import Belief, End, beliefs
from controller.program.states import Mode, State
from plant_sim.faults import Fault
from plant_sim.twin.commissioning import default_io_map, program_of
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import clear, press_emergency_stop
from tests.controller.program.modes.hands import change_mode
from tests.plant_sim.twin.routes import BRISK
from tests.plant_sim.twin.twin_rig import ALARM, switched_on, tags_of, until_step
from tests.sampling import one_in
from tests.wiring import wired

MACHINE = program_of(default_io_map())
TABLE = beliefs(MACHINE.tags)
CLAMPED = "row between clamping and lifting"
MOVING = {CLAMPED, "place of lift, slide and belt"}
CONSTANTS = "machine constants that differ from their defaults"
SLIDE_LEAST = next(value for word, value in MACHINE.program.set_points if word == MACHINE.tags.sp.slide_least) - 1
"""Least travel time of the slide that differs from its default, x10 ms."""
IN_STOPPED = {End.ABORTED, End.POWER_UP, End.MEMORY_LOST, End.MANUAL, End.GUARD, End.CUPS_AT_REST}


def holds(twin: Twin, condition: Expr) -> bool:
    """Return the value of a condition on the devices of the program."""
    return twin.runs_until(condition, for_ms=10)


def at_work(belief: Belief, io_map: IoMap | None = None) -> Twin:
    """Return a machine at work that knows everything, with arms at home, or with claws that close on a row."""
    differing = {"slide_least": SLIDE_LEAST} if belief.name == CONSTANTS else {}
    twin = switched_on({"trays_target": 2, **differing}, trays=2, parameters=BRISK, io_map=io_map)
    twin.home()
    twin.start()
    for side in ("left", "right"):
        twin.run_until(tags_of(twin, side).cycles.equals(1), within_ms=60_000, what="a row released")
    if belief.name == CLAMPED:
        until_step(twin, "left arm", "close claws", within_ms=30_000)
        twin.run_for(150)
    return twin


def at_rest(belief: Belief, io_map: IoMap | None = None) -> Twin:
    """Return the same machine stopped at the end of its cycle; claws that close are stopped where they are."""
    twin = at_work(belief, io_map)
    if belief.name != CLAMPED:
        twin.press("stop")
        twin.run_until_state(State.STOPPED, within_ms=30_000)
        twin.run_for(1_500)
    return twin


def abort(twin: Twin) -> None:
    press_emergency_stop(twin)
    clear(twin)


def to_manual(twin: Twin) -> None:
    if twin.state is not State.STOPPED:
        abort(twin)
    change_mode(twin, Mode.MANUAL)


def lose_power(twin: Twin) -> None:
    twin.power_cycle()
    twin.run_for(50)


def lose_memory(twin: Twin) -> None:
    twin.store.values = None
    twin.power_cycle()
    twin.plc.write(twin.machine.tags.system.memory_lost, 1)
    twin.run_for(50)


def raise_cup_alarm(twin: Twin) -> None:
    twin.plant.faults.add(Fault("doubled_pulses", "left.cup_pulse", size=0.75))
    twin.run_until(ALARM, within_ms=30_000, what="an alarm")
    twin.run_until_state(State.HELD, within_ms=30_000)
    assert set(twin.alarms()) & {"cups_implausible", "cups_fast"}


def count_twice_at_rest(twin: Twin) -> None:
    before = twin.alarms()
    twin.plant.faults.add(Fault("halved_flags", "right.cup_pulse", size=1.0))
    twin.run_for(5_000)
    assert twin.alarms() == before


def open_guard(twin: Twin) -> None:
    twin.plant.box.guard = True
    twin.run_for(300)
    twin.plant.box.guard = False
    twin.run_for(300)


def take_the_tray_and_put_it_back(twin: Twin) -> None:
    twin.plant.conveyor.push(-0.030)
    twin.run_until_state(State.HELD, within_ms=30_000)
    assert "tray_lost" in twin.alarms()
    twin.plant.conveyor.push(0.030)
    twin.run_for(300)


EVENTS: dict[End, Callable[[Twin], None]] = {
    End.ABORTED: abort,
    End.MANUAL: to_manual,
    End.POWER_UP: lose_power,
    End.MEMORY_LOST: lose_memory,
    End.CUP_ALARM: raise_cup_alarm,
    End.CUPS_AT_REST: count_twice_at_rest,
    End.GUARD: open_guard,
    End.TRAY_LOST: take_the_tray_and_put_it_back,
}


CELLS = sorted(
    (
        (belief, end)
        for belief in TABLE
        for end in End
        if end not in {End.CUP_ALARM, End.CUPS_AT_REST, End.TRAY_LOST}
        or belief.name not in MOVING  # the arms move until the alarm holds the machine
    ),
    key=lambda cell: cell[1] in cell[0].kept,
)
ENDED = sum(end in belief.ends for belief, end in CELLS)
"""Number of cells in which the event ends the belief; these come first, and all of them run by default."""


@pytest.mark.parametrize(
    ("belief", "end"),
    [*CELLS[:ENDED], *one_in(6, CELLS[ENDED:])],
    ids=[f"{belief.name}, {end}" for belief, end in CELLS],
)
def test_an_event_ends_the_beliefs_of_its_column_only(belief: Belief, end: End) -> None:
    io_map = wired("guard") if end is End.GUARD else None
    twin = at_rest(belief, io_map) if end in IN_STOPPED else at_work(belief, io_map)
    assert holds(twin, belief.known), "known before"
    EVENTS[end](twin)
    assert holds(twin, belief.known) == (end in belief.kept), twin.situation()


def test_a_belief_states_the_effect_of_every_event() -> None:
    first = TABLE[0]
    for ends in ({}, {**first.ends, **first.kept}):
        with pytest.raises(DeclarationError, match=r"belief 'x': state whether '.*' ends it or keeps it"):
            Belief("x", first.known, ends, first.kept)
