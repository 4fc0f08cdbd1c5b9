"""Claws and spreader: times, thresholds, memory."""

import pytest
from plant_rig import MACHINE

from plant_sim.devices.claws import Claws, ClawsSpec
from plant_sim.devices.spreader import Spreader
from plant_sim.spec import SpecError


def make_claws(*, is_open: bool) -> Claws:
    return Claws(MACHINE.claws, MACHINE.valve, is_open=is_open)


def work(claws: Claws, for_ms: int, *, open_coil: bool = False, close_coil: bool = False) -> None:
    for _ in range(for_ms // 5):
        claws.step(0.005, open_coil=open_coil, close_coil=close_coil)


def pull(spreader: Spreader, for_ms: int, *, spread: bool = False, converge: bool = False) -> None:
    for _ in range(for_ms // 5):
        spreader.step(0.005, spread=spread, converge=converge)


def test_claws_open_80_ms_after_their_valve() -> None:
    claws = make_claws(is_open=False)
    seen = []
    for for_ms in (15, 35, 5, 35, 5, 5):
        work(claws, for_ms, open_coil=True)
        seen.append((claws.angle_deg, claws.free, claws.moving))
    assert seen == [
        (-10.0, False, False),
        (7.5, False, True),  # 500 degrees/s: 35 ms are 17.5 degrees
        (10.0, True, True),
        (27.5, True, True),
        (30.0, True, True),
        (30.0, True, False),
    ]


def test_claws_grip_near_the_end_of_their_way() -> None:
    claws = make_claws(is_open=True)
    seen = []
    for for_ms in (80, 5, 5, 5):
        work(claws, for_ms, close_coil=True)
        seen.append((claws.angle_deg, claws.gripping))
    assert seen == [(-2.5, False), (-5.0, True), (-7.5, True), (-10.0, True)]  # 15 ms are the valve's


@pytest.mark.parametrize("is_open", [False, True])
def test_claws_keep_their_state_without_power(is_open: bool) -> None:
    claws = make_claws(is_open=is_open)
    work(claws, 100, open_coil=is_open, close_coil=not is_open)
    work(claws, 60_000)
    assert claws.angle_deg == (30.0 if is_open else -10.0)


def test_a_pulse_of_the_coil_is_enough() -> None:
    claws = make_claws(is_open=False)
    work(claws, 15, open_coil=True)
    work(claws, 80)
    assert claws.angle_deg == 30.0


def test_both_coils_leave_the_claws_as_they_are() -> None:
    claws = make_claws(is_open=False)
    work(claws, 1_000, open_coil=True, close_coil=True)
    assert claws.angle_deg == -10.0


def test_jammed_claws_stand_dead_though_the_valve_switches() -> None:
    claws = make_claws(is_open=False)
    claws.jammed = True
    work(claws, 500, open_coil=True)
    assert claws.angle_deg == -10.0
    assert not claws.moving
    claws.jammed = False
    work(claws, 80)
    assert claws.angle_deg == 30.0


def test_claws_that_never_grip_are_refused() -> None:
    with pytest.raises(SpecError, match="grips_below_deg must lie above the closed end"):
        ClawsSpec(closed_deg=-10, open_deg=30, travel_s=0.08, grips_below_deg=-10, frees_above_deg=10)


def test_the_spreader_spreads_in_985_ms() -> None:
    spreader = Spreader(MACHINE.spreader, travel_m=0.0)
    pull(spreader, 100, spread=True)  # 2 m/s2 for 0.1 s: 10 mm
    assert spreader.travel_m == pytest.approx(0.010)
    assert spreader.speed_m_s == pytest.approx(0.200)
    pull(spreader, 865, spread=True)  # 173 mm more
    assert spreader.travel_m == pytest.approx(0.183)
    assert not spreader.spread_switch.read()
    pull(spreader, 10, spread=True)
    assert spreader.spread_switch.read()
    assert spreader.travel_m < 0.187
    pull(spreader, 15, spread=True)
    assert spreader.travel_m == 0.187
    assert spreader.speed_m_s == 0.0


def test_the_spreader_converges_as_fast() -> None:
    spreader = Spreader(MACHINE.spreader, travel_m=0.187)
    pull(spreader, 965, converge=True)
    assert not spreader.converged_switch.read()
    pull(spreader, 10, converge=True)
    assert spreader.converged_switch.read()
    pull(spreader, 15, converge=True)
    assert spreader.travel_m == 0.0


def test_the_spreader_coasts_2_and_a_half_mm() -> None:
    spreader = Spreader(MACHINE.spreader, travel_m=0.0)
    pull(spreader, 500, spread=True)
    off_m = spreader.travel_m
    pull(spreader, 20)  # 25 ms from 0.2 m/s at 8 m/s2
    assert spreader.moving
    pull(spreader, 10)
    assert spreader.travel_m - off_m == pytest.approx(0.0025)
    assert not spreader.moving


def test_both_directions_stop_the_spreader() -> None:
    spreader = Spreader(MACHINE.spreader, travel_m=0.0)
    pull(spreader, 500, spread=True)
    off_m = spreader.travel_m
    pull(spreader, 1_000, spread=True, converge=True)
    assert spreader.travel_m - off_m == pytest.approx(0.0025)


def test_a_spreader_switch_goes_off_one_hysteresis_later() -> None:
    spreader = Spreader(MACHINE.spreader, travel_m=0.187)
    spreader.place(0.187 - 0.0039)
    assert spreader.spread_switch.read()
    spreader.place(0.187 - 0.0041)
    assert not spreader.spread_switch.read()
    spreader.place(0.187 - 0.0031)
    assert not spreader.spread_switch.read()
    spreader.place(0.187 - 0.0029)
    assert spreader.spread_switch.read()


def test_a_jammed_spreader_stands_dead() -> None:
    spreader = Spreader(MACHINE.spreader, travel_m=0.05)
    spreader.jammed = True
    pull(spreader, 500, spread=True)
    assert spreader.travel_m == 0.05
    assert not spreader.moving
