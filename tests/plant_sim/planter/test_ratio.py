"""Tests of the points of zero horizontal speed, the depth, and the separation of block and planter."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from plant_sim.common.limits import SpecError
from plant_sim.planter.motion import Motion, PathSegment
from plant_sim.planter.motion_model import MotionModel
from plant_sim.planter.ratio import Regime, depth_m, point_ratio, regime_of, zero_speed_points, zero_speed_times_s
from plant_sim.planter.separation import GRAVITY_M_S2, separation_closed_form_s, separation_time_s
from tests.plant_sim.planter.planter_rig import CHAIN, motion_at, motion_of_ratio, motions
from tests.sampling import examples

TURN_S = 1e-6
"""Tolerance of a time found at a minimum, where the speed is quadratic and rounding limits the time to 1e-8 turns."""


@pytest.mark.parametrize(
    ("speed_km_h", "regime", "count"),
    [(1.9, Regime.SHORTENED_CYCLOID, 0), (1.65, Regime.SHORTENED_CYCLOID, 0), (1.4, Regime.TROCHOID, 2)],
)
def test_the_simulated_cases_have_no_no_and_two_points_of_zero_speed(
    speed_km_h: float, regime: Regime, count: int
) -> None:
    """The second case, which the paper calls a cycloid with one point, is a shortened cycloid (ratio 0.9964)."""
    motion = motion_at(speed_km_h)
    assert regime_of(motion.ratio) is regime
    for offset in ((0.0, 0.0), CHAIN.tip, CHAIN.guide):
        assert len(zero_speed_points(motion, offset)) == len(zero_speed_times_s(motion, offset)) == count


def test_the_cycloid_has_one_point_at_complete_rest() -> None:
    motion = motion_of_ratio(1.0)
    assert regime_of(motion.ratio) is Regime.CYCLOID
    (point,) = zero_speed_points(motion)
    assert (point.phase_deg, point.vertical_m_s) == pytest.approx((90.0, 0.0), abs=1e-12)
    assert zero_speed_times_s(motion) == pytest.approx((point.time_s,), abs=TURN_S)
    np.testing.assert_allclose(motion.velocity_m_s(point.time_s, CHAIN.tip)[0, 0], 0.0, atol=1e-12)


def test_the_points_of_the_trochoid() -> None:
    """The points are at asin(1/1.1743) = 58.38 degrees and its supplement, with sqrt(456.69^2 - 388.89^2) mm/s."""
    first, second = zero_speed_points(motion_at(1.4))
    assert (first.phase_deg, second.phase_deg) == pytest.approx((58.38, 121.62), abs=0.005)
    assert (first.vertical_m_s, second.vertical_m_s) == pytest.approx((-0.2394, 0.2394), abs=5e-5)


def test_the_radius_of_the_corrected_model_moves_its_points() -> None:
    motion = motion_at(1.9, MotionModel.CORRECTED)
    assert point_ratio(motion, CHAIN.tip) == pytest.approx(motion.ratio * 0.110 / 0.080)
    assert len(zero_speed_points(motion)) == 2
    assert len(zero_speed_points(motion, (0.0, 0.0))) == 0


def test_the_printed_velocity_has_no_point_of_zero_speed() -> None:
    for ratio in (0.87, 1.0, 1.17, 5.0):
        motion = motion_of_ratio(ratio, MotionModel.PRINTED)
        assert len(zero_speed_points(motion)) == len(zero_speed_times_s(motion)) == 0


@examples(20, nightly=60)
@given(motions())
def test_analysis_and_root_finding_agree(motion: Motion) -> None:
    for offset in ((0.0, 0.0), motion.chain.tip, motion.chain.guide):
        points = zero_speed_points(motion, offset)
        # near a ratio of 1, the phase is ill-conditioned: sin(phase) = 1 / ratio
        margin = 1e-6 if abs(point_ratio(motion, offset) - 1.0) < 1e-4 else 1e-9
        turn_s = 2 * math.pi / motion.omega_rad_s
        assert zero_speed_times_s(motion, offset) == pytest.approx(
            [each.time_s for each in points], abs=margin * turn_s
        )
        for point in points:
            velocity_m_s = motion.velocity_m_s(point.time_s, offset)[0, 0]
            assert velocity_m_s == pytest.approx((0.0, point.vertical_m_s), abs=1e-9)
            circumferential_m_s = motion.radius_m(offset) * motion.omega_rad_s
            assert point.vertical_m_s**2 == pytest.approx(circumferential_m_s**2 - motion.speed_m_s**2, abs=1e-9)


@pytest.mark.parametrize("excess", [1e-9, 1e-6, 1e-3])
def test_ratios_next_to_1_are_told_apart(excess: float) -> None:
    for ratio, count in ((1.0 - excess, 0), (1.0 + excess, 2)):
        motion = motion_of_ratio(ratio)
        assert len(zero_speed_points(motion)) == len(zero_speed_times_s(motion)) == count


def test_points_of_zero_speed_require_a_moving_machine() -> None:
    motion = Motion(CHAIN, speed_m_s=0.0, frequency_per_min=56.0)
    for search in (zero_speed_points, zero_speed_times_s):
        with pytest.raises(SpecError, match="speed_m_s must be above 0"):
            search(motion)


@pytest.mark.parametrize(("model", "expected_m"), [(MotionModel.RIGID, 0.050), (MotionModel.CORRECTED, 0.080)])
def test_the_depth_is_that_of_the_lowest_position_of_the_tip(model: MotionModel, expected_m: float) -> None:
    motion = motion_at(1.4, model)
    lowest_m = motion.position_m(np.linspace(0.0, motion.period_s, 20_001), CHAIN.tip)[..., 1].min()
    assert depth_m(motion) == pytest.approx(expected_m)
    assert -lowest_m - CHAIN.axle_height_m == pytest.approx(expected_m, abs=1e-6)


def clearances_m(motion: Motion, release_s: float, after_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the heights of the tip above the top of a freely falling block, independently of the tested code, m."""
    start_m = motion.position_m(release_s, motion.chain.tip)[0, 0, 1]
    tip_m = motion.position_m(release_s + after_s, motion.chain.tip)[0, :, 1]
    start_m_s = motion.velocity_m_s(release_s, motion.chain.tip)[0, 0, 1]
    block_m = start_m + motion.chain.block_top_m + start_m_s * after_s - 0.5 * GRAVITY_M_S2 * after_s**2
    return np.asarray(tip_m - block_m)


@examples(40, nightly=100)
@given(motions((MotionModel.CORRECTED, MotionModel.RIGID)), st.floats(0.0, 1.0))
def test_the_block_is_free_after_the_separation_time_and_not_before(motion: Motion, share: float) -> None:
    release_s = share * motion.period_s
    time_s = separation_time_s(motion, release_s)
    *before_m, then_m = clearances_m(motion, release_s, time_s * np.array([0.0, 0.3, 0.6, 0.9, 0.99, 1.0]))
    assert then_m == pytest.approx(0.0, abs=1e-9)
    assert max(before_m) < 0.0
    closed_s = separation_closed_form_s(motion, release_s)
    assert closed_s is None or closed_s == pytest.approx(time_s, abs=1e-9)


def test_on_a_straight_segment_the_time_is_that_of_a_fall_past_the_block() -> None:
    """Block and planter separate as if released from rest, in sqrt(2 * 45 mm / g) = 95.8 ms."""
    motion = motion_at(1.4)
    release_s = motion.starts_s[PathSegment.RISE] + 0.5
    expected_s = math.sqrt(2 * 0.045 / GRAVITY_M_S2)
    assert separation_closed_form_s(motion, release_s) == pytest.approx(expected_s)
    assert separation_time_s(motion, release_s) == pytest.approx(expected_s)


def test_late_releases_have_a_closed_form_and_early_ones_have_none() -> None:
    motion = motion_at(1.4)
    closed_s = [separation_closed_form_s(motion, motion.time_at_s(phase_deg)) for phase_deg in (60.0, 100.0, 160.0)]
    assert closed_s[:2] == [None, None]
    assert closed_s[2] == pytest.approx(separation_time_s(motion, motion.time_at_s(160.0)), abs=1e-12)


def test_a_tip_that_passes_the_block_several_times_separates_at_the_first() -> None:
    """On the top arc at 140 plants/min, the planter accelerates downward by up to 16 m/s2, more than the block."""
    motion = Motion(dataclasses.replace(CHAIN, block_top_m=0.01), speed_m_s=1.0, frequency_per_min=140.0)
    times_s = np.linspace(0.0, 0.5, 5_001)
    above_m = clearances_m(motion, 0.0, times_s)
    upward = np.flatnonzero((above_m[:-1] < 0.0) & (above_m[1:] >= 0.0))
    assert len(upward) == 2
    assert separation_time_s(motion, 0.0) == pytest.approx(times_s[upward[0]], abs=2e-4)
    assert separation_closed_form_s(motion, 0.0) is None


def test_the_arc_shortens_the_separation() -> None:
    """The sprocket accelerates the planter upward by up to R omega^2 = 2.6 m/s2, symmetrically about the lowest point.

    The distance is the acceleration integrated twice, which weights the acceleration at a third of the time on average.
    The time is therefore shortest for a release at a third of the separation time before the lowest point.
    """
    motion = motion_at(1.4)
    phases_deg = np.linspace(0.0, 180.0, 181)
    times_s = [separation_time_s(motion, motion.time_at_s(phase_deg)) for phase_deg in phases_deg]
    assert max(times_s) <= math.sqrt(2 * CHAIN.block_top_m / GRAVITY_M_S2) * (1 + 1e-9)
    assert min(times_s) == pytest.approx(math.sqrt(2 * CHAIN.block_top_m / (GRAVITY_M_S2 + 2.607)), rel=0.01)
    turned_deg = math.degrees(min(times_s) / 3 * motion.omega_rad_s)
    assert phases_deg[int(np.argmin(times_s))] == pytest.approx(90.0 - turned_deg, abs=1.0)
    first, second = zero_speed_points(motion)
    assert separation_time_s(motion, first.time_s) < separation_time_s(motion, second.time_s)


def test_a_higher_block_takes_longer() -> None:
    motion = motion_at(1.4)
    higher = motion_at(1.4, chain=dataclasses.replace(CHAIN, block_top_m=0.06))
    assert separation_time_s(higher, higher.time_at_s(100.0)) > 1.1 * separation_time_s(motion, motion.time_at_s(100.0))


def test_the_printed_path_has_no_separation() -> None:
    motion = motion_at(1.4, MotionModel.PRINTED)
    for time_of in (separation_time_s, separation_closed_form_s):
        with pytest.raises(SpecError, match="model printed has no continuous path"):
            time_of(motion, motion.time_at_s(100.0))
