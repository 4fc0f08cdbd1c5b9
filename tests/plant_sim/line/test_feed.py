"""Feeds: single blocks from a conveyor, and cups filled by the program and the machine."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.crop.seedling import CELLS_ALONG
from plant_sim.line.drive import MotorDrive, WheelDrive
from plant_sim.line.errors import LineError
from plant_sim.line.feed import ArmsFeed, blocks
from plant_sim.line.file import ConveyorEntry
from plant_sim.line.ground import SlipSpec, SpeedProfile, Stretch, WheelSlip
from plant_sim.line.row import Missing
from plant_sim.machine.parameters import load_machine
from tests.sampling import first_of


def conveyor(rate: str = "120/min", gaps: str = "0 %", dropped: str = "0 %") -> ConveyorEntry:
    return ConveyorEntry.model_validate({"rate": rate, "gaps": gaps, "dropped": dropped})


def test_a_conveyor_that_is_fast_enough_offers_every_block() -> None:
    fed = blocks(conveyor(), np.arange(1000) / 2.0, np.random.default_rng(1))
    assert fed.seedlings.tolist() == [1] * 1000
    assert fed.cause.tolist() == [Missing.NONE] * 1000


def test_a_conveyor_that_is_too_slow_serves_every_second_planter() -> None:
    """At 90 planters and 60 blocks per minute, a block takes 1 s to arrive and a planter passes every 0.667 s."""
    fed = blocks(conveyor("60/min"), np.arange(1000) / 1.5, np.random.default_rng(1))
    assert fed.seedlings.tolist() == [1, 0] * 500
    assert set(fed.cause[1::2].tolist()) == {Missing.MISSED_CUP}


def test_gaps_and_dropped_blocks_have_their_shares() -> None:
    number = 100_000
    fed = blocks(conveyor(gaps="2 %", dropped="5 %"), np.arange(float(number)), np.random.default_rng(3))
    gaps, dropped = (np.count_nonzero(fed.cause == cause) for cause in (Missing.MISSED_CUP, Missing.HANDOVER))
    assert gaps == pytest.approx(0.02 * number, abs=5 * math.sqrt(0.02 * number))
    assert dropped == pytest.approx(0.98 * 0.05 * number, abs=5 * math.sqrt(0.05 * number))
    assert gaps + dropped + fed.seedlings.sum() == number


@settings(derandomize=True)
@given(st.lists(st.floats(0.1, 3.0), min_size=1, max_size=60), st.floats(20.0, 200.0))
def test_no_block_is_offered_before_the_feeding_interval(intervals_s: list[float], per_min: float) -> None:
    times_s = np.cumsum(intervals_s)
    fed = blocks(conveyor(f"{per_min}/min"), times_s, np.random.default_rng(1))
    taken_s = times_s[fed.seedlings > 0]
    assert np.all(np.diff(taken_s) >= 60 / per_min - 1e-9)
    missed_s = times_s[fed.seedlings == 0]
    last_s = taken_s[np.searchsorted(taken_s, missed_s) - 1]
    assert np.all(missed_s - last_s < 60 / per_min)


def ground() -> SpeedProfile:
    """Return a profile with a ramp, a hill and a stop."""
    stretches = (
        Stretch(0.30, for_m=10.0),
        Stretch(0.36, for_m=5.0, is_ramp=True),
        Stretch(0.26, for_m=5.0, grade=0.1),
        Stretch(0.0, for_s=15.0),
    )
    return SpeedProfile(stretches, acceleration_m_s2=0.3, length_m=60.0)


@pytest.fixture(scope="module")
def fed_arms() -> tuple[ArmsFeed, MotorDrive]:
    drive = MotorDrive(ground(), per_m=2.5, lag_s=0.5)
    arms = ArmsFeed(load_machine(), seed=4, cups=150, frequency_per_min=45.0, spacing_m=0.4)
    arms.run(drive, ground(), until_s=160.0, cups_to_planting=6)
    return arms, drive


@pytest.mark.nightly
def test_the_chains_follow_the_cycles_of_the_drive(fed_arms: tuple[ArmsFeed, MotorDrive]) -> None:
    """The chain position corresponds to the planted cup, which is six cups after the last claw."""
    arms, drive = fed_arms
    pitch_m = 0.060
    for arm, row in zip(arms.twin.plant.arms.values(), arms.rows, strict=True):
        passed = arm.row.passed or []
        first = min(cup.cup for cup in passed if cup.seedlings)
        planted = float(drive.cycles_at(160.0)) - row.first_cycle
        assert (first + planted + 11.5 + 6) * pitch_m == pytest.approx(arm.cups.chain_m, abs=1e-6)


def test_every_cup_and_seedling_of_the_arms_is_accounted_for(fed_arms: tuple[ArmsFeed, MotorDrive]) -> None:
    arms, _ = fed_arms
    counts = arms.twin.plant.counts()
    assert counts.in_tray + counts.in_claw + counts.in_cups + counts.P + counts.D + counts.T == counts.total
    assert counts.in_cups == arms.seedlings_tracked + arms.seedlings_passed
    for row in arms.rows:
        assert row.seedlings[0] == 1
        assert np.all((row.seedlings > 0) == (row.cause == Missing.NONE))
        assert len(row.seedlings) > 60


def test_scans_beyond_the_ground_speed_sensor_and_the_air_are_counted(fed_arms: tuple[ArmsFeed, MotorDrive]) -> None:
    """While the tractor slows down, the motor turns further than it drives: the slip is negative in some scans."""
    arms, _ = fed_arms
    beyond, scans = arms.sensor
    assert 0 < beyond < 0.1 * scans
    assert scans == 16_000
    assert arms.duration_s == pytest.approx(160.0)
    assert 0.0 < arms.air_l < arms.twin.plant.air_l


@pytest.mark.nightly
def test_the_causes_are_those_of_the_lost_seedlings() -> None:
    """At 45 plants per minute no cup is missed; each empty cup has the cause of the seedling that was lost."""
    stretches = [Stretch(0.3, for_m=100.0)]
    profile = SpeedProfile(stretches, acceleration_m_s2=0.3, length_m=100.0)
    wheel = WheelSlip(SlipSpec(), profile, np.random.default_rng(1))
    arms = ArmsFeed(load_machine(), seed=2, cups=250, frequency_per_min=45.0, spacing_m=0.4)
    arms.run(WheelDrive(profile, wheel, per_wheel_m=2.5), profile, until_s=300.0, cups_to_planting=0)
    counts = arms.twin.plant.counts()
    causes = np.bincount(np.concatenate([row.cause for row in arms.rows]), minlength=len(Missing))
    assert causes[Missing.MISSED_CUP] == 0
    for cause, lost in ((Missing.P, counts.P), (Missing.D, counts.D), (Missing.T, counts.T)):
        assert lost - CELLS_ALONG < causes[cause] <= lost
    assert sum(causes[1:]) > 10


def test_the_tractor_of_the_plant_moves_as_the_profile_does() -> None:
    """The ground-speed sensor measures the travel of the tractor correctly despite the slip of the drive wheel."""
    profile = ground()
    slip = WheelSlip(SlipSpec(0.08, 0.03, 1.0), profile, np.random.default_rng(1))
    arms = ArmsFeed(load_machine(), seed=2, cups=150, frequency_per_min=45.0, spacing_m=0.38)
    before_m = arms.twin.plant.ground.travel_m
    arms.run(WheelDrive(profile, slip, per_wheel_m=1 / 0.38), profile, until_s=100.0, cups_to_planting=0)
    travel_m = arms.twin.plant.ground.travel_m - before_m
    assert travel_m == pytest.approx(float(profile.travel_at(100.0)), rel=1e-3)


def test_a_machine_that_cannot_keep_up_misses_cups() -> None:
    """At 120 plants per minute, the arms cannot fill every cup; the empty cups are counted as missed."""
    profile = SpeedProfile([Stretch(0.8, for_m=100.0)], acceleration_m_s2=0.3, length_m=100.0)
    wheel = WheelSlip(SlipSpec(), profile, np.random.default_rng(1))
    arms = ArmsFeed(load_machine(), seed=2, cups=250, frequency_per_min=120.0, spacing_m=0.4)
    arms.run(WheelDrive(profile, wheel, per_wheel_m=2.5), profile, until_s=60.0, cups_to_planting=0)
    for row in arms.rows:
        assert np.count_nonzero(row.cause == Missing.MISSED_CUP) > 0.2 * len(row.cause)


@pytest.mark.parametrize("until_s", first_of([60.0, 160.0]))
def test_the_same_seed_fills_the_same_cups(fed_arms: tuple[ArmsFeed, MotorDrive], until_s: float) -> None:
    arms, drive = fed_arms
    again = ArmsFeed(load_machine(), seed=4, cups=150, frequency_per_min=45.0, spacing_m=0.4)
    again.run(drive, ground(), until_s=until_s, cups_to_planting=6)
    for row, same in zip(arms.rows, again.rows, strict=True):
        assert row.first_cycle == same.first_cycle
        assert len(same.cause) > 20
        assert row.cause[: len(same.cause)].tolist() == same.cause.tolist()


def test_too_many_trays_are_rejected() -> None:
    with pytest.raises(LineError, match="requires 1002 trays, more than 1000; reduce it"):
        ArmsFeed(load_machine(), seed=1, cups=36_000, frequency_per_min=45.0, spacing_m=0.4)
