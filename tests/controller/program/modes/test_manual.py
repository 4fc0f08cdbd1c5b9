"""Manual mode: each actuator is jogged by a command, with interlocks and bookkeeping active."""

from __future__ import annotations

import pytest

from controller.events.kinds import RefusalEvent
from controller.program.operator.commands import ARM_OUTPUTS, JOGGED
from controller.program.states import Mode, State
from controller.program.tags import FULL, IN_PLACE, IN_PROGRESS, ROWS, SIDES, TAKEN, Side
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import home_again, questions
from tests.controller.program.modes.hands import (
    blocking_rule,
    bring_to_feed,
    change_mode,
    in_manual,
    jog,
    jog_command,
    stop,
    take_row,
    to_continuous,
    to_manual,
)
from tests.plant_sim.twin.routes import run_row_1
from tests.plant_sim.twin.twin_rig import (
    ChangeRecorder,
    arm_of,
    at_work,
    moving_outputs,
    scan_ms,
    switched_on,
    tags_of,
    to_complete,
    undisturbed,
)

LEASE_MS = 300
ROUND = (
    "lift_retract",
    "spread",
    "lift_extend",
    "converge",
    "claws_close",
    "claws_open",
    "slide_inward",
    "slide_outward",
)
"""Every output of an arm, in an order that the interlocks allow."""


def rows(twin: Twin, side: Side) -> list[int]:
    return [twin.plc.read(tags_of(twin, side).rows[row]) for row in ROWS]


def last_refusal(twin: Twin) -> str:
    return [event.text.en for event in twin.events if isinstance(event, RefusalEvent)][-1]


# jogging


def test_every_output_can_be_jogged_alone() -> None:
    """With the arms at home, each motion output can be jogged while all other motion outputs are off."""
    twin = in_manual()
    assert {*ROUND} == {*ARM_OUTPUTS}
    for output in [*(f"{side}.{name}" for side in SIDES for name in ROUND), "tray_run"]:
        twin.command(jog_command(output))
        twin.scan()
        assert twin.outputs() - {"tray_forward"} == {output}, output
        jog(twin, output, 1_500)
        assert twin.outputs() == set(), output
        twin.run_for(300)
    assert twin.alarm_events() == []


@pytest.mark.parametrize("presses", [1, 4])
def test_an_output_goes_off_when_its_jog_is_not_renewed(presses: int) -> None:
    """After the last command the output stays on for the lease time, to within one scan."""
    twin = in_manual()
    recorder = ChangeRecorder.of_outputs(twin)
    for _ in range(presses):
        twin.command(jog_command("left.lift_retract"))
        twin.scan()
        last_ms = scan_ms(twin)
        twin.run_for(150)
    twin.run_for(1_000)
    (on, off) = recorder.of("left.lift_retract")
    assert on.on
    assert LEASE_MS - SCAN_MS <= off.at_ms - last_ms <= LEASE_MS + SCAN_MS


def test_a_jog_release_acts_in_the_same_scan() -> None:
    twin = in_manual()
    twin.command(jog_command("left.lift_retract"))
    twin.run_for(50)
    assert "left.lift_retract" in twin.outputs()
    twin.command("jog_release")
    twin.scan()
    assert twin.outputs() == set()
    twin.run_for(500)
    assert twin.outputs() == set()


def test_one_output_at_a_time() -> None:
    """A second jog command replaces the first in the same scan; two simultaneous commands turn on only one output."""
    twin = in_manual()
    twin.command(jog_command("left.lift_retract"))
    twin.run_for(50)
    twin.command(jog_command("right.lift_retract"))
    twin.scan()
    assert twin.outputs() == {"right.lift_retract"}
    for name in ("left.lift_retract", "right.lift_retract"):
        twin.command(jog_command(name))
    twin.scan()
    assert len(twin.outputs()) == 1


@pytest.mark.parametrize("ends", ["stop", "emergency_stop"])
def test_a_stop_ends_a_jog_at_once(ends: str) -> None:
    """X24 or X25 switches the output off, and it stays off even if the jog command is renewed."""
    twin = in_manual()
    twin.command(jog_command("left.lift_retract"))
    twin.run_for(50)
    setattr(twin.plant.box, ends, True)
    twin.run_for(30)
    for _ in range(20):
        assert "left.lift_retract" not in twin.outputs()
        twin.command(jog_command("left.lift_retract"))
        twin.scan()


# jog commands refused


def test_outside_manual_mode_no_output_can_be_jogged() -> None:
    """In continuous mode in Idle, each jog command is refused, the reason is reported, and no output turns on."""
    twin = switched_on()
    twin.home()
    for number, output in enumerate(JOGGED, 1):
        twin.command(jog_command(output))
        twin.scan()
        assert moving_outputs(twin) == set()
        assert len([event for event in twin.events if isinstance(event, RefusalEvent)]) == number
        assert last_refusal(twin) == "cannot jog: manual mode is not started"


def test_a_jog_command_during_automatic_operation_has_no_effect() -> None:
    twin = at_work({"trays_target": 1})
    for _ in range(100):
        twin.command(jog_command("left.slide_outward"))
        twin.scan()
    assert last_refusal(twin) == "cannot jog: manual mode is not started"
    assert to_complete(twin) == undisturbed()


def test_in_manual_mode_the_machine_must_be_started_first() -> None:
    """In manual mode outputs can be jogged in Execute, but not in Stopped or Idle."""
    twin = switched_on(mode=Mode.MANUAL)
    for state in (State.STOPPED, State.IDLE):
        if state is State.IDLE:
            twin.home()
        twin.command(jog_command("left.lift_retract"))
        twin.run_for(50)
        assert moving_outputs(twin) == set()
        assert last_refusal(twin) == "cannot jog: manual mode is not started"
    twin.start()
    twin.command(jog_command("left.lift_retract"))
    twin.scan()
    assert twin.outputs() == {"left.lift_retract"}


# interlocks


@pytest.mark.parametrize(
    ("side", "before", "output", "rule"),
    [
        ("left", (), "spread", "spread only when up at feed"),
        ("right", ("lift_retract",), "slide_inward", "inward ready"),
        ("left", ("claws_close",), "slide_inward", "inward ready"),
        ("right", ("slide_inward",), "lift_extend", "down at feed only"),
        ("left", ("slide_inward",), "slide_inward", "stop at the row"),
        ("right", ("slide_inward", "claws_close"), "slide_outward", "outward clear"),
        ("left", ("slide_inward", "claws_close", "lift_retract"), "claws_open", "release load only at cups or row"),
        ("right", (), "converge", "not yet converged"),
    ],
)
def test_interlocks_apply_and_are_reported(side: Side, before: tuple[str, ...], output: str, rule: str) -> None:
    """Blocked outputs stay off in manual mode, and `blocked_by` contains the number of the blocking rule."""
    twin = in_manual(side)
    for name in before:
        jog(twin, f"{side}.{name}", 2_500)
    twin.command(jog_command(f"{side}.{output}"))
    twin.run_for(50)
    assert f"{side}.{output}" not in twin.outputs()
    assert blocking_rule(twin, side) == rule
    twin.command("jog_release")
    twin.run_for(20)
    assert blocking_rule(twin, side) is None


def test_the_tray_is_blocked_while_an_arm_is_in_it() -> None:
    twin = in_manual()
    jog(twin, "left.slide_inward", 1_000)
    twin.command(jog_command("tray_run"))
    twin.run_for(50)
    assert twin.outputs() == set()
    tray = twin.machine.tags.tray
    names = {rule.number: rule.name for rule in twin.machine.tray_rules}
    assert names[twin.plc.read(tray.blocked_by)] == "arms at feed"


def test_the_centre_is_free_again_when_an_arm_turns_back_before_its_row() -> None:
    """The left arm leaves feed for row 2, turns back, and the right arm can then enter the centre."""
    twin = in_manual()
    arm = tags_of(twin, "left")
    jog(twin, "left.slide_inward", 600)
    assert not twin.plc.read(arm.at_feed)
    assert twin.plc.read(arm.in_centre)
    jog(twin, "left.slide_outward", 2_500)
    assert twin.plc.read(arm.at_feed)
    assert not twin.plc.read(arm.in_centre)


# bookkeeping


@pytest.mark.parametrize("side", SIDES)
def test_a_row_discarded_in_manual_mode_is_counted_once_and_work_resumes(side: Side) -> None:
    """A manually discarded row is marked as taken but not counted as a cycle; automatic mode takes the other rows.

    The emptied tray is counted once.
    """
    twin = in_manual(side)
    cycles = twin.plc.read(tags_of(twin, side).cycles)
    take_row(twin, side)
    assert rows(twin, side) == [TAKEN, IN_PROGRESS, FULL]
    assert len(arm_of(twin, side).grip.held) > 0
    bring_to_feed(twin, side)
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    jog(twin, f"{side}.spread", 1_500)
    jog(twin, f"{side}.lift_extend", 1_500)
    twin.run_until(tags_of(twin, side).cup_counter.done, within_ms=20_000)
    twin.command(f"{side}_discard")
    twin.scan()
    jog(twin, f"{side}.claws_open", 600)
    jog(twin, f"{side}.converge", 1_500)
    assert not arm_of(twin, side).grip.held
    assert not twin.plc.read(tags_of(twin, side).loaded)
    assert twin.plc.read(tags_of(twin, side).cycles) == cycles, "a discarded row is not counted as a cycle"
    to_continuous(twin)
    counts, usual = to_complete(twin), undisturbed()
    assert (counts.in_tray, counts.in_claw, counts.P, counts.D) == (0, 0, usual.P, usual.D)
    assert counts.in_cups + counts.T == usual.in_cups + usual.T
    assert twin.plc.read(tags_of(twin, side).cycles) == cycles + 1
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 1


@pytest.mark.parametrize("side", SIDES)
def test_a_row_brought_to_feed_in_manual_mode_is_released_in_automatic_mode(side: Side) -> None:
    """Homing leaves the row at feed; after start the arm releases it over the cups, and no seedling is lost."""
    twin = in_manual(side)
    take_row(twin, side)
    bring_to_feed(twin, side)
    to_continuous(twin)
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []


@pytest.mark.parametrize("side", SIDES)
def test_a_row_put_back_in_manual_mode_is_full_again(side: Side) -> None:
    """If row 2 is gripped and released again in place, it is marked as full and is taken like any other row."""
    twin = in_manual(side)
    take_row(twin, side)
    jog(twin, f"{side}.claws_open", 600)
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    assert not twin.plc.read(tags_of(twin, side).loaded)
    jog(twin, f"{side}.slide_outward", 2_500)
    to_continuous(twin)
    assert to_complete(twin) == undisturbed()


def test_a_tray_moved_in_manual_mode_raises_the_question_and_is_conveyed_out() -> None:
    """After a partly emptied tray is moved, inward motion is blocked; the answer "none" brings in the next tray."""
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
    twin.command(jog_command("left.slide_inward"))
    twin.run_for(50)
    assert blocking_rule(twin, "left") == "tray in place"
    stop(twin)
    change_mode(twin, Mode.CONTINUOUS)
    twin.command("reset")  # X0 answers the question that the lamp shows
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
