"""Speed profile and slip, compared with numerical integration and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import cumulative_trapezoid

from plant_sim.line.ground import SlipSpec, SpeedProfile, Stretch, WheelSlip
from tests.sampling import examples

VARIED = (
    Stretch(0.4, for_m=20.0),
    Stretch(0.6, for_m=10.0, is_ramp=True),
    Stretch(0.3, for_m=5.0, grade=0.1),
    Stretch(0.0, for_s=4.0),
    Stretch(0.5, for_s=15.0),
    Stretch(0.2, for_s=0.5),
    Stretch(0.7, for_m=0.05),
)


def profile(*stretches: Stretch, length_m: float = 100.0, acceleration_m_s2: float = 0.3) -> SpeedProfile:
    return SpeedProfile(stretches, acceleration_m_s2=acceleration_m_s2, length_m=length_m)


stretches = st.lists(
    st.one_of(
        st.builds(Stretch, st.floats(0.05, 2.0), for_m=st.floats(0.1, 30.0)),
        st.builds(Stretch, st.floats(0.05, 2.0), for_s=st.floats(0.1, 30.0)),
        st.builds(Stretch, st.floats(0.05, 2.0), for_m=st.floats(0.1, 30.0), is_ramp=st.just(True)),
        st.builds(Stretch, st.just(0.0), for_s=st.floats(0.0, 20.0)),
    ),
    min_size=1,
    max_size=5,
).filter(lambda each: each[0].target_m_s > 0)


def test_the_travel_is_the_integral_of_the_speed() -> None:
    ground = profile(*VARIED)
    time_s = np.linspace(0.0, ground.time_s[-1], 200_001)
    integral_m = cumulative_trapezoid(ground.speed_at(time_s), time_s, initial=0.0)
    assert np.abs(ground.travel_at(time_s) - integral_m).max() < 1e-5


@examples(30, nightly=100, derandomize=True)
@given(stretches)
def test_the_inverse_returns_the_earliest_time_of_a_travel(each: list[Stretch]) -> None:
    ground = profile(*each, length_m=50.0)
    travel_m = np.linspace(0.0, ground.travel_m[-1], 997)
    time_s = ground.time_at(travel_m)
    assert np.all(np.diff(time_s) >= 0)
    assert ground.travel_at(time_s) == pytest.approx(travel_m, abs=1e-9)
    earlier_s = time_s - 1e-3
    assert np.all(ground.travel_at(earlier_s[earlier_s > 0]) < travel_m[earlier_s > 0])


def test_a_stretch_has_its_length_including_the_change_of_speed() -> None:
    """From standstill to 0.6 m/s with 0.3 m/s2 takes 2 s and 0.6 m; 5.4 m at 0.6 m/s complete the 6 m."""
    ground = profile(Stretch(0.6, for_m=6.0), length_m=6.0)
    assert ground.time_s.tolist() == pytest.approx([0.0, 2.0, 11.0])
    assert ground.travel_m.tolist() == pytest.approx([0.0, 0.6, 6.0])


def test_a_stretch_that_is_too_short_ends_before_its_speed() -> None:
    ground = profile(Stretch(0.6, for_m=0.15), length_m=0.15)
    assert ground.speed_m_s[-1] == pytest.approx(math.sqrt(2 * 0.3 * 0.15))
    assert ground.travel_m[-1] == pytest.approx(0.15)


def test_a_stop_begins_at_standstill() -> None:
    ground = profile(Stretch(0.6, for_m=6.0), Stretch(0.0, for_s=10.0), length_m=6.0)
    assert ground.time_s.tolist() == pytest.approx([0.0, 2.0, 11.0, 13.0, 23.0])
    assert ground.speed_at(15.0) == 0.0
    assert ground.travel_at([13.0, 20.0]).tolist() == pytest.approx([6.6, 6.6])


def test_the_stretches_repeat_until_the_length_is_reached() -> None:
    ground = profile(Stretch(0.5, for_m=7.0), length_m=20.0)
    assert ground.travel_m[-1] == pytest.approx(21.0)


def test_a_profile_that_leads_nowhere_is_rejected() -> None:
    with pytest.raises(ValueError, match="lead nowhere"):
        profile(Stretch(0.0, for_s=10.0))
    with pytest.raises(ValueError, match="beyond the end of the profile"):
        profile(Stretch(0.5, for_m=7.0), length_m=7.0).time_at(7.5)


def test_the_wheel_turns_less_than_the_tractor_drives() -> None:
    ground = profile(Stretch(0.5, for_m=100.0))
    slip = WheelSlip(SlipSpec(0.05), ground, np.random.default_rng(1))
    assert slip.wheel_at(80.0) == pytest.approx(76.0)
    assert slip.travel_at(76.0) == pytest.approx(80.0)
    assert slip.at([0.0, 50.0]).tolist() == [0.05, 0.05]


def test_a_hill_adds_slip_only_on_the_hill() -> None:
    ground = profile(Stretch(0.5, for_m=10.5), Stretch(0.5, for_m=4.0, grade=0.1), length_m=20.0)
    slip = WheelSlip(SlipSpec(0.05, per_grade=0.5), ground, np.random.default_rng(1))
    assert slip.at([10.4, 10.6, 14.4, 14.6, 24.9, 25.1]).tolist() == pytest.approx([0.05, 0.10, 0.10, 0.05, 0.05, 0.10])
    assert slip.wheel_at(14.5) == pytest.approx(0.95 * 10.5 + 0.90 * 4.0)


def test_the_slip_of_the_patches_has_the_mean_and_the_scatter() -> None:
    ground = profile(Stretch(0.5, for_m=20_000.0), length_m=20_000.0)
    drawn = WheelSlip(SlipSpec(0.10, 0.02, 1.0), ground, np.random.default_rng(5)).slip
    assert len(drawn) == 20_000
    assert drawn.mean() == pytest.approx(0.10, abs=5 * 0.02 / math.sqrt(20_000))
    assert drawn.std() == pytest.approx(0.02, rel=5 / math.sqrt(40_000))


def test_slip_is_limited_and_the_patches_are_marked() -> None:
    ground = profile(Stretch(0.5, for_m=1000.0), length_m=1000.0)
    slip = WheelSlip(SlipSpec(0.2, 1.0, 1.0), ground, np.random.default_rng(5))
    assert (slip.slip.min(), slip.slip.max()) == (-0.5, 0.9)
    assert slip.limited.tolist() == [each in {-0.5, 0.9} for each in slip.slip.tolist()]
    assert not WheelSlip(SlipSpec(0.2, 0.1, 1.0), ground, np.random.default_rng(5)).limited.any()


def test_the_mean_slip_is_that_of_the_file_also_with_a_large_scatter() -> None:
    """With mean 2 % and SD 5 %, one patch in three has a negative slip; clipped at 0, the mean would be 3.2 %."""
    ground = profile(Stretch(0.5, for_m=20_000.0), length_m=20_000.0)
    slip = WheelSlip(SlipSpec(0.02, 0.05, 1.0), ground, np.random.default_rng(5))
    assert slip.slip.mean() == pytest.approx(0.02, abs=4 * 0.05 / math.sqrt(20_000))
    assert np.mean(slip.slip < 0.0) == pytest.approx(0.345, abs=0.015)
    assert np.all(np.diff(slip.wheel_at(np.linspace(0.0, 20_000.0, 9_999))) > 0.0)
