"""Hold, suspend, complete and abort: the reported reason, and resuming with the rows that the arms hold."""

from __future__ import annotations

import pytest

from controller.events.kinds import RefusalEvent, StateEvent
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again
from tests.controller.program.modes.hands import stop
from tests.plant_sim.twin.twin_rig import (
    TRAY_MS,
    ChangeRecorder,
    arm_of,
    at_work,
    go_on,
    switched_on,
    to_complete,
    undisturbed,
    until_picking,
    until_step,
)
from tests.sampling import one_in

STEPS = ("approach row", "close claws", "slide to feed", "spread", "wait for cups", "converge")
PANEL_LIMIT_MS = 500


def state_reasons(twin: Twin) -> list[tuple[str, str]]:
    """Return every state that was entered, with its reason."""
    return [(State(event.state).name, event.reason.en) for event in twin.events if isinstance(event, StateEvent)]


def in_row_1(side: Side, step: str) -> Twin:
    """Return a machine whose arm on this side has just entered this step of its first row."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, side, 1)
    if step != "approach row":
        until_step(twin, f"{side} arm", step)
    return twin


def hold(twin: Twin) -> None:
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=30_000)


# hold


@pytest.mark.parametrize("step", one_in(2, STEPS))
def test_after_a_hold_in_any_step_work_resumes_with_the_held_rows(step: str) -> None:
    """After a hold the arms rest at feed and the reason is reported; unhold resumes work without homing or losses."""
    twin = in_row_1("left", step)
    hold(twin)
    assert state_reasons(twin)[-2:] == [("HOLDING", "held by the operator"), ("HELD", "held by the operator")]
    assert all(arm_of(twin, side).sensors["slide_at_feed"].read() for side in SIDES)
    held = twin.plant.counts().in_claw
    twin.run_for(20_000)
    assert (twin.state, twin.outputs(), twin.plant.counts().in_claw) == (State.HELD, set(), held)
    twin.command("unhold")
    twin.run_until_state(State.EXECUTE, within_ms=50)
    assert to_complete(twin) == undisturbed()
    assert "RESETTING" not in {state for state, _ in state_reasons(twin)[4:]}
    assert twin.alarm_events() == []


@pytest.mark.parametrize("side", SIDES)
def test_a_hold_by_an_alarm_has_another_reason_and_cannot_be_resumed(side: Side) -> None:
    """If a lift jams, the reason for Held is the alarm; unhold is refused until the reset, which homes the machine."""
    twin = in_row_1(side, "lift from row")
    arm_of(twin, side).lift.jammed = True
    twin.run_until_state(State.HELD, within_ms=30_000)
    assert state_reasons(twin)[-1] == ("HELD", "alarm")
    twin.command("unhold")
    twin.scan()
    assert twin.state is State.HELD
    assert refusals(twin) == ["cannot resume: an alarm is active"]
    arm_of(twin, side).lift.place(arm_of(twin, side).lift.position_m)
    arm_of(twin, side).lift.jammed = False
    home_again(twin)
    twin.start()
    assert to_complete(twin) == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_unhold_is_refused_while_an_arm_is_not_ready(side: Side) -> None:
    """In Held, unhold is refused while the upper switch of a loaded arm is off, and the reason is reported."""
    twin = in_row_1(side, "slide to feed")
    hold(twin)
    switch = arm_of(twin, side).sensors["lift_up"]
    switch.stuck = False
    twin.run_for(100)
    twin.command("unhold")
    twin.run_for(100)
    assert twin.state is State.HELD
    assert refusals(twin) == [f"cannot resume: {side} lift not up while loaded"]
    switch.stuck = None
    twin.run_for(100)
    twin.command("unhold")
    assert to_complete(twin) == undisturbed()


def refusals(twin: Twin) -> list[str]:
    return [event.text.en for event in twin.events if isinstance(event, RefusalEvent)]


def test_x0_after_a_hold_command_homes_and_resumes() -> None:
    """After a hold by command, pressing X0 twice also resumes work with the held rows."""
    twin = in_row_1("left", "slide to feed")
    hold(twin)
    go_on(twin)
    assert to_complete(twin) == undisturbed()


# suspend


@pytest.mark.parametrize("step", ["approach row", "wait for cups"])
def test_no_row_is_started_while_suspended_by_command(step: str) -> None:
    """After a suspend command, held rows are released over the cups and no row is started; unsuspend resumes work."""
    twin = in_row_1("left", step)
    twin.command("suspend")
    twin.run_until_state(State.SUSPENDED, within_ms=50)
    assert state_reasons(twin)[-1] == ("SUSPENDED", "suspended by the operator")
    recorder = ChangeRecorder.of_steps(twin)
    twin.run_for(40_000)
    assert twin.state is State.SUSPENDED
    assert twin.plant.counts().in_claw == 0
    assert not any(change.on and "approach row" in change.name for change in recorder.changes)
    twin.command("unsuspend")
    twin.run_until_state(State.EXECUTE, within_ms=50)
    assert to_complete(twin) == undisturbed()
    assert refusals(twin) == []


def test_a_suspension_without_cups_is_not_ended_by_command() -> None:
    """While the cups are at rest, the reported reason for Suspended is "no cups", and unsuspend is refused."""
    twin = in_row_1("left", "wait for cups")
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_until_state(State.SUSPENDED, within_ms=20_000)
    assert state_reasons(twin)[-1][1].startswith("no cups")
    twin.command("unsuspend")
    twin.run_for(50)
    assert twin.state is State.SUSPENDED
    assert refusals(twin) == ["cannot unsuspend: the machine was not suspended by the operator"]


# complete, abort


@pytest.mark.parametrize(("side", "after_ms"), [("left", 0), ("right", 10)])
def test_complete_releases_the_held_rows_and_starts_no_row(side: Side, after_ms: int) -> None:
    """If complete is commanded during an approach, the row is transplanted before Complete; no other row is started."""
    twin = in_row_1(side, "approach row")
    twin.run_for(after_ms)
    twin.command("complete")
    twin.run_until_state(State.COMPLETE, within_ms=40_000)
    counts = twin.plant.counts()
    assert counts.in_claw == 0
    assert 12 <= 72 - counts.in_tray <= 24
    go_on(twin)
    assert to_complete(twin) == undisturbed()


def test_complete_as_both_arms_leave_feed_transplants_both_rows() -> None:
    """If complete is commanded just after both arms leave feed, both rows are transplanted before Complete."""
    twin = switched_on({"trays_target": 1})
    twin.home()
    stop(twin)
    for side in SIDES:
        twin.command(f"{side}_discard")
    twin.home()
    twin.start()
    assert all(twin.in_step(f"{side} arm", "approach row") for side in SIDES)
    twin.command("complete")
    twin.run_until_state(State.COMPLETE, within_ms=60_000)
    counts = twin.plant.counts()
    assert (counts.in_claw, counts.in_tray) == (0, 48)


@pytest.mark.parametrize("step", ["lift from row", "lower over cups"])
def test_abort_switches_every_coil_off_in_its_scan_and_clear_ends_it(step: str) -> None:
    """Abort leads to Aborted without an emergency stop; clear, home and start resume work without losses."""
    twin = in_row_1("right", step)
    twin.run_for(100)
    twin.command("abort")
    twin.scan()
    assert twin.outputs() == set()
    twin.run_until_state(State.ABORTED, within_ms=20)
    twin.run_for(2_000)
    twin.command("clear")
    twin.run_until_state(State.STOPPED, within_ms=30)
    home_again(twin)
    twin.start()
    assert to_complete(twin) == undisturbed()


# the panel


def fall_silent(twin: Twin) -> None:
    """Start the panel supervision with a single request and a short time limit."""
    twin.runtime.panel.limit_ms = PANEL_LIMIT_MS
    twin.runtime.panel.heartbeat()
    twin.scan()


@pytest.mark.parametrize("side", SIDES)
def test_a_panel_timeout_finishes_the_cycle_and_holds(side: Side) -> None:
    """After a panel timeout the row is brought to feed and the reason is reported; pressing X0 twice resumes work."""
    twin = in_row_1(side, "lift from row")
    fall_silent(twin)
    twin.run_for(PANEL_LIMIT_MS - 20)
    assert twin.state is State.EXECUTE
    twin.run_until_state(State.HOLDING, within_ms=40)
    twin.run_until_state(State.HELD, within_ms=30_000)
    assert state_reasons(twin)[-1] == ("HELD", "operator panel not responding")
    assert twin.alarms() == ["hmi_silent"]
    assert arm_of(twin, side).sensors["slide_at_feed"].read()
    assert arm_of(twin, side).grip.held
    go_on(twin)
    assert twin.alarms() == ["hmi_silent"], "reset only when the panel responds again"
    assert to_complete(twin) == undisturbed()
    twin.runtime.panel.heartbeat()
    twin.run_for(20)
    assert twin.alarms() == []


def test_a_panel_timeout_does_not_hold_a_machine_at_rest() -> None:
    """In Idle a panel timeout raises only the warning."""
    twin = switched_on({"trays_target": 1})
    twin.home()
    fall_silent(twin)
    twin.run_for(2 * PANEL_LIMIT_MS)
    assert (twin.state, twin.alarms()) == (State.IDLE, ["hmi_silent"])


def test_complete_while_no_tray_comes_ends_the_work() -> None:
    """In Suspended without a tray, complete leads to Complete without another tray or command."""
    twin = at_work({"trays_target": 2}, trays=1)
    twin.run_until_state(State.SUSPENDED, within_ms=2 * TRAY_MS)
    assert twin.in_step("tray feeder", "no tray")
    twin.command("complete")
    twin.run_until_state(State.COMPLETE, within_ms=1_000)
    assert twin.plant.counts() == undisturbed()
    assert twin.alarm_events() == []
