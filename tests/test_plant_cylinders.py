"""Slide and lift: times, stops, switches, against numbers derived by hand.

Slide: v = 0.7e-9 * 1e5 / (pi/4 * 0.025^2) = 0.142603 m/s. Lift down: 3.3e-9 * 1e5 / 1.64934e-3 =
0.200080 m/s, up: 3.93e-9 * 1e5 / 1.96350e-3 = 0.200153 m/s. From the coil: 15 ms valve, 20 ms dead
time, and a lag of 30 ms, which once settled costs 30 ms of way.
"""

import pytest
from plant_rig import MACHINE

from plant_sim.devices.cylinder import Cylinder
from plant_sim.devices.lift import Lift
from plant_sim.devices.sensor import PositionSwitch
from plant_sim.devices.slide import Slide

SLIDE_M_S = 0.1426028
PICK_1_M, PICK_2_M, PICK_3_M = 0.1925, 0.2355, 0.2785


def make_slide(x_m: float = 0.0) -> Slide:
    return Slide(MACHINE.slide, MACHINE.valve, MACHINE.picks_m, x_m=x_m)


def make_lift(y_m: float = 0.0) -> Lift:
    return Lift(MACHINE.lift, MACHINE.valve, y_m=y_m)


def move(slide: Slide, for_ms: int, *, inward: bool = False, outward: bool = False, dt_ms: int = 5) -> None:
    for _ in range(for_ms // dt_ms):
        slide.step(dt_ms / 1000, inward=inward, outward=outward)


def raise_or_lower(lift: Lift, for_ms: int, *, extend: bool = False, retract: bool = False) -> None:
    for _ in range(for_ms // 5):
        lift.step(0.005, extend=extend, retract=retract)


def test_pick_positions_follow_the_row_spacing() -> None:
    assert MACHINE.picks_m == pytest.approx((PICK_1_M, PICK_2_M, PICK_3_M))
    narrow = MACHINE.with_values({"layout.row_spacing_m": 0.350})
    assert narrow.picks_m == pytest.approx((0.0675, 0.1105, 0.1535))
    wide = MACHINE.with_values({"layout.row_spacing_m": 0.800})
    assert wide.picks_m == pytest.approx((0.2925, 0.3355, 0.3785))


def test_the_slide_starts_after_valve_and_dead_time() -> None:
    slide = make_slide()
    move(slide, 35, inward=True)
    assert slide.x_m == 0.0
    assert not slide.moving
    move(slide, 5, inward=True)
    assert 0.0 < slide.x_m < 0.0001  # 0.142603 * (5 - 30 * (1 - exp(-5/30))) ms = 0.056 mm
    assert slide.moving


def test_the_slide_takes_its_time_for_the_stroke() -> None:
    slide = make_slide()
    move(slide, 4_270, inward=True)  # 600 mm at 142.603 mm/s are 4207 ms, and 65 ms before
    assert 0.599 < slide.x_m < 0.600
    move(slide, 5, inward=True)
    assert slide.x_m == 0.600
    move(slide, 1_000, inward=True)
    assert slide.x_m == 0.600
    assert slide.speed_m_s == 0.0
    assert not slide.moving


@pytest.mark.parametrize(("dt_ms", "for_ms"), [(1, 505), (1, 1_000), (5, 1_000)])
def test_the_length_of_a_step_does_not_change_the_motion(dt_ms: int, for_ms: int) -> None:
    slide = make_slide()
    move(slide, for_ms, inward=True, dt_ms=dt_ms)
    settled_s = (for_ms - 35) / 1000 - 0.030
    assert slide.x_m == pytest.approx(SLIDE_M_S * settled_s, abs=1e-7)


def test_the_slide_stops_within_2_mm_once_the_check_valves_close() -> None:
    slide = make_slide()
    move(slide, 1_000, inward=True)
    at_coil_off_m = slide.x_m
    move(slide, 20)
    at_valve_off_m = slide.x_m
    assert at_valve_off_m - at_coil_off_m == pytest.approx(0.020 * SLIDE_M_S, abs=1e-6)
    move(slide, 1_000)
    assert 0.0016 < slide.x_m - at_valve_off_m < 0.0018  # 0.142603 m/s * 12 ms = 1.711 mm
    assert slide.speed_m_s == 0.0
    assert not slide.moving


def test_the_stop_is_over_in_a_tenth_of_a_second() -> None:
    slide = make_slide()
    move(slide, 1_000, inward=True)
    move(slide, 105)  # 20 ms valve, 12 ms * ln(0.1426 / 0.0001) = 87 ms
    assert slide.moving
    move(slide, 10)
    assert not slide.moving


def test_both_coils_hold_the_slide() -> None:
    slide = make_slide(0.300)
    move(slide, 1_000, inward=True, outward=True)
    assert slide.x_m == 0.300


def test_a_reversed_slide_stops_before_it_comes_back() -> None:
    slide = make_slide()
    move(slide, 1_000, inward=True)
    turned_m = slide.x_m
    furthest_m = turned_m
    while slide.speed_m_s > 0.0 or slide.x_m == turned_m:
        move(slide, 5, outward=True)
        furthest_m = max(furthest_m, slide.x_m)
    # 15 ms on until the second coil acts too, then the check valves close; 20 ms later the first
    # coil has let go, and after 20 ms of dead time it goes back
    assert 0.0031 < furthest_m - turned_m < 0.0040
    move(slide, 2_000, outward=True)
    assert slide.x_m == 0.0


def test_the_slide_moves_outward_as_fast_as_inward() -> None:
    slide = make_slide(0.600)
    move(slide, 4_270, outward=True)
    assert 0.0 < slide.x_m < 0.001
    move(slide, 5, outward=True)
    assert slide.x_m == 0.0


def test_a_jammed_slide_stands_dead_and_goes_on_when_freed() -> None:
    slide = make_slide()
    move(slide, 500, inward=True)
    stuck_m = slide.x_m
    slide.jammed = True
    move(slide, 1_000, inward=True)
    assert slide.x_m == stuck_m
    assert slide.speed_m_s == 0.0
    assert not slide.moving
    slide.jammed = False
    move(slide, 100, inward=True)  # no dead time left, only the lag
    assert slide.x_m - stuck_m == pytest.approx(SLIDE_M_S * 0.071, abs=0.0003)


@pytest.mark.parametrize(
    ("inward", "on_m", "off_m"),
    [(True, PICK_1_M - 0.005, PICK_1_M + 0.006), (False, PICK_1_M + 0.005, PICK_1_M - 0.006)],
)
def test_a_pick_switch_has_band_and_hysteresis_from_either_side(inward: bool, on_m: float, off_m: float) -> None:
    slide = make_slide(PICK_1_M - 0.03 if inward else PICK_1_M + 0.03)
    changes_m = positions_at_changes(slide, slide.at_pick[0], inward=inward)
    step_m = 0.00015  # a millisecond
    assert len(changes_m) == 2
    on_seen_m, off_seen_m = changes_m
    late = 1 if inward else -1
    assert 0.0 <= (on_seen_m - on_m) * late <= step_m
    assert 0.0 <= (off_seen_m - off_m) * late <= step_m


def positions_at_changes(slide: Slide, switch: PositionSwitch, *, inward: bool) -> list[float]:
    changes_m = []
    was_on = switch.read()
    for _ in range(600):
        slide.step(0.001, inward=inward, outward=not inward)
        if switch.read() != was_on:
            was_on = not was_on
            changes_m.append(slide.x_m)
    return changes_m


def test_every_switch_of_the_slide_is_where_it_belongs() -> None:
    slide = make_slide()
    switches = (slide.at_feed, *slide.at_pick)
    for x_m, on in ((0.0, 0), (PICK_1_M, 1), (PICK_2_M, 2), (PICK_3_M, 3)):
        slide.place(x_m)
        assert [switch.read() for switch in switches] == [index == on for index in range(4)]
    slide.place((PICK_1_M + PICK_2_M) / 2)
    assert not any(switch.read() for switch in switches)


@pytest.mark.parametrize("stuck", [False, True])
def test_a_stuck_switch_says_the_same_everywhere_until_it_is_repaired(stuck: bool) -> None:
    slide = make_slide()
    slide.at_feed.stuck = stuck
    assert slide.at_feed.read() is stuck
    move(slide, 1_000, inward=True)
    assert slide.at_feed.read() is stuck
    slide.at_feed.stuck = None
    assert slide.at_feed.read() is False
    slide.place(0.0)
    assert slide.at_feed.read() is True


def test_extending_the_lift_lowers_the_arm_in_time() -> None:
    lift = make_lift()
    assert lift.up.read()
    assert not lift.down.read()
    raise_or_lower(lift, 785, extend=True)  # 145 mm at 200.080 mm/s are 724.7 ms, and 65 ms before
    assert not lift.down.read()
    raise_or_lower(lift, 10, extend=True)
    assert lift.down.read()
    raise_or_lower(lift, 15, extend=True)  # 150 mm: 749.7 + 65 = 814.7 ms
    assert lift.y_m < 0.150
    raise_or_lower(lift, 10, extend=True)
    assert lift.y_m == 0.150
    assert lift.rise_m == 0.0
    assert not lift.up.read()


def test_retracting_the_lift_raises_the_arm_in_time() -> None:
    lift = make_lift(0.150)
    raise_or_lower(lift, 785, retract=True)  # 145 mm at 200.153 mm/s are 724.4 ms, and 65 ms before
    assert not lift.up.read()
    raise_or_lower(lift, 10, retract=True)
    assert lift.up.read()
    raise_or_lower(lift, 30, retract=True)
    assert lift.y_m == 0.0
    assert lift.rise_m == 0.150


def test_the_lift_leaves_its_lower_switch_6_mm_up() -> None:
    lift = make_lift(0.150)
    while lift.down.read():
        lift.step(0.001, extend=False, retract=True)
    assert 0.0060 <= lift.rise_m <= 0.0062
    while lift.rise_m < 0.010:
        lift.step(0.001, extend=False, retract=True)
    while not lift.down.read():
        lift.step(0.001, extend=True, retract=False)
    assert 0.0048 <= lift.rise_m <= 0.0050


def test_the_lift_holds_without_coils_between_its_ends() -> None:
    lift = make_lift(0.0)
    raise_or_lower(lift, 400, extend=True)
    valve_off_m = lift.y_m + 0.020 * 0.200080
    raise_or_lower(lift, 200)
    held_m = lift.y_m
    assert 0.0017 < held_m - valve_off_m < 0.0019  # 0.200080 m/s * 9 ms = 1.801 mm
    raise_or_lower(lift, 60_000)
    assert lift.y_m == held_m


@pytest.mark.parametrize(("cylinder", "stroke_m"), [(make_slide(0.1), 0.600), (make_lift(0.1), 0.150)])
def test_placing_clips_to_the_stroke(cylinder: Cylinder, stroke_m: float) -> None:
    cylinder.place(9.0)
    assert cylinder.position_m == stroke_m
    cylinder.place(-1.0)
    assert cylinder.position_m == 0.0


def test_placing_takes_the_speed() -> None:
    slide = make_slide()
    move(slide, 1_000, inward=True)
    slide.place(0.3)
    move(slide, 10)  # not yet long enough for the valve to close
    assert slide.x_m - 0.3 < 0.0003
