"""Stopping distances of the slide with and without its brake, compared with the paper and the switch bands.

The speed is 0.735e-9 * 1e5 / 490.87e-6 = 0.1497 m/s; see test_slide_lift.py.
"""

import pytest

from plant_sim.devices.pneumatic import Cylinder
from tests.plant_sim.machine.plant_rig import make_rig

SLIDE_M_S = 0.1497
FILTER_MS, SCAN_MS, WRITE_MS = 10, 10, 10
REACTIONS_MS = range(FILTER_MS + WRITE_MS, FILTER_MS + SCAN_MS + WRITE_MS + 1)
"""Delay from the edge of a switch to coil off: input filter, wait for the next scan, write of its outputs."""


def both_closed(cylinder: Cylinder) -> bool:
    return not cylinder.state["plus"]["piloted"] and not cylinder.state["minus"]["piloted"]


@pytest.mark.parametrize(("x_m", "coil"), [(0.0, "left.slide_inward"), (0.6, "left.slide_outward")])
@pytest.mark.parametrize("for_ms", [1_700, 2_000, 2_300, 2_611])
def test_the_slide_moves_less_than_2_mm_after_its_check_valves_have_closed(x_m: float, coil: str, for_ms: int) -> None:
    """The limit of 2 mm is stated in the paper and is interpreted as in docs/sources/machine.md 4."""
    rig = make_rig(x_m=x_m)
    slide = rig.left.slide
    rig.run(for_ms, coil)
    assert abs(slide.speed_m_s) == pytest.approx(SLIDE_M_S, rel=0.03)
    rig.run(20)
    while not both_closed(slide):
        rig.run(1)
    closed_m = slide.x_m
    assert abs(slide.speed_m_s) > 0.0
    rig.run(2_000)
    assert slide.speed_m_s == 0.0
    assert abs(slide.x_m - closed_m) < 0.002


@pytest.mark.parametrize(("x_m", "coil"), [(0.0, "left.slide_inward"), (0.6, "left.slide_outward")])
def test_the_slide_stops_about_6_mm_after_its_coil(x_m: float, coil: str) -> None:
    """The delay is the sum of valve delay, spool travel to the exhaust, and time to vent the driving tube.

    The valve takes 24.2 ms, and its spool opens the exhaust 2 ms later. The brake engages at 300 kPa gauge in the
    driving tube. This tube, 18.2 cm3, is vented through a conductance of 0.76e-8 m3/(s Pa) from 594 to 401 kPa in
    18.2e-6 / (1.0 to 1.2 * 0.76e-3) * ln(594 / 401) = 7.8 to 9.4 ms. The delay of 34 to 36 ms corresponds to 5.1 to 5.4
    mm. Then 150 N from the brake and 35 N of friction stop 10.4 kg within 0.6 mm, or within 0.9 mm if the remaining
    drive force is included.
    """
    rig = make_rig(x_m=x_m)
    slide = rig.left.slide
    rig.run(2_000, coil)
    off_m = slide.x_m
    rig.run(2_000)
    assert 0.0055 <= abs(slide.x_m - off_m) <= 0.0063


def test_the_slide_stops_within_60_ms() -> None:
    rig = make_rig()
    slide = rig.left.slide
    rig.run(2_000, "left.slide_inward")
    rig.run(36)
    assert slide.speed_m_s > 0.10
    rig.run(24)
    assert slide.speed_m_s == 0.0
    held_m = slide.x_m
    rig.run(60_000)
    assert slide.x_m == held_m


def test_without_its_brake_the_slide_coasts_on_its_trapped_air() -> None:
    """The check valves close 45 ms and 7 mm after the coil turns off; then only the trapped air stops the slide.

    The measured distance is 17.0 mm in total.
    """
    rig = make_rig({"slide.brake_n": 0.0})
    slide = rig.left.slide
    rig.run(2_000, "left.slide_inward")
    off_m = slide.x_m
    rig.run(3_000)
    assert 0.015 < slide.x_m - off_m < 0.019
    assert slide.speed_m_s == 0.0


def test_a_reversed_slide_stops_before_it_comes_back() -> None:
    """The second coil overrides the first after 19 ms and then exhausts the chamber that is now in front of the piston.

    One of the two tubes always releases the brake, so the air alone reverses the slide. The slide first travels at
    least 2.9 mm, the distance covered during the valve delay, and at most 19 mm, the limit for a slide without a brake.
    """
    rig = make_rig()
    slide = rig.left.slide
    rig.run(2_000, "left.slide_inward")
    turned_m = slide.x_m
    furthest_m = max(rig.trace(lambda: slide.x_m, 1_000, "left.slide_outward"))
    assert 0.0029 < furthest_m - turned_m < 0.019
    rig.run(4_000, "left.slide_outward")
    assert slide.x_m < 0.002


@pytest.mark.parametrize("spacing_m", [0.350, 0.600, 0.800])
@pytest.mark.parametrize("pick", [1, 2, 3])
def test_the_slide_stops_in_the_band_of_every_pick_for_any_reaction_time(spacing_m: float, pick: int) -> None:
    """The switch turns on at -5 mm and off at +6 mm, so the slide may travel 11 mm after the edge.

    During the reaction time of 20 to 30 ms at 0.15 m/s, the slide travels 3.0 to 4.5 mm, and then another 5.9 mm until
    it stops. With a row spacing of 350 mm the slide reaches pick 1 slightly faster, at 0.155 m/s.
    """
    rig = make_rig({"layout.row_spacing_m": spacing_m})
    slide = rig.left.slide
    switch = slide.at_pick[pick - 1]
    while not switch.edge_s:
        rig.run(1, "left.slide_inward")
    at_edge = rig.save()
    rests_m = []
    for reaction_ms in REACTIONS_MS:
        rig.restore(at_edge)
        rig.run(reaction_ms, "left.slide_inward")
        rig.run(500)
        assert slide.speed_m_s == 0.0
        assert switch.read()
        rests_m.append(slide.x_m - rig.machine.picks_m[pick - 1])
    assert rests_m == sorted(rests_m)
    assert rests_m[0] > 0.003
    assert rests_m[-1] < 0.006


def test_a_slide_that_overran_by_2_mm_returns_into_its_band_for_any_reaction_time() -> None:
    """If the coil turns off 45 ms after the edge, the slide stops 8 mm past the pick; its return ends in the band."""
    rig = make_rig()
    slide = rig.left.slide
    switch = slide.at_pick[0]
    rig.run_until(lambda: switch.edge_s > 0.0, "left.slide_inward")
    rig.run(45, "left.slide_inward")
    rig.run(500)
    assert 0.007 < slide.x_m - 0.1925 < 0.009
    assert not switch.read()
    off_s = switch.edge_s
    while switch.edge_s == off_s:
        rig.run(1, "left.slide_outward")
    at_edge = rig.save()
    for reaction_ms in REACTIONS_MS:
        rig.restore(at_edge)
        rig.run(reaction_ms, "left.slide_outward")
        rig.run(500)
        assert switch.read()
