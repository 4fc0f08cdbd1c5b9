"""Operation without an HMI, using only X0, X24 and X25."""

from __future__ import annotations

import pytest

from controller.program.states import State
from plant_sim.twin.lock_step import SCAN_MS, Twin
from tests.plant_sim.twin.twin_rig import output_bits


def test_a_start_button_held_at_power_up_moves_nothing() -> None:
    """If X0 is pressed or stuck at power-up, nothing happens until it is released and pressed again."""
    twin = Twin()
    twin.plant.box.start = True
    seen = twin.outputs()
    twin.watch(lambda t: seen.update(t.outputs()), output_bits(twin))
    twin.run_for(3_000)
    assert twin.state.name == "STOPPED"
    assert seen == set()
    twin.plant.box.start = False
    twin.run_for(100)
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=50)


def test_stop_has_priority_over_start() -> None:
    """While X24 is held, pressing X0 has no effect; after X24 is released, X0 homes the machine.

    Pressing X24 in Idle leads to Stopped, where X0 is again ignored while X24 is held.
    """
    twin = Twin()
    twin.scan()
    twin.plant.box.stop = True
    twin.press("start")
    twin.run_for(500)
    assert twin.state.name == "STOPPED"
    twin.plant.box.stop = False
    twin.run_for(100)
    twin.home()
    twin.plant.box.stop = True
    twin.run_until_state(State.STOPPED, within_ms=100)
    twin.press("start")
    twin.run_for(500)
    assert twin.state.name == "STOPPED"


@pytest.mark.parametrize("tag", ["stop", "emergency_stop"])
def test_a_broken_wire_acts_like_the_pressed_button(tag: str) -> None:
    """In Idle, loss of voltage at the terminal of a normally closed contact stops or aborts the machine."""
    twin = Twin()
    twin.home()
    terminal = twin.io_map[tag].number
    levels = twin.module.inputs()
    levels[terminal] = False
    twin.plc.scan(twin.now_ms, levels)
    twin.plc.scan(twin.now_ms + SCAN_MS, levels)
    wanted = State.STOPPING if tag == "stop" else State.ABORTING
    assert twin.state == wanted


def test_emergency_stop_is_cleared_by_a_press_of_stop_of_three_seconds() -> None:
    """In Aborted with X25 released, X24 pressed for 3 s and released clears; the machine stays in Stopped."""
    twin = Twin()
    twin.home()
    twin.start()
    twin.run_for(2_000)
    twin.plant.box.emergency_stop = True
    twin.run_until_state(State.ABORTED, within_ms=50)
    twin.press("stop", for_ms=4_000)
    twin.run_for(4_500)
    assert twin.state.name == "ABORTED", "cleared with X25 still pressed"
    twin.plant.box.emergency_stop = False
    twin.run_for(1_000)
    assert twin.state.name == "ABORTED", "cleared by itself"
    # the timer counts a free-running 100 ms base and may elapse one tick early
    twin.press("stop", for_ms=2_890)
    twin.run_for(3_000)
    assert twin.state.name == "ABORTED", "cleared by a press that is too short"
    twin.press("stop", for_ms=3_040)
    twin.run_for(3_030)
    assert twin.state.name == "ABORTED", "cleared before the release"
    twin.run_until_state(State.STOPPED, within_ms=50)
    moved = twin.outputs()
    twin.watch(lambda t: moved.update(t.outputs()), output_bits(twin))
    twin.run_for(2_000)
    assert twin.state.name == "STOPPED"
    assert moved == set()


def test_x0_has_one_meaning_in_each_state() -> None:
    """X0 homes the machine in Stopped and Complete, starts it in Idle, and is ignored in Execute and Aborted."""
    twin = Twin(trays=1, set_points={"trays_target": 1})
    twin.home()
    twin.start()
    twin.run_for(500)
    twin.press("start")
    twin.run_for(1_000)
    assert twin.state.name == "EXECUTE"
    twin.run_until_state(State.COMPLETE, within_ms=100_000)
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=50)
    twin.plant.box.emergency_stop = True
    twin.run_until_state(State.ABORTED, within_ms=50)
    twin.plant.box.emergency_stop = False
    twin.run_for(200)
    twin.press("start")
    twin.run_for(1_000)
    assert twin.state.name == "ABORTED"
