"""Solenoid valves: delays, hold, memory."""

import pytest

from plant_sim.devices.valve import CentredValve, LatchingValve, ValveSpec
from plant_sim.spec import SpecError

SPEC = ValveSpec(on_delay_s=0.015, off_delay_s=0.020)
MS = 0.001


def drive(valve: CentredValve, for_ms: int, *, plus: bool = False, minus: bool = False) -> None:
    for _ in range(for_ms):
        valve.step(MS, plus, minus)


def latch(valve: LatchingValve, for_ms: int, *, sets: bool = False, resets: bool = False) -> None:
    for _ in range(for_ms):
        valve.step(MS, sets, resets)


@pytest.mark.parametrize(("plus", "minus", "flow"), [(True, False, 1), (False, True, -1)])
def test_a_centred_valve_switches_on_after_15_ms_and_off_after_20_ms(plus: bool, minus: bool, flow: int) -> None:
    valve = CentredValve(SPEC)
    drive(valve, 14, plus=plus, minus=minus)
    assert valve.flow == 0
    drive(valve, 1, plus=plus, minus=minus)
    assert valve.flow == flow
    drive(valve, 19)
    assert valve.flow == flow
    drive(valve, 1)
    assert valve.flow == 0


def test_three_steps_of_5_ms_are_15_ms() -> None:
    valve = CentredValve(SPEC)
    flows = []
    for _ in range(4):
        valve.step(0.005, True, False)
        flows.append(valve.flow)
    assert flows == [0, 0, 1, 1]


def test_a_centred_valve_with_both_coils_holds() -> None:
    valve = CentredValve(SPEC)
    drive(valve, 50, plus=True)
    drive(valve, 14, plus=True, minus=True)
    assert valve.flow == 1
    drive(valve, 50, plus=True, minus=True)
    assert valve.flow == 0


def test_pulses_shorter_than_the_delay_do_not_add_up() -> None:
    valve = CentredValve(SPEC)
    for _ in range(10):
        drive(valve, 14, plus=True)
        drive(valve, 1)
    assert valve.flow == 0


def test_gaps_shorter_than_the_delay_do_not_add_up() -> None:
    valve = CentredValve(SPEC)
    drive(valve, 15, plus=True)
    for _ in range(10):
        drive(valve, 19)
        drive(valve, 1, plus=True)
    assert valve.flow == 1


def test_a_latching_valve_keeps_its_position_without_a_coil() -> None:
    valve = LatchingValve(SPEC, is_set=False)
    states = []
    for for_ms, sets, resets in ((14, True, False), (1, True, False), (10_000, False, False), (15, False, True)):
        latch(valve, for_ms, sets=sets, resets=resets)
        states.append(valve.is_set)
    assert states == [False, True, True, False]


@pytest.mark.parametrize("is_set", [False, True])
def test_a_latching_valve_keeps_its_position_with_both_coils(is_set: bool) -> None:
    valve = LatchingValve(SPEC, is_set=is_set)
    latch(valve, 1_000, sets=True, resets=True)
    assert valve.is_set is is_set


def test_a_latching_valve_obeys_the_coil_that_stays() -> None:
    valve = LatchingValve(SPEC, is_set=True)
    latch(valve, 100, sets=True, resets=True)
    states = []
    for for_ms in (19, 1):
        latch(valve, for_ms, resets=True)
        states.append(valve.is_set)
    assert states == [True, False]


def test_a_delay_that_no_valve_has_is_refused() -> None:
    with pytest.raises(SpecError, match=r"off_delay_s must lie within 0 to 0\.5, not -0\.02"):
        ValveSpec(on_delay_s=0.015, off_delay_s=-0.020)
