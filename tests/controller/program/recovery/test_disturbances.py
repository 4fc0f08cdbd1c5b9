"""Disturbances during steps: a lost link, flickering switches and a slow store never lead to a wrong state."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from controller.events.kinds import RefusalEvent, StateEvent
from controller.program.operator.refusals import Refusal
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import home_again
from tests.controller.program.recovery.cable import CableLink
from tests.plant_sim.twin.routes import Route, Stop, finish, interrupted, route_to
from tests.plant_sim.twin.twin_rig import (
    arm_of,
    at_work,
    moving_outputs,
    tags_of,
    undisturbed,
    until_picking,
    until_step,
)
from tests.sampling import first_of, one_in

CLAW_LIMIT_MS = 3_000
UNBIDDEN_MS = 500


def pull_the_cable(twin: Twin, for_ms: int) -> None:
    """Disconnect the field I/O for a given time and let the link reopen, then use the previous link again."""
    link, cable = twin.runtime.link, CableLink(twin.module)
    cable.open()
    twin.runtime.field.link = cable
    cable.pulled = True
    twin.run_for(for_ms)
    cable.pulled = False
    twin.run_for(1_000)
    twin.runtime.field.link = link


def check_trial(twin: Twin, route: Route) -> None:
    """Check that the seedling counts match an undisturbed trial, unless the route discards or loosens a row."""
    counts, wanted = twin.plant.counts(), undisturbed(trays=route.trays)
    assert counts.in_tray == counts.in_claw == 0
    assert route.discards or route.loosens or counts == wanted


@pytest.mark.parametrize("stop", one_in(3, interrupted(0)))
def test_a_link_lost_in_any_step_derives_no_state_from_assumed_inputs(stop: Stop) -> None:
    """A link loss of half a second leads to Aborted; clear, home and start resume work without losses."""
    route = route_to(stop)
    twin = route.travel(stop)
    sides = [stop.side] if stop.side else SIDES  # the other arm may be in a claw step as well
    before = [twin.plc.read(word) for side in sides for word in tags_of(twin, side).rows.values()]
    phase = twin.plc.read(twin.machine.tags.tray.phase)
    twin.run_for(50)
    pull_the_cable(twin, 500)
    assert twin.state == State.ABORTED
    assert not moving_outputs(twin)
    after = [twin.plc.read(word) for side in sides for word in tags_of(twin, side).rows.values()]
    if stop.title not in ("settle at row", "close claws", "lift from row", "raise loaded", "settle", "put back"):
        assert after == before
    if stop.side is not None:
        assert twin.plc.read(twin.machine.tags.tray.phase) == phase
    twin.command("clear")
    twin.run_for(200)
    route.restore(twin)
    home_again(twin)
    finish(twin)
    check_trial(twin, route)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("step", "switch"), [("close claws", "lift_down"), ("open claws", "lift_down")])
def test_claws_without_a_confirmed_position_raise_the_alarm_of_their_step(side: Side, step: str, switch: str) -> None:
    """If the position signal is lost permanently as a claw step begins, the alarm of the step is raised at its limit.

    The arm is lowered late, so its claws open less than a second after it is down. After repair and homing, work
    resumes.
    """
    twin = at_work({"trays_target": 1, "descend_at_count": 12})
    until_picking(twin, side, 1)
    until_step(twin, f"{side} arm", step)
    began_ms = twin.now_ms
    arm_of(twin, side).sensors[switch].stuck = False
    twin.run_until(lambda: bool(twin.alarms()), within_ms=CLAW_LIMIT_MS + 200)
    assert twin.alarms() == [f"{side}: {step}"]
    assert CLAW_LIMIT_MS - 100 <= twin.now_ms - began_ms <= CLAW_LIMIT_MS + 20
    assert twin.plc.read(tags_of(twin, side).loaded) == 1
    twin.run_until_state(State.HELD, within_ms=20_000)
    arm_of(twin, side).sensors[switch].stuck = None
    home_again(twin)
    finish(twin)
    counts = twin.plant.counts()
    assert (counts.P, counts.D) == (undisturbed().P, undisturbed().D)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("switch", ["lift_down", "claws_spread", "slide_at_feed"])
def test_a_switch_that_changes_at_rest_raises_an_alarm_and_a_flicker_does_not(side: Side, switch: str) -> None:
    """If a switch of an arm at rest changes, an alarm is raised after 0.5 s; a change that lasts 0.3 s raises none."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, side, 1)
    until_step(twin, f"{side} arm", "wait for cups")
    twin.run_for(1_200)
    sensor = arm_of(twin, side).sensors[switch]
    sensor.stuck = False
    twin.run_for(300)
    sensor.stuck = None
    twin.run_for(700)
    assert twin.in_step(f"{side} arm", "wait for cups")
    assert twin.alarm_events() == []
    sensor.stuck = False
    took_ms = twin.run_until(lambda: bool(twin.alarms()), within_ms=1_000)
    assert twin.alarms() == [f"{side}: unbidden"]
    assert UNBIDDEN_MS - 100 <= took_ms - 2 * SCAN_MS <= UNBIDDEN_MS
    assert arm_of(twin, side).grip.held
    twin.run_until_state(State.HELD, within_ms=20_000)
    sensor.stuck = None
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


@pytest.mark.parametrize("flicker_ms", [30, 350])
def test_a_flicker_of_the_lower_limit_while_clamping_marks_no_row_as_taken(flicker_ms: int) -> None:
    """If lift_down is briefly off in 'close claws', the row is still clamped, and no other row is affected."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 2)
    until_step(twin, "left arm", "close claws")
    twin.run_for(50)
    arm_of(twin, "left").sensors["lift_down"].stuck = False
    twin.run_for(flicker_ms)
    arm_of(twin, "left").sensors["lift_down"].stuck = None
    assert [twin.plc.read(word) for word in tags_of(twin, "left").rows.values()] == [0, 2, 1]
    finish(twin)
    assert twin.plant.counts() == undisturbed()


class SlowStore:
    """Store that takes a given time to save data; it saves the newest values, one write after another.

    Args:
        twin: Twin whose time passes.
        takes_ms: Time of each write, ms.
        first_takes_ms: Time of the first write, ms; None for that of the others.
    """

    error = None

    def __init__(self, twin: Twin, takes_ms: int, first_takes_ms: int | None = None) -> None:
        self._twin, self._takes_ms = twin, takes_ms
        self._first_takes_ms = takes_ms if first_takes_ms is None else first_takes_ms
        self._begins_ms, self._done_ms = -1, 0
        self.first_ms: int | None = None

    def submit(self, values: Mapping[str, int]) -> None:
        now_ms = self._twin.now_ms
        if now_ms > self._begins_ms:  # otherwise, these values replace those of a write that has not started
            self._begins_ms = max(now_ms, self._done_ms)
            self._done_ms = self._begins_ms + (self._first_takes_ms if self.first_ms is None else self._takes_ms)
        if self.first_ms is None:
            self.first_ms = now_ms

    @property
    def settled(self) -> bool:
        return self._twin.now_ms >= self._done_ms

    def close(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize(
    ("step", "takes_ms", "first_takes_ms"),
    first_of(
        [
            ("release delay", 250, 400),
            ("close claws", 230, 230),
            *((step, 250, first_ms) for step in ("close claws", "release delay") for first_ms in range(0, 400, 40)),
        ]
    ),
)
def test_a_slow_store_causes_no_claw_stroke_to_be_skipped(step: str, takes_ms: int, first_takes_ms: int) -> None:
    """If the store is slower than a claw stroke, coils are delayed, but every seedling is transplanted.

    The time of the first write shifts the later ones against the steps. With 280 ms a write, 3 of 22 such shifts end in
    a store fault.
    """
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", step)
    twin.runtime._retentive_writer = store = SlowStore(twin, takes_ms, first_takes_ms)
    store.submit({})  # pending when the coil is due, even if this step does not change the memory
    finish(twin)
    counts = twin.plant.counts()
    assert (counts.P, counts.D, counts.in_tray, counts.in_claw) == (undisturbed().P, undisturbed().D, 0, 0)
    assert twin.alarms() == []


def test_a_store_too_slow_for_successive_changes_is_a_store_fault() -> None:
    """The outputs wait for all changes; with 300 ms a write they wait for more than 1 s. No seedling is dropped."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.runtime._retentive_writer = SlowStore(twin, 300)
    twin.run_until_state(State.ABORTED, within_ms=150_000)
    assert twin.alarms() == ["store_fault"]
    assert not twin.outputs()
    assert twin.plant.counts().D == 0


def test_a_store_that_hangs_is_a_store_fault() -> None:
    """If the store hangs, the store fault is raised after 1 s, and no actuator alarm is raised."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    store = SlowStore(twin, 10**9)
    twin.runtime._retentive_writer = store
    twin.run_until(lambda: bool(twin.alarms()), within_ms=30_000)
    assert twin.alarms() == ["store_fault"]
    assert store.first_ms is not None
    assert 1_000 < twin.now_ms - store.first_ms <= 1_000 + 3 * SCAN_MS
    twin.scan()
    assert twin.state in {State.ABORTING, State.ABORTED}
    assert not twin.outputs()


def test_cups_are_not_counted_by_the_loss_and_return_of_the_link() -> None:
    """If the link is lost while the tractor is at rest with the flag under the sensor, no cup is counted."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    counter = tags_of(twin, "left").cup_counter.value
    twin.run_until(counter.equals(3), within_ms=30_000)
    twin.plant.planting_frequency_per_min = 0.0
    sensor = arm_of(twin, "left").sensors["cup_pulse"]
    sensor.stuck = True
    twin.run_for(1_000)
    counted = twin.plc.read(counter)
    for _ in range(3):
        pull_the_cable(twin, 500)
        assert twin.plc.read(counter) == counted


def test_cups_empty_is_accepted_only_while_the_count_is_invalid() -> None:
    """While the count is valid and below twelve, the cups_empty command has no effect."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 2)
    arm = tags_of(twin, "left")
    assert twin.plc.read(arm.cup_counter.value) < 12
    twin.command("cups_empty")
    twin.scan()
    assert twin.plc.read(arm.cups_confirmed) == 0
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_a_discard_without_a_held_row_does_not_apply_to_the_next_row() -> None:
    """If discard is commanded while the arm is empty or moving, the next row is transplanted, not discarded."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.command("left_discard")
    twin.run_for(100)
    assert twin.plc.read(tags_of(twin, "left").discard) == 0
    until_step(twin, "left arm", "slide to feed")
    twin.command("left_discard")
    twin.run_for(100)
    assert twin.plc.read(tags_of(twin, "left").discard) == 0
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_discard_answers_the_question() -> None:
    """If it is unknown whether a row is held, discard is accepted as the answer, and homing releases the row."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "close claws")
    twin.run_for(150)
    twin.power_cycle()
    twin.run_for(500)
    assert twin.plc.read(tags_of(twin, "left").ask) == 1
    twin.command("left_discard")
    twin.run_for(100)
    assert twin.plc.read(tags_of(twin, "left").ask) == 0
    assert home_again(twin) == {"tray"}
    assert twin.plc.read(tags_of(twin, "left").loaded) == 0
    assert twin.plc.read(tags_of(twin, "left").discard) == 0


def test_a_start_with_an_arm_that_left_home_is_refused() -> None:
    """If the right arm is pushed inward in Idle, start is refused, the reason is reported, and nothing moves."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=60_000)
    twin.home()
    arm_of(twin, "right").place(x_m=0.01)
    twin.run_for(200)
    twin.press("start")
    twin.run_for(1_000)
    assert (twin.state, twin.outputs(), twin.alarms()) == (State.IDLE, set(), [])
    refused = twin.events[-1]
    assert isinstance(refused, RefusalEvent)
    assert (refused.command, refused.reason) == ("start", Refusal.RIGHT_NOT_AT_FEED)
    assert refused.text.en == "cannot start: right slide not at feed"


def test_an_arm_that_left_home_by_itself_raises_an_alarm_and_causes_no_collision() -> None:
    """If the left arm is pushed inward while it waits for the centre, an alarm is raised and the right arm stops."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "right", 3)
    left, right = (arm_of(twin, side) for side in SIDES)
    twin.run_until(twin.step_of("left arm", "wait at feed"), within_ms=30_000)
    assert twin.in_step("right arm", "approach row")
    left.place(x_m=0.01)
    twin.run_for(3 * SCAN_MS)
    assert "right.slide_inward" not in twin.outputs()
    took_ms = twin.run_until(lambda: bool(twin.alarms()), within_ms=2_000)
    assert twin.alarms() == ["left: off home"]
    assert 890 <= took_ms <= 1_100
    assert not twin.plc.read(tags_of(twin, "left").cycling)
    at_m = right.slide.x_m
    twin.run_until_state(State.HELD, within_ms=30_000)
    assert right.slide.x_m <= at_m
    assert set(twin.alarms()) == {"left: off home", "right: approach row"}
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_the_reason_of_a_suspension_is_reported() -> None:
    """If the cups stop while one arm waits for them, the change to Suspended states the reason and the side."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "wait for cups")
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_until_state(State.SUSPENDED, within_ms=5_000)
    (event,) = [e for e in twin.events if isinstance(e, StateEvent) and e.state == State.SUSPENDED]
    assert event.reason.en == "no cups at the left row"


def test_a_complete_batch_restarts_after_a_stop_and_a_power_loss() -> None:
    """If the machine is stopped and loses power after Complete, the next homing begins a new batch."""
    twin = at_work({"trays_target": 1}, trays=2)
    twin.run_until_state(State.COMPLETE, within_ms=120_000)
    twin.press("stop")
    twin.run_until_state(State.STOPPED, within_ms=200)
    twin.power_cycle()
    twin.run_for(500)
    twin.home()
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 0
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
    assert twin.plant.counts() == undisturbed(trays=2)


def test_first_out_names_the_alarm_that_came_first() -> None:
    """`first_out` contains the number of the alarm that was raised first, regardless of the numbers of later alarms."""
    twin = at_work({"trays_target": 1})
    first_out = twin.machine.tags.machine.first_out
    assert twin.plc.read(first_out) == 0
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "lift from row")
    arm_of(twin, "left").lift.jammed = True
    until_step(twin, "right arm", "slide to feed")
    arm_of(twin, "right").slide.jammed = True
    twin.run_until(lambda: bool(twin.alarms()), within_ms=6_000)
    (first,) = twin.plc.annunciators()
    twin.run_until(lambda: len(twin.plc.annunciators()) == 2, within_ms=6_000)
    assert max(twin.plc.annunciators()) > first
    assert twin.plc.read(first_out) == first
    twin.plant.box.emergency_stop = True
    twin.run_for(100)
    assert min(twin.plc.annunciators()) < first
    assert twin.plc.read(first_out) == first


def test_an_open_stop_wire_does_not_clear_and_is_reported() -> None:
    """While the wire of X24 is open, an emergency stop cannot be cleared, and a warning names the cause."""
    twin = at_work({"trays_target": 1})
    twin.plant.box.stop = True
    twin.run_for(9_500)
    assert "stop_stuck" not in twin.alarms()
    twin.run_for(1_000)
    assert "stop_stuck" in twin.alarms()
    twin.plant.box.emergency_stop = True
    twin.run_for(500)
    twin.plant.box.emergency_stop = False
    twin.run_for(10_000)
    assert twin.state == State.ABORTED
    twin.plant.box.stop = False
    twin.run_for(100)
    assert "stop_stuck" not in twin.alarms()


def test_a_scan_that_fails_is_a_latched_fault_with_safe_outputs() -> None:
    """A scan that raises an exception switches the outputs off and aborts the machine; clear permits a restart."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    twin.run_for(500)
    assert twin.outputs()
    scan = twin.plc.scan
    twin.plc.scan = failing_once(twin, scan)  # type: ignore[method-assign, assignment]
    twin.scan()
    assert not twin.outputs()
    twin.scan()
    assert twin.state == State.ABORTING
    assert "scan_fault" in twin.alarms()
    twin.run_for(1_000)
    twin.command("clear")
    twin.run_for(100)
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def failing_once(twin: Twin, scan: object) -> object:
    """Return a scan function that fails on its first call only."""

    def fail(now_ms: int, levels: list[bool]) -> list[bool]:
        twin.plc.scan = scan  # type: ignore[method-assign, assignment]
        raise ZeroDivisionError(f"planted at {now_ms // SCAN_MS} with {len(levels)} levels")

    return fail
