"""Loss of power in every step: it comes back without moving anything, asks what it cannot know, and goes on."""

from __future__ import annotations

import random
from functools import cache

import pytest
from routes import BRISK, STOPS, Stop, finish, route_to
from twin_rig import at_work, tags_of, undisturbed, until_step

from controller.program.states import State
from controller.program.tags import ROWS, SIDES, TAKEN
from plant_sim.bench.recovery import clear, home_again, press_emergency_stop, questions
from plant_sim.bench.twin import SCAN_MS, Twin

OFF_MS = 1_000
ROW_IN_DOUBT = {
    ("arm", "close claws"),
    ("arm", "lift from row"),
    ("homing", "lower to put back"),
    ("homing", "put back"),
    ("homing", "decide"),
}
"""Steps between clamping and leaving the row (and the one that waits for the answer). In 'lift from row' the outputs
stay on until the watchdog has acted, 100 ms: too short for the air above the piston to let the arm rise."""
TRAY_IN_DOUBT = {"creep", "settle"}
"""Steps in which the tray may have come too far under its sensor before the watchdog acted."""


CREEP_M = 0.003
"""What a lift that was on its way down rises until the air above its piston is as warm as the cylinder."""


def whereabouts(twin: Twin) -> list[float]:
    """Return where everything is but the lifts."""
    arms = twin.plant.arms.values()
    devices = [(arm.slide.x_m, arm.claws.angle_deg, arm.spreader.travel_m) for arm in arms]
    return [twin.plant.conveyor.belt_m, *(value for device in devices for value in device)]


def rises_m(twin: Twin) -> list[float]:
    """Return how high the lifts are, m."""
    return [arm.lift.rise_m for arm in twin.plant.arms.values()]


def rests(twin: Twin, for_ms: int) -> None:
    """Run for a time in which the machine is in Stopped, no output is on and nothing moves but warm air a lift."""
    before, low_m = whereabouts(twin), rises_m(twin)
    for _ in range(for_ms // SCAN_MS):
        twin.scan()
        assert twin.state is State.STOPPED
        assert not twin.outputs()
    assert whereabouts(twin) == before
    assert all(low <= high <= low + CREEP_M for low, high in zip(low_m, rises_m(twin), strict=True))


@pytest.mark.parametrize("stop", STOPS, ids=str)
def test_power_loss_in_every_step(stop: Stop) -> None:
    """Given a step under way, when the power goes and comes, nothing moves before X0, and the trial is finished."""
    route = route_to(stop)
    twin = route.travel(stop)
    twin.power_cycle(OFF_MS)
    rests(twin, for_ms=1_000)
    own = f"{stop.side} loaded"
    in_doubt = questions(twin)
    assert (own in in_doubt) == ((stop.kind, stop.title) in ROW_IN_DOUBT)
    route.mend(twin)
    asked = home_again(twin)
    assert asked == in_doubt | ({"tray"} if stop.title in TRAY_IN_DOUBT and stop.side is None else set())
    finish(twin)
    assert twin.plant.counts() == undisturbed(trays=route.trays)
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == route.trays


@cache
def tray_seen_ms() -> int:
    """Return the time at which the second tray's edge ends the creeping."""
    twin = at_work({"trays_target": 2}, trays=2, parameters=BRISK)
    until_step(twin, "tray feeder", "creep")
    return until_step(twin, "tray feeder", "settle")


@pytest.mark.parametrize(
    ("earlier_ms", "is_seen", "is_in_place"),
    [(200, False, False), (180, True, False), (80, False, True), (40, True, False), (0, True, True)],
)
def test_power_loss_just_before_the_tray_is_in_place(earlier_ms: int, is_seen: bool, is_in_place: bool) -> None:
    """Given a creeping tray, when the power goes, its drive runs until the watchdog acts: the operator must look."""
    twin = at_work({"trays_target": 2}, trays=2, parameters=BRISK)
    twin.run_for(tray_seen_ms() - twin.now_ms - earlier_ms)
    assert twin.in_step("tray feeder", "creep")
    twin.power_cycle(OFF_MS)
    conveyor = twin.plant.conveyor
    assert (conveyor.beam.read(), conveyor.placed_tray is not None) == (is_seen, is_in_place)
    assert home_again(twin) == ({"tray"} if is_seen else set())
    finish(twin)
    assert twin.plant.counts() == undisturbed(trays=2)


@pytest.mark.parametrize("into_ms", [0, 20, 40, 80, 120])
def test_power_loss_as_the_last_row_leaves_its_tray_counts_the_tray_once(into_ms: int) -> None:
    """Given the lift about to leave its lower limit, when the power goes, row and tray are counted when it is back."""
    twin = at_work({"trays_target": 1}, parameters=BRISK)
    rows = [tags_of(twin, side).rows[row] for side in SIDES for row in ROWS]
    lifting = [twin.machine.cycles[side]["lift from row"] for side in SIDES]
    twin.run_until(
        lambda: sum(twin.plc.read(row) != TAKEN for row in rows) == 1 and any(map(twin.plc.read, lifting)),
        within_ms=90_000,
        what="the last row is lifted",
    )
    twin.run_for(into_ms)
    twin.power_cycle(OFF_MS)
    assert home_again(twin) == set()
    finish(twin)
    assert twin.plant.counts() == undisturbed()
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == 1


@pytest.mark.nightly
@pytest.mark.parametrize("seed", range(60))
def test_power_losses_and_emergency_stops_at_any_moment(seed: int) -> None:
    """Given two trays, when power loss and emergency stop come at any moments, the trial is finished as without."""
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
