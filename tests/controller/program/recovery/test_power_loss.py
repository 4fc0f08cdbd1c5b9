"""Power loss in every step: nothing moves at power-up, unknown states lead to a question, and work resumes."""

from __future__ import annotations

import random
from functools import cache

import pytest

from controller.core.expr import all_of, any_of
from controller.program.states import State
from controller.program.tags import ROWS, SIDES, TAKEN
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import clear, home_again, press_emergency_stop, questions
from tests.plant_sim.twin.routes import BRISK, Stop, finish, interrupted, route_to
from tests.plant_sim.twin.twin_rig import at_work, moving_outputs, tags_of, undisturbed, until_step
from tests.sampling import one_in

OFF_MS = 1_000
ROW_IN_DOUBT = {
    ("arm", "close claws"),
    ("arm", "lift from row"),
    ("homing", "lower to put back"),
    ("homing", "put back"),
    ("homing", "decide"),
}
"""Steps between clamping and leaving the row, and the step that waits for the answer.

In 'lift from row' the outputs stay on for 100 ms until the watchdog trips. This is too short for the arm to rise
against the air above the piston.
"""
TRAY_IN_DOUBT = {"creep", "settle"}
"""Steps in which the tray may have overrun its sensor before the watchdog tripped."""


CREEP_M = 0.003
"""Rise of a lift that was moving down, m, until the air above its piston has reached the cylinder temperature."""

SETTLE_M = 0.0005
"""Descent of a lift that was just moving up, m, until its chambers balance its weight."""


def positions_without_lifts(twin: Twin) -> list[float]:
    """Return the positions of all devices except the lifts."""
    arms = twin.plant.arms.values()
    devices = [(arm.slide.x_m, arm.claws.angle_deg, arm.spreader.travel_m) for arm in arms]
    return [twin.plant.conveyor.belt_m, *(value for device in devices for value in device)]


def lift_heights_m(twin: Twin) -> list[float]:
    """Return the heights of the lifts, m."""
    return [arm.lift.rise_m for arm in twin.plant.arms.values()]


def check_at_rest(twin: Twin, for_ms: int) -> None:
    """Run and check that the machine is in Stopped with all outputs off, and that nothing moves except a lift."""
    before, low_m = positions_without_lifts(twin), lift_heights_m(twin)
    for _ in range(for_ms // SCAN_MS):
        twin.scan()
        assert twin.state is State.STOPPED
        assert not moving_outputs(twin)
    assert positions_without_lifts(twin) == before
    rises_m = [high - low for low, high in zip(low_m, lift_heights_m(twin), strict=True)]
    assert all(-SETTLE_M <= rise_m <= CREEP_M for rise_m in rises_m)


@pytest.mark.parametrize("stop", one_in(3, interrupted(2)))
def test_power_loss_in_every_step(stop: Stop) -> None:
    """After a power loss during a step, nothing moves before X0 is pressed, and the trial can be finished."""
    route = route_to(stop)
    twin = route.travel(stop)
    twin.power_cycle(OFF_MS)
    check_at_rest(twin, for_ms=1_000)
    own = f"{stop.side} loaded"
    in_doubt = questions(twin)
    assert (own in in_doubt) == ((stop.kind, stop.title) in ROW_IN_DOUBT)
    route.restore(twin)
    asked = home_again(twin)
    in_place = stop.side is not None or stop.title == "wait for an empty tray"
    assert asked == in_doubt | ({"tray"} if in_place or stop.title in TRAY_IN_DOUBT else set())
    finish(twin)
    assert twin.plant.counts() == undisturbed(trays=route.trays)
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == route.trays


@cache
def tray_seen_ms() -> int:
    """Return the time at which the edge of the second tray ends the creep step."""
    twin = at_work({"trays_target": 2}, trays=2, parameters=BRISK)
    until_step(twin, "tray feeder", "creep")
    return until_step(twin, "tray feeder", "settle")


@pytest.mark.parametrize(
    ("earlier_ms", "is_seen", "is_in_place"),
    one_in(3, [(200, False, False), (180, True, False), (80, False, True), (40, True, False), (0, True, True)]),
)
def test_power_loss_just_before_the_tray_is_in_place(earlier_ms: int, is_seen: bool, is_in_place: bool) -> None:
    """After a power loss during creep, the tray question is asked if X15 is on when the watchdog stops the belt."""
    twin = at_work({"trays_target": 2}, trays=2, parameters=BRISK)
    twin.run_for(tray_seen_ms() - twin.now_ms - earlier_ms)
    assert twin.in_step("tray feeder", "creep")
    twin.power_cycle(OFF_MS)
    conveyor = twin.plant.conveyor
    assert (conveyor.beam.read(), conveyor.placed_tray is not None) == (is_seen, is_in_place)
    assert home_again(twin) == ({"tray"} if is_seen else set())
    finish(twin)
    assert twin.plant.counts() == undisturbed(trays=2)


@pytest.mark.parametrize("into_ms", one_in(3, [0, 20, 40, 80, 120]))
def test_power_loss_as_the_last_row_leaves_its_tray_counts_the_tray_once(into_ms: int) -> None:
    """If power is lost as the lift leaves its lower limit, the row and the tray are counted at power-up."""
    twin = at_work({"trays_target": 1}, parameters=BRISK)
    rows = [tags_of(twin, side).rows[row] for side in SIDES for row in ROWS]
    lifting = any_of(*(twin.machine.cycles[side]["lift from row"] for side in SIDES))
    last = any_of(*(all_of(*(row.differs(TAKEN) if row is one else row.equals(TAKEN) for row in rows)) for one in rows))
    twin.run_until(all_of(last, lifting), within_ms=90_000, what="the last row is lifted")
    twin.run_for(into_ms)
    twin.power_cycle(OFF_MS)
    assert home_again(twin) == {"tray"}
    finish(twin)
    assert twin.plant.counts() == undisturbed()
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 1


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(60))
def test_power_losses_and_emergency_stops_at_any_moment(seed: int) -> None:
    """Random power losses and emergency stops during two trays do not change the result of the trial."""
    draws = random.Random(f"disturbances {seed}")
    twin = at_work({"trays_target": 2, "converge_at": seed % 2}, trays=2, parameters=BRISK)
    for _ in range(4):
        twin.run_for(draws.randrange(0, 20_000, SCAN_MS))
        if draws.random() < 0.5:
            twin.power_cycle(draws.randrange(200, 5_000))
        else:
            press_emergency_stop(twin)
            clear(twin)
        home_again(twin)
        twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
    assert twin.plant.counts() == undisturbed(trays=2)
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 2
