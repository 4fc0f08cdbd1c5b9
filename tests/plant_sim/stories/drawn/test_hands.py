"""Actions of a random story: each has its effect on the twin, and an order of the operator counts as one."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from controller.program.states import Mode, State
from plant_sim.stories.drawn.action import parse_story
from plant_sim.stories.drawn.hands import Hands
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import press_emergency_stop, questions
from tests.plant_sim.stories.drawn.story_rig import played
from tests.sampling import one_in


def working(for_ms: int = 9_000) -> tuple[Twin, Hands]:
    """Return a twin that has worked for some time, and the hands of a story."""
    twin = Twin(trays=2)
    twin.home()
    twin.start()
    twin.run_for(for_ms)
    return twin, Hands(twin)


def do(hands: Hands, text: str) -> bool:
    """Carry out one action."""
    [action] = parse_story(f"seed=1 trays=1 work=0; 0 {text}").actions
    return hands.do(action)


def test_a_tray_is_pushed_by_the_stated_way_and_its_sensor_follows() -> None:
    twin, hands = working()
    press_emergency_stop(twin)
    front_m = twin.plant.conveyor.front_m[0]
    assert do(hands, "push =12.5")
    assert twin.plant.conveyor.front_m[0] == pytest.approx(front_m + 0.0125)
    assert do(hands, "push =-60.0")
    assert twin.plant.conveyor.front_m[0] < 0.0
    twin.run_for(100)
    assert not twin.runs_until(twin.machine.tags.tray.edge, for_ms=100)
    assert hands.ordered == []


def test_a_push_while_the_machine_works_is_an_order() -> None:
    twin, hands = working()
    assert do(hands, "push =1.0")
    assert len(hands.ordered) == 1
    assert twin.state is State.EXECUTE


def test_memory_is_kept_lost_or_old() -> None:
    for memory, lost, blind in (("kept", 0, 0), ("lost", 1, 0), ("old =0.0", 0, 1)):
        twin, hands = working(200)
        do(hands, "mend")  # an image of the memory is taken at each action
        twin.run_for(25_000)
        word = twin.machine.tags.arms["left"].cycles
        cycles = twin.plc.read(word)
        assert cycles > 0
        assert do(hands, f"power {memory} for=500")
        assert ("memory_lost" in twin.alarms()) == lost
        assert len(hands.blind) == blind
        assert twin.plc.read(word) == (cycles if memory == "kept" else 0)


def test_damaged_memory_is_set_aside_or_taken_for_true() -> None:
    results = set()
    for share in (0.0, 0.3, 0.5, 0.8, 1.0):
        twin, hands = working(2_000)
        assert do(hands, f"power damaged ={share} for=100")
        results.add("memory_lost" in twin.alarms())
        assert len(hands.blind) == 1
    assert results == {True, False}


def test_the_operator_tends_the_machine_from_an_emergency_stop_to_work() -> None:
    twin, hands = working()
    press_emergency_stop(twin)
    for _ in range(20):
        do(hands, "tend")
        twin.run_for(2_000)
    assert twin.state is State.EXECUTE
    assert hands.ordered == hands.acted == []


@pytest.mark.parametrize("command", one_in(2, ["suspend", "hold", "stop", "abort", "complete"]))
def test_the_operator_goes_on_after_a_command(command: str) -> None:
    story = played(f"seed=1 trays=2 work=9000; 100 command {command}")
    assert story.harms == []
    assert story.acted == {"command": 1}


def test_the_operator_leaves_manual_mode() -> None:
    twin, hands = working()
    twin.command("stop")
    twin.run_until_state(State.STOPPED, within_ms=40_000)
    twin.command("mode_manual")
    twin.run_for(100)
    for _ in range(20):
        do(hands, "tend")
        twin.run_for(2_000)
    assert twin.plc.read(twin.machine.tags.machine.mode) == Mode.CONTINUOUS
    assert twin.state is State.EXECUTE


def test_a_false_answer_is_an_order_and_a_true_one_is_none() -> None:
    for text, orders in (("answer_falsely for=1000", 1), ("tend", 0)):
        twin, hands = working(200)
        twin.run_until(twin.step_of("left arm", "close claws"), within_ms=20_000)
        twin.run_for(150)
        twin.power_cycle()
        twin.run_for(300)
        assert questions(twin) == {"left loaded"}
        assert do(hands, text)
        twin.run_for(300)
        assert questions(twin) == set()
        assert len(hands.ordered) == orders


def stopped() -> tuple[Twin, Hands]:
    """Return a twin that has been stopped."""
    twin, hands = working()
    twin.command("stop")
    twin.run_until_state(State.STOPPED, within_ms=40_000)
    return twin, hands


@pytest.mark.parametrize(
    ("text", "effect"),
    [
        ("override left.claws_close for=500", lambda twin: not twin.plant.left.claws.free),
        ("take_off", lambda twin: 0 not in twin.plant.conveyor.front_m),
        (
            "air =0.0",
            lambda twin: float(twin.plant.state[0]["arms"][0]["slide"]["plus"]["chamber"]["pressure_pa"]) < 2e5,
        ),
        ("speed =0.0", lambda twin: twin.plant.planting_frequency_per_min == 0.0),
        ("fault stuck_on:left.lift_up", lambda twin: len(twin.plant.faults.active) == 1),
        ("status link_lost for=1000", lambda twin: twin.state is State.ABORTED),
        ("press emergency_stop for=1000", lambda twin: twin.state is State.ABORTED),
        ("command abort", lambda twin: twin.state is State.ABORTED),
    ],
)
def test_an_action_at_rest_has_its_effect(text: str, effect: Callable[[Twin], bool]) -> None:
    twin, hands = stopped()
    assert do(hands, text)
    twin.run_for(300)
    assert effect(twin)


def test_a_reported_condition_ends_after_its_time() -> None:
    """Else the machine would not work again."""
    story = played("seed=1 trays=1 work=3000; 100 status link_lost for=500; 1500 tend; 6000 tend; 12000 tend")
    assert story.harms == []
    assert story.acted["status"] == 1
