"""Planting by the nozzle and the chain planter, and handover through the chute."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant_sim.line.drive import MotorDrive, WheelDrive
from plant_sim.line.file import ChuteEntry, NozzleEntry
from plant_sim.line.ground import SlipSpec, SpeedProfile, Stretch, WheelSlip
from plant_sim.line.injury import CabbageInjury
from plant_sim.line.planting import (
    CARRIED_CYCLES,
    ChainPlanter,
    Course,
    Transport,
    drop_through_chute,
    plant_by_chain,
    plant_by_nozzle,
    releases,
)
from plant_sim.line.row import NO_PLANT, FedRow, Missing
from plant_sim.planter.falls import default_table
from plant_sim.planter.quality import injury_share
from plant_sim.planter.scatter import Ground
from plant_sim.planter.verdict import Stand
from tests.plant_sim.line.test_ground import stretches
from tests.sampling import examples

SPEED_M_S = 0.3
SPACING_M = 0.4
FREQUENCY_HZ = SPEED_M_S / SPACING_M
PHASE = 0.4 * FREQUENCY_HZ


def course(speed_m_s: float = SPEED_M_S, metres: float = 50.0) -> Course:
    ground = SpeedProfile([Stretch(speed_m_s, for_m=100.0)], acceleration_m_s2=0.3, length_m=metres + 40.0)
    wheel = WheelSlip(SlipSpec(), ground, np.random.default_rng(1))
    return Course(ground, WheelDrive(ground, wheel, per_wheel_m=1 / SPACING_M), metres)


def full(cups: int, first_cycle: float = 10.0) -> FedRow:
    return FedRow(np.ones(cups, dtype=np.int64), np.zeros(cups, dtype=np.int64), first_cycle)


def nozzle(**values: str) -> NozzleEntry:
    return NozzleEntry.model_validate({"fall": "0.2 s", "depth": "60 mm", **values})


def chute(**values: str) -> ChuteEntry:
    return ChuteEntry.model_validate({"transit": "0.4 s", "window": "20 %", **values})


def test_a_row_has_its_length_and_the_rest_is_in_transit() -> None:
    """A release every 0.4 m gives 125 releases from 0 to 49.6 m, and one more at 50 m depending on rounding."""
    at = releases(course(), 10.3, 200)
    assert at.number in {125, 126}
    assert at.travel_m[0] == 0.0
    assert np.diff(at.travel_m) == pytest.approx(SPACING_M, rel=1e-9)
    assert at.travel_m[-1] == pytest.approx(SPACING_M * (at.number - 1))
    row = plant_by_nozzle(nozzle(), full(200, 10.3), course(), np.random.default_rng(1))
    assert row.released + row.in_transit == 200
    assert row.in_transit == row.seedlings_in_transit > 0


def test_a_plant_lands_a_fall_after_its_release() -> None:
    """At 0.3 m/s and a fall time of 0.2 s, the nozzle travels 60 mm during the fall."""
    row = plant_by_nozzle(nozzle(), full(150), course(), np.random.default_rng(1))
    assert row.position_m == pytest.approx(row.travel_m + 0.060, abs=1e-9)
    assert set(row.stand.tolist()) == {Stand.UPRIGHT}
    assert set(row.depth_m.tolist()) == {0.060}


def test_the_scatter_of_the_nozzle_has_its_size() -> None:
    long = course(metres=4000.0)
    entry = nozzle(scatter="10 mm", depth_scatter="6 mm", tilted="5 %", lodged="2 %", injured="1 %", unreleased="3 %")
    row = plant_by_nozzle(entry, full(10_100), long, np.random.default_rng(7))
    planted = row.planted
    assert row.injured is not None
    off_m = row.position_m[planted] - row.travel_m[planted] - 0.060
    number = int(np.count_nonzero(planted))
    assert off_m.std() == pytest.approx(0.010, rel=5 / math.sqrt(2 * number))
    assert row.depth_m[planted].std() == pytest.approx(0.006, rel=5 / math.sqrt(2 * number))
    for hits, share, of in (
        (row.stand == Stand.TILTED, 0.05, number),
        (row.stand == Stand.LODGED, 0.02, number),
        (row.injured, 0.01, number),
        (row.missing == Missing.RELEASE, 0.03, row.released),
    ):
        assert np.count_nonzero(hits) == pytest.approx(share * of, abs=5 * math.sqrt(share * of))


def test_an_empty_cup_plants_nothing_and_keeps_its_cause() -> None:
    fed = full(150)
    fed.seedlings[[3, 7]] = 0
    fed.cause[[3, 7]] = Missing.P, Missing.MISSED_CUP
    fed.seedlings[5] = 2
    row = plant_by_nozzle(nozzle(injured="100 %", unreleased="0 %"), fed, course(), np.random.default_rng(1))
    assert row.missing[[3, 5, 7]].tolist() == [Missing.P, Missing.NONE, Missing.MISSED_CUP]
    assert np.isnan(row.position_m[[3, 7]]).all()
    assert np.isnan(row.depth_m[[3, 7]]).all()
    assert row.stand[[3, 7]].tolist() == [NO_PLANT, NO_PLANT]
    assert row.injured is not None
    assert row.injured.tolist() == row.planted.tolist()
    assert (row.single, row.double, row.causes[Missing.P]) == (row.released - 3, 1, 1)


def planter(**values: Any) -> ChainPlanter:
    return ChainPlanter(default_table(Ground.SOIL), **{"clamp_n": 104.62, **values})


def transport(blocks: int) -> Transport:
    fed = full(blocks)
    return Transport(fed.seedlings, fed.cause, 0, np.empty(0))


def chain_course(ratio: float, speed_m_s: float = 0.44, metres: float = 50.0) -> Course:
    """Return a course with constant lambda."""
    ground = SpeedProfile([Stretch(speed_m_s, for_m=100.0)], acceleration_m_s2=0.3, length_m=metres + 40.0)
    wheel = WheelSlip(SlipSpec(), ground, np.random.default_rng(1))
    return Course(ground, WheelDrive(ground, wheel, per_wheel_m=ratio / planter().pitch_m), metres)


@pytest.mark.parametrize("ratio", [0.87, 1.0, 1.17, 1.3])
def test_a_block_lies_where_the_planter_has_released_it(ratio: float) -> None:
    """The position of a block is the travel at its release plus the displacement of the drawn fall."""
    row = plant_by_chain(
        transport(200), CARRIED_CYCLES, chain_course(ratio), planter=planter(), rng=np.random.default_rng(8)
    )
    rng = np.random.default_rng(8)
    rng.random(row.released)  # random numbers that decide whether a block is released
    falls = planter().draw(row.ratio, rng, frequency_per_min=60 * row.speed_m_s * row.ratio / planter().pitch_m)
    assert row.ratio == pytest.approx(ratio)
    assert np.diff(row.travel_m) == pytest.approx(planter().pitch_m / ratio, rel=1e-9)
    assert row.position_m == pytest.approx(row.travel_m + falls.along_m)
    for name in ("depth_m", "tilt_deg", "stand", "scraped", "within"):
        assert getattr(row, name).tolist() == getattr(falls, name).tolist()


def test_a_low_lambda_lodges_or_tilts_more_plants() -> None:
    """At 0.87 a large share of the blocks is tilted or lodged, at 1.17 only those that stick to a plate."""
    leaning = {}
    for ratio in (0.87, 1.17):
        row = plant_by_chain(
            transport(3000), 3.0, chain_course(ratio, metres=800.0), planter=planter(), rng=np.random.default_rng(8)
        )
        leaning[ratio] = np.count_nonzero(row.stand != Stand.UPRIGHT) / row.released
    assert leaning[0.87] > 4 * leaning[1.17]
    assert 0.02 < leaning[1.17] < 0.1


def test_injury_has_the_share_of_equation_11_at_the_local_setting() -> None:
    """At 0.44 m/s and lambda 1.1 the frequency is 59.4/min; the injured share is that of the regression."""
    row = plant_by_chain(
        transport(4000),
        3.0,
        chain_course(1.1, metres=1500.0),
        planter=planter(injury=CabbageInjury(104.62)),
        rng=np.random.default_rng(8),
    )
    share = injury_share(3.6 * 0.44, 60 * 0.44 * 1.1 / planter().pitch_m, 104.62)
    assert not share.extrapolated
    assert row.injury_within[10:].all()
    assert row.injured is not None
    number = row.released
    sd = math.sqrt(share.value * (1 - share.value) * number)
    assert np.count_nonzero(row.injured) == pytest.approx(share.value * number, abs=4 * sd)
    without = plant_by_chain(transport(100), 3.0, chain_course(1.0), planter=planter(), rng=np.random.default_rng(8))
    assert without.injured is None


def test_injury_is_rounded_by_less_than_a_twentieth_of_a_point() -> None:
    rng = np.random.default_rng(3)
    speed_m_s, per_min = rng.uniform(0.42, 0.55, 500), rng.uniform(56.0, 60.0, 500)
    shares = CabbageInjury(100.0).shares(speed_m_s, per_min)
    exact = [injury_share(3.6 * speed, rate, 100.0) for speed, rate in zip(speed_m_s, per_min, strict=True)]
    assert shares.value == pytest.approx([share.value for share in exact], abs=5e-4)
    assert (~shares.within).sum() == pytest.approx(sum(share.extrapolated for share in exact), abs=3)


def test_injury_beyond_the_bench_test_is_marked() -> None:
    """Plants at 1 km/h are extrapolated, because the lowest speed of the bench test is higher."""
    row = plant_by_chain(
        transport(100),
        3.0,
        chain_course(1.1, 1 / 3.6),
        planter=planter(injury=CabbageInjury(104.62)),
        rng=np.random.default_rng(8),
    )
    assert not row.injury_within.any()


def test_a_lambda_beyond_the_table_is_marked() -> None:
    row = plant_by_chain(transport(150), 3.0, chain_course(0.6), planter=planter(), rng=np.random.default_rng(8))
    assert not row.within.any()


def test_unreleased_blocks_have_their_share() -> None:
    row = plant_by_chain(
        transport(4000),
        3.0,
        chain_course(1.0, metres=900.0),
        planter=planter(unreleased=0.1),
        rng=np.random.default_rng(8),
    )
    lost = row.causes[Missing.RELEASE]
    assert lost == row.seedlings_lost == row.released - row.single
    assert lost == pytest.approx(0.1 * row.released, abs=5 * math.sqrt(0.09 * row.released))


def test_every_plug_is_caught_at_the_set_frequency() -> None:
    fed = full(120)
    transport = drop_through_chute(chute(), fed, course(), phase_cycles=PHASE, rng=np.random.default_rng(1))
    assert transport.seedlings.tolist() == [1] * 120
    assert np.abs(transport.phase).max() < 1e-9
    assert transport.lost == 0


@pytest.mark.parametrize(("speed_m_s", "caught"), [(0.36, True), (0.38, False), (0.24, True), (0.22, False)])
def test_the_window_limits_the_speed(speed_m_s: float, caught: bool) -> None:
    """The phase error is the transit time times the difference of the frequencies: 0.4 s x 0.25/s = 10 % at 0.4 m/s.

    The catch window of 15 % therefore allows 0.3 m/s plus or minus 0.075 m/s.
    """
    transport = drop_through_chute(
        chute(window="15 %"),
        full(100),
        course(speed_m_s),
        phase_cycles=PHASE,
        rng=np.random.default_rng(1),
    )
    assert transport.phase == pytest.approx(0.4 * (speed_m_s / SPACING_M - FREQUENCY_HZ))
    assert transport.lost == (0 if caught else 100)
    assert transport.cause.tolist() == [Missing.NONE if caught else Missing.HANDOVER] * 100


def test_the_share_outside_the_window_follows_from_the_scatter() -> None:
    """A scatter of 50 ms is 3.75 % of a cycle at 0.75/s; a window of 15 % is 4 standard deviations wide."""
    number = 20_000
    transport = drop_through_chute(
        chute(window="15 %", scatter="50 ms"),
        full(number),
        course(metres=9000.0),
        phase_cycles=PHASE,
        rng=np.random.default_rng(2),
    )
    outside = math.erfc(2 / math.sqrt(2))
    assert transport.lost == pytest.approx(outside * number, abs=5 * math.sqrt(outside * number))


def test_a_fixed_phase_error_shifts_every_arrival() -> None:
    transport = drop_through_chute(
        chute(phase_error="-8 %"), full(50), course(), phase_cycles=PHASE, rng=np.random.default_rng(1)
    )
    assert transport.phase == pytest.approx(-0.08)


def test_a_plug_in_the_window_of_the_next_planter_makes_a_double() -> None:
    """At twice the frequency and a transit time of more than one cycle, plugs reach the next planter."""
    fed = full(40)
    fed.seedlings[1::2] = 0
    fed.cause[1::2] = Missing.D
    transport = drop_through_chute(
        chute(transit="1.3333333333333333 s"),
        fed,
        course(2 * SPEED_M_S),
        phase_cycles=1.0,
        rng=np.random.default_rng(1),
    )
    assert transport.phase == pytest.approx(1.0)
    assert transport.seedlings.tolist() == [0, 1] * 20
    assert set(transport.cause[0::2].tolist()) == {Missing.HANDOVER}
    assert set(transport.cause[1::2].tolist()) == {Missing.NONE}


@examples(30, nightly=100, derandomize=True)
@given(
    stretches,
    st.booleans(),
    st.floats(0.01, 2.0),
    st.floats(0.0, 1.0),
    st.floats(0.01, 1.0),
    st.floats(-0.5, 0.5),
    st.integers(0, 2**31),
)
def test_no_seedling_is_lost_without_count(
    each: list[Stretch], is_motor: bool, transit_s: float, scatter_s: float, window: float, phase: float, seed: int
) -> None:
    """Caught plus lost seedlings equal those in the cups, and each empty planter has a cause."""
    rng = np.random.default_rng(seed)
    ground = SpeedProfile(each, acceleration_m_s2=0.3, length_m=40.0)
    slip = WheelSlip(SlipSpec(0.1, 0.05, 0.7), ground, rng)
    drive = MotorDrive(ground, per_m=2.5, lag_s=0.4) if is_motor else WheelDrive(ground, slip, per_wheel_m=2.5)
    seedlings = rng.choice([0, 1, 2], size=60, p=[0.2, 0.7, 0.1])
    fed = FedRow(seedlings, np.where(seedlings, Missing.NONE, Missing.P), 4.5)
    entry = chute(transit=f"{transit_s} s", scatter=f"{scatter_s} s", window=f"{window}", phase_error=f"{phase}")
    transport = drop_through_chute(entry, fed, Course(ground, drive, 30.0), phase_cycles=transit_s, rng=rng)
    over_chute = int(np.count_nonzero(4.5 + np.arange(60) <= drive.end_cycles))
    assert transport.seedlings.sum() + transport.lost == seedlings[:over_chute].sum()
    assert np.all((transport.seedlings > 0) == (transport.cause == Missing.NONE))
    row = plant_by_nozzle(nozzle(unreleased="10 %"), fed, Course(ground, drive, 30.0), rng)
    assert row.single + row.double + sum(row.causes.values()) == row.released
    assert row.released + row.in_transit == 60
    assert row.seedlings.sum() + row.seedlings_lost + row.seedlings_in_transit == seedlings.sum()
