"""The operator who mends a machine: what is let out and waited for, what is answered, and what gives up."""

from __future__ import annotations

import pytest
from twin_rig import arm_of, at_work, switched_on, tags_of, undisturbed, until_picking, until_step

from controller.program.states import State
from controller.program.tags import IN_PROGRESS, SIDES, TAKEN
from plant_sim.bench.recovery import (
    answer_truly,
    by_hand,
    clear,
    home_again,
    mend,
    press_emergency_stop,
    questions,
    struck_cylinders,
    true_tray,
)
from plant_sim.bench.twin import NotReachedError
from plant_sim.faults import FaultError, parse_fault


@pytest.mark.parametrize(
    ("fault", "struck"),
    [
        ("jammed:left.slide", ["left.slide"]),
        ("leak:right.lift.plus=2e-9", ["right.lift"]),
        ("stuck_valve:left.claws", []),
        ("stuck_on:left.lift_up", []),
        ("jammed:left.spreader", []),
        ("low_supply:supply=0.2MPa", ["left.slide", "right.slide", "left.lift", "right.lift"]),
        ("failing_supply:compressor=0", ["left.slide", "right.slide", "left.lift", "right.lift"]),
    ],
)
def test_the_air_is_let_out_of_what_the_fault_has_struck(fault: str, struck: list[str]) -> None:
    twin = switched_on()
    names = {id(getattr(arm_of(twin, side), drive)): f"{side}.{drive}" for side in SIDES for drive in ("slide", "lift")}
    found = [names[id(device)] for device in struck_cylinders(twin, parse_fault(fault))]
    assert found == struck


def test_a_jam_mended_under_pressure_does_not_leap() -> None:
    """Given a slide that has been pushed on for its whole limit, mended it stays where it is."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 2)
    until_step(twin, "left arm", "slide to feed")
    twin.run_for(300)
    jam = parse_fault("jammed:left.slide")
    twin.plant.faults.add(jam)
    twin.run_until_state(State.HELD, within_ms=20_000)
    stood_m = arm_of(twin, "left").slide.x_m
    mend(twin, jam)
    assert twin.plant.faults.active == []
    twin.run_for(2_000)
    assert arm_of(twin, "left").slide.x_m == pytest.approx(stood_m, abs=0.002)


def test_low_air_is_waited_for() -> None:
    """Given a regulator turned down, the operator goes on when the pressure is back, and not before."""
    twin = at_work({"trays_target": 1})
    low = parse_fault("low_supply:supply=0.1MPa")
    twin.plant.faults.add(low)
    twin.run_until_state(State.HELD, within_ms=60_000)
    assert twin.plant.supply.pressure_pa < 0.2e6
    mend(twin, low)
    assert twin.plant.supply.pressure_pa >= 0.95 * twin.parameters.supply.pressure_pa


def test_what_is_not_broken_cannot_be_mended() -> None:
    with pytest.raises(FaultError, match=r"^jammed:left.slide: is not broken; there is none$"):
        mend(switched_on(), parse_fault("jammed:left.slide"))


@pytest.mark.parametrize("opened", [False, True])
def test_the_answer_is_what_the_claws_hold(opened: bool) -> None:
    """Given a power loss with closed claws, opened by hand or not: the answer is true, and nothing is lost."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "close claws")
    twin.run_for(190)
    twin.power_cycle()
    twin.scan()
    if opened:
        by_hand(twin, "left.claws_open", for_ms=500)
    assert bool(arm_of(twin, "left").grip.held) == (not opened)
    assert questions(twin) == answer_truly(twin) == {"left loaded"}
    assert questions(twin) == set()
    assert twin.plc.read(tags_of(twin, "left").rows[1]) == (IN_PROGRESS if opened else TAKEN)
    assert home_again(twin) == set()
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
    assert twin.plant.counts() == undisturbed()


def test_the_tray_is_told_as_it_stands() -> None:
    """Given no tray, then a full one, then one with a row taken, the operator says so."""
    twin = switched_on({"trays_target": 1})
    assert true_tray(twin) == "none"
    twin.home()
    assert true_tray(twin) == "full"
    twin.start()
    until_picking(twin, "left", 2)
    assert true_tray(twin) == "same"


def test_a_question_that_homing_asks_is_answered_and_homing_goes_on() -> None:
    """Given a power loss as the tray comes to rest, homing is held to ask for the tray, and then ends in Idle."""
    twin = switched_on({"trays_target": 1})
    twin.press("start")
    until_step(twin, "tray feeder", "settle")
    twin.power_cycle()
    assert home_again(twin) == {"tray"}
    assert twin.state is State.IDLE


def test_a_machine_that_is_still_broken_is_not_homed() -> None:
    """Given a lift still dead, homing ends in its alarm and the operator gives up, naming where it stands."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 2)
    until_step(twin, "left arm", "lift from row")
    arm_of(twin, "left").lift.jammed = True
    twin.run_until_state(State.HELD, within_ms=20_000)
    with pytest.raises(NotReachedError, match=r"not end in Idle; at \d+ ms HELD, .*left: home"):
        home_again(twin)


def test_an_emergency_stop_is_cleared_by_holding_the_stop_button() -> None:
    twin = at_work({"trays_target": 1})
    press_emergency_stop(twin)
    assert twin.state.name == "ABORTED"
    clear(twin)
    assert twin.state.name == "STOPPED"
