"""Manual mode: every actuator by itself while a hand holds it, under the interlocks, with the books kept."""

from __future__ import annotations

import pytest
from hands import (
    bring_to_feed,
    by_hand,
    change_mode,
    jog,
    order,
    refusing_rule,
    stop,
    take_row,
    to_continuous,
    to_manual,
)
from routes import run_row_1
from twin_rig import Recorder, arm_of, at_work, scan_ms, switched_on, tags_of, to_complete, undisturbed

from controller.hmi.production import RefusalEvent
from controller.program.commands import ARM_OUTPUTS, JOGGED
from controller.program.states import Mode, State
from controller.program.tags import FULL, IN_PLACE, IN_PROGRESS, ROWS, SIDES, TAKEN, Side
from plant_sim.bench.recovery import begin_homing, home_again, questions
from plant_sim.bench.twin import SCAN_MS, Twin

LEASE_MS = 300
ROUND = ("lift_retract", "spread", "lift_extend", "converge", "claws_close", "claws_open", "slide_inward",
         "slide_outward")  # fmt: skip
"""Every output of an arm, in an order that the interlocks allow."""


def rows(twin: Twin, side: Side) -> list[int]:
    return [twin.plc.read(tags_of(twin, side).rows[row]) for row in ROWS]


def last_refusal(twin: Twin) -> str:
    return [event.text for event in twin.events if isinstance(event, RefusalEvent)][-1]


# holding


def test_every_actuator_moves_by_itself() -> None:
    """Given arms at home, each output in turn is on while it is held, and no other; then the tray's."""
    twin = by_hand()
    assert {*ROUND} == {*ARM_OUTPUTS}
    for output in [*(f"{side}.{name}" for side in SIDES for name in ROUND), "tray_run"]:
        twin.command(order(output))
        twin.scan()
        assert twin.outputs() - {"tray_forward"} == {output}, output
        jog(twin, output, 1_500)
        assert twin.outputs() == set(), output
        twin.run_for(300)
    assert twin.alarm_events() == []


@pytest.mark.parametrize("presses", [1, 4])
def test_an_output_goes_off_when_its_order_is_not_renewed(presses: int) -> None:
    """Given the last order, the output stays on for the lease, and a scan at most longer."""
    twin = by_hand()
    recorder = Recorder.of_outputs(twin)
    for _ in range(presses):
        twin.command(order("left.lift_retract"))
        twin.scan()
        last_ms = scan_ms(twin)
        twin.run_for(150)
    twin.run_for(1_000)
    (on, off) = recorder.of("left.lift_retract")
    assert on.on
    assert LEASE_MS - SCAN_MS <= off.at_ms - last_ms <= LEASE_MS + SCAN_MS


def test_letting_go_is_felt_in_the_same_scan() -> None:
    twin = by_hand()
    twin.command(order("left.lift_retract"))
    twin.run_for(50)
    assert "left.lift_retract" in twin.outputs()
    twin.command("jog_release")
    twin.scan()
    assert twin.outputs() == set()
    twin.run_for(500)
    assert twin.outputs() == set()


def test_one_output_at_a_time() -> None:
    """Given one output held, the order for another takes its place in that scan; of two at once only one is on."""
    twin = by_hand()
    twin.command(order("left.lift_retract"))
    twin.run_for(50)
    twin.command(order("right.lift_retract"))
    twin.scan()
    assert twin.outputs() == {"right.lift_retract"}
    for name in ("left.lift_retract", "right.lift_retract"):
        twin.command(order(name))
    twin.scan()
    assert len(twin.outputs()) == 1


@pytest.mark.parametrize("ends", ["stop", "emergency_stop"])
def test_a_stop_ends_what_is_held_at_once(ends: str) -> None:
    """Given an output held and its order given on, X24 or X25 takes it away, and it stays away."""
    twin = by_hand()
    twin.command(order("left.lift_retract"))
    twin.run_for(50)
    setattr(twin.plant.box, ends, True)
    twin.run_for(30)
    for _ in range(20):
        assert "left.lift_retract" not in twin.outputs()
        twin.command(order("left.lift_retract"))
        twin.scan()


# where it is not heard


def test_outside_manual_mode_no_output_is_held_by_hand() -> None:
    """Given Idle in continuous mode, the order for each output is refused with its reason, and none comes on."""
    twin = switched_on()
    twin.home()
    for number, output in enumerate(JOGGED, 1):
        twin.command(order(output))
        twin.scan()
        assert twin.outputs() == set()
        assert len([event for event in twin.events if isinstance(event, RefusalEvent)]) == number
        assert last_refusal(twin) == "cannot move by hand: manual mode has not been started"


def test_at_work_a_hand_changes_nothing() -> None:
    twin = at_work({"trays_target": 1})
    for _ in range(100):
        twin.command(order("left.slide_outward"))
        twin.scan()
    assert last_refusal(twin) == "cannot move by hand: manual mode has not been started"
    assert to_complete(twin) == undisturbed()


def test_in_manual_mode_the_machine_must_be_started_first() -> None:
    """Given manual mode in Stopped and in Idle, no output is held; in Execute it is."""
    twin = switched_on(mode=Mode.MANUAL)
    for state in (State.STOPPED, State.IDLE):
        if state is State.IDLE:
            twin.home()
        twin.command(order("left.lift_extend"))
        twin.run_for(50)
        assert twin.outputs() == set()
        assert last_refusal(twin) == "cannot move by hand: manual mode has not been started"
    twin.start()
    twin.command(order("left.lift_extend"))
    twin.scan()
    assert twin.outputs() == {"left.lift_extend"}


# interlocks


@pytest.mark.parametrize(
    ("side", "before", "output", "rule"),
    [
        ("left", (), "spread", "spread up at feed"),
        ("right", ("lift_retract",), "slide_inward", "inward ready"),
        ("left", ("claws_close",), "slide_inward", "inward ready"),
        ("right", ("slide_inward",), "lift_extend", "down at feed only"),
        ("left", ("slide_inward",), "slide_inward", "stop at the row"),
        ("right", ("slide_inward", "claws_close"), "slide_outward", "outward clear"),
        ("left", ("slide_inward", "claws_close", "lift_retract"), "claws_open", "open at a place"),
        ("right", (), "converge", "converge as far as it goes"),
    ],
)
def test_interlocks_hold_and_are_named(side: Side, before: tuple[str, ...], output: str, rule: str) -> None:
    """Given where hands have brought an arm, what would do harm there stays off, and the register names the rule."""
    twin = by_hand(side)
    for name in before:
        jog(twin, f"{side}.{name}", 2_500)
    twin.command(order(f"{side}.{output}"))
    twin.run_for(50)
    assert f"{side}.{output}" not in twin.outputs()
    assert refusing_rule(twin, side) == rule
    twin.command("jog_release")
    twin.run_for(20)
    assert refusing_rule(twin, side) is None


def test_the_tray_stands_while_an_arm_is_in_it() -> None:
    twin = by_hand()
    jog(twin, "left.slide_inward", 1_000)
    twin.command(order("tray_run"))
    twin.run_for(50)
    assert twin.outputs() == set()
    tray = twin.machine.tags.tray
    names = {rule.number: rule.name for rule in twin.machine.tray_rules}
    assert names[twin.plc.read(tray.blocked_by)] == "arms at feed"


# the books


@pytest.mark.parametrize("side", SIDES)
def test_a_row_thrown_away_by_hand_is_counted_once_and_work_goes_on(side: Side) -> None:
    """Given row 2 gripped, lifted, brought to feed and discarded over the cups by hand, automatic takes the others."""
    twin = by_hand(side)
    cycles = twin.plc.read(tags_of(twin, side).cycles)
    take_row(twin, side)
    assert rows(twin, side) == [TAKEN, IN_PROGRESS, FULL]
    assert len(arm_of(twin, side).grip.held) > 0
    bring_to_feed(twin, side)
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    jog(twin, f"{side}.spread", 1_500)
    jog(twin, f"{side}.lift_extend", 1_500)
    twin.run_until(lambda: bool(twin.plc.read(tags_of(twin, side).cup_counter.done)), within_ms=20_000)
    twin.command(f"{side}_discard")
    twin.scan()
    jog(twin, f"{side}.claws_open", 600)
    jog(twin, f"{side}.converge", 1_500)
    assert not arm_of(twin, side).grip.held
    assert not twin.plc.read(tags_of(twin, side).loaded)
    assert twin.plc.read(tags_of(twin, side).cycles) == cycles, "what is given away is no row thrown"
    to_continuous(twin)
    counts, usual = to_complete(twin), undisturbed()
    assert (counts.in_tray, counts.in_claw, counts.P, counts.D) == (0, 0, usual.P, usual.D)
    assert counts.in_cups + counts.T == usual.in_cups + usual.T
    assert twin.plc.read(tags_of(twin, side).cycles) == cycles + 1
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 1


@pytest.mark.parametrize("side", SIDES)
def test_a_row_brought_to_feed_by_hand_is_thrown_by_the_machine(side: Side) -> None:
    """Given a load at feed, homing keeps it, and it is the first to be thrown; nothing is lost."""
    twin = by_hand(side)
    take_row(twin, side)
    bring_to_feed(twin, side)
    to_continuous(twin)
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []


@pytest.mark.parametrize("side", SIDES)
def test_a_row_put_back_by_hand_is_full_again(side: Side) -> None:
    """Given row 2 gripped and opened again at its place, it is full, and is taken by the machine as any other."""
    twin = by_hand(side)
    take_row(twin, side)
    jog(twin, f"{side}.claws_open", 600)
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    assert not twin.plc.read(tags_of(twin, side).loaded)
    jog(twin, f"{side}.slide_outward", 2_500)
    to_continuous(twin)
    assert to_complete(twin) == undisturbed()


def test_a_tray_drawn_away_by_hand_is_asked_about_and_run_out() -> None:
    """Given a tray with rows left that a hand has moved, no arm goes in; the answer "none" has the next one brought."""
    twin = switched_on({"trays_target": 1}, trays=2)
    run_row_1(twin, "left")
    stop(twin)
    left_over = twin.plant.counts().in_tray - 72
    assert left_over > 0
    to_manual(twin)
    jog(twin, "tray_run", 400)
    twin.run_for(500)
    tray = twin.machine.tags.tray
    assert twin.plc.read(tray.ask)
    twin.command(order("left.slide_inward"))
    twin.run_for(50)
    assert refusing_rule(twin, "left") == "tray in place"
    stop(twin)
    change_mode(twin, Mode.CONTINUOUS)
    begin_homing(twin)
    twin.run_until_state(State.HELD, within_ms=20_000)
    assert questions(twin) == {"tray"}
    twin.command("tray_none")
    twin.run_for(200)
    assert [rows(twin, side) for side in SIDES] == [[TAKEN] * 3] * 2
    assert home_again(twin) == set()
    assert twin.plc.read(tray.phase) == IN_PLACE
    assert twin.plant.conveyor.placed_tray == 1
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
    assert twin.plant.counts().in_tray == left_over
