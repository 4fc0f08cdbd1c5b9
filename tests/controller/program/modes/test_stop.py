"""X24: the arms finish the current cycle and move home, but a row held over cups at rest is parked."""

from __future__ import annotations

import pytest

from controller.core.expr import all_of
from controller.events.kinds import StateEvent
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.machine import build
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.faults import Fault
from plant_sim.twin.lock_step import Twin
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    ChangeRecorder,
    at_initial_state,
    at_work,
    go_on,
    is_parked_loaded,
    moving_outputs,
    other_side,
    scan_ms,
    switched_on,
    tags_of,
    to_complete,
    undisturbed,
    until_picking,
    until_step,
)
from tests.sampling import one_in

CUP_MS = 60_000 / 45
NO_CUPS_MS = 4_000
"""Three cup intervals at 45 cups/min, ms."""
TICK_MS = 100
STANDSTILL_MS = 1_000
"""Time in which the cups slow down from 45 mm/s to rest at 50 mm/s2, ms."""
NOT_ON_THE_WAY = {"wait at feed", "return to row", "wait to lower", "park", "parked"}
"""Steps that are not part of an undisturbed cycle."""
RAISING = {"raise empty", "lower empty"}
CYCLE_STEPS = [
    step.title for step in build(load_io_map(DEFAULT_IO_MAP)).cycles["left"].steps if step.title not in NOT_ON_THE_WAY
]


def states(twin: Twin) -> list[str]:
    return [State(event.state).name for event in twin.events if isinstance(event, StateEvent)]


def press_stop(twin: Twin) -> None:
    twin.press("stop")
    twin.run_until_state(State.STOPPING, within_ms=50)


def halt_tractor(twin: Twin) -> None:
    twin.plant.planting_frequency_per_min = 0.0


def start_tractor(twin: Twin) -> None:
    twin.plant.planting_frequency_per_min = 45.0


# cups run


@pytest.mark.parametrize("step", one_in(5, CYCLE_STEPS))
def test_stop_in_any_step_finishes_the_cycle_and_goes_home(step: str) -> None:
    """If X24 is pressed in this step of row 1, the arm releases the row, starts no other row and moves home."""
    twin = at_work({"trays_target": 1, "converge_at": int(step in RAISING)})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", step)
    begun = {side: twin.plc.read(tags_of(twin, side).cycles) for side in SIDES}
    press_stop(twin)
    outputs = ChangeRecorder.of_outputs(twin)
    twin.run_until_state(State.STOPPED, within_ms=20_000)
    for side in SIDES:
        assert at_initial_state(twin, side), side
        assert twin.plc.read(tags_of(twin, side).loaded) == 0
        assert twin.plc.read(tags_of(twin, side).cycles) - begun[side] <= 1
    assert {(cycle.side, cycle.row) for cycle in twin.cycles()} >= {("left", 1)}
    assert twin.plant.counts().in_claw == 0
    assert not any(change.on for side in SIDES for change in outputs.of(f"{side}.slide_inward"))
    twin.run_for(20_000)
    assert (twin.state, twin.outputs()) == (State.STOPPED, set())
    go_on(twin)
    assert to_complete(twin) == undisturbed()


# cups at rest


def both_waiting(set_points: dict[str, int] | None = None) -> Twin:
    """Return a machine whose arms both hold their first row over moving cups."""
    twin = at_work({"trays_target": 1} | (set_points or {}))
    step = "wait to lower" if twin.plc.read(twin.machine.tags.sp.descend_at_count) else "wait for cups"
    for side in SIDES:
        until_picking(twin, side, 1)
    twin.run_until(all_of(*(twin.step_of(f"{side} arm", step) for side in SIDES)), within_ms=20_000, what=step)
    return twin


def both_counting() -> tuple[Twin, ChangeRecorder]:
    """Return a machine whose arms both hold their first row over moving cups, and a recording of the cups."""
    twin = both_waiting()
    sensors = {side: twin.plant.arms[side].cups.pulse for side in SIDES}
    cups = ChangeRecorder(twin, lambda _: {side for side in SIDES if sensors[side].read()})
    twin.run_for(1_400)  # one cup passes each arm
    return twin, cups


def last_cup_ms(cups: ChangeRecorder, side: Side) -> int:
    return max(change.at_ms for change in cups.of(side) if change.on)


def first_without_cups(cups: ChangeRecorder) -> Side:
    return min(SIDES, key=lambda side: last_cup_ms(cups, side))


def test_arms_with_rows_over_cups_at_rest_suspend_the_machine_until_the_cups_move() -> None:
    twin, cups = both_counting()
    halt_tractor(twin)
    twin.run_until_state(State.SUSPENDED, within_ms=10_000)
    first = first_without_cups(cups)
    assert NO_CUPS_MS - TICK_MS <= scan_ms(twin) - last_cup_ms(cups, first) <= NO_CUPS_MS + 40
    assert twin.plc.read(tags_of(twin, first).no_cups)
    twin.run_for(20_000)
    assert (twin.state, moving_outputs(twin), twin.alarms()) == (State.SUSPENDED, set(), [])
    assert all(twin.in_step(f"{side} arm", "wait for cups") for side in SIDES)
    start_tractor(twin)
    twin.run_until_state(State.EXECUTE, within_ms=4_000)
    assert 0 <= scan_ms(twin) - max(last_cup_ms(cups, side) for side in SIDES) <= 40
    assert states(twin)[-5:] == ["EXECUTE", "SUSPENDING", "SUSPENDED", "UNSUSPENDING", "EXECUTE"]
    assert to_complete(twin) == undisturbed()


def test_an_arm_that_arrives_over_cups_at_rest_waits_three_cup_intervals() -> None:
    twin = at_work({"trays_target": 1})
    until_picking(twin, "right", 1)
    halt_tractor(twin)
    waiting_ms = until_step(twin, "right arm", "wait for cups")
    twin.run_until_state(State.SUSPENDED, within_ms=10_000)
    assert NO_CUPS_MS - TICK_MS <= scan_ms(twin) - waiting_ms <= NO_CUPS_MS + 40
    assert [side for side in SIDES if twin.plc.read(tags_of(twin, side).no_cups)] == ["right"]


def test_slow_cups_do_not_suspend() -> None:
    """At 18 cups/min, which is a cup interval of 3.3 s, the machine is not suspended."""
    twin = both_waiting()
    twin.plant.planting_frequency_per_min = 18.0
    twin.run_for(30_000)
    assert "SUSPENDED" not in states(twin)


def nearly_counted(other: Side, cups: int) -> Twin:
    """Return a machine whose arms both wait for cups, with this many cups left before arm `other` releases its row."""
    twin = both_waiting()
    counter = tags_of(twin, other).cup_counter.value
    twin.run_until(counter.equals(12 - cups), within_ms=20_000, what=f"{cups} cups to come")
    return twin


@pytest.mark.parametrize("side", SIDES)
def test_two_cups_on_one_side_and_none_on_the_other_hold_the_machine(side: Side) -> None:
    """While the cups of one side are at rest, the second cup of the other side raises an alarm; the row is parked."""
    other = other_side(side)
    twin = nearly_counted(side, cups=11)
    cups = ChangeRecorder(twin, lambda _: {"cup"} if twin.plant.arms[other].cups.pulse.read() else set())
    twin.plant.arms[side].cups.jammed = True
    twin.run_until(ALARM, within_ms=12_000, what="an alarm")
    assert twin.alarms() == [f"{other}: cup counts"]
    assert len([change for change in cups.changes if change.on]) == 2
    twin.run_until_state(State.HELD, within_ms=5_000)
    assert is_parked_loaded(twin, side)
    twin.plant.arms[side].cups.jammed = False
    go_on(twin)
    assert to_complete(twin) == undisturbed()


@pytest.mark.parametrize("earlier_ms", [0, 10, 20, 30])
def test_a_stop_in_the_scan_of_a_cup_alarm_parks_the_rows(earlier_ms: int) -> None:
    """No row is released while the alarm is set, which only homing resets: waiting for cups would never end."""
    twin = both_waiting()
    twin.plant.faults.add(Fault("doubled_pulses", "left.cup_pulse", size=0.75))
    before = twin.snapshot()
    alarm_ms = twin.run_until(ALARM, within_ms=12_000, what="an alarm")
    twin.restore(before)
    twin.run_for(alarm_ms - earlier_ms)
    press_stop(twin)
    twin.run_until_state(State.STOPPED, State.HELD, within_ms=12_000)
    twin.plant.faults.clear("doubled_pulses:left.cup_pulse")
    assert all(is_parked_loaded(twin, side) for side in SIDES)
    go_on(twin)
    assert to_complete(twin) == undisturbed()


# stop over cups at rest


@pytest.mark.parametrize(("descend_at_count", "waits_in"), [(0, "wait for cups"), (11, "wait to lower")])
def test_a_stop_over_cups_at_rest_parks_the_rows_and_a_start_resumes_with_them(
    descend_at_count: int, waits_in: str
) -> None:
    """In Suspended without cups, X24 parks both arms raised and closed; pressing X0 twice resumes work."""
    twin = both_waiting({"descend_at_count": descend_at_count})
    halt_tractor(twin)
    twin.run_for(10_000)
    assert twin.state == State.SUSPENDED
    held = twin.plant.counts().in_claw
    press_stop(twin)
    twin.run_until_state(State.STOPPED, within_ms=2_000)
    assert all(is_parked_loaded(twin, side) for side in SIDES)
    twin.run_for(20_000)
    assert (twin.state, twin.outputs(), twin.plant.counts().in_claw) == (State.STOPPED, set(), held)
    steps = ChangeRecorder.of_steps(twin)
    go_on(twin)
    twin.run_for(3_000)
    for side in SIDES:
        assert "raise to converge" not in {change.name for change in steps.of(f"{side} homing: ")}
        visited = [change.name for change in steps.of(f"{side} arm: ") if change.on]
        assert visited[-1] == waits_in
        assert set(visited) <= {"spread", "wait to lower", "lower over cups", "wait for cups"}
    assert twin.plant.counts().in_claw == held
    start_tractor(twin)
    assert to_complete(twin) == undisturbed()


def test_a_stop_before_the_third_cup_interval_waits_for_it_before_parking() -> None:
    """After X24 the arm waits for the cup timeout before it parks, because the next cup may still arrive."""
    twin, cups = both_counting()
    halt_tractor(twin)
    twin.run_for(1_500)
    press_stop(twin)
    first = first_without_cups(cups)
    parking_ms = until_step(twin, f"{first} arm", "park")
    assert NO_CUPS_MS - TICK_MS <= parking_ms - last_cup_ms(cups, first) <= NO_CUPS_MS + 20
    twin.run_until_state(State.STOPPED, within_ms=5_000)
    assert all(is_parked_loaded(twin, side) for side in SIDES)
    assert twin.plant.counts().in_claw > 20


# stop while homing


def test_a_stop_while_homing_is_immediate_and_homing_can_be_restarted() -> None:
    """X24 stops homing immediately while the arms move; if the tray is moving, it is first brought into place."""
    twin = switched_on({"trays_target": 1})
    for homing_ms in (200, 600, 900, 5_000, 6_500):
        twin.press("start")
        twin.run_until_state(State.RESETTING, within_ms=50)
        twin.run_for(homing_ms)
        twin.press("stop")
        assert twin.run_until_state(State.STOPPED, within_ms=20_000) <= (500 if homing_ms < 6_000 else 13_000)
        twin.run_for(2_000)
        assert (twin.state, twin.outputs()) == (State.STOPPED, set())
        assert (twin.plant.conveyor.placed_tray is None) == (homing_ms < 6_000), "a moving tray is brought into place"
    go_on(twin)
    assert to_complete(twin) == undisturbed()
