"""Guard: opened in every step, state and mode, all coils go off, and closing it moves nothing without a fresh order.

In every scenario a monitor checks that no coil is on in a scan that reads the guard as open.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.events.kinds import RefusalEvent
from controller.program.operator.next_press import NextPress
from controller.program.operator.refusals import Refusal
from controller.program.states import Mode, Reason, State
from plant_sim.faults import parse_fault
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, clear, home_again, press_emergency_stop, questions
from tests.controller.program.modes.hands import jog_command
from tests.controller.program.recovery.test_emergency_stop import (
    AT_SPEED_M_S,
    SEEN_MS,
    STARTS_MS,
    check_trial,
    holds,
    is_at_rest_except_warm_lift,
    positions,
    speed_m_s,
    states,
    stopping_distances,
)
from tests.plant_sim.twin.routes import BRISK, Stop, finish, interrupted, restart_tractor, route_to, run_row_1, run_to
from tests.plant_sim.twin.twin_rig import TRAY_MS, moving_outputs, switched_on, tags_of
from tests.sampling import one_in
from tests.wiring import wired

GUARD = wired("guard")
WITH_BUTTON = wired("guard", "reset")
LATER_MS = 3_000
"""Time after the guard has closed, ms, in which nothing may move."""


def machine(*, trays: int = 1, mode: Mode = Mode.CONTINUOUS, with_button: bool = False) -> Twin:
    """Return a machine with a guard, in Stopped."""
    io_map = WITH_BUTTON if with_button else GUARD
    return switched_on({"trays_target": trays}, trays=trays, parameters=BRISK, io_map=io_map, mode=mode)


def lifting(*, with_button: bool = False) -> Twin:
    """Return a machine whose left arm lifts row 2."""
    twin = machine(with_button=with_button)
    run_to("lift from row")(twin, "left")
    return twin


def open_guard(twin: Twin, for_ms: int = 1_500) -> None:
    twin.plant.box.guard = True
    twin.run_for(for_ms)


def close_guard(twin: Twin, for_ms: int = LATER_MS) -> None:
    """Close the guard and check that nothing moves by itself."""
    state, since = twin.state, len(twin.events)
    twin.plant.box.guard = False
    bits = [bit for tag, bit in twin.machine.tags.moving.items()]
    for bit in bits:
        assert not twin.runs_until(bit, for_ms=10)
    twin.run_for(for_ms)
    assert moving_outputs(twin) == set()
    assert (twin.state, states(twin, since)) == (state, [])


def read(twin: Twin, name: str) -> int:
    return twin.plc.read(getattr(twin.machine.tags.machine, name))


def refusals(twin: Twin) -> list[tuple[str, Refusal]]:
    return [(e.command, Refusal(e.reason)) for e in twin.events if isinstance(e, RefusalEvent)]


@pytest.mark.parametrize("stop", one_in(2, interrupted(2)))
def test_guard_opened_in_every_step(stop: Stop) -> None:
    """The relay stops all motion, the load is kept, and the trial is finished without losses after a homing."""
    route = route_to(stop)
    twin = route.travel(stop, GUARD)
    if stop.step.watch is not None and not stop.works_claws:
        twin.run_until(lambda: speed_m_s(twin, stop.side) > AT_SPEED_M_S, within_ms=STARTS_MS, what="at speed")
    if str(stop) == "right arm: lift from row":
        twin.run_for(10)  # stopped at 5.7 mm, the plugs are loose but the lower switch is on: the row is lost (ADR 62)
    was = twin.state
    before, held, since = positions(twin), holds(twin), len(twin.events)
    rising = {f"{side} lift" for side in ("left", "right") if f"{side}.lift_retract" in twin.outputs()}
    twin.plant.box.guard = True
    twin.run_for(SEEN_MS)
    ends = State.STOPPED if was in {State.STOPPING, State.IDLE} else State.HELD
    assert states(twin, since) == [ends]
    twin.run_for(1_000)
    at_rest, limits = positions(twin), stopping_distances()
    moved = {name: abs(at_rest[name] - before[name]) for name in before}
    assert all(moved[name] <= limits[name] + 1e-9 for name in before), moved
    assert ("guard_open" in twin.alarms()) == (was is not State.IDLE)

    close_guard(twin)
    assert states(twin, since) == [ends]
    assert is_at_rest_except_warm_lift(at_rest, positions(twin), rising)
    assert {side: holds(twin)[side] for side in held} == held
    route.restore(twin)
    home_again(twin)
    assert "guard_open" not in twin.alarms()
    finish(twin)
    check_trial(twin, route, stop.side or "left", discarded=route.discards)


# ---- states -----------------------------------------------------------------------------------------------------


def to_execute(twin: Twin) -> None:
    run_row_1(twin, "left")


def to_suspended(twin: Twin) -> None:
    run_row_1(twin, "left")
    twin.command("suspend")
    twin.run_until_state(State.SUSPENDED, within_ms=TRAY_MS)


def to_no_cups(twin: Twin) -> None:
    run_to("wait for cups")(twin, "left")
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_until_state(State.SUSPENDED, within_ms=TRAY_MS)


def to_holding(twin: Twin) -> None:
    run_to("lift from row")(twin, "left")
    twin.command("hold")
    twin.run_until_state(State.HOLDING, within_ms=100)


def to_held(twin: Twin) -> None:
    to_holding(twin)
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)


def to_complete(twin: Twin) -> None:
    run_row_1(twin, "left")
    twin.command("complete")
    twin.run_until_state(State.COMPLETE, within_ms=TRAY_MS)


def to_stopping(twin: Twin) -> None:
    run_to("lift from row")(twin, "left")
    twin.press("stop")
    twin.run_until_state(State.STOPPING, within_ms=100)


def to_resetting(twin: Twin) -> None:
    begin_homing(twin)


def to_idle(twin: Twin) -> None:
    twin.home()


def to_stopped(twin: Twin) -> None:
    twin.scan()


def to_aborted(twin: Twin) -> None:
    press_emergency_stop(twin)


OPENED: dict[str, tuple[Callable[[Twin], None], State, bool]] = {
    "Execute": (to_execute, State.HELD, True),
    "Suspended by the operator": (to_suspended, State.HELD, True),
    "Suspended, no cups": (to_no_cups, State.HELD, True),
    "Holding": (to_holding, State.HELD, True),
    "Resetting": (to_resetting, State.HELD, True),
    "Stopping": (to_stopping, State.STOPPED, True),
    "Idle": (to_idle, State.STOPPED, False),
    "Stopped": (to_stopped, State.STOPPED, False),
    "Held": (to_held, State.HELD, False),
    "Complete": (to_complete, State.COMPLETE, False),
    "Aborted": (to_aborted, State.ABORTED, False),
}
"""State in which the guard is opened: the state that follows, and whether an alarm reports it. Completing and the other
states that last one scan are covered by the proof."""


@pytest.mark.parametrize("name", one_in(2, OPENED))
def test_guard_opened_in_every_state(name: str) -> None:
    """Only motion that is cut short raises the alarm; the tray is no longer trusted in any state."""
    to_state, ends, reports = OPENED[name]
    twin = machine()
    to_state(twin)
    twin.plant.box.guard = True
    twin.run_for(SEEN_MS)
    assert twin.state is ends
    assert moving_outputs(twin) == set()
    twin.run_for(LATER_MS)
    assert twin.state is ends
    assert ("guard_open" in twin.alarms()) == reports
    assert not twin.plc.read(twin.machine.tags.tray.place_known)
    if ends is State.HELD:
        assert read(twin, "reason") == Reason.GUARD_OPEN
    if ends is not State.ABORTED:
        assert read(twin, "next_press") == NextPress.CLOSE_GUARD
    restart_tractor(twin)
    close_guard(twin)
    if ends is State.ABORTED:
        clear(twin)
    assert read(twin, "next_press") in {NextPress.HOME, NextPress.REPAIR_AND_HOME}
    home_again(twin)


@pytest.mark.parametrize("mode", [Mode.ONE_CYCLE, Mode.STEP, Mode.ZERO_RETURN])
def test_guard_opened_in_homing_of_every_mode(mode: Mode) -> None:
    twin = machine(mode=mode)
    begin_homing(twin)
    twin.run_for(500)
    open_guard(twin)
    assert twin.state is State.HELD
    close_guard(twin)
    home_again(twin)


def test_step_mode_begins_no_step_after_the_guard() -> None:
    """A press that was armed before the guard opened is lost."""
    twin = machine(mode=Mode.STEP)
    twin.home()
    twin.start()
    twin.command("step")
    twin.run_for(200)
    assert moving_outputs(twin)
    open_guard(twin, 200)
    close_guard(twin)
    twin.command("step")
    twin.scan()
    assert refusals(twin)[-1] == ("step", Refusal.NOT_STEPPING)


def test_a_jog_that_is_held_down_ends_with_the_guard() -> None:
    """The panel renews a held key; after the guard has closed, only a new start permits jogs."""
    twin = machine(mode=Mode.MANUAL)
    twin.home()
    twin.start()
    renewed = jog_command("left.lift_retract")
    for at_ms in range(0, 1_500, 100):
        twin.plant.box.guard = 500 <= at_ms < 1_000
        twin.command(renewed)
        twin.run_for(100)
        assert bool(moving_outputs(twin)) == (at_ms < 500)
    assert twin.state is State.HELD
    twin.home()
    twin.start()
    twin.command(renewed)
    twin.run_for(50)
    assert moving_outputs(twin) == {"left.lift_retract"}


# ---- orders -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["reset", "unhold", "start"])
def test_no_order_is_accepted_with_the_guard_open(command: str) -> None:
    twin = machine()
    if command == "start":
        to_no_cups(twin)
        twin.command("suspend")
        twin.scan()
    else:
        to_held(twin)
    open_guard(twin)
    twin.command(command)
    twin.run_for(50)
    reason = Refusal.NOT_IDLE if command == "start" else Refusal.GUARD_OPEN
    assert refusals(twin)[-1] == (command, reason)
    close_guard(twin)


def test_x0_held_while_the_guard_closes_is_no_order() -> None:
    """X0 acts on its edge; a later press homes."""
    twin = lifting()
    open_guard(twin)
    twin.plant.box.start = True
    twin.run_for(500)
    assert refusals(twin)[-1] == ("reset", Refusal.GUARD_OPEN)
    close_guard(twin)
    twin.plant.box.start = False
    twin.run_for(LATER_MS)
    assert twin.state is State.HELD
    home_again(twin)


def test_the_reset_button_pressed_with_the_guard_open_is_no_order() -> None:
    """It acts when it is released, also if the guard has been closed in between."""
    twin = lifting(with_button=True)
    open_guard(twin)
    twin.plant.box.reset = True
    twin.run_for(200)
    close_guard(twin)
    twin.plant.box.reset = False
    twin.run_for(LATER_MS)
    assert twin.state is State.HELD
    twin.press("reset")
    twin.run_until_state(State.RESETTING, within_ms=1_000)


def test_resume_is_refused_because_the_tray_may_have_been_moved() -> None:
    twin = machine()
    to_held(twin)
    open_guard(twin)
    close_guard(twin)
    twin.command("unhold")
    twin.run_for(50)
    assert refusals(twin)[-1] == ("unhold", Refusal.TRAY_UNKNOWN)
    assert "tray" in home_again(twin)


def test_a_stop_with_the_guard_open_is_accepted() -> None:
    twin = lifting()
    open_guard(twin)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=100)
    close_guard(twin)


def test_stop_and_guard_in_the_same_scan_end_in_stopped() -> None:
    twin = lifting()
    twin.plant.box.guard = twin.plant.box.stop = True
    twin.run_for(SEEN_MS + 20)
    assert (twin.state, moving_outputs(twin)) == (State.STOPPED, set())
    twin.plant.box.stop = False
    twin.run_for(100)
    close_guard(twin)
    home_again(twin)


def test_a_guard_that_is_open_for_one_scan_stops_for_good() -> None:
    twin = lifting()
    twin.plant.box.guard = True
    twin.run_until(twin.machine.tags.machine.guard_open, within_ms=50, what="guard seen")
    close_guard(twin)
    assert twin.state is State.HELD


# ---- cups, tray, arms -------------------------------------------------------------------------------------------


def test_the_cups_go_on_counting_with_the_guard_open() -> None:
    twin = machine()
    run_to("wait for cups")(twin, "left")
    counter = tags_of(twin, "left").cup_counter
    open_guard(twin, 50)
    before = twin.plc.read(counter.value)
    twin.run_for(2_500)
    assert twin.plc.read(counter.value) >= min(before + 2, 12)


def test_a_tray_pushed_through_the_guard_is_asked_about() -> None:
    """A tray that is no longer at its mark is answered as not the same; no arm moves in over it."""
    twin = machine(trays=2)
    run_to("wait for cups")(twin, "left")
    open_guard(twin)
    twin.plant.conveyor.push(0.012)
    close_guard(twin)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    twin.run_for(50)
    assert questions(twin) == {"tray"}
    assert read(twin, "next_press") == NextPress.ANSWER_SAME_TRAY
    open_guard(twin, 100)
    assert read(twin, "next_press") == NextPress.CLOSE_GUARD
    close_guard(twin)
    lost_before = twin.plant.counts().P
    assert home_again(twin) == {"tray"}
    twin.start()
    twin.run_for(20_000)
    lost = twin.plant.counts().P - lost_before
    assert lost <= 1, "the moved tray is fed again, and its rows are found"


def test_an_answer_with_the_guard_open_is_asked_again() -> None:
    twin = machine()
    to_held(twin)
    open_guard(twin)
    close_guard(twin)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=40_000)
    open_guard(twin, 100)
    twin.command("tray_same")
    twin.run_for(50)
    close_guard(twin)
    assert "tray" in home_again(twin)


# ---- relay and wire ---------------------------------------------------------------------------------------------


def test_the_relay_stops_the_arm_although_the_input_reads_closed() -> None:
    """The coil stays on, but has no power: the time limit of the step reports it."""
    twin = lifting()
    twin.plant.faults.add(parse_fault("stuck_off:guard"))
    before = positions(twin)["left lift"]
    open_guard(twin, 2_000)
    assert "left.lift_retract" in twin.outputs()
    assert abs(positions(twin)["left lift"] - before) <= stopping_distances()["left lift"]
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    assert "left: lift from row" in twin.alarms()


@pytest.mark.parametrize("fault", ["stuck_on:guard", "broken_wire:guard"])
def test_a_failed_wire_reads_as_an_open_guard(fault: str) -> None:
    twin = lifting()
    twin.plant.faults.add(parse_fault(fault))
    twin.run_for(100)
    assert (twin.state, twin.alarms()) == (State.HELD, ["guard_open"])
    twin.press("start")
    twin.run_for(100)
    assert refusals(twin)[-1] == ("reset", Refusal.GUARD_OPEN)
    twin.plant.faults.clear(fault)
    twin.run_for(LATER_MS)
    assert (twin.state, moving_outputs(twin)) == (State.HELD, set())
    home_again(twin)


def test_without_the_input_the_program_is_the_delivered_one() -> None:
    """The guard of the plant then has no effect on the program; its relay takes the coil power."""
    twin = switched_on({"trays_target": 1}, parameters=BRISK)
    tags = twin.machine.tags
    assert not {tags.machine.guard_open, tags.machine.guard_stops} & {*twin.machine.program.devices()}
