"""Simulated operator: repair with venting, waiting for pressure, correct answers, and failed recovery."""

from __future__ import annotations

import pytest

from controller.program.states import State
from controller.program.tags import IN_PROGRESS, SIDES, TAKEN
from plant_sim.faults import FaultError, parse_fault
from plant_sim.twin.lock_step import NotReachedError
from plant_sim.twin.recovery import (
    affected_cylinders,
    answer_truly,
    clear,
    home_again,
    operate_manually,
    press_emergency_stop,
    questions,
    repair,
    true_tray,
)
from tests.plant_sim.twin.twin_rig import arm_of, at_work, switched_on, tags_of, undisturbed, until_picking, until_step


@pytest.mark.parametrize(
    ("fault", "affected"),
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
def test_cylinders_affected_by_a_fault_are_vented(fault: str, affected: list[str]) -> None:
    twin = switched_on()
    names = {id(getattr(arm_of(twin, side), drive)): f"{side}.{drive}" for side in SIDES for drive in ("slide", "lift")}
    affected_names = [names[id(device)] for device in affected_cylinders(twin, parse_fault(fault))]
    assert affected_names == affected


def test_a_jam_repaired_under_pressure_does_not_jump() -> None:
    """A slide that was pressurised against a jam for its full time limit does not move when the jam is cleared."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 2)
    until_step(twin, "left arm", "slide to feed")
    twin.run_for(300)
    jam = parse_fault("jammed:left.slide")
    twin.plant.faults.add(jam)
    twin.run_until_state(State.HELD, within_ms=20_000)
    position_m = arm_of(twin, "left").slide.x_m
    repair(twin, jam)
    assert twin.plant.faults.active == []
    twin.run_for(2_000)
    assert arm_of(twin, "left").slide.x_m == pytest.approx(position_m, abs=0.002)


def test_the_operator_waits_for_the_pressure() -> None:
    """If the regulator pressure was too low, recovery continues only after the pressure is restored."""
    twin = at_work({"trays_target": 1})
    low = parse_fault("low_supply:supply=0.1MPa")
    twin.plant.faults.add(low)
    twin.run_until_state(State.HELD, within_ms=60_000)
    assert twin.plant.supply.pressure_pa < 0.2e6
    repair(twin, low)
    assert twin.plant.supply.pressure_pa >= 0.95 * twin.parameters.supply.pressure_pa


def test_repairing_a_missing_fault_is_an_error() -> None:
    with pytest.raises(FaultError, match=r"^jammed:left.slide: neither active nor scheduled; current faults: none$"):
        repair(switched_on(), parse_fault("jammed:left.slide"))


@pytest.mark.parametrize("opened", [False, True])
def test_the_loaded_question_is_answered_from_the_claws(opened: bool) -> None:
    """After a power loss with closing claws, the answer is correct and no seedling is lost.

    This includes claws that are opened manually before the answer. The question of the tray comes later, in homing.
    """
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "close claws")
    twin.run_for(190)
    twin.power_cycle()
    twin.scan()
    if opened:
        operate_manually(twin, "left.claws_open", for_ms=500)
    assert bool(arm_of(twin, "left").grip.held) == (not opened)
    assert questions(twin) == answer_truly(twin) == {"left loaded"}
    assert questions(twin) == set()
    assert twin.plc.read(tags_of(twin, "left").rows[1]) == (IN_PROGRESS if opened else TAKEN)
    assert home_again(twin) == {"tray"}
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
    assert twin.plant.counts() == undisturbed()


def test_the_tray_question_is_answered_from_the_tray() -> None:
    """The answer is 'none' without a tray, 'full' for a full tray, and 'same' after a row has been taken."""
    twin = switched_on({"trays_target": 1})
    assert true_tray(twin) == "none"
    twin.home()
    assert true_tray(twin) == "full"
    twin.start()
    until_picking(twin, "left", 2)
    assert true_tray(twin) == "same"


def test_only_a_tray_that_has_overrun_its_mark_is_moved_back() -> None:
    """A tray 6.6 mm past its mark is misplaced and is moved behind the beam; one that is leaving stays where it is."""
    twin = switched_on({"trays_target": 1})
    twin.home()
    conveyor = twin.plant.conveyor
    operate_manually(twin, "tray_run", "tray_forward", for_ms=50)
    twin.run_for(100)
    assert conveyor.placed_tray == 0
    assert true_tray(twin) == "none"
    twin.plc.write(twin.machine.tags.tray.ask, True)
    answer_truly(twin)
    assert conveyor.front_m[0] < 0
    operate_manually(twin, "tray_run", "tray_forward", for_ms=1_000)
    twin.run_for(300)
    leaving_m = conveyor.front_m[0]
    assert leaving_m > 0.1
    twin.plc.write(twin.machine.tags.tray.ask, True)
    answer_truly(twin)
    assert conveyor.front_m[0] == leaving_m


def test_homing_continues_after_its_question_is_answered() -> None:
    """After a power loss as the tray stops, homing holds for the tray question and then ends in Idle."""
    twin = switched_on({"trays_target": 1})
    twin.press("start")
    until_step(twin, "tray feeder", "settle")
    twin.power_cycle()
    assert home_again(twin) == {"tray"}
    assert twin.state is State.IDLE


def test_homing_after_a_power_cycle_confirms_machine_constants_that_differ() -> None:
    """The program refuses X0 until X25 has been pressed and released; the tray may have been moved without power."""
    twin = switched_on({"clamp": 21})
    twin.home()
    twin.power_cycle()
    assert home_again(twin) == {"tray"}
    assert twin.state is State.IDLE


def test_a_machine_with_a_remaining_fault_is_not_homed() -> None:
    """With a lift still jammed, homing ends in an alarm, and recovery fails with a message that describes the state."""
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
