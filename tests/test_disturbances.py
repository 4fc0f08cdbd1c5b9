"""Facts come from real inputs and strokes: lost link, flickering switches and a slow store in the midst of steps."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from cable import CableLink
from routes import STOPS, Route, Stop, finish, route_to
from twin_rig import arm_of, at_work, tags_of, undisturbed, until_picking, until_step

from controller.hmi.production import RefusalEvent
from controller.program.refusals import Refusal
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.bench.recovery import home_again
from plant_sim.bench.twin import SCAN_MS, Twin

CLAW_LIMIT_MS = 3_000
UNBIDDEN_MS = 500


def pull_the_cable(twin: Twin, for_ms: int) -> None:
    """Take the field away for a time; the link in use is opened anew."""
    cable = CableLink(twin.module)
    cable.open()
    twin.runtime._link = cable
    cable.pulled = True
    twin.run_for(for_ms)
    cable.pulled = False
    twin.run_for(1_000)


def check_trial(twin: Twin, route: Route) -> None:
    """Every seedling is where it would be without the disturbance; a discarded row may miss the cups."""
    counts, wanted = twin.plant.counts(), undisturbed(trays=route.trays)
    assert counts.in_tray == counts.in_claw == 0
    assert route.discards or route.loosens or counts == wanted


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_a_link_lost_in_any_step_makes_no_fact_of_inputs_it_did_not_read(stop: Stop) -> None:
    """Given a silence of half a second in any step: Aborted; clear, home, start, and nothing is lost or skipped."""
    route = route_to(stop)
    twin = route.travel(stop)
    sides = [stop.side] if stop.side else SIDES  # the other arm may be in a claw step of its own
    before = [twin.plc.read(word) for side in sides for word in tags_of(twin, side).rows.values()]
    phase = twin.plc.read(twin.machine.tags.tray.phase)
    twin.run_for(50)
    pull_the_cable(twin, 500)
    assert twin.state == State.ABORTED
    assert not twin.outputs()
    after = [twin.plc.read(word) for side in sides for word in tags_of(twin, side).rows.values()]
    if stop.title not in ("settle at row", "close claws", "lift from row", "raise loaded", "settle", "put back"):
        assert after == before
    if stop.side is not None:
        assert twin.plc.read(twin.machine.tags.tray.phase) == phase
    twin.command("clear")
    twin.run_for(200)
    route.mend(twin)
    home_again(twin)
    finish(twin)
    check_trial(twin, route)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("switch", ["lift_down", "claws_spread", "slide_at_feed"])
def test_claws_that_did_not_open_are_not_believed_to_be_open(side: Side, switch: str) -> None:
    """Given the place for opening lost for 350 ms as the claws should open, they open after it, and nothing is torn."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, side, 1)
    until_step(twin, f"{side} arm", "release delay")
    arm_of(twin, side).sensors[switch].stuck = False
    twin.run_for(350)
    assert twin.plc.read(tags_of(twin, side).loaded) == 1
    arm_of(twin, side).sensors[switch].stuck = None
    finish(twin)
    counts = twin.plant.counts()
    assert (counts.P, counts.D) == (undisturbed().P, undisturbed().D)
    assert counts.in_tray == counts.in_claw == 0


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("step", "switch"), [("close claws", "lift_down"), ("open claws", "lift_down")])
def test_claws_without_their_place_raise_an_alarm_of_their_own(side: Side, step: str, switch: str) -> None:
    """Given the place lost for good by an arm that has just come to it, the step's own alarm comes at its limit.

    Lowered late, the arm opens less than a second after it is down. Mended and homed, all goes on.
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
def test_a_switch_that_changes_while_the_arm_rests_is_told_and_a_flicker_is_not(side: Side, switch: str) -> None:
    """Given an arm that has waited over the cups for more than a second, its alarm comes 0.5 s after the change."""
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
def test_a_flicker_of_the_lower_limit_while_clamping_takes_no_row(flicker_ms: int) -> None:
    """Given lift_down off for a moment in 'close claws', the row is clamped after it, and no other row is touched."""
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


class SlowKeeper:
    """A store that takes a time to keep what it is given."""

    error = None

    def __init__(self, twin: Twin, takes_ms: int) -> None:
        self._twin, self._takes_ms, self._done_ms = twin, takes_ms, 0
        self.first_ms: int | None = None

    def submit(self, values: Mapping[str, int]) -> None:
        self._done_ms = self._twin.now_ms + self._takes_ms
        if self.first_ms is None:
            self.first_ms = self._twin.now_ms

    @property
    def settled(self) -> bool:
        return self._twin.now_ms >= self._done_ms

    def close(self) -> None:
        """Nothing is left to do."""


@pytest.mark.parametrize(("step", "takes_ms"), [("close claws", 230), ("release delay", 400)])
def test_a_slow_store_skips_no_stroke_of_the_claws(step: str, takes_ms: int) -> None:
    """Given a store that outlasts the stroke from a claw step on, coils come late, and every seedling still arrives."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", step)
    twin.runtime._keeper = keeper = SlowKeeper(twin, takes_ms)
    keeper.submit({})  # pending as the coil is due, whether or not this step itself changes the memory
    finish(twin)
    counts = twin.plant.counts()
    assert (counts.P, counts.D, counts.in_tray, counts.in_claw) == (undisturbed().P, undisturbed().D, 0, 0)
    assert twin.alarms() == []


def test_a_store_that_hangs_is_named() -> None:
    """Given a store that never ends, the fault is the store's, within its limit, and not some actuator's."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    keeper = SlowKeeper(twin, 10**9)
    twin.runtime._keeper = keeper
    twin.run_until(lambda: bool(twin.alarms()), within_ms=30_000)
    assert twin.alarms() == ["store_fault"]
    assert keeper.first_ms is not None
    assert 1_000 < twin.now_ms - keeper.first_ms <= 1_000 + 3 * SCAN_MS
    twin.scan()
    assert twin.state in {State.ABORTING, State.ABORTED}
    assert not twin.outputs()


def test_cups_are_not_counted_by_the_loss_and_return_of_the_link() -> None:
    """Given the tractor standing with the flag under the sensor, losses of the link count no cup."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    counter = tags_of(twin, "left").cup_counter.value
    twin.run_until(lambda: twin.plc.read(counter) == 3, within_ms=30_000)
    twin.plant.planting_frequency_per_min = 0.0
    sensor = arm_of(twin, "left").sensors["cup_pulse"]
    sensor.stuck = True
    twin.run_for(1_000)
    counted = twin.plc.read(counter)
    for _ in range(3):
        pull_the_cable(twin, 500)
        assert twin.plc.read(counter) == counted


def test_cups_empty_is_heard_only_while_the_count_is_invalid() -> None:
    """Given a valid count below twelve, the command changes nothing."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 2)
    arm = tags_of(twin, "left")
    assert twin.plc.read(arm.cup_counter.value) < 12
    twin.command("cups_empty")
    twin.scan()
    assert twin.plc.read(arm.cups_confirmed) == 0
    finish(twin)
    assert twin.plant.counts() == undisturbed()


def test_a_discard_of_nothing_is_not_kept_for_the_next_load() -> None:
    """Given discard ordered with an empty arm, or in motion, the next load is thrown and not discarded."""
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
    """Given a row in doubt, discard is an answer: the load is opened over the cups while homing."""
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
    twin.home(within_ms=60_000)
    assert twin.plc.read(tags_of(twin, "left").loaded) == 0
    assert twin.plc.read(tags_of(twin, "left").discard) == 0


def test_a_start_with_an_arm_that_left_home_is_refused() -> None:
    """Given the right arm pushed inward in Idle, the start is refused with that reason, and nothing moves."""
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
    assert refused.text == "cannot start: right slide not at feed"


def test_an_arm_that_left_home_by_itself_is_told_and_never_met() -> None:
    """Given the left arm pushed inward while it waits for the centre, its own alarm, and the right arm stops inward."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "right", 3)
    left, right = (arm_of(twin, side) for side in SIDES)
    twin.run_until(lambda: twin.in_step("left arm", "wait at feed"), within_ms=30_000)
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


def test_the_reason_of_a_suspension_is_told() -> None:
    """Given no cups at one row, then at both, the register and the event say so."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, "left", 1)
    until_step(twin, "left arm", "wait for cups")
    arm_of(twin, "left").sensors["cup_pulse"].stuck = False
    twin.run_until_state(State.SUSPENDED, within_ms=5_000)
    (event,) = [e for e in twin.events if getattr(e, "state", None) == State.SUSPENDED]
    assert getattr(event, "reason", "") == "no cups at the left row"


def test_a_batch_that_was_complete_begins_anew_whatever_came_between() -> None:
    """Given Complete, a stop and a power loss before the next homing do not leave the old batch standing."""
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
    """Given two alarms, the register keeps the first, whatever their numbers."""
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


def test_a_stop_wire_that_is_open_neither_clears_nor_hides() -> None:
    """Given X24's wire open, an emergency stop is not cleared by it, and a warning says why nothing starts."""
    twin = at_work({"trays_target": 1})
    twin.plant.box.stop = True
    twin.run_for(6_000)
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
    """Given an exception in one scan in motion, that scan's outputs are safe, the next aborts, and clear goes on."""
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
    """Return a scan that fails the first time it is called and then is itself again."""

    def fail(now_ms: int, levels: list[bool]) -> list[bool]:
        twin.plc.scan = scan  # type: ignore[method-assign, assignment]
        raise ZeroDivisionError(f"planted at {now_ms // SCAN_MS} with {len(levels)} levels")

    return fail
