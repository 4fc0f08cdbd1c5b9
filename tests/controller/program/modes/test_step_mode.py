"""Step mode: one transfer of the selected sequence per press; the other sequences are at rest."""

from __future__ import annotations

import pytest

from controller.program.states import Mode, State
from controller.program.tags import SIDES, Side
from plant_sim.twin.lock_step import Twin
from tests.controller.program.modes.hands import change_mode, stop
from tests.plant_sim.twin.routes import run_row_1
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    ChangeRecorder,
    at_initial_state,
    switched_on,
    tags_of,
    to_complete,
    undisturbed,
)

PRESS_MS = 2_000
THROW = ["release delay", "open claws"]
"""Steps of the release. One press is enough for both, because the awaited cup is passing."""
CHOSEN = {"left arm": 1, "right arm": 2, "tray feeder": 3}


def stepping(side: Side = "left", *, trays: int = 1) -> Twin:
    """Return a machine in Execute in step mode with this arm selected; its row 1 has been released over the cups."""
    twin = switched_on({"trays_target": trays, "step_sequence": CHOSEN[f"{side} arm"]}, trays=trays)
    run_row_1(twin, side)
    stop(twin)
    change_mode(twin, Mode.STEP)
    twin.home()
    twin.start()
    twin.run_for(1_000)
    return twin


def press(twin: Twin) -> None:
    twin.command("step")
    twin.scan()


def step_to(twin: Twin, side: Side, title: str) -> list[str]:
    """Issue the step command every 0.5 s until this step of the arm is on; return all steps of the arm that were on."""
    recorder = ChangeRecorder.of_steps(twin)
    for _ in range(300):
        press(twin)
        twin.run_for(500)
        visited = [change.name for change in recorder.of(f"{side} arm: ") if change.on]
        if title in visited:
            return visited
    raise AssertionError(f"{title} not reached: {visited}")


@pytest.mark.parametrize("side", SIDES)
def test_one_transfer_per_press_and_the_others_are_at_rest(side: Side) -> None:
    """During a complete cycle, each press moves the selected arm by at most one step or releases its row."""
    twin = stepping(side)
    recorder = ChangeRecorder.of_steps(twin)
    visited = []
    for _ in range(40):
        before = len(recorder.changes)
        press(twin)
        twin.run_for(2_990)
        assert all(change.name.startswith(f"{side} arm: ") for change in recorder.changes[before:])
        came = [change.name.partition(": ")[2] for change in recorder.changes[before:] if change.on]
        assert len(came) <= 1 or came == THROW
        visited += came
        if visited[-1] == "wait at feed":
            break
    assert visited == [
        "approach row",
        "settle at row",
        "close claws",
        "lift from row",
        "slide to feed",
        "pause at feed",
        "spread",
        "wait to lower",
        "lower over cups",
        "wait for cups",
        "release delay",
        "open claws",
        "converge",
        "wait at feed",
    ]
    assert twin.alarm_events() == []
    assert at_initial_state(twin, side)
    assert twin.plant.counts().in_claw == 0


@pytest.mark.parametrize("side", SIDES)
def test_a_row_taken_in_step_mode_is_in_its_cups_and_automatic_mode_takes_the_rest(side: Side) -> None:
    """After a complete cycle in step mode, continuous mode transplants the remaining rows without losses."""
    twin = stepping(side)
    cycles = twin.plc.read(tags_of(twin, side).cycles)
    step_to(twin, side, "open claws")
    step_to(twin, side, "wait at feed")
    assert twin.plc.read(tags_of(twin, side).cycles) == cycles + 1
    stop(twin)
    change_mode(twin, Mode.CONTINUOUS)
    twin.home()
    twin.start()
    assert to_complete(twin) == undisturbed()


def test_without_a_press_nothing_moves() -> None:
    twin = stepping()
    recorder = ChangeRecorder.of_outputs(twin)
    twin.run_for(10_000)
    assert not recorder.changes
    assert twin.state is State.EXECUTE


def test_a_button_press_is_a_step_too() -> None:
    """In step mode, X0 moves the arm by one step and is not refused as a start command."""
    twin = stepping()
    events = len(twin.events)
    twin.press("start")
    twin.run_for(300)
    assert twin.in_step("left arm", "approach row")
    assert twin.events[events:] == []


@pytest.mark.parametrize(("late_ms", "goes"), [(PRESS_MS - 300, True), (PRESS_MS + 100, False)])
def test_a_press_waits_two_seconds_for_its_transfer_and_expires(late_ms: int, goes: bool) -> None:
    """The transfer occurs only if the cup arrives within two seconds of the press; one arrives every 3 s."""
    twin = stepping()
    step_to(twin, "left", "wait for cups")
    arm = tags_of(twin, "left")
    twin.run_until(arm.cup_counter.done, within_ms=30_000)
    twin.plant.planting_frequency_per_min = 20.0
    twin.run_for(15_000)
    twin.run_until(arm.cup, within_ms=4_000)
    twin.run_for(3_000 - late_ms)
    assert twin.in_step("left arm", "wait for cups")
    press(twin)
    assert twin.runs_until(twin.step_of("left arm", "open claws"), for_ms=late_ms + 1_500) == goes
    assert twin.in_step("left arm", "wait for cups") != goes


@pytest.mark.parametrize("step", ["approach row", "converge"])
def test_no_limit_expires_while_the_operator_waits(step: str) -> None:
    """No alarm is raised during ten seconds without a press after a motion, which is twice the longest limit."""
    twin = stepping()
    step_to(twin, "left", step)
    twin.run_for(10_000)
    assert twin.in_step("left arm", step)
    assert twin.alarms() == []


def test_a_motion_that_does_not_end_is_an_alarm_in_step_mode_too() -> None:
    twin = stepping()
    step_to(twin, "left", "close claws")
    twin.run_for(500)
    twin.plant.arms["left"].lift.jammed = True
    press(twin)
    twin.run_until(ALARM, within_ms=4_000, what="an alarm")
    assert twin.alarms() == ["left: lift from row"]


def test_the_tray_feeder_is_stepped_through_while_rows_are_held() -> None:
    """If work resumes in step mode after a hold with the last rows, step commands bring in the next tray."""
    twin = switched_on({"trays_target": 2, "step_sequence": CHOSEN["tray feeder"]}, trays=2)
    twin.home()
    twin.start()
    done = twin.machine.tags.machine.trays_done
    twin.run_until(done.equals(1), within_ms=120_000, what="the first tray empty")
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=20_000)
    change_mode(twin, Mode.STEP)
    twin.command("unhold")
    twin.run_for(5_000)
    recorder = ChangeRecorder.of_steps(twin)
    visited: list[str] = []
    for _ in range(12):
        before = len(recorder.changes)
        press(twin)
        twin.run_for(3_000)
        came = [change.name for change in recorder.changes[before:] if change.on]
        assert len(came) <= 1
        visited += [name.removeprefix("tray feeder: ") for name in came]
        if visited[-1:] == ["wait for an empty tray"]:
            break
    assert [title for title in visited if title != "creep"] == [
        "move tray out",
        "index",
        "settle",
        "wait for an empty tray",
    ]
    assert twin.plant.conveyor.placed_tray == 1
    stop(twin)
    change_mode(twin, Mode.CONTINUOUS)
    twin.home()
    twin.start()
    assert to_complete(twin) == undisturbed(trays=2)


def test_stop_in_step_mode_is_immediate() -> None:
    """X24 stops a motion without waiting for the end of the cycle; after homing, work resumes without losses."""
    twin = stepping()
    step_to(twin, "left", "slide to feed")
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=100)
    assert twin.outputs() == set()
    twin.run_for(500)
    change_mode(twin, Mode.CONTINUOUS)
    twin.home()
    twin.start()
    assert to_complete(twin) == undisturbed()


def test_step_mode_is_not_suspended_without_cups() -> None:
    """The machine stays in Execute while an arm waits for cups that are at rest."""
    twin = stepping()
    step_to(twin, "left", "wait for cups")
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_for(20_000)
    assert twin.state is State.EXECUTE


def test_homing_needs_no_presses() -> None:
    """In step mode, one command homes the machine."""
    twin = switched_on({"trays_target": 1}, mode=Mode.STEP)
    twin.home()
    assert twin.state is State.IDLE
