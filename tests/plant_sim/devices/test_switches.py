"""Position switches on slide and lift: band, hysteresis, edges, contacts, faults."""

from itertools import pairwise

import pytest

from plant_sim.devices.sensor import Sensor
from tests.plant_sim.machine.plant_rig import Rig, make_rig

PICK_1_M, PICK_2_M, PICK_3_M = 0.1925, 0.2355, 0.2785


@pytest.mark.parametrize(
    ("from_m", "coil", "on_m", "off_m"),
    [
        (0.05, "slide_inward", PICK_1_M - 0.005, PICK_1_M + 0.006),
        (0.35, "slide_outward", PICK_1_M + 0.005, PICK_1_M - 0.006),
    ],
)
def test_a_pick_switch_has_band_and_hysteresis_from_either_side(
    from_m: float, coil: str, on_m: float, off_m: float
) -> None:
    """The time of an edge is that at which the slide crosses the edge position, interpolated within the step."""
    rig = make_rig(x_m=from_m)
    slide = rig.left.slide
    switch = slide.at_pick[0]
    places_m = []
    edges_s: dict[float, None] = {}
    for _ in range(3_000):
        places_m.append(slide.x_m)
        rig.run(1, f"left.{coil}")
        edges_s[switch.edge_s] = None
    due_s = [reached_s([*places_m, slide.x_m], edge_m) for edge_m in (on_m, off_m)]
    assert [edge_s for edge_s in edges_s if edge_s > 0.0] == pytest.approx(due_s, abs=1e-6)


@pytest.mark.parametrize(
    ("coil", "y_m", "on_m", "off_m"),
    [
        ("lift_retract", 0.150, 0.005, 0.144),
        ("lift_extend", 0.0, 0.145, 0.006),
    ],
)
def test_a_lift_switch_turns_off_6_mm_from_its_end_and_on_5_mm_from_it(
    coil: str, y_m: float, on_m: float, off_m: float
) -> None:
    rig = make_rig(y_m=y_m)
    lift = rig.left.lift
    places_m = rig.trace(lambda: lift.y_m, 1_500, f"left.{coil}")
    arrives, leaves = (lift.up, lift.down) if coil == "lift_retract" else (lift.down, lift.up)
    assert leaves.edge_s == pytest.approx(reached_s(places_m, off_m), abs=1e-6)
    assert arrives.edge_s == pytest.approx(reached_s(places_m, on_m), abs=1e-6)


def test_a_contact_bounces_for_3_ms_when_it_closes_and_opens_clean() -> None:
    """The contact is closed, open, closed, open and closed, for 0.6 ms each."""
    rig = make_rig({"simulation.step_s": 1e-4}, x_m=0.05)
    switch = rig.left.slide.at_pick[0]
    says = []
    while switch.edge_s == 0.0:
        rig.run(1, "left.slide_inward")
    edge_s = switch.edge_s
    while rig.plant.time_ms / 1000 < edge_s + 0.010:
        since_ms = rig.plant.time_ms - 1000 * edge_s
        says.append((since_ms, switch.read()))
        rig.run(1, "left.slide_inward")
    assert all(on is (int(5 * since_ms / 3) % 2 == 0) for since_ms, on in says if since_ms < 2.99)
    assert all(on for since_ms, on in says if since_ms >= 2.99)
    changes = rig.changes(switch, 500, "left.slide_inward")
    assert [on for _, on in changes] == [False]


def test_bouncing_ends_after_its_time() -> None:
    rig = make_rig({"contact.bounce_s": 0.020}, x_m=0.05)
    switch = rig.left.slide.at_pick[0]
    changes = rig.changes(switch, 1_500, "left.slide_inward")
    assert [on for _, on in changes] == [True, False, True, False, True, False]
    on_ms, steady_ms = changes[0][0], changes[4][0]
    assert 15 <= steady_ms - on_ms <= 17  # the last of five parts begins after 16 ms


def test_a_late_switch_delays_its_edges() -> None:
    rig = make_rig(x_m=0.05)
    switch = rig.left.slide.at_pick[0]
    switch.late_s = 0.050
    rig.run_until(lambda: switch.edge_s > 0.0, "left.slide_inward")
    edge_ms, now_ms = 1000 * switch.edge_s, rig.plant.time_ms
    assert not switch.read()
    ((change_ms, on),) = rig.changes(switch, 52, "left.slide_inward")[:1]
    assert on
    assert 50 <= now_ms + change_ms - edge_ms <= 54  # first edge while the contact bounces


def test_every_switch_of_the_slide_is_at_its_position() -> None:
    rig = make_rig()
    slide = rig.left.slide
    switches = (slide.at_feed, *slide.at_pick)
    for x_m, on in ((0.0, 0), (PICK_1_M, 1), (PICK_2_M, 2), (PICK_3_M, 3)):
        slide.place(x_m)
        assert [switch.read() for switch in switches] == [index == on for index in range(4)]
    slide.place((PICK_1_M + PICK_2_M) / 2)
    assert not any(switch.read() for switch in switches)


@pytest.mark.parametrize("stuck", [False, True])
def test_a_stuck_switch_keeps_its_level_everywhere_until_repaired(stuck: bool) -> None:
    rig = make_rig()
    switch = rig.left.slide.at_feed
    switch.stuck = stuck
    assert level_of(rig, switch) is stuck
    rig.run(1_500, "left.slide_inward")
    assert level_of(rig, switch) is stuck
    switch.stuck = None
    assert level_of(rig, switch) is False
    rig.left.place(x_m=0.0)
    assert level_of(rig, switch) is True


def level_of(rig: Rig, switch: Sensor) -> bool:
    """Return the level of the feed switch at its terminal and at the sensor."""
    assert rig.active("left.slide_at_feed") is switch.read()
    return switch.read()


def reached_s(places_m: list[float], edge_m: float) -> float:
    """Return the time at which a position was first crossed, interpolated between samples one millisecond apart."""
    for number, (before_m, after_m) in enumerate(pairwise(places_m)):
        if min(before_m, after_m) <= edge_m <= max(before_m, after_m) and before_m != after_m:
            return (number + (edge_m - before_m) / (after_m - before_m)) / 1000
    raise AssertionError(f"{edge_m} m was never passed")
