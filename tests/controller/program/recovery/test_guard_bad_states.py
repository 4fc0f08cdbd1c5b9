"""Guard from bad states: open at power-up, opened in homing with a load or in the warning, bouncing, commands.

In every scenario a monitor checks that no coil is on in a scan that reads the guard as open.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.program.operator.next_press import NextPress
from controller.program.operator.refusals import Refusal
from controller.program.operator.start_warning import WARNING_MS
from controller.program.states import Mode, Reason, State
from plant_sim.faults import parse_fault
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import begin_homing, clear, home_again, press_emergency_stop, questions
from tests.controller.program.modes.hands import jog_command
from tests.controller.program.recovery.test_emergency_stop import holds
from tests.controller.program.recovery.test_guard import (
    close_guard,
    lifting,
    machine,
    open_guard,
    read,
    refusals,
    to_complete,
    to_held,
    to_idle,
    to_suspended,
)
from tests.controller.program.recovery.test_ways_out import hold, power_lost_clamping
from tests.plant_sim.twin.routes import BRISK, run_row_1, run_to
from tests.plant_sim.twin.twin_rig import TRAY_MS, moving_outputs, switched_on, until_step
from tests.sampling import first_of
from tests.wiring import wired

BOUNCES_MS = (20, 40, 90)
"""Times for which a bouncing contact is open, and then closed, ms: from one that the input filter hides to several
scans."""


def bounce(twin: Twin, each_ms: int, count: int = 8) -> None:
    """Open and close the guard in turn; it ends closed."""
    for _ in range(count):
        for is_open in (True, False):
            twin.plant.box.guard = is_open
            twin.run_for(each_ms)


def rests(twin: Twin, for_ms: int = 3_000) -> None:
    """Check that nothing switches on and the state remains."""
    state = twin.state
    for _ in range(for_ms // 10):
        twin.run_for(10)
        assert moving_outputs(twin) == set()
    assert twin.state is state


# ---- power-up ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", first_of(["lift from row", "slide to feed", "approach row", "close claws"]))
def test_a_guard_that_is_open_at_power_up_lets_nothing_move_until_a_fresh_press(step: str) -> None:
    """The power fails in mid-cycle; X0 is held from before the power returns until after the guard has closed."""
    twin = machine()
    run_to(step)(twin, "left")
    twin.run_for(200)
    held = holds(twin)
    twin.plant.box.guard = True
    twin.plant.box.start = True
    twin.power_cycle()
    twin.scan()
    rests(twin, 1_500)
    assert twin.state is State.STOPPED
    assert read(twin, "next_press") == NextPress.CLOSE_GUARD
    close_guard(twin)
    twin.plant.box.start = False
    rests(twin)
    assert twin.state is State.STOPPED
    assert holds(twin) == held
    home_again(twin)
    twin.start()


def test_a_new_machine_is_homed_only_after_its_guard_has_closed() -> None:
    twin = machine()
    twin.plant.box.guard = True
    twin.power_cycle()
    for button in ("start", "stop", "start"):
        twin.press(button)
        twin.run_for(500)
        assert moving_outputs(twin) == set()
    assert twin.state is State.STOPPED
    close_guard(twin)
    home_again(twin)


def test_a_guard_opened_and_closed_while_the_power_is_off_is_no_order() -> None:
    """The program has not seen it; the place of the tray is unknown after every power-up."""
    twin = lifting()
    twin.plant.box.guard = True
    twin.power_cycle()
    twin.plant.box.guard = False
    twin.scan()
    rests(twin)
    assert not twin.plc.read(twin.machine.tags.tray.place_known)
    home_again(twin)


# ---- homing with a load, start warning ----------------------------------------------------------------------------


@pytest.mark.parametrize("after_ms", first_of([100, 600, 1_200, 2_000]))
def test_a_guard_opened_in_homing_drops_no_load(after_ms: int) -> None:
    """Twice in the same homing: the claws keep the row, and a third order brings it to the feed."""
    twin = machine()
    run_to("slide to feed")(twin, "left")
    twin.run_for(300)
    press_emergency_stop(twin)
    clear(twin)
    carried = holds(twin)["left"]
    assert carried
    for _ in range(2):
        begin_homing(twin)
        twin.run_for(after_ms)
        open_guard(twin)
        assert twin.state is State.HELD
        assert read(twin, "reason") == Reason.GUARD_OPEN
        close_guard(twin)
        assert holds(twin)["left"] == carried
    home_again(twin)
    assert holds(twin)["left"] == carried
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=2 * TRAY_MS)
    assert twin.plant.counts().in_cups == twin.plant.counts().total


def with_horn(order: Callable[[Twin], None]) -> Twin:
    """Return a machine with guard and horn, 1 s into the warning of an order."""
    twin = switched_on({"trays_target": 1}, parameters=BRISK, io_map=wired("guard", "horn"))
    order(twin)
    twin.run_until(twin.machine.tags.machine.warning, within_ms=2_000, what="warning")
    twin.run_for(1_000)
    return twin


@pytest.mark.parametrize("each_ms", first_of(BOUNCES_MS[1:], 0))
def test_a_guard_that_bounces_in_the_warning_cancels_the_order(each_ms: int) -> None:
    """Also while X0 is still held, whose press began before the warning."""
    twin = with_horn(lambda each: setattr(each.plant.box, "start", True))
    bounce(twin, each_ms, 3)
    rests(twin, WARNING_MS + 1_000)
    twin.plant.box.start = False
    rests(twin)
    home_again(twin)


# ---- bouncing -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("each_ms", first_of(BOUNCES_MS))
@pytest.mark.parametrize("step", first_of(["lift from row", "slide to feed"]))
def test_after_the_first_opening_of_a_bouncing_guard_no_coil_comes_back(step: str, each_ms: int) -> None:
    """The first level that the input shows ends the motion; the later ones are no order."""
    twin = machine()
    run_to(step)(twin, "left")
    twin.run_for(100)
    twin.plant.box.guard = True
    twin.run_until(twin.machine.tags.machine.guard_open, within_ms=50, what="guard seen")
    state = twin.state
    assert state is State.HELD
    for _ in range(8):
        for is_open in (False, True):
            twin.plant.box.guard = is_open
            rests(twin, each_ms)
    close_guard(twin)
    home_again(twin)


def test_x0_pressed_between_two_bounces_is_cancelled_by_the_next_one() -> None:
    twin = lifting()
    open_guard(twin)
    twin.plant.box.guard = False
    twin.run_for(100)
    twin.press("start", for_ms=60)
    twin.run_until_state(State.RESETTING, within_ms=200)
    twin.run_for(300)
    bounce(twin, 40, 2)
    assert twin.state is State.HELD
    rests(twin)
    home_again(twin)


# ---- commands while it is open ------------------------------------------------------------------------------------


def to_held_with_a_load(twin: Twin) -> None:
    run_to("slide to feed")(twin, "left")
    twin.command("hold")
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    if not holds(twin)["left"]:
        raise AssertionError("the left arm holds nothing")


RESTING: dict[str, Callable[[Twin], None]] = {
    "Held with a load": to_held_with_a_load,
    "Idle": to_idle,
    "Complete": to_complete,
    "Suspended": to_suspended,
    "Aborted": press_emergency_stop,
}


@pytest.mark.parametrize("name", first_of(RESTING))
def test_no_command_that_is_given_with_the_guard_open_acts_when_it_closes(name: str) -> None:
    """Each command of the table from the same instant; a forgotten *discard* would drop the load of the left arm."""
    twin = machine()
    RESTING[name](twin)
    open_guard(twin, 200)
    instant, held = twin.snapshot(), holds(twin)
    for command in twin.machine.tags.commands:
        twin.restore(instant)
        twin.command(command.name)
        twin.run_for(50)
        assert moving_outputs(twin) == set(), command.name
        twin.plant.box.guard = False
        rests(twin, 500)
        assert holds(twin) == held, command.name


def test_an_answer_by_button_with_the_guard_open_is_asked_again() -> None:
    twin = machine()
    to_held(twin)
    open_guard(twin)
    close_guard(twin)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    twin.run_for(50)
    assert questions(twin) == {"tray"}
    open_guard(twin, 200)
    twin.press("start", for_ms=2_500)
    twin.run_for(3_000)
    close_guard(twin)
    assert not twin.plc.read(twin.machine.tags.tray.place_known)
    assert "tray" in home_again(twin)


@pytest.mark.parametrize("open_ms", first_of([1_000, 100, 2_400]))
@pytest.mark.parametrize("button", ["start", "stop"])
def test_a_press_during_which_the_guard_was_open_answers_nothing(button: str, open_ms: int) -> None:
    """It begins behind the open guard, or the guard opens during it; a press after that answers."""
    twin = power_lost_clamping("left", wired("guard"))
    box, instant = twin.plant.box, twin.snapshot()
    for before_ms in (0, 500):
        twin.restore(instant)
        box.guard = not before_ms
        twin.run_for(200)
        setattr(box, button, True)
        twin.run_for(before_ms)
        open_guard(twin, open_ms)
        box.guard = False
        twin.run_for(2_500)
        setattr(box, button, False)
        twin.run_for(200)
        assert questions(twin) == {"left loaded"}, before_ms
        hold(twin, button)
        assert questions(twin) == set(), before_ms


def test_a_press_that_is_released_behind_the_open_guard_is_refused() -> None:
    """The line says to close the guard, and the press of X0 is reported as refused for it."""
    twin = power_lost_clamping("left", wired("guard"))
    open_guard(twin, 200)
    hold(twin, "start")
    assert refusals(twin) == [("reset", Refusal.GUARD_OPEN)]
    assert read(twin, "next_press") == NextPress.CLOSE_GUARD


def test_a_jam_that_is_freed_behind_the_open_guard_moves_nothing_when_it_closes() -> None:
    twin = machine()
    run_row_1(twin, "left")
    until_step(twin, "left arm", "slide to feed")
    twin.plant.faults.add(parse_fault("jammed:left.slide"))
    twin.run_until_state(State.HELD, within_ms=TRAY_MS)
    open_guard(twin)
    twin.plant.faults.clear("jammed:left.slide")
    twin.run_for(500)
    close_guard(twin)
    home_again(twin)


def test_a_jog_given_with_the_guard_open_is_lost() -> None:
    twin = machine(mode=Mode.MANUAL)
    twin.home()
    twin.start()
    open_guard(twin, 200)
    for _ in range(4):
        twin.command(jog_command("left.lift_retract"))
        twin.run_for(50)
    close_guard(twin)
    assert twin.state is State.HELD


# ---- an input that does not open ----------------------------------------------------------------------------------


@pytest.mark.nightly
def test_with_the_input_stuck_closed_a_long_opening_ends_in_held_and_a_short_one_goes_on() -> None:
    """The known limit: the relay gives back the power that it has cut, unless it restarts by hand only (safety.md)."""
    for open_ms, ends in ((1_000, State.EXECUTE), (15_000, State.HELD)):
        twin = lifting()
        twin.plant.faults.add(parse_fault("stuck_off:guard"))
        lift_m = twin.plant.arms["left"].lift.position_m
        open_guard(twin, 300)
        rest_m = twin.plant.arms["left"].lift.position_m
        twin.run_for(open_ms - 300)
        assert twin.plant.arms["left"].lift.position_m == pytest.approx(rest_m, abs=1e-3), lift_m
        twin.plant.box.guard = False
        twin.run_for(500)
        assert twin.state is ends
        if ends is State.HELD:
            rests(twin)
