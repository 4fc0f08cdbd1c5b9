"""Release of a row: the plugs land in the middle of their cups at any chain speed, or the cup is left empty."""

from __future__ import annotations

import pytest

from controller.program.states import State
from controller.program.tags import SIDES, Side
from plant_sim.faults.fault import Fault
from plant_sim.machine.parameters import load_machine
from plant_sim.study.row_motion import MotionWatch
from plant_sim.twin.lock_step import Twin
from plant_sim.twin.recovery import home_again
from tests.plant_sim.twin.routes import finish
from tests.plant_sim.twin.twin_rig import arm_of, at_work, scan_ms, tags_of, to_complete, undisturbed, until_step

MACHINE = load_machine()
LANDING_M = 0.004
"""Largest landing offset: 1.2 mm for two flags, 10 to 20 ms for scans and timers at 90 mm/s, and 0.3 mm of spread."""


def landings_m(per_min: float, *, then_per_min: float | None = None, **set_points: int) -> list[float]:
    """Return the landing offsets of all rows of a tray; the tractor changes its speed after the second throw."""
    parameters = MACHINE.with_values({"cups.planting_frequency_per_min": per_min})
    set_points = {"trays_target": 1, "no_cups": 150, **set_points}
    twin = Twin(trays=1, parameters=parameters, set_points=set_points)
    watch = MotionWatch()

    def change_speed(twin: Twin) -> None:
        if then_per_min is not None and len(watch.rows) == 2:
            twin.plant.planting_frequency_per_min = then_per_min

    twin.watch(watch, devices=())
    twin.watch(change_speed, devices=())
    twin.home(within_ms=60_000)
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=400_000)
    return [row.throw_along_m for row in watch.rows]


@pytest.mark.parametrize("per_min", [15.0, 30.0, 60.0, 90.0])
def test_plugs_land_in_the_middle_at_every_frequency(per_min: float) -> None:
    """The set-points permit 15 cups per minute."""
    offsets_m = landings_m(per_min, cup_time_longest=420)
    assert len(offsets_m) == 6
    assert max(map(abs, offsets_m)) < LANDING_M


@pytest.mark.parametrize(("per_min", "then_per_min"), [(30.0, 60.0), (70.0, 35.0)])
def test_the_release_follows_a_change_of_speed(per_min: float, then_per_min: float) -> None:
    assert max(map(abs, landings_m(per_min, then_per_min=then_per_min))) < LANDING_M


def waiting(set_points: dict[str, int] | None = None, per_min: float = 45.0) -> Twin:
    """Return a machine whose left arm has twelve empty cups and enters the release delay with the next one."""
    parameters = MACHINE.with_values({"cups.planting_frequency_per_min": per_min})
    twin = at_work({"trays_target": 1, **(set_points or {})}, parameters=parameters)
    until_step(twin, "left arm", "approach row")
    until_step(twin, "left arm", "release delay", within_ms=60_000)
    return twin


@pytest.mark.parametrize("per_min", [22.0, 30.0])
def test_a_counter_that_fails_during_a_flag_causes_no_throw(per_min: float) -> None:
    """The flag appears to be short, so the cup is left empty; after the repair, no seedling is lost."""
    twin = waiting(per_min=per_min)
    twin.run_for(round(0.6 * 0.2 * 60_000 / per_min))
    arm_of(twin, "left").cups.pulse.stuck = False
    until_step(twin, "left arm", "wait for cups", within_ms=200)
    twin.run_for(800)
    arm_of(twin, "left").cups.pulse.stuck = None
    assert to_complete(twin, within_ms=900_000) == undisturbed()


@pytest.mark.parametrize("side", SIDES)
def test_a_chain_that_stops_in_the_flag_causes_no_throw(side: str) -> None:
    """The flag takes longer than the one before, so the cup is left empty; the machine is suspended, and goes on."""
    twin = at_work({"trays_target": 1})
    until_step(twin, f"{side} arm", "approach row")
    until_step(twin, f"{side} arm", "release delay", within_ms=60_000)
    for arm in twin.plant.arms.values():
        arm.cups.jammed = True
    until_step(twin, f"{side} arm", "wait for cups", within_ms=1_000)
    twin.run_until_state(State.SUSPENDED, within_ms=6_000)
    twin.run_for(20_000)
    for arm in twin.plant.arms.values():
        arm.cups.jammed = False
    assert to_complete(twin) == undisturbed()
    assert twin.alarm_events() == []


def test_a_cup_left_empty_is_counted_as_missed_and_the_next_one_is_used() -> None:
    twin = waiting()
    arm = tags_of(twin, "left")
    missed = twin.plc.read(arm.missed_cups)
    arm_of(twin, "left").cups.pulse.stuck = False
    twin.run_for(100)
    arm_of(twin, "left").cups.pulse.stuck = None
    began_ms = until_step(twin, "left arm", "wait for cups", within_ms=200)
    assert until_step(twin, "left arm", "open claws", within_ms=6_000) - began_ms > 1_000
    assert twin.plc.read(arm.missed_cups) > missed


@pytest.mark.parametrize(("lead", "expected_ms"), [(0, 533), (25, 283), (40, 133)])
def test_the_claws_open_at_two_flags_less_the_lead(lead: int, expected_ms: int) -> None:
    """At 45 cups/min two flags take 533 ms; with a lead longer than a flag, half the gap times the release."""
    twin = waiting({"release_lead": lead})
    began_ms = scan_ms(twin)
    opened_ms = until_step(twin, "left arm", "open claws", within_ms=1_000)
    assert abs(opened_ms - began_ms - expected_ms) <= 40


@pytest.mark.parametrize("fixed", [1, 6, 100])
def test_a_release_delay_that_is_set_replaces_the_measured_one(fixed: int) -> None:
    twin = waiting({"release_delay": fixed})
    began_ms = scan_ms(twin)
    assert until_step(twin, "left arm", "open claws", within_ms=2_000) - began_ms in range(10 * fixed, 10 * fixed + 20)


@pytest.mark.parametrize("kind", ["missed_pulses", "doubled_pulses"])
def test_flags_counted_wrongly_hold_the_machine_without_a_loss(kind: str) -> None:
    twin = Twin(trays=1, faults=[Fault(kind, f"{side}.cup_pulse", 30_000, size=0.2) for side in SIDES])
    twin.plant.seedlings.make_typical()
    twin.home()
    twin.start()
    twin.run_until_state(State.HELD, within_ms=120_000)
    assert (twin.plant.counts().T, twin.plant.events) == (0, [])


def test_an_alarm_of_the_cups_in_the_release_delay_prevents_the_throw() -> None:
    twin = waiting()
    twin.plc.write(twin.machine.alarms.cups_implausible, 1)
    until_step(twin, "left arm", "wait for cups", within_ms=100)
    twin.run_until_state(State.HELD, within_ms=10_000)
    assert arm_of(twin, "left").grip.held


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("switch", ["claws_spread", "lift_down", "slide_at_feed"])
def test_claws_that_may_not_open_in_time_do_not_open_later(side: Side, switch: str) -> None:
    """A switch fails for 0.3 s as the release is due: later the plugs would fall between cups, or onto other plugs."""
    twin = at_work({"trays_target": 1})
    until_step(twin, f"{side} arm", "approach row")
    until_step(twin, f"{side} arm", "release delay", within_ms=60_000)
    twin.run_for(200)
    sensor = arm_of(twin, side).sensors[switch]
    sensor.stuck = False
    until_step(twin, f"{side} arm", "open claws", within_ms=2_000)
    twin.run_for(300)
    sensor.stuck = None
    twin.run_until_state(State.HELD, within_ms=10_000)
    assert twin.alarms() == [f"{side}: open claws"]
    assert len(arm_of(twin, side).grip.held) == 12
    home_again(twin)
    finish(twin)
    assert twin.plant.counts() == undisturbed()
