"""Homing by rules 1 to 6 of `home.homing`: order of outputs, final position, memory and subsequent work.

Rule 7, a question to the operator, is tested in `test_questions`.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import pytest

from controller.program.states import State
from controller.program.tags import FULL, ROWS, SIDES, TAKEN, Side
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import (
    HOMING_LIMIT_MS,
    answer_truly,
    begin_homing,
    clear,
    home_again,
    operate_manually,
    press_emergency_stop,
    questions,
)
from tests.plant_sim.twin.routes import BRISK, finish, run_row_1, run_to
from tests.plant_sim.twin.twin_rig import (
    ChangeRecorder,
    arm_of,
    at_initial_state,
    is_parked_loaded,
    switched_on,
    tags_of,
    undisturbed,
    until_step,
)

LIFT_MS = range(700, 800)
"""Time to lower the lift, ms: 145 mm at 0.21 m/s, with valve, tube, and cushions at both ends."""

PRESS_MS = range(1_000, 1_020)
"""Time to fill the outer chamber of the slide at its end position, ms."""
LIFT_PRESS_MS = range(400, 510)
"""Time to fill the upper chamber of the lift at its lower end, ms; its timer counts in steps of 100 ms."""
EMPTY_AT_FEED = ["lift_extend", "claws_open", "lift_retract", "lift_extend", "slide_outward"]
"""Outputs of homing for an empty, converged arm that is down at feed."""
SPREAD_AT_FEED = ["lift_extend", "claws_open", "lift_retract", "converge", "lift_extend", "slide_outward"]
"""Outputs of homing for an empty, spread arm that is down at feed."""
NOT_YET_MS = 10**9


def machine() -> Twin:
    """Return a machine in Stopped with a target of one tray."""
    return switched_on({"trays_target": 1}, parameters=BRISK)


def stopped_in(side: Side, step: str, into_ms: int) -> Twin:
    """Return a machine in Stopped after an emergency stop during a step of row 2, `into_ms` after its start."""
    twin = machine()
    run_to(step)(twin, side)
    twin.run_for(into_ms)
    press_emergency_stop(twin)
    clear(twin)
    return twin


def stopped_after_row_1(side: Side) -> Twin:
    """Return a machine in Stopped with the arms at home, row 1 taken and the claws known to be open."""
    twin = machine()
    run_row_1(twin, side)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=20_000)
    twin.run_for(300)
    return twin


def homed(twin: Twin, asked: Collection[str] = ("tray",)) -> ChangeRecorder:
    """Home the machine, check what is asked, answer and home again; return the output changes of the first homing."""
    recorder = ChangeRecorder.of_outputs(twin)
    begin_homing(twin)
    twin.run_until_state(State.IDLE, State.HELD, within_ms=HOMING_LIMIT_MS)
    first = [*recorder.changes]
    assert questions(twin) == {*asked}
    if asked:
        answer_truly(twin)
        assert home_again(twin) == set()
    recorder.changes[:] = first
    return recorder


class Stroke(NamedTuple):
    """Interval during which an output was on."""

    from_ms: int
    to_ms: int
    output: str


def strokes(recorder: ChangeRecorder, side: Side) -> list[Stroke]:
    """Return the intervals in which the outputs of an arm were on, in order of start, excluding those of only one scan.

    A step whose end position is already reached still turns its coil on for one scan.
    """
    found: list[Stroke] = []
    since_ms: dict[str, int] = {}
    for change in recorder.of(f"{side}."):
        if change.on:
            since_ms[change.name] = change.at_ms
        elif change.name in since_ms:
            found.append(Stroke(since_ms.pop(change.name), change.at_ms, change.name))
    found += [Stroke(from_ms, NOT_YET_MS, output) for output, from_ms in since_ms.items()]
    return sorted(stroke for stroke in found if stroke.to_ms - stroke.from_ms > SCAN_MS)


def output_order(recorder: ChangeRecorder, side: Side) -> list[str]:
    """Return the outputs of an arm in the order in which they turned on."""
    return [stroke.output for stroke in strokes(recorder, side)]


def times(recorder: ChangeRecorder, side: Side, output: str) -> list[tuple[int, int]]:
    """Return the start and end of each interval of an output, ms."""
    return [(stroke.from_ms, stroke.to_ms) for stroke in strokes(recorder, side) if stroke.output == output]


def rows(twin: Twin, side: Side) -> list[int]:
    """Return the stored states of rows 1 to 3 of an arm."""
    return [twin.plc.read(tags_of(twin, side).rows[row]) for row in ROWS]


def is_loaded(twin: Twin, side: Side) -> bool:
    """Return True if the arm holds a row according to the memory."""
    return bool(twin.plc.read(tags_of(twin, side).loaded))


def resumes_with(twin: Twin, side: Side, row: int) -> None:
    """Start, check that the arm approaches this row next, and check the seedling counts at the end of the trial."""
    twin.start()
    until_step(twin, f"{side} arm", "approach row")
    assert twin.plc.read(tags_of(twin, side).row_is[row])
    twin.run_until_state(State.COMPLETE, within_ms=90_000)
    assert twin.plant.counts() == undisturbed()


# (1) unknown claw state


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("is_open", [False, True])
def test_claws_in_an_unknown_state_count_as_closed_and_holding_a_row(side: Side, is_open: bool) -> None:
    """On a new machine, an arm that is down over the tray moves fully up, then out, and can then release a row."""
    twin = machine()
    arm_of(twin, side).place(x_m=0.15, is_open=is_open)
    assert is_loaded(twin, side)
    recorder = homed(twin, asked=())
    assert output_order(recorder, side) == ["lift_retract", "slide_outward"]
    assert is_loaded(twin, side)
    assert arm_of(twin, side).sensors["lift_up"].read()
    resumes_with(twin, side, 1)


def test_the_tray_waits_until_both_arms_are_home() -> None:
    """If both arms are away from feed and there is no tray, the feeder starts only when the second arm is at feed."""
    twin = machine()
    arm_of(twin, "left").place(x_m=0.10)
    arm_of(twin, "right").place(x_m=0.20)
    recorder = homed(twin, asked=())
    run_ms = next(change.at_ms for change in recorder.changes if change.name == "tray_run")
    ((_, left_ms),) = times(recorder, "left", "slide_outward")
    ((_, right_ms),) = times(recorder, "right", "slide_outward")
    assert left_ms < right_ms <= run_ms <= right_ms + 20


# (2) clamped, the lift still at its lower limit


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("step", "into_ms"), [("close claws", 0), ("close claws", 150), ("lift from row", 20)])
def test_a_row_not_yet_lifted_is_put_back_and_stays_full(side: Side, step: str, into_ms: int) -> None:
    twin = stopped_in(side, step, into_ms)
    held = len(arm_of(twin, side).grip.held)
    assert held == (0 if into_ms == 0 else 12)
    recorder = homed(twin)
    lowered = ["lift_extend"] if step == "lift from row" else []
    assert output_order(recorder, side) == [*lowered, "claws_open", "slide_outward", *EMPTY_AT_FEED]
    (put_back_ms, done_ms), _ = times(recorder, side, "claws_open")
    (outward_ms, _), (press_ms, pressed_ms) = times(recorder, side, "slide_outward")
    assert done_ms - put_back_ms in range(200, 230)
    assert outward_ms - put_back_ms in range(200, 230)
    assert pressed_ms - press_ms in PRESS_MS
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    assert not is_loaded(twin, side)
    assert at_initial_state(twin, side)
    resumes_with(twin, side, 2)


# (3) holding a row away from feed


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("into_ms", [420, 600, 900])
def test_a_row_being_lifted_moves_fully_up_and_then_out(side: Side, into_ms: int) -> None:
    twin = stopped_in(side, "lift from row", into_ms)
    rise_m = arm_of(twin, side).lift.rise_m
    assert 0.006 < rise_m < 0.145
    recorder = homed(twin)
    assert output_order(recorder, side) == ["lift_retract", "slide_outward"]
    ((up_from_ms, up_ms),) = times(recorder, side, "lift_retract")
    ((outward_ms, pressed_ms),) = times(recorder, side, "slide_outward")
    assert up_from_ms + 100 < outward_ms < up_ms, "the lift is held up during the motion outward"
    assert pressed_ms - up_ms in PRESS_MS
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    assert is_loaded(twin, side)
    assert is_parked_loaded(twin, side)
    resumes_with(twin, side, 3)


@pytest.mark.parametrize("side", SIDES)
def test_a_row_on_its_way_out_continues_at_once_with_the_lift_held_up(side: Side) -> None:
    twin = stopped_in(side, "slide to feed", 500)
    recorder = homed(twin)
    assert output_order(recorder, side) == ["lift_retract", "slide_outward"]
    ((up_from_ms, up_ms),) = times(recorder, side, "lift_retract")
    ((outward_ms, pressed_ms),) = times(recorder, side, "slide_outward")
    assert outward_ms == up_from_ms
    assert pressed_ms - up_ms in PRESS_MS
    assert is_parked_loaded(twin, side)
    assert rows(twin, side) == [TAKEN, TAKEN, FULL]
    resumes_with(twin, side, 3)


# (4) empty and open, away from feed


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("step", "into_ms"), [("approach row", 800), ("approach row", 1_600), ("settle at row", 50)])
def test_an_empty_arm_that_is_down_moves_out_without_lifting(side: Side, step: str, into_ms: int) -> None:
    twin = stopped_in(side, step, into_ms)
    begin_homing(twin)
    highest_m = 0.0
    arm = arm_of(twin, side)
    recorder = ChangeRecorder.of_outputs(twin)
    assert f"{side}.slide_outward" in twin.outputs()
    while not arm.slide.at_feed.read():
        highest_m = max(highest_m, arm.lift.rise_m)
        twin.scan()
    assert highest_m < 0.006
    twin.run_until_state(State.HELD, within_ms=10_000)
    assert output_order(recorder, side) == EMPTY_AT_FEED
    assert answer_truly(twin) == {"tray"}
    assert home_again(twin) == set()
    assert at_initial_state(twin, side)
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    resumes_with(twin, side, 2)


@pytest.mark.parametrize("side", SIDES)
def test_an_empty_arm_at_mid_height_moves_up_and_then_out(side: Side) -> None:
    """An empty arm that was manually raised halfway over the tray is raised fully before it moves outward."""
    twin = stopped_in(side, "approach row", 1_000)
    operate_manually(twin, f"{side}.lift_retract", for_ms=600)
    assert 0.03 < arm_of(twin, side).lift.rise_m < 0.12
    recorder = homed(twin)
    assert output_order(recorder, side) == [
        "lift_retract",
        "slide_outward",
        "claws_open",
        "lift_extend",
        "slide_outward",
    ]
    ((up_from_ms, up_ms),) = times(recorder, side, "lift_retract")
    (outward_ms, at_feed_ms), (press_ms, pressed_ms) = times(recorder, side, "slide_outward")
    assert up_from_ms + 100 < outward_ms < at_feed_ms <= up_ms
    assert at_feed_ms - outward_ms > 300
    assert pressed_ms - press_ms in PRESS_MS
    assert at_initial_state(twin, side)
    resumes_with(twin, side, 2)


# (5) at feed, holding a row


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(
    ("step", "into_ms", "raises", "then"),
    [
        ("pause at feed", 250, [], ["spread", "lift_extend"]),
        ("spread", 400, [], ["spread", "lift_extend"]),
        ("lower over cups", 400, ["lift_retract"], ["lift_extend"]),
        ("wait for cups", 300, ["lift_extend", "lift_retract"], ["lift_extend"]),
        ("release delay", 50, ["lift_extend", "lift_retract"], ["lift_extend"]),
    ],
)
def test_a_row_at_feed_stays_ready_and_start_resumes_with_it(
    side: Side, step: str, into_ms: int, raises: list[str], then: list[str]
) -> None:
    """Homing leaves the row raised at feed; after start the arm spreads it if necessary, lowers it and releases it."""
    twin = stopped_in(side, step, into_ms)
    held = arm_of(twin, side).grip.held
    recorder = homed(twin)
    assert output_order(recorder, side) == [*raises, "slide_outward"]
    ((press_ms, pressed_ms),) = times(recorder, side, "slide_outward")
    assert pressed_ms - press_ms in PRESS_MS
    assert is_parked_loaded(twin, side)
    assert is_loaded(twin, side)
    assert arm_of(twin, side).grip.held == held
    started = ChangeRecorder.of_outputs(twin)
    twin.start()
    until_step(twin, f"{side} arm", "open claws", within_ms=20_000)
    assert output_order(started, side) == [*then, "claws_open"]
    assert arm_of(twin, side).grip.held == held
    twin.run_until_state(State.COMPLETE, within_ms=90_000)
    assert twin.plant.counts() == undisturbed()


# (6) at feed, empty


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("step", ["converge", "wait at feed"])
def test_an_empty_arm_at_feed_opens_moves_up_converges_and_moves_down(side: Side, step: str) -> None:
    twin = stopped_in(side, step, 200 if step == "converge" else 0)
    verified = [] if twin.plc.read(tags_of(twin, side).reached["feed"]) else ["slide_outward"]
    recorder = homed(twin)
    assert output_order(recorder, side) == [*verified, *(SPREAD_AT_FEED if step == "converge" else EMPTY_AT_FEED)]
    ((open_ms, shut_ms),) = times(recorder, side, "claws_open")
    ((up_ms, _),) = times(recorder, side, "lift_retract")
    assert shut_ms - open_ms in range(200, 230)
    assert up_ms - open_ms in range(200, 230)
    (pressed_ms, released_ms), (down_ms, lower_limit_ms) = times(recorder, side, "lift_extend")
    assert released_ms - pressed_ms in LIFT_PRESS_MS
    assert lower_limit_ms - down_ms in LIFT_MS
    assert at_initial_state(twin, side)
    assert rows(twin, side) == [TAKEN, FULL, FULL]
    resumes_with(twin, side, 2)


@pytest.mark.parametrize("side", SIDES)
def test_an_arm_pushed_away_from_home_is_brought_back(side: Side) -> None:
    """If the valves of an arm at home are operated manually in Stopped, homing moves the arm up, out and home."""
    twin = stopped_after_row_1(side)
    operate_manually(twin, f"{side}.slide_inward", for_ms=1_000)
    operate_manually(twin, f"{side}.lift_retract", for_ms=600)
    assert not arm_of(twin, side).sensors["slide_at_feed"].read()
    assert questions(twin) == set()
    assert output_order(homed(twin, asked=()), side)[:2] == ["lift_retract", "slide_outward"]
    assert at_initial_state(twin, side)
    finish(twin)
    assert twin.plant.counts() == undisturbed()
