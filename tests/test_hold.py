"""Hold and suspend, complete, abort: each with its reason, and the way on from it with what the arms hold."""

from __future__ import annotations

import pytest
from hands import stop
from twin_rig import (
    TRAY_MS,
    Recorder,
    arm_of,
    at_work,
    go_on,
    switched_on,
    to_complete,
    undisturbed,
    until_picking,
    until_step,
)

from controller.hmi.production import RefusalEvent, StateEvent
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.bench.recovery import home_again
from plant_sim.bench.twin import Twin

STEPS = ("approach row", "close claws", "slide to feed", "spread", "wait for cups", "converge")
PANEL_LIMIT_MS = 500


def told(twin: Twin) -> list[tuple[str, str]]:
    """Return every state that was entered, with its reason."""
    return [(State(event.state).name, event.reason) for event in twin.events if isinstance(event, StateEvent)]


def in_row_1(side: Side, step: str) -> Twin:
    """Return a machine whose arm has just come to a step of its first row, or of the second where it is over."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, side, 1)
    if step != "approach row":
        until_step(twin, f"{side} arm", step)
    return twin


def hold(twin: Twin) -> None:
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=30_000)


# hold


@pytest.mark.parametrize("step", STEPS)
def test_a_hold_ordered_in_any_step_goes_on_with_what_the_arms_hold(step: str) -> None:
    """Given hold, the arms rest at feed and the reason is told; unhold goes on without homing, and nothing is lost."""
    twin = in_row_1("left", step)
    hold(twin)
    assert told(twin)[-2:] == [("HOLDING", "held by the operator"), ("HELD", "held by the operator")]
    assert all(arm_of(twin, side).sensors["slide_at_feed"].read() for side in SIDES)
    held = twin.plant.counts().in_claw
    twin.run_for(20_000)
    assert (twin.state, twin.outputs(), twin.plant.counts().in_claw) == (State.HELD, set(), held)
    twin.command("unhold")
    twin.run_until_state(State.EXECUTE, within_ms=50)
    assert to_complete(twin) == undisturbed()
    assert "RESETTING" not in {state for state, _ in told(twin)[4:]}
    assert twin.alarm_events() == []


@pytest.mark.parametrize("side", SIDES)
def test_a_hold_after_an_alarm_has_another_reason_and_is_not_gone_on_from(side: Side) -> None:
    """Given a lift that jams, Held tells of the alarm; unhold is refused until it is reset, which homes."""
    twin = in_row_1(side, "lift from row")
    arm_of(twin, side).lift.jammed = True
    twin.run_until_state(State.HELD, within_ms=30_000)
    assert told(twin)[-1] == ("HELD", "alarm")
    twin.command("unhold")
    twin.scan()
    assert twin.state is State.HELD
    assert refusals(twin) == ["cannot go on: an alarm is set"]
    arm_of(twin, side).lift.place(arm_of(twin, side).lift.position_m)
    arm_of(twin, side).lift.jammed = False
    home_again(twin)
    twin.start()
    assert to_complete(twin) == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_unhold_is_refused_while_an_arm_is_not_ready(side: Side) -> None:
    """Given a loaded arm whose upper switch is off in Held, unhold is refused by name; with the switch back it goes."""
    twin = in_row_1(side, "slide to feed")
    hold(twin)
    switch = arm_of(twin, side).sensors["lift_up"]
    switch.stuck = False
    twin.run_for(100)
    twin.command("unhold")
    twin.run_for(100)
    assert twin.state is State.HELD
    assert refusals(twin) == [f"cannot go on: {side} lift not up with its load"]
    switch.stuck = None
    twin.run_for(100)
    twin.command("unhold")
    assert to_complete(twin) == undisturbed()


def refusals(twin: Twin) -> list[str]:
    return [event.text for event in twin.events if isinstance(event, RefusalEvent)]


def test_x0_after_an_ordered_hold_homes_and_goes_on() -> None:
    """Given Held by order with loads, X0, X0 is a way on, too."""
    twin = in_row_1("left", "slide to feed")
    hold(twin)
    go_on(twin)
    assert to_complete(twin) == undisturbed()


# suspend


@pytest.mark.parametrize("step", ["approach row", "wait for cups"])
def test_a_suspension_by_order_begins_no_row_and_goes_on_when_it_ends(step: str) -> None:
    """Given suspend, what is held is thrown, no row is begun; after unsuspend the work goes on by itself."""
    twin = in_row_1("left", step)
    twin.command("suspend")
    twin.run_until_state(State.SUSPENDED, within_ms=50)
    assert told(twin)[-1] == ("SUSPENDED", "suspended by the operator")
    recorder = Recorder.of_steps(twin)
    twin.run_for(40_000)
    assert twin.state is State.SUSPENDED
    assert twin.plant.counts().in_claw == 0
    assert not any(change.on and "approach row" in change.name for change in recorder.changes)
    twin.command("unsuspend")
    twin.run_until_state(State.EXECUTE, within_ms=50)
    assert to_complete(twin) == undisturbed()
    assert refusals(twin) == []


def test_suspended_for_want_of_cups_is_not_ended_by_order() -> None:
    """Given standing cups, the reason is theirs, and unsuspend is refused."""
    twin = in_row_1("left", "wait for cups")
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_until_state(State.SUSPENDED, within_ms=20_000)
    assert told(twin)[-1][1].startswith("no cups")
    twin.command("unsuspend")
    twin.run_for(50)
    assert twin.state is State.SUSPENDED
    assert refusals(twin) == ["cannot end the suspension: the machine was not suspended by the operator"]


# complete, abort


@pytest.mark.parametrize(("side", "after_ms"), [("left", 0), ("right", 10)])
def test_complete_throws_what_is_held_and_begins_no_row(side: Side, after_ms: int) -> None:
    """Given complete as an arm has set out, its row is thrown, then Complete; the rows that are left are there."""
    twin = in_row_1(side, "approach row")
    twin.run_for(after_ms)
    twin.command("complete")
    twin.run_until_state(State.COMPLETE, within_ms=40_000)
    counts = twin.plant.counts()
    assert counts.in_claw == 0
    assert 12 <= 72 - counts.in_tray <= 24
    go_on(twin)
    assert to_complete(twin) == undisturbed()


def test_complete_as_both_arms_set_out_throws_both_rows() -> None:
    """Given a press in the scan after both arms have left feed together, both rows are thrown, then Complete."""
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
def test_abort_takes_every_coil_off_in_its_scan_and_clear_leads_out(step: str) -> None:
    """Given abort, Aborted without an emergency stop; clear, home and start go on, and nothing is lost."""
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


def fall_silent(twin: Twin, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a panel that is watched speak once and never again."""
    monkeypatch.setattr(twin.runtime, "_panel_limit_ms", PANEL_LIMIT_MS)
    twin.runtime.heard()
    twin.scan()


@pytest.mark.parametrize("side", SIDES)
def test_a_panel_gone_silent_lets_the_cycle_end_and_holds(side: Side, monkeypatch: pytest.MonkeyPatch) -> None:
    """Given silence in the middle of a cycle: the load goes to feed, Held with its reason and a warning; X0, X0."""
    twin = in_row_1(side, "lift from row")
    fall_silent(twin, monkeypatch)
    twin.run_for(PANEL_LIMIT_MS - 20)
    assert twin.state is State.EXECUTE
    twin.run_until_state(State.HOLDING, within_ms=40)
    twin.run_until_state(State.HELD, within_ms=30_000)
    assert told(twin)[-1] == ("HELD", "operator panel silent")
    assert twin.alarms() == ["hmi_silent"]
    assert arm_of(twin, side).sensors["slide_at_feed"].read()
    assert arm_of(twin, side).grip.held
    go_on(twin)
    assert twin.alarms() == ["hmi_silent"], "it goes when the panel is back, and not before"
    assert to_complete(twin) == undisturbed()
    twin.runtime.heard()
    twin.run_for(20)
    assert twin.alarms() == []


def test_a_silent_panel_does_not_hold_a_machine_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Given silence in Idle, only the warning comes."""
    twin = switched_on({"trays_target": 1})
    twin.home()
    fall_silent(twin, monkeypatch)
    twin.run_for(2 * PANEL_LIMIT_MS)
    assert (twin.state, twin.alarms()) == (State.IDLE, ["hmi_silent"])


def test_complete_ordered_while_no_tray_comes_ends_the_work() -> None:
    """Given a machine Suspended for want of a tray, complete ends in Complete without another tray or press."""
    twin = at_work({"trays_target": 2}, trays=1)
    twin.run_until_state(State.SUSPENDED, within_ms=2 * TRAY_MS)
    assert twin.in_step("tray feeder", "no tray")
    twin.command("complete")
    twin.run_until_state(State.COMPLETE, within_ms=1_000)
    assert twin.plant.counts() == undisturbed()
    assert twin.alarm_events() == []
