"""The spreader: a DC motor, its brake, its belt and its end switches.

The motor runs on 24 V with 5.25 ohm and 105 V s/m (= N/A) at the belt and moves 28 kg against 60 N of friction. The
steady speed is (24 V - 60 N * 5.25 ohm / 105 N/A) / 105 V s/m = 0.200 m/s. The back-EMF damps the motion with 105^2 /
5.25 = 2100 N s/m, so the spreader approaches this speed with a time constant of 28 kg / 2100 N s/m = 13.3 ms, and then
lags by 0.2 m/s * 13.3 ms = 2.67 mm.
"""

import math

import pytest

from plant_sim.devices.spreader import Spreader
from tests.plant_sim.machine.plant_rig import MACHINE, Rig

FULL_M = 0.187
TIME_S = 28 / 2100


def make_spreader(travel_m: float = 0.0) -> tuple[Rig, Spreader]:
    rig = Rig(trays=0)
    rig.left.place(travel_m=travel_m)
    return rig, rig.left.spreader


def test_at_steady_speed_motor_force_and_friction_balance() -> None:
    assert MACHINE.spreader.speed_m_s == pytest.approx(0.200)
    rig, spreader = make_spreader()
    rig.run(500, "left.spread")
    assert spreader.speed_m_s == pytest.approx(0.200, abs=1e-6)


def test_it_accelerates_with_a_time_constant_of_13_ms() -> None:
    """The speed is 0.2 m/s * (1 - exp(-t / 13.3 ms)), i.e. 63 % after 13.3 ms; steps of 1 ms give up to 4 % more."""
    rig, spreader = make_spreader()
    for at_ms in (5, 10, 20, 40, 80):
        rig.run(at_ms - rig.plant.time_ms, "left.spread")
        assert spreader.speed_m_s == pytest.approx(0.200 * (1 - math.exp(-at_ms / 1000 / TIME_S)), rel=0.04)


@pytest.mark.parametrize(("coil", "travel_m"), [("left.spread", 0.0), ("left.converge", FULL_M)])
def test_it_reaches_its_end_in_948_ms_and_switches_15_ms_before(coil: str, travel_m: float) -> None:
    """The travel takes (187 + 2.67) mm / 0.2 m/s = 948.3 ms; the switch 3 mm before the end turns on at 933.3 ms."""
    rig, spreader = make_spreader(travel_m)
    switch = spreader.spread_switch if coil == "left.spread" else spreader.converged_switch
    ways_m = rig.trace(lambda: abs(spreader.travel_m - travel_m), 1_200, coil)
    assert switch.edge_s == pytest.approx(0.9333, abs=0.001)
    assert ways_m[947] < FULL_M
    assert ways_m[950] == FULL_M
    assert ways_m[-1] == FULL_M
    assert spreader.speed_m_s == 0.0


def test_it_coasts_1_9_mm_when_its_motor_is_short_circuited() -> None:
    """The spreader stops after 13.3 ms * ln(1 + 200 / 28.6) = 27.7 ms, where 60 N / 2100 N s/m = 28.6 mm/s.

    It travels 13.3 ms * 200 mm/s - 27.7 ms * 28.6 mm/s = 1.88 mm, or slightly less with steps of 1 ms.
    """
    rig, spreader = make_spreader()
    rig.run(500, "left.spread")
    off_m = spreader.travel_m
    rig.run(25)
    assert spreader.speed_m_s > 0.0
    rig.run(5)
    assert spreader.speed_m_s == 0.0
    assert spreader.travel_m - off_m == pytest.approx(0.00188, abs=0.00005)


def test_both_directions_brake_it_as_well_as_none() -> None:
    ways_m = []
    for coils in ((), ("left.spread", "left.converge")):
        rig, spreader = make_spreader()
        rig.run(500, "left.spread")
        off_m = spreader.travel_m
        rig.run(1_000, *coils)
        ways_m.append(spreader.travel_m - off_m)
    assert ways_m[0] == ways_m[1]


def test_it_reverses_at_once() -> None:
    """Owing to its inertia, the spreader overshoots by at most 2.67 mm before it reverses."""
    rig, spreader = make_spreader()
    rig.run(500, "left.spread")
    turned_m = spreader.travel_m
    ways_m = rig.trace(lambda: spreader.travel_m, 1_000, "left.converge")
    assert max(ways_m) - turned_m < 0.00267
    assert ways_m[-1] == 0.0


def test_a_switch_turns_off_one_hysteresis_later() -> None:
    """The switch has a band of 3 mm and a hysteresis of 1 mm."""
    rig, spreader = make_spreader(FULL_M)
    ways_m = rig.trace(lambda: FULL_M - spreader.travel_m, 100, "left.converge")
    after = next(ms for ms, way_m in enumerate(ways_m) if way_m > 0.004)
    share = (0.004 - ways_m[after - 1]) / (ways_m[after] - ways_m[after - 1])
    assert spreader.spread_switch.edge_s == pytest.approx((after - 1 + share) / 1000, abs=1e-9)
    for back_m, on in ((0.0031, False), (0.0029, True)):
        spreader.place(FULL_M - back_m)
        assert spreader.spread_switch.read() is on


def test_a_jammed_spreader_stops_and_continues_when_released() -> None:
    """At standstill the motor force is 24 V / 5.25 ohm * 105 N/A = 480 N; the belt slips only at 600 N."""
    rig, spreader = make_spreader(0.05)
    spreader.jammed = True
    rig.run(500, "left.spread")
    assert spreader.travel_m == 0.05
    assert spreader.speed_m_s == 0.0
    spreader.jammed = False
    rig.run(100, "left.spread")
    assert spreader.travel_m - 0.05 == pytest.approx(0.200 * 0.100 - 0.00267, abs=0.0002)


def test_a_slipping_belt_transmits_its_slip_force_only() -> None:
    """A slip force of 120 N less 60 N of friction accelerates 8 kg at 7.5 m/s2, to 0.0375 m/s in 5 ms.

    An intact belt transmits 180 N, and the spreader reaches 0.063 m/s: the motor force of 480 N less 60 N accelerates
    28 kg at 15 m/s2, for which the 8 kg driven by the belt require 120 N, plus 60 N of friction.
    """
    speeds_m_s = []
    for slips_n in (120.0, 190.0):
        rig, spreader = make_spreader()
        spreader.params["slips_n"] = slips_n
        rig.run(5, "left.spread")
        speeds_m_s.append(spreader.speed_m_s)
    assert speeds_m_s == pytest.approx([7.5 * 0.005, 0.200 * (1 - math.exp(-0.005 / TIME_S))], rel=0.04)


def test_a_slip_force_below_the_friction_causes_no_motion() -> None:
    rig, spreader = make_spreader()
    spreader.params["slips_n"] = 55.0
    rig.run(2_000, "left.spread")
    assert spreader.travel_m == 0.0
    spreader.params["slips_n"] = 65.0  # 5 N on 8 kg: 0.625 m/s2, 31 mm after 316 ms
    rig.run(316, "left.spread")
    assert spreader.travel_m == pytest.approx(0.031, abs=0.003)


def test_placing_clips_to_the_travel_and_sets_the_speed_to_0() -> None:
    rig, spreader = make_spreader()
    rig.run(500, "left.spread")
    spreader.place(9.0)
    assert (spreader.travel_m, spreader.speed_m_s) == (FULL_M, 0.0)
    spreader.place(-1.0)
    assert spreader.travel_m == 0.0
    rig.run(100)
    assert spreader.travel_m == 0.0


def test_the_motor_stalls_when_the_claws_are_against_their_end_stop() -> None:
    """The stall force of 480 N is less than the 600 N at which the belt slips."""
    rig = Rig()
    rig.run(2_000, "left.spread")
    state = rig.left.spreader.state
    assert float(state["travel_m"]) == rig.machine.spreader.travel_m
    assert (float(state["speed_m_s"]), float(state["motor_m_s"])) == (0.0, 0.0)
