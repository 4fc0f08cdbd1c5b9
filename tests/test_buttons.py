"""The operator without an HMI: X0, X24 and X25, and what they must never do."""

from __future__ import annotations

import pytest

from controller.program.states import State
from plant_sim.bench.twin import SCAN_MS, Twin


def test_a_start_button_held_while_the_power_comes_moves_nothing() -> None:
    """Given X0 pressed (or stuck) at power-up, nothing happens until it is let go and pressed again."""
    twin = Twin()
    twin.plant.box.start = True
    seen: set[str] = set()
    twin.watch(lambda t: seen.update(t.outputs()))
    twin.run_for(3_000)
    assert twin.state.name == "STOPPED"
    assert seen == set()
    twin.plant.box.start = False
    twin.run_for(100)
    twin.press("start")
    twin.run_until_state(State.RESETTING, within_ms=50)


def test_stop_wins_over_start() -> None:
    """Given X24 held, neither homing nor starting is accepted; let go, both are."""
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
    """Given the normally closed contacts, a terminal without voltage in Idle stops or aborts the machine."""
    twin = Twin()
    twin.home()
    terminal = twin.io_map[tag].number
    levels = twin.module.inputs()
    levels[terminal] = False
    twin.plc.scan(twin.now_ms, levels)
    twin.plc.scan(twin.now_ms + SCAN_MS, levels)
    wanted = State.STOPPING if tag == "stop" else State.ABORTING
    assert twin.state == wanted


def test_emergency_stop_is_cleared_by_holding_stop_for_three_seconds() -> None:
    """Given Aborted with X25 released, X24 held 3 s clears, not sooner; the machine then is Stopped and still."""
    twin = Twin()
    twin.home()
    twin.start()
    twin.run_for(2_000)
    twin.plant.box.emergency_stop = True
    twin.run_until_state(State.ABORTED, within_ms=50)
    twin.press("stop", for_ms=4_000)
    twin.run_for(4_500)
    assert twin.state.name == "ABORTED", "cleared while X25 was still pressed"
    twin.plant.box.emergency_stop = False
    twin.run_for(1_000)
    assert twin.state.name == "ABORTED", "cleared by itself"
    twin.plant.box.stop = True
    # the timer counts a free-running 100 ms base: it may close one base early, plus filter and scan after it
    twin.run_for(2_890)
    assert twin.state.name == "ABORTED"
    took_ms = twin.run_until_state(State.STOPPED, within_ms=200)
    assert 2_900 <= 2_890 + took_ms <= 3_040
    twin.plant.box.stop = False
    moved: set[str] = set()
    twin.watch(lambda t: moved.update(t.outputs()))
    twin.run_for(2_000)
    assert twin.state.name == "STOPPED"
    assert moved == set()


def test_x0_has_one_meaning_in_each_state() -> None:
    """Given X0: Stopped homes, Idle starts, Execute ignores it, Aborted ignores it, Complete homes."""
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
