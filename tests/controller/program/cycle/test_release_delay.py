"""Release delay: the plugs land in the middle of their cups at any chain speed."""

from __future__ import annotations

import pytest

from controller.program.states import State
from controller.program.tags import SIDES
from plant_sim.faults.fault import Fault
from plant_sim.machine.parameters import load_machine
from plant_sim.study.row_motion import MotionWatch
from plant_sim.twin.lock_step import Twin
from tests.plant_sim.twin.twin_rig import arm_of, at_work, to_complete

MACHINE = load_machine()
LANDING_M = 0.0018
"""Largest landing offset: 0.6 mm for the flag, 10 ms for the timers at 90 mm/s, and 0.3 mm of spread."""


def landings_m(per_min: float, *, then_per_min: float | None = None, faults: tuple[Fault, ...] = ()) -> list[float]:
    """Return the landing offsets of all rows of a tray; the tractor changes its speed after the second throw."""
    parameters = MACHINE.with_values({"cups.planting_frequency_per_min": per_min})
    twin = Twin(trays=1, parameters=parameters, set_points={"trays_target": 1, "no_cups": 150}, faults=faults)
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
    offsets_m = landings_m(per_min)
    assert len(offsets_m) == 6
    assert max(map(abs, offsets_m)) < LANDING_M


@pytest.mark.parametrize(("per_min", "then_per_min"), [(30.0, 60.0), (70.0, 35.0)])
def test_the_release_follows_a_change_of_speed(per_min: float, then_per_min: float) -> None:
    assert max(map(abs, landings_m(per_min, then_per_min=then_per_min))) < LANDING_M


@pytest.mark.parametrize("kind", ["missed_pulses", "doubled_pulses"])
def test_flags_counted_wrongly_do_not_change_the_delay(kind: str) -> None:
    """If a fifth of the flags is missed or counted twice, plugs land in the middle of a cup or half a pitch away."""
    faults = tuple(Fault(kind, f"{side}.cup_pulse", size=0.2) for side in SIDES)
    half_m = MACHINE.cups.pitch_m / 2
    for off_m in landings_m(45.0, faults=faults):
        assert min(abs(off_m), half_m - abs(off_m)) < LANDING_M


def test_a_sensor_that_fails_during_a_flag_does_not_shorten_the_delay() -> None:
    twin = at_work({"trays_target": 1})
    delay = twin.machine.tags.machine.release_delay
    pulse = arm_of(twin, "left").cups.pulse
    twin.run_for(5_000)
    twin.run_until(lambda: not pulse.read(), within_ms=10_000)
    twin.run_until(pulse.read, within_ms=10_000)
    twin.run_for(50)  # the time of the last flag becomes valid
    before = twin.plc.read(delay)
    twin.run_for(350)
    pulse.stuck = False
    twin.run_for(1_000)
    assert twin.plc.read(twin.machine.tags.machine.flag_time) < before - 5, "the flag was cut short"
    assert twin.plc.read(delay) == before


def test_a_flag_at_which_the_chain_stands_does_not_change_the_delay() -> None:
    twin = at_work({"trays_target": 1})
    flag_time = twin.machine.tags.machine.flag_time
    pulse = arm_of(twin, "left").cups.pulse
    twin.run_until(pulse.read, within_ms=10_000)
    twin.run_until(lambda: not pulse.read(), within_ms=10_000)
    twin.run_for(50)
    before = twin.plc.read(flag_time)
    twin.run_until(pulse.read, within_ms=10_000)
    twin.plant.planting_frequency_per_min = 0.0
    twin.run_for(10_000)
    assert pulse.read(), "the chain is stopped at the flag"
    twin.plant.planting_frequency_per_min = 45.0
    twin.run_until(lambda: not pulse.read(), within_ms=10_000)
    twin.run_for(100)
    assert twin.plc.read(flag_time) == before
    to_complete(twin)


@pytest.mark.parametrize(("lead", "expected"), [(0, 53), (25, 28), (53, 0)])
def test_the_delay_is_the_time_of_the_flag_less_the_lead(lead: int, expected: int) -> None:
    """At 45 cups/min a flag takes 533 ms; without a lead, the delay is this time in units of 10 ms."""
    twin = at_work({"trays_target": 1, "release_lead": lead})
    assert abs(measured(twin, 5_000) - expected) <= 1


def test_until_the_first_flag_the_delay_is_that_of_45_plants_per_minute() -> None:
    """The tractor is stationary at power-up."""
    parameters = MACHINE.with_values({"cups.planting_frequency_per_min": 0.0})
    assert measured(Twin(parameters=parameters), 3_000) == 28


@pytest.mark.parametrize("fixed", [1, 6, 100])
def test_a_release_delay_that_is_set_replaces_the_measured_one(fixed: int) -> None:
    assert measured(at_work({"trays_target": 1, "release_delay": fixed}), 5_000) == fixed


def measured(twin: Twin, after_ms: int) -> int:
    """Return the release delay after a given time, in units of 10 ms."""
    twin.run_for(after_ms)
    return twin.plc.read(twin.machine.tags.machine.release_delay)
