"""Pneumatic motion of slide and lift: start, speed, ends and stops, compared with calculated values.

Areas: slide pi/4 * 0.025^2 = 490.87 mm2; lift pi/4 * 0.050^2 = 1963.5 mm2 on the cap side and, less pi/4 * 0.020^2 for
the rod, 1649.3 mm2 on the rod side. Meter-out speed, C * 1e5 / area: slide 0.735e-9 * 1e5 / 490.87e-6 = 0.1497 m/s;
lift down 3.5e-9 * 1e5 / 1649.3e-6 = 0.2122 m/s, up 4.1e-9 * 1e5 / 1963.5e-6 = 0.2088 m/s. Delay from the coil to the
first flow: 15 ms (on) or 20 ms (off) in the valve, plus the tube length at 343 m/s: 4.2 ms (slide), 3.8 ms (lift).
"""

import math
from itertools import pairwise

import pytest

from plant_sim.devices.pneumatic import Cylinder
from tests.plant_sim.machine.plant_rig import MACHINE, Rig, make_rig

SLIDE_M_S = 0.1497
SLIDE_M2, LIFT_FULL_M2, LIFT_ROD_M2 = 490.87e-6, 1963.5e-6, 1649.3e-6
PICK_1_M, PICK_2_M, PICK_3_M = 0.1925, 0.2355, 0.2785
OUTERMOST_M, INNERMOST_M = 0.002, 0.598  # the bumpers begin here
ATMOSPHERE_PA = 101_325.0


def pressures_pa(cylinder: Cylinder) -> tuple[float, float]:
    """Return the absolute chamber pressures, first that of the chamber that drives the load away from position 0."""
    plus, minus = (float(cylinder.state[end]["chamber"]["pressure_pa"]) for end in ("plus", "minus"))
    return plus, minus


def test_pick_positions_follow_the_row_spacing() -> None:
    assert MACHINE.picks_m == pytest.approx((PICK_1_M, PICK_2_M, PICK_3_M))
    narrow = MACHINE.with_values({"layout.row_spacing_m": 0.350})
    assert narrow.picks_m == pytest.approx((0.0675, 0.1105, 0.1535))
    wide = MACHINE.with_values({"layout.row_spacing_m": 0.800})
    assert wide.picks_m == pytest.approx((0.2925, 0.3355, 0.3785))


class TestValve:
    """Delays of the slide valve, measured at its spool."""

    @pytest.mark.parametrize(("coil", "end"), [("left.slide_inward", 1.0), ("left.slide_outward", -1.0)])
    def test_it_switches_19_ms_after_its_coil_comes_on_and_24_ms_after_it_goes_off(self, coil: str, end: float) -> None:
        """The delay is 15 + 4.23 ms or 20 + 4.23 ms; the spool then takes 4 ms from mid-position to an end position.

        After 20 ms, it has moved for 0.77 ms of these.
        """
        rig = make_rig(x_m=0.3)
        seen = []
        for for_ms, tags in ((19, [coil]), (1, [coil]), (3, [coil]), (24, []), (1, []), (3, [])):
            rig.run(for_ms, *tags)
            seen.append(spool(rig))
        assert seen == pytest.approx([0.0, 0.193 * end, 0.943 * end, end, 0.807 * end, 0.057 * end], abs=0.001)

    def test_both_coils_hold(self) -> None:
        rig = make_rig(x_m=0.3)
        rig.run(1_000, "left.slide_inward", "left.slide_outward")
        assert spool(rig) == 0.0
        assert rig.left.slide.x_m == 0.3

    def test_a_second_coil_cancels_the_first(self) -> None:
        rig = make_rig(x_m=0.3)
        rig.run(50, "left.slide_inward")
        rig.run(19, "left.slide_inward", "left.slide_outward")
        assert spool(rig) == 1.0
        rig.run(5, "left.slide_inward", "left.slide_outward")
        assert spool(rig) == 0.0

    def test_pulses_shorter_than_the_delay_of_the_valve_do_not_add_up(self) -> None:
        rig = make_rig(x_m=0.3)
        for _ in range(10):
            rig.run(14, "left.slide_inward")
            rig.run(6)
            assert spool(rig) == 0.0

    @pytest.mark.parametrize("tube_length_m", [0.3, 1.45, 10.0])
    @pytest.mark.parametrize("pulse_ms", [15, 18, 40])
    def test_a_pulse_arrives_through_a_tube_of_any_length(self, pulse_ms: int, tube_length_m: float) -> None:
        """A pulse that switches the valve arrives with its full length, longer by 5 ms because the valve is slower off.

        The spool moves at 0.25 per ms, so the area under its travel is the length of the pulse.
        """
        rig = make_rig({"slide_port.tube_length_m": tube_length_m}, x_m=0.3)
        travels = rig.trace(lambda: spool(rig), pulse_ms, "left.slide_inward") + rig.trace(lambda: spool(rig), 100)
        assert sum(travels) == pytest.approx(pulse_ms + 5.0, abs=1.0)

    def test_several_pulses_travel_in_a_long_tube(self) -> None:
        """The travel through 20 m takes 58 ms; three pulses of 16 ms, each 20 ms apart, all arrive."""
        rig = make_rig({"slide_port.tube_length_m": 20.0, "valve.off_delay_s": 0.015}, x_m=0.3)
        travels = []
        for _ in range(3):
            travels += rig.trace(lambda: spool(rig), 16, "left.slide_inward") + rig.trace(lambda: spool(rig), 20)
        travels += rig.trace(lambda: spool(rig), 100)
        assert sum(before < 0.5 <= after for before, after in pairwise(travels)) == 3

    def test_gaps_shorter_than_the_delay_do_not_add_up(self) -> None:
        rig = make_rig(x_m=0.3)
        rig.run(25, "left.slide_inward")
        for _ in range(10):
            rig.run(19)
            rig.run(6, "left.slide_inward")
            assert spool(rig) == 1.0


def spool(rig: Rig) -> float:
    return float(rig.left.slide.state["valve"]["spool"])


class TestStart:
    """Start of the slide, delayed until the air in front of the piston has been exhausted through the throttle."""

    @pytest.mark.parametrize(("x_m", "coil"), [(0.0, "left.slide_inward"), (0.6, "left.slide_outward")])
    @pytest.mark.parametrize("throttle_m3_s_pa", [0.4e-9, 0.735e-9, 1.2e-9])
    def test_it_starts_when_the_pressure_before_it_has_fallen(
        self, x_m: float, coil: str, throttle_m3_s_pa: float
    ) -> None:
        """Both chambers are initially at 0.9 * 0.5 MPa + atmosphere = 551.3 kPa.

        The supply, 601.3 kPa less the 10 kPa that open the check valve, soon fills the 23 cm3 behind the piston to
        591.3 kPa. A difference of 71.3 kPa overcomes 35 N of friction, so the other pressure must fall to 520.0 kPa.
        From its volume V = 22 + 490.87 * 0.598 = 315.5 cm3, a volume of C * 1e5 is exhausted per second: t = V /
        (n C 1e5) * ln(551.3 / 520.0), with n between 1 (slow) and 1.2 (fast), i.e. 0.21 to 0.25 s with the default
        throttle. Valve and spool add 21 ms.
        """
        slow_ms = 1000 * 315.5e-6 / (throttle_m3_s_pa * 1e5) * math.log(551.3 / 520.0)
        rig = make_rig({"slide.throttle_conductance_m3_s_pa": throttle_m3_s_pa}, x_m=x_m)
        slide = rig.left.slide
        places_m = rig.trace(lambda: slide.x_m, 1_000, coil)
        stands_ms = next(ms for ms, place_m in enumerate(places_m) if abs(place_m - places_m[0]) > 1e-6)
        assert 21 + slow_ms / 1.2 <= stands_ms <= 21 + slow_ms + 5

    def test_residual_air_of_the_previous_stroke_lengthens_the_delay(self) -> None:
        """After a reversal at pick 3, the pressure in front of the piston is 579 kPa instead of 551 kPa.

        This is residual air that drove the previous stroke.
        """
        fresh = make_rig(x_m=PICK_3_M)
        used = make_rig()
        used.go_to_pick(3)
        waits_ms = []
        for rig in (fresh, used):
            slide = rig.left.slide
            start_m = slide.x_m
            waits_ms.append(rig.run_until(lambda: slide.x_m < start_m - 1e-5, "left.slide_outward"))  # noqa: B023
        assert 100 <= waits_ms[0] < waits_ms[1] - 50 < 700


class TestSpeed:
    """Steady speed with a choked exhaust: C * 1e5 / area, or slightly less if the air is cold."""

    @pytest.mark.parametrize(("x_m", "coil", "sign"), [(0.0, "slide_inward", 1), (0.6, "slide_outward", -1)])
    def test_the_slide_runs_at_150_mm_s_either_way(self, x_m: float, coil: str, sign: int) -> None:
        rig = make_rig(x_m=x_m)
        assert speed_m_s(rig, 0.25, 0.40, coil) == pytest.approx(sign * SLIDE_M_S, rel=0.02)

    @pytest.mark.parametrize(
        "values",
        [
            {"supply.pressure_pa": 0.45e6},
            {"slide.carried_kg": 20.0},
            {"slide_friction.coulomb_n": 30.0},
        ],
    )
    def test_neither_pressure_nor_load_nor_friction_change_it(self, values: dict[str, bool | int | float]) -> None:
        assert speed_m_s(make_rig(values), 0.25, 0.40, "slide_inward") == pytest.approx(SLIDE_M_S, rel=0.02)

    def test_the_throttle_does(self) -> None:
        """A narrower throttle gives 0.4e-9 * 1e5 / 490.87e-6 = 0.0815 m/s."""
        rig = make_rig({"slide.throttle_conductance_m3_s_pa": 0.4e-9})
        assert speed_m_s(rig, 0.25, 0.40, "slide_inward") == pytest.approx(0.0815, rel=0.02)

    @pytest.mark.parametrize(
        ("y_m", "coil", "at_m_s"), [(0.0, "lift_extend", 0.2122), (0.150, "lift_retract", -0.2088)]
    )
    def test_the_lift_runs_at_about_200_mm_s(self, y_m: float, coil: str, at_m_s: float) -> None:
        """The stroke is too short for a steady speed, and the flow in the throttle is not fully choked.

        The mean speeds measured over the middle of the stroke are 0.232 m/s down, still with oscillation, and 0.195 m/s
        up.
        """
        rig = make_rig(y_m=y_m)
        lift = rig.left.lift
        assert crossing_m_s(rig, lambda: lift.y_m, 0.040, 0.130, coil) == pytest.approx(at_m_s, rel=0.10)

    def test_the_weight_of_the_arm_accelerates_the_start_of_lowering(self) -> None:
        """At rest, the rod-side air carries the 15 kg arm; as the arm starts to move, it first compresses this air."""
        down, up = make_rig(y_m=0.0), make_rig(y_m=0.150)
        down_m_s = max(down.trace(lambda: down.left.lift.speed_m_s, 300, "left.lift_extend"))
        up_m_s = -min(up.trace(lambda: up.left.lift.speed_m_s, 300, "left.lift_retract"))
        assert down_m_s > 1.5 * 0.2122
        assert up_m_s < 0.2088


def arrival(rig: Rig, coil: str, end_m: float) -> tuple[float, float]:
    """Return the fastest speed in the 20 mm before the cushion, and the speed at the stop, m/s."""
    lift = rig.left.lift
    way = rig.trace(lambda: (abs(lift.y_m - end_m), abs(lift.speed_m_s)), 1_500, f"left.{coil}")
    before_m_s = max(speed_m_s for left_m, speed_m_s in way if 0.015 < left_m < 0.035)
    hit = next(ms for ms, (left_m, _) in enumerate(way) if left_m < 0.0003)
    return before_m_s, way[hit][1]


def speed_m_s(rig: Rig, low_m: float, high_m: float, coil: str) -> float:
    return crossing_m_s(rig, lambda: rig.left.slide.x_m, low_m, high_m, coil)


def crossing_m_s(rig: Rig, place_m: object, low_m: float, high_m: float, coil: str) -> float:
    """Return the mean speed between two positions."""
    assert callable(place_m)
    places_m = rig.trace(place_m, 5_000, f"left.{coil}")
    inside = [ms for ms, at_m in enumerate(places_m) if low_m <= at_m <= high_m]
    return float(places_m[inside[-1]] - places_m[inside[0]]) / (inside[-1] - inside[0]) * 1000


class TestEnds:
    """Bumpers, cushions and end stops."""

    @pytest.mark.parametrize(
        ("coil", "rests_m", "stop_m"), [("inward", INNERMOST_M, 0.600), ("outward", OUTERMOST_M, 0.0)]
    )
    def test_the_slide_compresses_its_bumper(self, coil: str, rests_m: float, stop_m: float) -> None:
        """A bumper of 200 N/mm is compressed by 1.0 to 1.2 mm.

        The force is 490 kPa * 490.87 mm2 = 240 N, less up to 35 N of friction.
        """
        rig = make_rig(x_m=0.3)
        slide = rig.left.slide
        places_m = rig.trace(lambda: slide.x_m, 6_000, f"left.slide_{coil}")
        assert min(places_m) >= 0.0
        assert max(places_m) <= 0.600
        assert 0.0009 <= abs(slide.x_m - rests_m) <= 0.0013
        assert abs(slide.x_m - stop_m) < 0.002
        assert abs(slide.speed_m_s) < 1e-6

    def test_the_bumper_softens_the_stop(self) -> None:
        """Stopping 10.4 kg from 0.15 m/s requires a mean force of 60 N over 2 mm, but 1560 N in 1 ms (hard stop)."""
        rig = make_rig(x_m=0.3)
        slide = rig.left.slide
        speeds_m_s = rig.trace(lambda: slide.speed_m_s, 4_000, "left.slide_inward")
        hardest_m_s2 = max(abs(after - before) for before, after in pairwise(speeds_m_s)) / 0.001
        assert hardest_m_s2 * 10.0 < 600

    @pytest.mark.parametrize(("y_m", "coil", "end_m"), [(0.0, "lift_extend", 0.150), (0.150, "lift_retract", 0.0)])
    def test_the_cushion_slows_the_last_15_mm(self, y_m: float, coil: str, end_m: float) -> None:
        """The needle lets 1.4e-9 * 1e5 / 1348 mm2 = 0.104 m/s pass, half of the speed before the cushion, +-20 %."""
        before_m_s, hit_m_s = arrival(make_rig(y_m=y_m), coil, end_m)
        assert 0.19 < before_m_s < 0.24
        assert hit_m_s < 0.125

    @pytest.mark.parametrize(("y_m", "coil", "end_m"), [(0.0, "lift_extend", 0.150), (0.150, "lift_retract", 0.0)])
    def test_the_cushion_brakes_an_unthrottled_lift(self, y_m: float, coil: str, end_m: float) -> None:
        """With the throttles open, the lift reaches its cushion at over 0.4 m/s and its stop at less than 0.2 m/s.

        The air behind the plunger, 22 cm3 compressed towards 2 cm3, takes up the energy. Without the cushion or with a
        needle that is wide open, the lift hits its stop more than twice as fast.
        """
        open_ = {"lift.extend_conductance_m3_s_pa": 1.6e-8, "lift.retract_conductance_m3_s_pa": 1.9e-8}
        before_m_s, hit_m_s = arrival(make_rig(open_, y_m=y_m), coil, end_m)
        assert before_m_s > 0.4
        assert hit_m_s < 0.2
        for undone in ({"lift.needle_conductance_m3_s_pa": 1e-7}, {"lift.cushion_m": 0.0}):
            _, undamped_m_s = arrival(make_rig(open_ | undone, y_m=y_m), coil, end_m)
            assert undamped_m_s > 2.0 * hit_m_s

    @pytest.mark.parametrize(("y_m", "coil", "end_m"), [(0.0, "lift_extend", 0.150), (0.150, "lift_retract", 0.0)])
    def test_the_stops_of_the_lift_yield(self, y_m: float, coil: str, end_m: float) -> None:
        """Against 5 kN/mm, the final force is 0.49 MPa * 1963 mm2 + 147 N = 1109 N down or 661 N up: 0.22, 0.13 mm."""
        rig = make_rig(y_m=y_m)
        lift = rig.left.lift
        rig.run(5_000, f"left.{coil}")
        beyond_mm = 1e3 * (lift.y_m - end_m) if end_m else -1e3 * lift.y_m
        assert beyond_mm == pytest.approx(0.22 if end_m else 0.13, abs=0.015)
        assert lift.speed_m_s == pytest.approx(0.0, abs=1e-6)

    def test_extending_lowers_and_retracting_raises(self) -> None:
        rig = make_rig(y_m=0.0)
        lift = rig.left.lift
        assert (lift.up.read(), lift.down.read(), lift.rise_m) == (True, False, 0.150)
        rig.run(1_500, "left.lift_extend")
        assert (lift.up.read(), lift.down.read(), round(lift.rise_m, 3)) == (False, True, 0.0)
        rig.run(1_500, "left.lift_retract")
        assert (lift.up.read(), lift.down.read(), round(lift.rise_m, 3)) == (True, False, 0.150)

    @pytest.mark.parametrize(
        ("y_m", "coil", "first_ms", "last_ms"), [(0.0, "lift_extend", 650, 700), (0.150, "lift_retract", 840, 890)]
    )
    def test_the_lift_arrives_in_time(self, y_m: float, coil: str, first_ms: int, last_ms: int) -> None:
        """A stroke of 145 mm at 0.21 m/s takes 690 ms.

        The measured times are 677 ms down, assisted by the weight, and 864 ms up, delayed by the air to be exhausted.
        """
        rig = make_rig(y_m=y_m)
        rig.run(1_500, f"left.{coil}")
        switch = rig.left.lift.down if coil == "lift_extend" else rig.left.lift.up
        assert first_ms <= 1000 * switch.edge_s <= last_ms

    def test_placing_clips_to_the_available_stroke(self) -> None:
        rig = make_rig()
        for cylinder, low_m, high_m in ((rig.left.slide, 0.002, 0.598), (rig.left.lift, 0.0, 0.150)):
            cylinder.place(9.0)
            assert cylinder.position_m == high_m
            cylinder.place(-1.0)
            assert cylinder.position_m == low_m


class TestHolding:
    """Effects of the air trapped between the check valves."""

    @pytest.mark.parametrize(("coil", "y_m"), [("left.lift_extend", 0.0), ("left.lift_retract", 0.150)])
    def test_the_lift_stops_on_its_trapped_air(self, coil: str, y_m: float) -> None:
        """The lift travels 5 mm during the 24 ms valve delay, and 12 mm in total (measured).

        After the delay, 15 kg at 0.21 m/s compress 100 to 200 cm3 of air.
        """
        rig = make_rig(y_m=y_m)
        lift = rig.left.lift
        rig.run_until(lambda: abs(lift.y_m - y_m) > 0.060, coil)
        off_m = lift.y_m
        rig.run(500)
        assert 0.009 < abs(lift.y_m - off_m) < 0.016
        held_m = lift.y_m
        rig.run(60_000)
        assert lift.y_m == held_m

    @pytest.mark.parametrize("y_m", [0.0, 0.075, 0.150])
    def test_the_lift_carries_the_weight_of_the_arm_on_its_air(self, y_m: float) -> None:
        """With the valve in mid-position, the gauge pressures times the areas carry 15 kg * 9.80665 = 147.1 N."""
        rig = make_rig(y_m=y_m)
        lift = rig.left.lift
        rig.run(10_000)
        plus_pa, minus_pa = pressures_pa(lift)
        held_n = (minus_pa - ATMOSPHERE_PA) * LIFT_ROD_M2 - (plus_pa - ATMOSPHERE_PA) * LIFT_FULL_M2
        assert held_n == pytest.approx(147.1, abs=1.0)
        assert lift.y_m == y_m


class TestFaults:
    """Jams and decoupled magnets."""

    def test_a_jammed_slide_stops_and_continues_when_released(self) -> None:
        """After the jam is cleared, the slide accelerates freely, because the air in front of it has been exhausted."""
        rig = make_rig()
        slide = rig.left.slide
        rig.run(1_000, "left.slide_inward")
        stuck_m = slide.x_m
        slide.jammed = True
        places_m = rig.trace(lambda: slide.x_m, 3_000, "left.slide_inward")
        assert set(places_m) == {stuck_m}
        assert slide.speed_m_s == 0.0
        assert not slide.decoupled
        slide.jammed = False
        speeds_m_s = rig.trace(lambda: slide.speed_m_s, 200, "left.slide_inward")
        assert speeds_m_s[5] > 0.02
        assert max(speeds_m_s) > 2 * SLIDE_M_S
        rig.run(2_000, "left.slide_inward")
        assert slide.x_m > stuck_m + 0.2

    @pytest.mark.parametrize(("main_pa", "decouples"), [(0.740e6, False), (0.760e6, True)])
    def test_the_magnets_of_a_blocked_slide_decouple_above_740_kpa(self, main_pa: float, decouples: bool) -> None:
        """The limit is 363 N / 490.87 mm2 = 739.5 kPa across the piston plus 10 kPa to open the check valve."""
        rig = make_rig(
            {"supply.pressure_pa": main_pa, "supply.compressor_on_pa": 0.85e6, "supply.compressor_off_pa": 0.95e6},
            x_m=0.3,
        )
        slide = rig.left.slide
        slide.jammed = True
        rig.run(15_000, "left.slide_inward")
        assert slide.decoupled is decouples
        assert slide.x_m == 0.3

    def test_placing_sets_the_speed_to_0(self) -> None:
        rig = make_rig()
        slide = rig.left.slide
        rig.run(2_000, "left.slide_inward")
        rig.left.place(x_m=0.3)
        assert slide.speed_m_s == 0.0
        rig.run(10)  # not yet long enough for the valve to close
        assert abs(slide.x_m - 0.3) < 0.0003
