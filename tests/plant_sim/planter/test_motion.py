"""Tests of the motion of the planters: paths, velocities and joints of the three models."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings

from plant_sim.common.limits import SpecError
from plant_sim.planter.motion import Motion, PathSegment
from plant_sim.planter.motion_model import MotionModel
from tests.plant_sim.planter.planter_rig import CHAIN, FREQUENCY_PER_MIN, motion_at, motions

CONTINUOUS = (MotionModel.CORRECTED, MotionModel.RIGID)


def velocity_errors_m_s(motion: Motion, segment: PathSegment, offset: tuple[float, float]) -> np.ndarray:
    """Return the velocity of planter 0 inside a segment, less the central difference of its position.

    The step minimises the sum of the rounding and the truncation error of a central difference.
    """
    start_s, end_s = motion.starts_s[segment], motion.starts_s[segment + 1]
    step_s = 1e-5 / motion.omega_rad_s
    times_s = np.linspace(start_s + 2 * step_s, end_s - 2 * step_s, 101)
    assert (motion.segment(times_s)[0] == segment).all()
    ahead_m, behind_m = motion.position_m(times_s + step_s, offset), motion.position_m(times_s - step_s, offset)
    difference: np.ndarray = motion.velocity_m_s(times_s, offset)[0] - (ahead_m - behind_m)[0] / (2 * step_s)
    return difference


@pytest.mark.parametrize("offset", [(0.0, 0.0), CHAIN.tip, CHAIN.guide], ids=["hinge", "tip", "guide"])
@pytest.mark.parametrize("segment", PathSegment)
@pytest.mark.parametrize("model", CONTINUOUS)
def test_the_velocity_is_the_derivative_of_the_position(
    model: MotionModel, segment: PathSegment, offset: tuple[float, float]
) -> None:
    assert np.abs(velocity_errors_m_s(motion_at(1.4, model), segment, offset)).max() < 1e-6


@settings(max_examples=60)
@given(motions(CONTINUOUS))
def test_the_velocity_of_any_motion_is_the_derivative_of_its_position(motion: Motion) -> None:
    for segment in PathSegment:
        assert np.abs(velocity_errors_m_s(motion, segment, motion.chain.tip)).max() < 1e-6


@pytest.mark.parametrize("segment", [PathSegment.FALL, PathSegment.RISE])
def test_the_printed_velocity_is_right_on_the_straight_segments(segment: PathSegment) -> None:
    assert np.abs(velocity_errors_m_s(motion_at(1.4, MotionModel.PRINTED), segment, CHAIN.tip)).max() < 1e-6


def test_printed_equation_6_lacks_omega_in_the_horizontal_speed() -> None:
    motion = motion_at(1.4, MotionModel.PRINTED)
    errors_m_s = velocity_errors_m_s(motion, PathSegment.TOP, CHAIN.tip)
    largest = (CHAIN.sprocket_radius_m + CHAIN.offset_m) * (1 - motion.omega_rad_s)
    assert errors_m_s[:, 0].min() == pytest.approx(largest, abs=1e-6)
    assert np.abs(errors_m_s[:, 1]).max() < 1e-6


def test_printed_equation_8_has_the_wrong_sign_of_the_horizontal_speed() -> None:
    motion = motion_at(1.4, MotionModel.PRINTED)
    errors_m_s = velocity_errors_m_s(motion, PathSegment.BOTTOM, CHAIN.tip)
    largest = 2 * (CHAIN.sprocket_radius_m + CHAIN.offset_m) * motion.omega_rad_s
    assert errors_m_s[:, 0].max() == pytest.approx(largest, abs=1e-6)
    assert np.abs(errors_m_s[:, 1]).max() < 1e-6


def test_printed_equation_1_begins_at_minus_the_centre_distance() -> None:
    """In the printed model, the path of the tip jumps by h - H at joint A and back at joint B."""
    jumps_m = {joint.name: joint.position_jump_m for joint in motion_at(1.4, MotionModel.PRINTED).joints()}
    shift_m = CHAIN.tip_height_m - CHAIN.centre_distance_m
    assert jumps_m["A"] == pytest.approx((0.0, shift_m), abs=1e-12)
    assert jumps_m["B"] == pytest.approx((0.0, -shift_m), abs=1e-12)
    for name in "CD":
        assert jumps_m[name] == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("model", [MotionModel.PRINTED, MotionModel.CORRECTED])
def test_the_vertical_speed_of_the_tip_jumps_by_l_omega_at_every_joint(model: MotionModel) -> None:
    motion = motion_at(1.65, model)
    jump_m_s = CHAIN.offset_m * motion.omega_rad_s
    assert jump_m_s == pytest.approx(0.1713, abs=1e-4)
    jumps_m_s = {joint.name: joint.velocity_jump_m_s for joint in motion.joints()}
    for name, sign in {"B": 1, "C": 1, "D": -1, "A": -1}.items():
        assert jumps_m_s[name] == pytest.approx((0.0, sign * jump_m_s), abs=1e-12)
    for joint in motion.joints((0.0, 0.0)):
        assert joint.velocity_jump_m_s == pytest.approx((0.0, 0.0), abs=1e-12)


@settings(max_examples=60)
@given(motions((MotionModel.RIGID,)))
def test_the_rigid_motion_is_continuous(motion: Motion) -> None:
    for joint in motion.joints():
        assert joint.position_jump_m == pytest.approx((0.0, 0.0), abs=1e-12)
        assert joint.velocity_jump_m_s == pytest.approx((0.0, 0.0), abs=1e-10)


def test_the_jumps_are_those_of_positions_and_velocities_around_a_joint() -> None:
    for model in MotionModel:
        motion = motion_at(1.4, model)
        for joint in motion.joints():
            times_s = motion.period_s + joint.time_s + np.array([-1e-9, 1e-9])
            position_m, velocity_m_s = motion.position_m(times_s, CHAIN.tip), motion.velocity_m_s(times_s, CHAIN.tip)
            assert position_m[0, 1] - position_m[0, 0] == pytest.approx(joint.position_jump_m, abs=1e-8)
            assert velocity_m_s[0, 1] - velocity_m_s[0, 0] == pytest.approx(joint.velocity_jump_m_s, abs=1e-7)


@settings(max_examples=60)
@given(motions((MotionModel.RIGID,)))
def test_every_point_of_a_rigid_planter_moves_with_the_hinge(motion: Motion) -> None:
    times_s = np.linspace(-motion.period_s, 2 * motion.period_s, 61)
    moved_m = motion.position_m(times_s, motion.chain.tip) - motion.position_m(times_s)
    np.testing.assert_allclose(moved_m, np.broadcast_to(motion.chain.tip, moved_m.shape), atol=1e-12)
    assert (motion.velocity_m_s(times_s, motion.chain.tip) == motion.velocity_m_s(times_s)).all()


@settings(max_examples=60)
@given(motions((MotionModel.RIGID, MotionModel.CORRECTED)))
def test_the_hinge_moves_along_the_chain_at_constant_speed(motion: Motion) -> None:
    """The distance of the hinge from the line between the sprocket centres is R, and its speed is that of the chain."""
    times_s = np.linspace(0.0, motion.period_s, 101)
    on_machine_m = motion.position_m(times_s)[0] - np.outer(times_s, [motion.speed_m_s, 0.0])
    nearest_m = np.clip(on_machine_m[:, 1], 0.0, motion.chain.centre_distance_m)
    distances_m = np.hypot(on_machine_m[:, 0], on_machine_m[:, 1] - nearest_m)
    np.testing.assert_allclose(distances_m, motion.chain.sprocket_radius_m, rtol=1e-9)
    speeds_m_s = np.hypot(*(motion.velocity_m_s(times_s)[0] - [motion.speed_m_s, 0.0]).T)
    np.testing.assert_allclose(speeds_m_s, motion.chain_m_s, rtol=1e-9)


def test_the_planter_goes_up_behind_and_down_in_front() -> None:
    """On the bottom arc, a planter moves backward relative to the machine, as zero speed at the soil requires."""
    motion = Motion(CHAIN, speed_m_s=0.0, frequency_per_min=FREQUENCY_PER_MIN)
    middles_s = [(start + end) / 2 for start, end in zip(motion.starts_s[:-1], motion.starts_s[1:], strict=True)]
    radius_m, high_m = CHAIN.sprocket_radius_m, CHAIN.centre_distance_m
    expected_m = [(0.0, high_m + radius_m), (radius_m, high_m / 2), (0.0, -radius_m), (-radius_m, high_m / 2)]
    np.testing.assert_allclose(motion.position_m(middles_s)[0], expected_m, atol=1e-12)
    chain_m_s = motion.chain_m_s
    expected_m_s = [(chain_m_s, 0.0), (0.0, -chain_m_s), (-chain_m_s, 0.0), (0.0, chain_m_s)]
    np.testing.assert_allclose(motion.velocity_m_s(middles_s)[0], expected_m_s, atol=1e-12)


@settings(max_examples=60)
@given(motions())
def test_the_planters_follow_one_another_at_equal_spacing(motion: Motion) -> None:
    """One planting interval later and one spacing farther, planter k + 1 is where planter k was."""
    times_s = np.linspace(0.0, motion.period_s, 37) + 1e-4 * motion.period_s
    step_s = motion.period_s / motion.chain.planters
    earlier_m = motion.position_m(times_s, motion.chain.tip)
    later_m = motion.position_m(times_s + step_s, motion.chain.tip)
    assert later_m.shape == (motion.chain.planters, len(times_s), 2)
    np.testing.assert_allclose(later_m[1:] - [motion.spacing_m, 0.0], earlier_m[:-1], atol=1e-9)
    np.testing.assert_allclose(later_m[0] - [motion.spacing_m, 0.0], earlier_m[-1], atol=1e-9)


def test_the_chain_of_the_paper() -> None:
    motion = motion_at(1.65)
    assert 1000 * motion.chain_m_s == pytest.approx(456.7, abs=0.05)
    assert motion.omega_rad_s == motion.chain_m_s / 0.080
    assert motion.period_s == pytest.approx(6 * 60 / 56)
    assert motion.chain_m_s * motion.period_s == pytest.approx(2.936, abs=0.0005)


@pytest.mark.parametrize(("speed_km_h", "ratio"), [(1.9, 0.8653), (1.65, 0.9964), (1.4, 1.1743)])
def test_the_ratios_and_spacings_of_the_simulated_cases(speed_km_h: float, ratio: float) -> None:
    motion = motion_at(speed_km_h)
    assert motion.ratio == pytest.approx(ratio, abs=5e-5)
    assert motion.spacing_m == pytest.approx(0.4893 / ratio, abs=1e-4)
    assert motion.spacing_m == pytest.approx(speed_km_h / 3.6 * 60 / 56)


def test_the_ends_of_the_centre_distance_reproduce_all_three_printed_ratios() -> None:
    """All three ratios round to the printed ones if and only if H is in its range in planter.yaml."""
    for high_m, fits in ((1.2160, False), (1.2161, True), (1.2174, True), (1.2175, False)):
        chain = dataclasses.replace(CHAIN, centre_distance_m=high_m)
        ratios = [motion_at(speed_km_h, chain=chain).ratio for speed_km_h in (1.9, 1.65, 1.4)]
        assert ([round(ratio, 2) for ratio in ratios] == [0.87, 1.0, 1.17]) is fits


def test_at_standstill_the_path_is_closed() -> None:
    motion = Motion(CHAIN, speed_m_s=0.0, frequency_per_min=FREQUENCY_PER_MIN)
    assert (motion.ratio, motion.spacing_m) == (math.inf, 0.0)
    np.testing.assert_allclose(motion.position_m(0.3), motion.position_m(0.3 + motion.period_s), atol=1e-12)


def test_a_segment_begins_at_its_joint() -> None:
    motion = motion_at(1.4)
    assert motion.segment(motion.starts_s[:-1])[0].tolist() == list(PathSegment)
    before_s = np.array(motion.starts_s[1:]) - 1e-9
    assert motion.segment(before_s)[0].tolist() == list(PathSegment)
    assert motion.segment(motion.starts_s[-1] + 1e-9)[0] == PathSegment.TOP


def test_a_time_on_the_bottom_arc_is_given_by_its_phase() -> None:
    motion = motion_at(1.4)
    assert motion.time_at_s(0.0) == motion.starts_s[PathSegment.BOTTOM]
    assert motion.time_at_s(180.0) == pytest.approx(motion.starts_s[PathSegment.RISE])
    lowest_m = motion.position_m(motion.time_at_s(90.0))[0, 0, 1]
    assert lowest_m == pytest.approx(motion.position_m(np.linspace(0, motion.period_s, 9_999))[0, :, 1].min(), abs=1e-6)


@pytest.mark.parametrize(
    ("speed_m_s", "frequency_per_min", "message"),
    [
        (-0.1, 56.0, "speed_m_s must be 0 to 10, not -0.1"),
        (math.nan, 56.0, "speed_m_s must be 0 to 10, not nan"),
        (0.4, 0.0, "frequency_per_min must be above 0, up to 1000, not 0"),
        (0.4, math.inf, "frequency_per_min must be above 0, up to 1000, not inf"),
    ],
)
def test_an_impossible_motion_is_rejected(speed_m_s: float, frequency_per_min: float, message: str) -> None:
    with pytest.raises(SpecError, match=f"^{message}$"):
        Motion(CHAIN, speed_m_s=speed_m_s, frequency_per_min=frequency_per_min)


def test_a_point_behind_the_centre_of_the_arc_is_rejected_unless_rigid() -> None:
    with pytest.raises(SpecError, match="offset must be less than R behind the hinge in model corrected"):
        motion_at(1.4, MotionModel.CORRECTED).position_m(0.0, (-0.08, 0.0))
    assert motion_at(1.4).position_m(0.0, (-0.08, 0.0)).shape == (6, 1, 2)
