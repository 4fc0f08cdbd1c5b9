"""Tests of what disturbs a fall: pitch, roll, uneven plates, slope of the furrow, and the polygon of the chain."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from plant_sim.planter.contact import STEP_S, UNDISTURBED, Disturbance, Fall, FallFrame, drop
from plant_sim.planter.falls import motion_at
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter, load_planter, load_ranges
from plant_sim.planter.polygon import along_m, angle_rad, polygon_path_m
from plant_sim.planter.roll import final_roll_deg
from plant_sim.planter.scatter import Ground, draw

PLANTER, RANGES = load_planter(), load_ranges()
MOTION = motion_at(PLANTER, 1.17)


def fall(disturbance: Disturbance = UNDISTURBED, planter: Planter = PLANTER) -> tuple[Fall, list[FallFrame]]:
    frames: list[FallFrame] = []
    found = drop(planter, planter.rigid_ground, MOTION, opener_deg=75.0, disturbance=disturbance, frames=frames)
    return found, frames


def without_guide() -> Planter:
    return PLANTER.with_values({"chain.guide_behind_m": 0.1})


@pytest.mark.parametrize("pitch_deg", [-5.0, 5.0])
def test_pitched_block_keeps_its_angle_and_its_middle_in_the_plates(pitch_deg: float) -> None:
    _, frames = fall(Disturbance(pitch_deg=pitch_deg), without_guide())
    held = round(PLANTER.grip.free_s / STEP_S) - 2
    pitch_rad, half_m = math.radians(pitch_deg), PLANTER.block.edge_m / 2
    for frame in frames[:held]:
        assert frame.tilt_rad == pytest.approx(pitch_rad, abs=1e-4)
        middle_m = frame.block_x_m + half_m * math.sin(pitch_rad) - frame.hinge_x_m
        assert middle_m == pytest.approx(0.0, abs=1e-4)
        # the middle of an upright block is as high
        above_m = frame.block_y_m + half_m * math.cos(pitch_rad) - frame.hinge_y_m
        assert above_m == pytest.approx(PLANTER.chain.block_top_m - half_m, abs=1e-4)


def test_block_that_the_guide_plate_would_penetrate_touches_it_instead() -> None:
    close = PLANTER.with_values({"chain.guide_behind_m": 0.0205})
    _, frames = fall(Disturbance(behind_m=0.001, pitch_deg=6.0), close)
    first, half_m, pitch_rad = frames[0], PLANTER.block.edge_m / 2, math.radians(6.0)
    middle_m = first.block_x_m + half_m * math.sin(first.tilt_rad) - first.hinge_x_m
    rear_m = middle_m - half_m * (math.cos(pitch_rad) + math.sin(pitch_rad))
    assert rear_m == pytest.approx(-0.0205, abs=2e-5)


@pytest.mark.parametrize("slope_deg", [-4.0, 4.0])
def test_block_on_a_slope_leans_with_it(slope_deg: float) -> None:
    """A furrow that falls in the direction of travel leans the block forward."""
    found, _ = fall(Disturbance(slope_deg=slope_deg), without_guide())
    assert found.rested
    assert found.tilt_deg == pytest.approx(slope_deg, abs=0.2)


def test_second_plate_delays_the_release() -> None:
    """The force ends when the sum of both openings is the compression."""
    grip = PLANTER.grip
    for uneven_s in (0.0, 0.004, 0.05):
        free_s = grip.free_after_s(uneven_s)
        opened_m = grip.opening_m_s * (free_s + max(0.0, free_s - uneven_s))
        assert opened_m == pytest.approx(grip.compression_m)
        assert grip.force_n(free_s + 1e-6, uneven_s) == 0.0
        assert grip.force_n(free_s - 1e-4, uneven_s) > 0.0
    assert grip.free_after_s(0.05) == pytest.approx(2 * grip.free_s)
    assert (grip.sideways_m_s(0.0), grip.sideways_m_s(0.05)) == (0.0, grip.opening_m_s / 2)


def test_block_leaves_uneven_plates_later() -> None:
    left = []
    for uneven_s in (0.0, 0.010):
        _, frames = fall(Disturbance(uneven_s=uneven_s))
        start_m = frames[0].block_y_m - frames[0].hinge_y_m
        left.append(next(i for i, each in enumerate(frames) if each.block_y_m - each.hinge_y_m < start_m - 1e-4))
    assert (left[1] - left[0]) * STEP_S == pytest.approx(0.005, abs=0.0015)


@pytest.mark.parametrize("kind", list(Ground))
def test_block_rolled_by_the_largest_plausible_angle_comes_to_rest_upright(kind: Ground) -> None:
    """Therefore the tables of falls, which are simulated in the plane of travel, need no roll."""
    roll_deg, uneven_s = RANGES["scatter.roll_deg"][1], RANGES["scatter.uneven_s"][1]
    for frequency_per_min in (30.0, 66.0):
        motion = motion_at(PLANTER, 1.0, frequency_per_min)
        disturbance = Disturbance(roll_deg=roll_deg, uneven_s=uneven_s)
        found_deg = final_roll_deg(PLANTER, getattr(PLANTER, kind), motion, disturbance, opener_deg=75.0)
        assert abs(found_deg) < 0.5


def test_block_rolled_beyond_its_balance_tips() -> None:
    """A block on one edge tips if its centre of mass is beyond this edge."""
    balance_deg = math.degrees(math.atan(PLANTER.block.edge_m / 2 / PLANTER.block.centre_m))
    for roll_deg, tips in ((balance_deg - 3.0, False), (balance_deg + 3.0, True), (-balance_deg - 3.0, True)):
        found_deg = final_roll_deg(
            PLANTER, PLANTER.rigid_ground, MOTION, Disturbance(roll_deg=roll_deg), opener_deg=90.0
        )
        assert (abs(found_deg) > 60.0) == tips
        assert not tips or math.copysign(1.0, found_deg) == math.copysign(1.0, roll_deg)


def times_s(motion: Motion, until_s: float = 0.6) -> np.ndarray:
    times: np.ndarray = motion.time_at_s(45.0) + np.arange(0.0, until_s, 2e-4)
    return times


def test_hinge_is_on_the_pitch_circle_and_then_on_the_span() -> None:
    chain = PLANTER.chain
    at_s = times_s(MOTION)
    path_m = polygon_path_m(MOTION, at_s)
    path_m[:, 0] -= MOTION.speed_m_s * at_s
    inner_m = chain.sprocket_radius_m * math.cos(math.pi / chain.teeth)
    is_arc = path_m[:, 1] <= 0.0
    assert np.hypot(*path_m[is_arc].T) == pytest.approx(chain.sprocket_radius_m)
    lateral_m = -path_m[path_m[:, 1] > chain.link_m, 0]
    assert lateral_m.min() == pytest.approx(inner_m, abs=2e-6)
    assert lateral_m.max() == pytest.approx(chain.sprocket_radius_m, abs=2e-6)
    steps_m = np.hypot(*np.diff(path_m, axis=0).T)
    assert steps_m.max() < 1.02 * MOTION.chain_m_s * 2e-4


def test_span_moves_at_the_mean_speed_of_the_chain() -> None:
    """Over a whole number of teeth, the hinge rises by as many links; at the lowest point it is where `Motion` is."""
    chain, lowest_s = PLANTER.chain, MOTION.time_at_s(90.0)
    tooth_s = chain.link_m / MOTION.chain_m_s
    heights_m = polygon_path_m(MOTION, lowest_s + 0.35 + tooth_s * np.arange(4))[:, 1]
    assert np.diff(heights_m) == pytest.approx(chain.link_m)
    assert polygon_path_m(MOTION, lowest_s)[0] == pytest.approx(MOTION.position_m(lowest_s)[0, 0])


@pytest.mark.parametrize("part", [0.0, 0.5])
def test_lower_sprocket_turns_evenly_only_with_whole_links(part: float) -> None:
    """The extreme ratios of the angular speeds of two sprockets half a link out of step are cos(pi/N) and 1/cos(pi/N).

    Source: kinematics of chain drives; each sprocket moves the span at omega R cos(psi).
    """
    chain = dataclasses.replace(PLANTER.chain, span_part=part)
    motion = Motion(chain, speed_m_s=0.4, frequency_per_min=58)
    at_s = times_s(motion, 0.2)
    path_m = polygon_path_m(motion, at_s)
    phase_rad = np.unwrap(np.arctan2(path_m[:, 1], path_m[:, 0] - motion.speed_m_s * at_s))
    driver_rad_s = motion.chain_m_s * 2 * math.pi / chain.teeth / chain.link_m
    ratio = np.abs(np.diff(phase_rad)) / 2e-4 / driver_rad_s
    cosine = math.cos(math.pi / chain.teeth) if part else 1.0
    assert ratio.min() == pytest.approx(cosine, abs=2e-4)
    assert ratio.max() == pytest.approx(1 / cosine, abs=2e-4)


def test_polygon_with_many_teeth_is_the_ideal_path() -> None:
    chain = dataclasses.replace(PLANTER.chain, teeth=200)
    motion = Motion(chain, speed_m_s=0.4, frequency_per_min=58)
    at_s = times_s(motion)
    assert polygon_path_m(motion, at_s) == pytest.approx(motion.position_m(at_s)[0], abs=2e-5)


def test_hinge_that_reaches_the_upper_sprocket_follows_the_ideal_path() -> None:
    motion = Motion(PLANTER.chain, speed_m_s=0.4, frequency_per_min=400)
    at_s = times_s(motion, 0.8)
    path_m, ideal_m = polygon_path_m(motion, at_s), motion.position_m(at_s)[0]
    assert path_m == pytest.approx(ideal_m, abs=2e-3)


def test_travel_and_angle_are_inverse() -> None:
    angles = np.linspace(-7.0, 7.0, 401)
    assert angle_rad(PLANTER.chain, along_m(PLANTER.chain, angles)) == pytest.approx(angles, abs=1e-7)


def test_engine_moves_the_planter_on_the_polygon() -> None:
    _, frames = fall()
    at_s = MOTION.time_at_s(90.0) + np.array([each.time_s for each in frames])
    lowest_m = MOTION.position_m(MOTION.time_at_s(90.0))[0, 0]
    hinge_m = np.array([(each.hinge_x_m, each.hinge_y_m) for each in frames])
    assert hinge_m == pytest.approx(polygon_path_m(MOTION, at_s) - lowest_m, abs=1e-9)


def test_drawn_disturbances_fill_their_ranges() -> None:
    rng, scatter = np.random.default_rng(1), PLANTER.scatter
    drawn = np.array([draw(PLANTER, RANGES, Ground.SOIL, rng).disturbance for _ in range(300)])
    largest = np.array([scatter.place_m, scatter.pitch_deg, scatter.roll_deg, scatter.uneven_s, scatter.slope_deg])
    smallest = np.where(np.arange(5) == Disturbance._fields.index("uneven_s"), 0.0, -largest)
    assert (drawn <= largest).all()
    assert (drawn >= smallest).all()
    assert (drawn.max(axis=0) > 0.95 * largest).all()
    assert (drawn.min(axis=0) < smallest + 0.05 * largest).all()
