"""Claw pressure switch, seedling beam and cup sensor: each reports what it can see, and nothing else."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from controller.core.expr import Bit
from controller.program.states import State
from plant_sim.common.limits import SpecError
from plant_sim.devices.yield_sensors import (
    BEAM,
    BEAM_PARAMS,
    CLAW_PRESSURE,
    CLAW_PRESSURE_PARAMS,
    CUP_SENSOR,
    CUP_SENSOR_PARAMS,
    ClawPressureSwitch,
    CupSensor,
    SeedlingBeam,
    step_beam,
    step_claw_pressure,
    step_cup_sensor,
)
from plant_sim.machine.parameters import load_machine
from plant_sim.twin.lock_step import Twin
from tests.sampling import first_of
from tests.wiring import DELIVERED, YIELD, wired

MACHINE = load_machine()
SPEC = MACHINE.yield_sensors
PITCH_M, CLAWS, LAST_CLAW_M = 0.06, 12, 0.66
LOOK_S = 0.01
CUPS_READ = 300
"""Cups whose wrong readings are counted; the tolerance follows from this number."""


def rising(levels: list[bool]) -> int:
    return sum(now and not before for before, now in zip([False, *levels], levels, strict=False))


def records(state: np.dtype[Any], params: np.dtype[Any]) -> tuple[Any, Any]:
    """Return the records of a sensor of its own."""
    return np.zeros(1, state)[0], np.zeros(1, params)[0]


def pressure_switch() -> ClawPressureSwitch:
    return ClawPressureSwitch(SPEC, "claws", *records(CLAW_PRESSURE, CLAW_PRESSURE_PARAMS), set_pa=400e3)


def free_beam() -> SeedlingBeam:
    return SeedlingBeam(SPEC, "beam", *records(BEAM, BEAM_PARAMS), claws=CLAWS)


def cup_sensor() -> CupSensor:
    cups = records(CUP_SENSOR, CUP_SENSOR_PARAMS)
    return CupSensor(SPEC, "cups", *cups, last_claw_m=LAST_CLAW_M, pitch_m=PITCH_M)


def follow_pressure(switch: ClawPressureSwitch, gauge_pa: float, now_s: float) -> bool:
    step_claw_pressure(switch.state, switch.params, gauge_pa, now_s)
    return switch.sensor.read()


def follow_slide(beam: SeedlingBeam, x_m: float, rise_m: float, now_s: float) -> bool:
    step_beam(beam.state, beam.params, x_m, rise_m, now_s)
    return beam.sensor.read()


def follow_chain(sensor: CupSensor, chain_m: float, speed_m_s: float, filled: Collection[int], now_s: float) -> bool:
    """Return the output after a look at a chain of which only the 25 cups near the sensor are known, as in a row."""
    last = round((chain_m - LAST_CLAW_M) / PITCH_M)
    sensor.fill(cup for cup in range(last - 12, last + 13) if cup in filled)
    step_cup_sensor(sensor.state, sensor.params, chain_m, speed_m_s, now_s)
    return sensor.sensor.read()


def pressed(switch: ClawPressureSwitch, *gauges_pa: float) -> list[bool]:
    """Return the outputs after each pressure has lasted for longer than the response time."""
    levels = []
    for number, gauge_pa in enumerate(gauges_pa):
        follow_pressure(switch, gauge_pa, 2 * number * LOOK_S)
        levels.append(follow_pressure(switch, gauge_pa, (2 * number + 1) * LOOK_S))
    return levels


def carried(beam: SeedlingBeam, stems: Collection[int], *, speed_m_s: float, rise_m: float = 0.15) -> list[bool]:
    """Return the outputs at each look while the slide moves from pick 1 to the feed."""
    levels, now_s = [], 0.0
    x_m = MACHINE.picks_m[0]
    beam.hold(stems)
    while x_m > 0.0:
        levels.append(follow_slide(beam, x_m, rise_m, now_s))
        now_s, x_m = now_s + LOOK_S, x_m - speed_m_s * LOOK_S
    return levels


def at_pulses(
    sensor: CupSensor, filled: Collection[int], *, per_min: float, cups: int, look_s: float = 0.001
) -> list[bool]:
    """Return the outputs at the cup pulses while the chain passes with some cups filled."""
    speed_m_s = per_min / 60 * PITCH_M
    lead_m = MACHINE.cups.sensor_lead_m
    levels: list[bool] = []
    pulse, chain_m, now_s = 1, 0.0, 0.0
    while len(levels) < cups:
        chain_m, now_s = chain_m + speed_m_s * look_s, now_s + look_s
        level = follow_chain(sensor, chain_m, speed_m_s, filled, now_s)
        if chain_m >= pulse * PITCH_M - lead_m:
            pulse += 1
            levels.append(level)
    return levels


def test_the_pressure_switch_turns_on_and_off_at_its_points() -> None:
    """Adjusted to 0.4 MPa: on at 0.30 MPa, off below 0.28 MPa."""
    switch = pressure_switch()
    assert pressed(switch, 0.0, 299e3, 301e3, 281e3, 279e3, 299e3) == [False, False, True, True, False, False]


def test_the_pressure_switch_follows_after_its_response_time() -> None:
    switch = pressure_switch()
    follow_pressure(switch, 400e3, 1.0)
    assert not follow_pressure(switch, 400e3, 1.0 + SPEC.claw_delay_s / 2)
    assert follow_pressure(switch, 400e3, 1.0 + 1.01 * SPEC.claw_delay_s)


@pytest.mark.parametrize("stems", [range(12), (), (0,), (11,), (0, 2, 4, 6, 8, 10), (3, 4, 5)])
@pytest.mark.parametrize("speed_m_s", [0.05, 0.143, 0.2])
def test_the_stems_of_a_raised_row_cross_the_beam_one_after_the_other(stems: Collection[int], speed_m_s: float) -> None:
    levels = carried(free_beam(), stems, speed_m_s=speed_m_s)
    assert rising(levels) == len(stems)
    assert not levels[0]
    assert not levels[-1]


def test_each_level_of_the_beam_lasts_longer_than_filter_and_scan() -> None:
    """At the default speed of the slide, 0.143 m/s, both levels last 40 ms; input filter and scan take 20 ms."""
    levels = carried(free_beam(), range(CLAWS), speed_m_s=0.143)
    first, last = levels.index(True), len(levels) - levels[::-1].index(True)
    runs, length = [], 0
    for before, now in zip(levels[first : last - 1], levels[first + 1 : last], strict=True):
        length += 1
        if before != now:
            runs.append(length)
            length = 0
    assert min(runs) * LOOK_S >= 0.03


def test_a_lowered_arm_interrupts_the_beam_without_seedlings() -> None:
    levels = carried(free_beam(), (), speed_m_s=0.143, rise_m=0.0)
    assert rising(levels) == 1


@pytest.mark.parametrize("per_min", [20, 45, 90])
def test_a_cup_is_in_front_of_the_sensor_at_each_cup_pulse(per_min: float) -> None:
    """The first pulse shows the cup that will be under the last claw before cup 0 is: cup -11."""
    filled = {-11, -9, -8, -2, 0, 1, 5}
    levels = at_pulses(cup_sensor(), filled, per_min=per_min, cups=18)
    assert levels == [cup in filled for cup in range(-11, 7)]


def test_the_cup_sensor_is_on_over_the_slot_of_a_filled_cup() -> None:
    """The slot is 20 mm wide; with hysteresis, the sensor is on for 21 mm of each pitch of 60 mm."""
    sensor, on, speed_m_s = cup_sensor(), 0, 0.045
    for number in range(4_000):
        on += follow_chain(sensor, number * 0.001 * speed_m_s, speed_m_s, range(-99, 99), number * 0.001)
    assert on * 0.001 * speed_m_s == pytest.approx(0.021 * 3, abs=0.0003)


@pytest.mark.parametrize("share", first_of([0.05, 0.5]))
def test_wrong_readings_have_their_share(share: float) -> None:
    sensor = cup_sensor()
    sensor.wrong = share
    levels = at_pulses(sensor, range(-20, 1_000, 2), per_min=90, cups=CUPS_READ, look_s=LOOK_S / 2)
    wrong = sum(level != ((number - 11) % 2 == 0) for number, level in enumerate(levels))
    assert wrong / CUPS_READ == pytest.approx(share, abs=3 * (share * (1 - share) / CUPS_READ) ** 0.5)


def test_a_wrong_reading_of_the_beam_is_a_stem_missed() -> None:
    beam = free_beam()
    beam.wrong = 1.0
    assert rising(carried(beam, range(CLAWS), speed_m_s=0.143)) == 0


def test_a_wrong_reading_of_the_pressure_switch_lasts_for_a_stroke() -> None:
    switch = pressure_switch()
    switch.wrong = 1.0
    assert pressed(switch, 400e3, 400e3, 0.0, 400e3) == [False, False, True, False]


def test_wrong_readings_differ_from_stroke_to_stroke_and_from_pass_to_pass() -> None:
    switch, beam = pressure_switch(), free_beam()
    switch.wrong = beam.wrong = 0.5
    levels = pressed(switch, *[400e3, 0.0] * 50)
    assert 0 < sum(level != (number % 2 == 0) for number, level in enumerate(levels)) < len(levels)
    assert len({rising(carried(beam, range(CLAWS), speed_m_s=0.143)) for _ in range(8)}) > 1


@pytest.mark.parametrize(
    "changed",
    [{"claw_on_share": 1.0}, {"cup_slot_m": 0.1}, {"beam_step_m": 0.006}, {"beam_first_m": -0.1}],
    ids=lambda changed: next(iter(changed)),
)
def test_parameters_outside_their_limits_are_rejected(changed: dict[str, float]) -> None:
    with pytest.raises(SpecError, match=next(iter(changed))):
        replace(SPEC, **changed)


def test_the_delivered_machine_does_not_evaluate_the_sensors() -> None:
    assert {*YIELD} <= {point.tag for point in DELIVERED.unwired}
    assert not any(arm.watches_yield for arm in Twin().plant.arms.values())
    assert all(arm.watches_yield for arm in Twin(io_map=wired(*YIELD)).plant.arms.values())


def test_a_cup_that_has_passed_the_last_claw_is_still_seen() -> None:
    """In a whole trial, each cup sensor sees as many plugs as the cups of its row contain."""
    twin = Twin(trays=1, io_map=wired(*YIELD), set_points={"trays_target": 1})
    twin.plant.seedlings.make_typical()
    seen = {"left": [False], "right": [False]}

    def look(_twin: Twin) -> None:
        for side, arm in twin.plant.arms.items():
            seen[side].append(arm.cup_filled.sensor.read())

    twin.watch(look, devices=[Bit("X", twin.io_map[f"{side}.cup_filled"].number) for side in seen])
    twin.home(within_ms=60_000)
    twin.start()
    twin.run_until_state(State.COMPLETE, within_ms=150_000)
    twin.run_for(20_000)
    assert {side: rising(levels) for side, levels in seen.items()} == {"left": 36, "right": 36}
