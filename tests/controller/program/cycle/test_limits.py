"""Step time limits: if one expires, the alarm of the step is raised, its arm stops, and the other arm moves to feed.

No seedling is lost. The limits are read from the declared sequences; a step that is not reached fails the test.
"""

from __future__ import annotations

import inspect

import pytest

from controller.events.kinds import StateEvent
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.alarms.table import Alarm
from controller.program.machine import build
from controller.program.states import State
from controller.program.tags import DEVICES, SIDES, Side
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again
from tests.paths import ROOT
from tests.plant_sim.twin.routes import STOPS, Stop, finish, route_to, sampled
from tests.plant_sim.twin.twin_rig import (
    ALARM,
    MACHINE,
    ChangeRecorder,
    Device,
    arm_of,
    at_initial_state,
    at_work,
    free,
    go_on,
    is_parked_loaded,
    moving_outputs,
    other_side,
    scan_ms,
    switched_on,
    to_complete,
    undisturbed,
    until_picking,
    until_step,
)
from tests.sampling import one_in

TICK_MS = 100
"""Tick of a limit timer, ms; a limit may expire up to one tick early."""
PUSH_M = 0.008
"""Displacement out of the switch band of a row (5 mm, 1 mm hysteresis) that does not reach the next row (43 mm), m."""


WATCHED = [stop for stop in STOPS if stop.step.watch and not stop.works_claws]
"""Declared steps with a time limit that are ended by a sensor; test_disturbances.py covers the claw steps."""


def actuator(twin: Twin, stop: Stop) -> Device:
    """Return the device that the first output of a step moves; a second output may hold the lift up."""
    if stop.side is None:
        return twin.plant.conveyor
    arm = arm_of(twin, stop.side)
    request = stop.step.hold[0]
    devices: dict[str, Device] = {
        "slide_inward": arm.slide,
        "slide_outward": arm.slide,
        "lift_extend": arm.lift,
        "lift_retract": arm.lift,
        "spread": arm.spreader,
        "converge": arm.spreader,
    }
    return devices[request.name.removeprefix(f"{stop.side}.want ")]


def coils_of(twin: Twin, side: Side | None) -> set[str]:
    """Return the active outputs of an arm, or of the feeder."""
    return {tag for tag in twin.outputs() if tag.startswith(f"{side}." if side else "tray_")}


def is_at_rest_at_feed(twin: Twin, side: Side) -> bool:
    """Return True if an arm is at rest at feed: raised if it holds or may hold a row, otherwise at home."""
    loaded = twin.plc.read(twin.machine.tags.arms[side].loaded)
    return is_up_at_feed(twin, side) if loaded else at_initial_state(twin, side)


def is_up_at_feed(twin: Twin, side: Side) -> bool:
    sensors = arm_of(twin, side).sensors
    return sensors["slide_at_feed"].read() and sensors["lift_up"].read()


@pytest.mark.parametrize("stop", one_in(3, sampled(WATCHED, 0, of=4)))
def test_a_jam_raises_the_alarm_of_its_step_and_the_trial_can_be_finished(stop: Stop) -> None:
    """If an actuator jams as its step begins, its arm stops with an alarm; after repair the trial can be finished."""
    assert stop.step.watch is not None
    limit_ms, alarm = stop.step.watch.ms, stop.step.watch.alarm
    route = route_to(stop)
    twin = route.travel(stop)
    began_ms, end = scan_ms(twin), State.STOPPED if twin.state == State.STOPPING else State.HELD
    device = actuator(twin, stop)
    device.jammed = True
    twin.run_for(limit_ms - TICK_MS - began_ms % TICK_MS)
    assert twin.alarms() == [], "too early"
    twin.run_until(ALARM, within_ms=2 * TICK_MS)
    assert limit_ms - TICK_MS <= scan_ms(twin) - began_ms <= limit_ms
    assert twin.plc.annunciators() == [alarm.number]

    def at_rest() -> bool:
        assert coils_of(twin, stop.side) == set(), twin.situation()
        return twin.state == end

    twin.run_until(at_rest, within_ms=15_000, what=end.name)
    twin.run_for(3_000)
    assert (twin.state, twin.plc.annunciators(), moving_outputs(twin)) == (end, [alarm.number], set())
    for side in SIDES:
        assert side == stop.side or is_at_rest_at_feed(twin, side), twin.situation()
    free(device)
    route.restore(twin)
    aborted = any(isinstance(event, StateEvent) and event.state == State.ABORTED for event in twin.events)
    assert home_again(twin) == ({"tray"} if aborted or device is twin.plant.conveyor else set())
    assert twin.alarms() == []
    finish(twin)
    counts = twin.plant.counts()
    assert counts.in_tray == counts.in_claw == 0
    assert route.discards or route.loosens or counts == undisturbed(trays=route.trays)


@pytest.mark.parametrize(
    ("left_late_until", "step", "never"),
    [("lift from row", "slide to feed", "spread"), ("slide to feed", "wait to lower", "lift_extend")],
)
def test_no_arm_starts_a_release_while_holding(left_late_until: str, step: str, never: str) -> None:
    """After an alarm in Execute, the right arm neither spreads a row at feed nor lowers a spread row."""
    twin = at_work({"trays_target": 1, "descend_at_count": 9})
    until_picking(twin, "right", 1)
    slide = arm_of(twin, "left").slide
    slide.jammed = True
    until_step(twin, "right arm", left_late_until)
    free(slide)
    until_step(twin, "right arm", step)
    beam = twin.plant.conveyor.beam
    beam.stuck = False
    twin.run_until_state(State.HOLDING, within_ms=1_000)
    outputs = ChangeRecorder.of_outputs(twin)
    assert twin.run_until_state(State.HELD, within_ms=10_000) >= 1_000
    assert is_parked_loaded(twin, "right")
    assert outputs.of(f"right.{never}") == []
    beam.stuck = None
    assert home_again(twin) == {"tray"}
    twin.start()
    assert to_complete(twin) == undisturbed()


# overrun


def in_row_1(side: Side, step: str) -> Twin:
    """Return a machine whose arm on this side is in this step of its first row."""
    twin = at_work({"trays_target": 1})
    until_picking(twin, side, 1)
    until_step(twin, f"{side} arm", step)
    return twin


def push(twin: Twin, side: Side) -> None:
    arm = arm_of(twin, side)
    arm.place(x_m=arm.slide.x_m + PUSH_M)


@pytest.mark.parametrize("side", SIDES)
def test_a_slide_past_its_row_is_brought_back_once_per_row(side: Side) -> None:
    twin = at_work({"trays_target": 1})
    for row in (1, 2):
        until_picking(twin, side, row)
        until_step(twin, f"{side} arm", "settle at row")
        push(twin, side)
        returning_ms = until_step(twin, f"{side} arm", "return to row", within_ms=100)
        # 12 mm minus the 5 mm switch band; the air in front of the piston vents while the slide accelerates
        assert 200 <= until_step(twin, f"{side} arm", "settle at row", within_ms=1_000) - returning_ms <= 500
        until_step(twin, f"{side} arm", "close claws", within_ms=200)
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []


@pytest.mark.parametrize("side", SIDES)
def test_a_slide_past_its_row_a_second_time_is_an_overrun(side: Side) -> None:
    twin = in_row_1(side, "settle at row")
    push(twin, side)
    until_step(twin, f"{side} arm", "return to row", within_ms=100)
    until_step(twin, f"{side} arm", "settle at row", within_ms=1_000)
    push(twin, side)
    twin.run_until(ALARM, within_ms=100)
    assert twin.alarms() == [f"{side}: overrun"]
    twin.run_until_state(State.HELD, within_ms=15_000)
    assert twin.alarms() == [f"{side}: overrun"]
    assert is_parked_loaded(twin, other_side(side)) or at_initial_state(twin, other_side(side))
    go_on(twin)
    assert to_complete(twin) == undisturbed()


def test_a_slide_that_cannot_stop_in_its_row_overruns_it_twice() -> None:
    """Without its brake the slide coasts 17 mm instead of 6 mm and overruns its row, first inward and then outward."""
    twin = at_work({"trays_target": 1}, parameters=MACHINE.with_values({"slide.brake_n": 0.0}))
    twin.run_until(ALARM, within_ms=30_000)
    assert twin.alarms() == ["right: overrun"]
    assert twin.plant.counts() == switched_on().plant.counts(), "no seedling was touched"


@pytest.mark.parametrize("side", SIDES)
def test_a_row_lost_while_clamping_is_an_overrun_and_the_row_stays_full(side: Side) -> None:
    twin = in_row_1(side, "close claws")
    switch = arm_of(twin, side).slide.at_pick[0]
    switch.stuck = False
    assert twin.run_until(ALARM, within_ms=100) <= 40
    assert twin.alarms() == [f"{side}: overrun"]
    twin.run_until_state(State.HELD, within_ms=15_000)
    switch.stuck = None
    go_on(twin)
    assert to_complete(twin) == undisturbed()


# tray alarms


def test_a_lost_tray_is_an_alarm_after_half_a_second_and_a_flicker_is_not() -> None:
    twin = in_row_1("left", "wait for cups")
    beam = twin.plant.conveyor.beam
    beam.stuck = False
    twin.run_for(300)
    beam.stuck = None
    twin.run_for(1_000)
    assert twin.alarm_events() == []
    beam.stuck = False
    took_ms = twin.run_until(ALARM, within_ms=1_000)
    assert 400 <= took_ms - 20 <= 510
    twin.run_until_state(State.HELD, within_ms=5_000)
    assert twin.alarms() == ["tray_lost"]
    assert all(is_parked_loaded(twin, side) for side in SIDES)
    beam.stuck = None
    assert home_again(twin) == {"tray"}
    twin.start()
    assert to_complete(twin) == undisturbed()


LISTED = (*range(900, 972), *range(990, 993))
"""S numbers to which the list below applies; alarms and warnings of new devices take the numbers after them."""


@pytest.fixture
def other_alarms() -> list[Alarm]:
    """Return the alarms that are not raised by a time limit."""
    limits = {stop.step.watch.alarm for stop in STOPS if stop.step.watch}
    return [alarm for alarm in build(load_io_map(DEFAULT_IO_MAP)).alarms if alarm.bit not in limits]


def test_the_alarms_other_than_time_limits_are_known(other_alarms: list[Alarm]) -> None:
    """The list contains every alarm that is not raised by a time limit; other tests cover these alarms."""
    assert {alarm.key for alarm in other_alarms if alarm.bit.number in LISTED} == {
        "emergency_stop",
        "link_lost",
        "scan_fault",
        "store_fault",
        "memory_lost",
        "air_low",
        "tray_lost",
        "magazine_empty",
        "overrun",
        "off home",
        "stop_stuck",
        "lift switches",
        "slide switches",
        "belt switches",
        "unbidden",
        "cup counts",
        "hmi_silent",
    }


def test_every_other_alarm_has_a_test_of_its_own(other_alarms: list[Alarm]) -> None:
    """A string in another test contains the key of each alarm that is not raised by a time limit."""
    own = inspect.getsource(test_the_alarms_other_than_time_limits_are_known)
    tests = "".join(path.read_text(encoding="utf-8").replace(own, "") for path in (ROOT / "tests").rglob("test_*.py"))
    named = "".join(tests.replace("{device}", device) for device in DEVICES)
    assert [alarm.key for alarm in other_alarms if f'{alarm.key}"' not in named] == []
