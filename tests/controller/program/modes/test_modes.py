"""Operating modes: conditions for a mode change, zero return, and end of the work in each mode."""

from __future__ import annotations

import pytest

from controller.events.kinds import ModeEvent, RefusalEvent
from controller.program.states import MODE_CHANGES, Mode, State
from controller.program.tags import SIDES
from controller.program.texts.operator import MODES
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again, press_emergency_stop
from tests.controller.program.modes.hands import change_mode, stop
from tests.plant_sim.twin.routes import run_row_1
from tests.plant_sim.twin.twin_rig import (
    at_initial_state,
    at_work,
    go_on,
    switched_on,
    to_complete,
    undisturbed,
    until_picking,
)

PACKML = {
    "CLEARING": 1,
    "STOPPED": 2,
    "STARTING": 3,
    "IDLE": 4,
    "SUSPENDED": 5,
    "EXECUTE": 6,
    "STOPPING": 7,
    "ABORTING": 8,
    "ABORTED": 9,
    "HOLDING": 10,
    "HELD": 11,
    "UNHOLDING": 12,
    "SUSPENDING": 13,
    "UNSUSPENDING": 14,
    "RESETTING": 15,
    "COMPLETING": 16,
    "COMPLETE": 17,
}
PACKML_COMMANDS = {
    "reset": 1,
    "start": 2,
    "stop": 3,
    "hold": 4,
    "unhold": 5,
    "suspend": 6,
    "unsuspend": 7,
    "abort": 8,
    "clear": 9,
    "complete": 10,
}


def refusals(twin: Twin) -> list[str]:
    return [event.text.en for event in twin.events if isinstance(event, RefusalEvent)]


def mode_of(twin: Twin) -> Mode:
    return Mode(twin.plc.read(twin.machine.tags.machine.mode))


def test_states_and_commands_have_packml_numbers() -> None:
    assert {state.name: state.value for state in State} == PACKML
    commands = at_work_machine().machine.tags.commands
    assert {command.name: command.packml for command in commands if command.packml is not None} == PACKML_COMMANDS


def at_work_machine() -> Twin:
    return switched_on({"trays_target": 1})


# changes


def test_the_mode_cannot_change_in_execute() -> None:
    """In Execute a change to any other mode is refused, the reason is reported, and work continues unaffected."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    others = [mode for mode in Mode if mode is not Mode.CONTINUOUS]
    for mode in others:
        twin.command(f"mode_{mode.name.lower()}")
        twin.scan()
        assert mode_of(twin) is Mode.CONTINUOUS
    why = "cannot change the mode: the mode can be changed only in Stopped, Idle, Held or Complete"
    assert refusals(twin) == [why] * len(others)
    assert to_complete(twin) == undisturbed()


@pytest.mark.parametrize("mode", list(Mode))
def test_at_rest_the_mode_changes_and_is_reported(mode: Mode) -> None:
    """In Stopped any mode can be selected, and the name of the new mode is reported."""
    twin = switched_on(mode=Mode.ZERO_RETURN if mode is Mode.CONTINUOUS else Mode.CONTINUOUS)
    before = len(twin.events)
    twin.command(f"mode_{mode.name.lower()}")
    twin.run_for(50)
    assert mode_of(twin) is mode
    assert [event.text.en for event in twin.events[before:] if isinstance(event, ModeEvent)] == [MODES[mode].en]


def test_no_change_to_or_from_manual_in_idle() -> None:
    twin = at_work_machine()
    twin.home()
    twin.command("mode_manual")
    twin.scan()
    assert mode_of(twin) is Mode.CONTINUOUS
    assert refusals(twin) == [
        "cannot change the mode: manual mode can be entered or left only in Stopped, Held or Complete"
    ]
    change_mode(twin, Mode.STEP)
    assert State.IDLE in MODE_CHANGES


def test_the_mode_is_retained_over_a_power_loss() -> None:
    twin = switched_on(mode=Mode.ONE_CYCLE)
    twin.power_cycle()
    twin.scan()
    assert mode_of(twin) is Mode.ONE_CYCLE


def test_the_mode_is_retained_in_an_emergency_stop() -> None:
    twin = at_work_machine()
    press_emergency_stop(twin)
    twin.command("mode_manual")
    twin.run_for(50)
    assert mode_of(twin) is Mode.CONTINUOUS


# zero return


def test_zero_return_homes_and_never_starts_a_cycle() -> None:
    """In zero return mode X0 homes the machine; in Idle, X0 and start are refused with the reason and nothing moves."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.run_for(800)
    twin.command("abort")
    twin.run_for(500)
    twin.command("clear")
    twin.run_for(100)
    change_mode(twin, Mode.ZERO_RETURN)
    home_again(twin)
    assert at_initial_state(twin, "left")
    for press in (twin.press, twin.command):
        press("start")
        twin.run_for(2_000)
        assert (twin.state, twin.outputs()) == (State.IDLE, set())
        assert refusals(twin)[-1] == "cannot start: zero return mode is selected"
    change_mode(twin, Mode.CONTINUOUS)
    twin.start()
    assert to_complete(twin) == undisturbed()


def test_zero_return_does_not_resume_from_a_hold() -> None:
    """In Held, unhold is refused in zero return mode; in continuous mode it resumes work."""
    twin = at_work({"trays_target": 1})
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=30_000)
    change_mode(twin, Mode.ZERO_RETURN)
    twin.command("unhold")
    twin.run_for(100)
    assert twin.state is State.HELD
    assert refusals(twin) == ["cannot resume: zero return mode is selected"]
    change_mode(twin, Mode.CONTINUOUS)
    twin.command("unhold")
    assert to_complete(twin) == undisturbed()


# amount of work


def test_one_cycle_is_one_row_of_each_arm_every_time() -> None:
    """In one-cycle mode each start transplants at most one row per arm until the tray is empty; no seedling is lost."""
    twin = at_work_machine()
    run_row_1(twin, "left")
    stop(twin)
    change_mode(twin, Mode.ONE_CYCLE)
    left = twin.plant.counts().in_tray
    while left:
        go_on(twin)
        twin.run_until_state(State.COMPLETE, within_ms=60_000)
        taken = left - twin.plant.counts().in_tray
        assert taken in {12, 24}
        left -= taken
    assert twin.plant.counts() == undisturbed()


def test_continuous_work_stops_after_the_ordered_trays_and_can_be_restarted() -> None:
    """With a target of two, one of three trays is still full in Complete; a run with a target of one empties it."""
    twin = at_work({"trays_target": 2}, trays=3)
    to_complete(twin)
    assert twin.plant.counts().in_tray == 72
    assert all(at_initial_state(twin, side) for side in SIDES)
    twin.plc.write(twin.machine.tags.sp.trays_target, 1)
    go_on(twin)
    assert to_complete(twin) == undisturbed(trays=3)
