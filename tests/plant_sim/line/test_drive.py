"""Drives: spacing and lambda at constant speed, on ramps, with slip and with motor lag."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from plant_sim.line.drive import MotorDrive, WheelDrive
from plant_sim.line.ground import SlipSpec, SpeedProfile, Stretch, WheelSlip
from plant_sim.line.planting import ChainPlanter
from plant_sim.planter.falls import default_table
from plant_sim.planter.motion import Motion
from plant_sim.planter.scatter import Ground
from tests.plant_sim.line.test_ground import VARIED, stretches
from tests.sampling import examples

TABLE = default_table(Ground.SOIL)
PITCH_M = ChainPlanter(TABLE, TABLE.planter.grip.clamp_n).pitch_m


def ground_of(*stretches: Stretch, length_m: float = 100.0) -> SpeedProfile:
    return SpeedProfile(stretches, acceleration_m_s2=0.3, length_m=length_m)


def wheel(ground: SpeedProfile, slip: SlipSpec, per_wheel_m: float, seed: int = 1) -> WheelDrive:
    return WheelDrive(ground, WheelSlip(slip, ground, np.random.default_rng(seed)), per_wheel_m=per_wheel_m)


def events_m(drive: WheelDrive | MotorDrive, ground: SpeedProfile) -> np.ndarray:
    """Return the travel at every complete cycle, m."""
    return ground.travel_at(drive.time_at(np.arange(int(drive.end_cycles) + 1)))


def test_the_planters_are_489_3_mm_apart() -> None:
    """The pitch agrees with the paper's chain speed of 456.7 mm/s at 56 plants/min, and with the motion of the tips."""
    assert pytest.approx(0.4893, abs=1e-4) == PITCH_M
    motion = Motion(TABLE.planter.chain, speed_m_s=0.4, frequency_per_min=56.0)
    assert motion.ratio * motion.spacing_m == pytest.approx(PITCH_M, rel=1e-12)


@pytest.mark.parametrize("slip", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("ratio", [0.87, 1.0, 1.17, 1.398])
def test_the_spacing_is_the_pitch_divided_by_lambda(ratio: float, slip: float) -> None:
    ground = ground_of(Stretch(0.44, for_m=100.0))
    drive = wheel(ground, SlipSpec(slip), ratio / PITCH_M)
    at_s = drive.time_at(np.arange(1, int(drive.end_cycles)))
    lambdas = PITCH_M * drive.per_m_at(at_s)
    assert lambdas == pytest.approx(np.full(len(lambdas), ratio * (1 - slip)))
    assert np.diff(ground.travel_at(at_s)) == pytest.approx(PITCH_M / lambdas[1:], rel=1e-9)
    assert drive.rate_at(at_s) == pytest.approx(ground.speed_at(at_s) * lambdas / PITCH_M)


def test_a_ground_wheel_keeps_the_spacing_through_every_change_of_speed() -> None:
    drive = wheel(ground := ground_of(*VARIED), SlipSpec(), 2.5)
    assert np.diff(events_m(drive, ground)) == pytest.approx(0.4, rel=1e-9)


@pytest.mark.parametrize("lag_s", [0.05, 0.5, 3.0])
def test_the_motor_drive_agrees_with_numerical_integration(lag_s: float) -> None:
    """Numerical integration of the differential equation of the lag gives the same number of cycles."""
    ground = ground_of(*VARIED, length_m=60.0)
    drive = MotorDrive(ground, per_m=2.5, lag_s=lag_s)

    def slopes(time_s: float, state: np.ndarray) -> list[float]:
        return [state[1], (2.5 * float(ground.speed_at(time_s)) - state[1]) / lag_s]

    state = np.zeros(2)
    for start_s, end_s in zip(ground.time_s[:-1], ground.time_s[1:], strict=True):
        times_s = np.linspace(start_s, end_s, 7)
        solved = solve_ivp(slopes, (start_s, end_s), state, t_eval=times_s, rtol=1e-10, atol=1e-12)
        assert drive.cycles_at(times_s[:-1]) == pytest.approx(solved.y[0][:-1], abs=1e-6)
        state = solved.y[:, -1]
    assert drive.end_cycles == pytest.approx(state[0], abs=1e-6)


def test_the_motor_lags_behind_a_ramp_by_its_time_constant() -> None:
    """On a long ramp of 0.01 m/s2, the rate corresponds to the speed one time constant earlier; lambda is reduced."""
    ground = ground_of(Stretch(0.2, for_s=20.0), Stretch(1.2, for_s=100.0, is_ramp=True), length_m=50.0)
    drive = MotorDrive(ground, per_m=2.5, lag_s=0.8)
    assert drive.rate_at(90.0) == pytest.approx(2.5 * ground.speed_at(89.2), rel=1e-9)
    assert drive.per_m_at(90.0) < 2.5


def test_the_motor_keeps_the_spacing_at_constant_speed_despite_slip() -> None:
    ground = ground_of(Stretch(0.44, for_m=100.0))
    drive = MotorDrive(ground, per_m=1.2 / PITCH_M, lag_s=0.5)
    assert np.diff(events_m(drive, ground))[30:] == pytest.approx(PITCH_M / 1.2, rel=1e-9)


def test_the_motor_runs_on_when_the_tractor_stops() -> None:
    """After the stop, the motor turns by the product of its rate and its lag, and lambda is infinite."""
    ground = ground_of(Stretch(0.5, for_m=20.0), Stretch(0.0, for_s=30.0), length_m=20.0)
    drive = MotorDrive(ground, per_m=2.5, lag_s=0.5)
    stop_s = ground.time_s[-2]
    rest = float(drive.rate_at(stop_s)) * 0.5
    assert rest > 0.1
    assert drive.end_cycles - float(drive.cycles_at(stop_s)) == pytest.approx(rest, rel=1e-9)
    assert np.isinf(drive.per_m_at(stop_s + 1.0))


@examples(30, nightly=100, derandomize=True)
@given(stretches, st.floats(0.02, 5.0), st.booleans())
def test_the_inverse_of_a_drive_returns_its_cycles(each: list[Stretch], lag_s: float, is_motor: bool) -> None:
    ground = ground_of(*each, length_m=40.0)
    slip = SlipSpec(0.1, 0.05, 0.7)
    drive = MotorDrive(ground, per_m=2.5, lag_s=lag_s) if is_motor else wheel(ground, slip, 2.5)
    cycles = np.linspace(0.0, drive.end_cycles * (1 - 1e-12), 499)
    time_s = drive.time_at(cycles)
    assert np.all(np.diff(time_s) >= 0)
    assert drive.cycles_at(time_s) == pytest.approx(cycles, abs=1e-8)


@pytest.mark.parametrize(("patch_m", "spacing_m"), [(1.0, 0.4), (5.0, 0.4), (0.2, 0.5)])
def test_the_scatter_of_the_slip_gives_the_spacing_its_variation(patch_m: float, spacing_m: float) -> None:
    """The coefficient of variation follows from the variance of the mean slip over one spacing.

    For independent patches of length L and a spacing S, the variance of the mean slip is the variance of the slip times
    1 - S/(3L) if S is at most L, and times (L/S)(1 - L/(3S)) otherwise.
    """
    mean, sd = 0.10, 0.02
    ground = ground_of(Stretch(0.5, for_m=20_000.0), length_m=20_000.0)
    drive = wheel(ground, SlipSpec(mean, sd, patch_m), 1 / (spacing_m * (1 - mean)))
    spacings_m = np.diff(events_m(drive, ground))
    share = patch_m / spacing_m
    averaging = 1 - 1 / (3 * share) if share >= 1 else share * (1 - share / 3)
    assert spacings_m.mean() == pytest.approx(spacing_m, rel=0.003)
    wanted = sd / (1 - mean) * math.sqrt(averaging)
    assert spacings_m.std() / spacings_m.mean() == pytest.approx(wanted, rel=0.04)
