"""Emergency stop in every step: motion stops immediately, the stop is latched, and work resumes without losses.

In every scenario a monitor checks that no coil is on in the scan that reads the button.
"""

from __future__ import annotations

from collections.abc import Collection

import pytest

from controller.events.kinds import StateEvent
from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.twin.lock_step import SCAN_MS, Twin
from plant_sim.twin.recovery import clear, home_again, press_emergency_stop
from tests.plant_sim.twin.routes import BRISK, Route, Stop, finish, interrupted, route_to, run_to
from tests.plant_sim.twin.twin_rig import arm_of, moving_outputs, switched_on, tags_of, undisturbed
from tests.sampling import one_in

SEEN_MS = 2 * SCAN_MS
"""Delay of the input filter, ms: X25 is accepted after 10 ms, in the second scan."""
AT_SPEED_M_S = 0.05
STARTS_MS = 2_000
"""Longest start delay of a cylinder, ms: the air in front of its piston vents through the throttle."""
STOPS_M = {"slide": 0.008, "lift": 0.018, "belt": 0.004}
"""Maximum stopping distances after loss of coil power, m: valve and tube, then brake, check valves or motor.

The values, which are stated in docs/physics.md, apply to 600 mm row spacing and 0.5 MPa.
"""
CREEP_M = 0.003
"""Rise of a lift that was moving down, m, until the air above its piston has reached the cylinder temperature."""
SINKS_M = 0.0005
"""Sinking of a lift that was driven up, m, until the air below its piston has cooled to the cylinder temperature.

At most 0.46 mm in stops at every 0.1 s of every step that raises a lift; it ends within 4 s.
"""
ROUNDING_M = 1e-9

Positions = dict[str, float]


def positions(twin: Twin) -> Positions:
    """Return the positions of all moving devices, m."""
    found = {"tray": twin.plant.conveyor.belt_m}
    for side, arm in twin.plant.arms.items():
        found |= {f"{side} slide": arm.slide.x_m, f"{side} lift": arm.lift.y_m, f"{side} belt": arm.spreader.travel_m}
    return found


def stopping_distances() -> Positions:
    """Return the maximum stopping distance of each device after the button is pressed, m."""
    conveyor = BRISK.conveyor
    ramp_m = conveyor.speed_m_s**2 / (2 * conveyor.acceleration_m_s2)
    found = {"tray": ramp_m + conveyor.cycle_m / 4}  # the rotor settles within one step of the command
    return found | {f"{side} {device}": stops_m for side in SIDES for device, stops_m in STOPS_M.items()}


def is_at_rest_except_warm_lift(before: Positions, after: Positions, rising: Collection[str]) -> bool:
    """Return True if nothing has moved, except for a lift by a little while the temperature of its air settles.

    Args:
        before: Positions, m.
        after: Later positions, m.
        rising: Names of the lifts that were driven up when the button was pressed; only these may sink.
    """
    raised_m = {name: before[name] - after[name] for name in before}
    lifts = {f"{side} lift" for side in SIDES}
    return all(
        -(SINKS_M if name in rising else 0) - ROUNDING_M
        <= raised_m[name]
        <= (CREEP_M if name in lifts else 0) + ROUNDING_M
        for name in before
    )


def speed_m_s(twin: Twin, side: Side | None) -> float:
    """Return the speed of the fastest device of an arm, or the speed of the tray."""
    if side is None:
        return abs(twin.plant.conveyor.speed_m_s)
    arm = arm_of(twin, side)
    return max(abs(device.speed_m_s) for device in (arm.slide, arm.lift, arm.spreader))


def holds(twin: Twin) -> dict[str, list[int]]:
    """Return the numbers of the claws that hold a seedling, for each arm whose claws are not opening."""
    return {
        side: [seedling.along for seedling in arm_of(twin, side).grip.held]
        for side in SIDES
        if f"{side}.claws_open" not in twin.outputs()
    }


def states(twin: Twin, since: int) -> list[State]:
    """Return the states entered after the first `since` events."""
    return [State(event.state) for event in twin.events[since:] if isinstance(event, StateEvent)]


def check_trial(twin: Twin, route: Route, side: Side, *, discarded: bool) -> None:
    """Check the seedling counts against an undisturbed trial, and that each tray and each row was counted once."""
    counts, wanted = twin.plant.counts(), undisturbed(trays=route.trays)
    if route.loosens:
        assert wanted.P + 10 <= counts.P <= wanted.P + 12
        assert counts.in_tray == counts.in_claw == 0
    elif discarded:
        assert (counts.P, counts.D, counts.in_cups + counts.T) == (wanted.P, wanted.D, wanted.in_cups + wanted.T)
    else:
        assert counts == wanted
    assert twin.plc.read(twin.machine.tags.machine.trays_done) == route.trays
    for each in SIDES:
        thrown = 3 * route.trays - (discarded and each == side)
        assert twin.plc.read(tags_of(twin, each).cycles) == thrown


@pytest.mark.parametrize("stop", one_in(2, interrupted(1)))
def test_emergency_stop_in_every_step(stop: Stop) -> None:
    """If the button is pressed during a step, all motion stops, the stop is latched, and the trial can be finished."""
    route = route_to(stop)
    twin = route.travel(stop)
    if stop.step.watch is not None and not stop.works_claws:
        twin.run_until(lambda: speed_m_s(twin, stop.side) > AT_SPEED_M_S, within_ms=STARTS_MS, what="at speed")
        assert twin.in_step(stop.sequence, stop.title)
    before, held, since = positions(twin), holds(twin), len(twin.events)
    rising = {f"{side} lift" for side in SIDES if f"{side}.lift_retract" in twin.outputs()}

    twin.plant.box.emergency_stop = True
    twin.run_for(SEEN_MS)
    assert states(twin, since) == [State.ABORTING]
    twin.run_for(1_000)
    assert states(twin, since) == [State.ABORTING, State.ABORTED]
    at_rest, limits = positions(twin), stopping_distances()
    moved = {name: abs(at_rest[name] - before[name]) for name in before}
    assert all(moved[name] <= limits[name] + ROUNDING_M for name in before), moved
    assert twin.alarms() == ["emergency_stop"]

    twin.run_for(1_000)
    twin.plant.box.emergency_stop = False
    twin.run_for(3_000)
    assert states(twin, since) == [State.ABORTING, State.ABORTED]
    assert is_at_rest_except_warm_lift(at_rest, positions(twin), rising)
    assert {side: holds(twin)[side] for side in held} == held

    clear(twin)
    assert is_at_rest_except_warm_lift(at_rest, positions(twin), rising)
    route.restore(twin)
    home_again(twin)
    finish(twin)
    check_trial(twin, route, stop.side or "left", discarded=route.discards)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("into_ms", [0, 10, 30, 100, 190])
def test_a_plug_that_is_already_falling_lands_in_its_cup(side: Side, into_ms: int) -> None:
    """If the button is pressed as the claws open, they open fully or not at all; no plug is lost or counted twice."""
    route = Route()
    twin = switched_on({"trays_target": 1}, parameters=BRISK)
    run_to("open claws")(twin, side)
    in_cups = twin.plant.counts().in_cups
    held = len(arm_of(twin, side).grip.held)
    twin.run_for(into_ms)
    press_emergency_stop(twin)
    has_fallen = not arm_of(twin, side).grip.held
    assert has_fallen == (into_ms >= 10)  # one scan is too short for the valve, 15 ms; two are not
    assert twin.plant.counts().in_cups - in_cups in (range(held - 2, held + 1) if has_fallen else [0])
    clear(twin)
    home_again(twin)
    finish(twin)
    check_trial(twin, route, side, discarded=False)


@pytest.mark.parametrize("state", [State.STOPPED, State.IDLE, State.COMPLETE])
def test_an_emergency_stop_at_rest_is_also_latched(state: State) -> None:
    twin = switched_on({"trays_target": 1}, parameters=BRISK)
    if state is not State.STOPPED:
        twin.home()
    if state is State.COMPLETE:
        finish(twin)
    assert twin.state is state
    since = len(twin.events)
    press_emergency_stop(twin, for_ms=100)
    twin.plant.box.emergency_stop = False
    for button in ("start", "stop"):
        twin.press(button)
        twin.run_for(1_000)
    assert states(twin, since) == [State.ABORTING, State.ABORTED]


def test_an_emergency_stop_pressed_at_power_up() -> None:
    """If the button is latched at power-up, the machine is in Aborted and X0 does not home it."""
    twin = switched_on({"trays_target": 1}, parameters=BRISK)
    twin.home()
    twin.plant.box.emergency_stop = True
    twin.power_cycle()
    twin.run_for(50)
    assert twin.state is State.ABORTED
    twin.press("start")
    twin.run_for(500)
    assert twin.state is State.ABORTED
    assert not moving_outputs(twin)
    clear(twin)
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()
