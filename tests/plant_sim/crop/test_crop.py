"""Response surface, traits, trays and counts of seedlings, tested separately from the machine."""

import dataclasses
import math

import numpy as np
import pytest

from plant_sim.common.limits import SpecError
from plant_sim.crop.bed import Bed
from plant_sim.crop.grip import Grip
from plant_sim.crop.handling import HandlingSpec
from plant_sim.crop.incident import Incident
from plant_sim.crop.mechanics import Mechanics
from plant_sim.crop.planting_row import RECENT_CUPS, PassedCup, PlantingRow
from plant_sim.crop.pose import Pose, Reach
from plant_sim.crop.response import CropSpec, success_percent
from plant_sim.crop.seedling import Location, Seedling, Seedlings
from plant_sim.crop.traits import TYPICAL, Traits
from plant_sim.machine.parameters import load_machine

DEFAULT = CropSpec(foam_thickness_mm=10, seedling_age_d=51, claw_pressure_mpa=0.40)
AXIAL = 1.525
TRIALS = (
    *zip(
        [(x1, x2, x3) for x3 in (-1, 1) for x2 in (-1, 1) for x1 in (-1, 1)],
        (86.1, 79.2, 94.6, 81.6, 80.7, 82.5, 78.5, 74.3),
        strict=True,
    ),
    ((-AXIAL, 0, 0), 87.3),
    ((AXIAL, 0, 0), 82.3),
    ((0, -AXIAL, 0), 87.7),
    ((0, AXIAL, 0), 82.6),
    ((0, 0, -AXIAL), 84.2),
    ((0, 0, AXIAL), 76.8),
    *(((0, 0, 0), percent) for percent in (94.4, 92.4, 95.6, 92.4, 95.1, 93.9)),
)
"""Table 4 of the pepper paper, docs/sources/machine.md 5: coded factors and success, %."""


def at_coded(x1: float, x2: float, x3: float) -> CropSpec:
    return CropSpec(12 + 3.6 * x1, 50 + 5 * x2, 0.45 + 0.13 * x3)


def percent_of(crop: CropSpec) -> float:
    return success_percent(crop.foam_thickness_mm, crop.seedling_age_d, crop.claw_pressure_mpa)


def test_eq_5_at_the_optimum_of_the_paper() -> None:
    assert success_percent(10, 51, 0.40) == pytest.approx(94.93, abs=0.01)


def test_eq_5_has_its_maximum_at_the_optimum_of_the_paper() -> None:
    best = success_percent(10.1, 51.0, 0.394)
    assert best == pytest.approx(94.95, abs=0.01)
    for foam_mm, age_d, pressure_mpa in ((9.6, 51, 0.394), (10.6, 51, 0.394), (10.1, 50, 0.394), (10.1, 52, 0.394)):
        assert success_percent(foam_mm, age_d, pressure_mpa) < best
    assert success_percent(10.1, 51, 0.374) < best
    assert success_percent(10.1, 51, 0.414) < best


@pytest.mark.parametrize(
    ("coded", "percent"),
    [
        ((0, 0, 0), 93.76),
        ((-1, -1, -1), 85.54),  # 93.76 + 2.37 + 0.58 + 2.91 - 1.50 + 2.20 - 2.67 - 3.47 - 3.32 - 5.32
        ((1, -1, 1), 83.32),  # 93.76 - 2.37 + 0.58 - 2.91 + 1.50 + 2.20 + 2.67 - 3.47 - 3.32 - 5.32
        ((1, 1, 1), 73.82),  # 93.76 - 2.37 - 0.58 - 2.91 - 1.50 + 2.20 - 2.67 - 3.47 - 3.32 - 5.32
    ],
)
def test_eq_5_by_hand(coded: tuple[int, int, int], percent: float) -> None:
    assert percent_of(at_coded(*coded)) == pytest.approx(percent, abs=0.01)


def test_eq_5_fits_its_trials() -> None:
    errors = [percent_of(at_coded(*coded)) - percent for coded, percent in TRIALS]
    assert max(map(abs, errors)) == pytest.approx(2.55, abs=0.02)
    assert math.sqrt(sum(error**2 for error in errors) / len(errors)) == pytest.approx(1.24, abs=0.01)


def test_the_design_region_contains_the_trials_only() -> None:
    assert not DEFAULT.extrapolates
    assert not any(at_coded(*coded).extrapolates for coded, _ in TRIALS)
    assert all(at_coded(*(1.02 * x for x in coded)).extrapolates for coded, _ in TRIALS if any(coded))


def traits_of(seed: int, trays: int) -> list[list[Traits]]:
    seedlings = Seedlings(trays=trays, seed=seed)
    return [[plant.traits for column in range(6) for plant in seedlings.column(tray, column)] for tray in range(trays)]


def test_traits_depend_on_seed_and_tray_only() -> None:
    assert traits_of(3, trays=2) == traits_of(3, trays=5)[:2]
    assert traits_of(3, trays=1) != traits_of(4, trays=1)
    first, second = traits_of(3, trays=2)
    assert first != second


def test_traits_are_standard_normal_and_independent() -> None:
    """For n = 14,400, means and correlations are within 4/sqrt(n) of 0, and variances are within 4 sqrt(2/n) of 1."""
    drawn = np.array([plant.traits for plant in Seedlings(trays=200, seed=7)])
    assert np.abs(drawn.mean(axis=0)).max() < 4 / math.sqrt(14_400)
    assert np.abs(drawn.var(axis=0) - 1).max() < 4 * math.sqrt(2 / 14_400)
    correlations = np.corrcoef(drawn.T) - np.eye(drawn.shape[1])
    assert np.abs(correlations).max() < 4 / math.sqrt(14_400)


def test_typical_seedlings_are_identical() -> None:
    seedlings = Seedlings(trays=1, seed=1)
    seedlings.make_typical()
    assert {plant.traits for plant in seedlings} == {TYPICAL}


def test_a_tray_has_twelve_seedlings_in_each_of_six_columns() -> None:
    seedlings = Seedlings(trays=2, seed=1)
    cells = {(plant.tray, plant.column, plant.along) for plant in seedlings}
    assert cells == {(tray, column, along) for tray in (0, 1) for column in range(6) for along in range(12)}
    assert [plant.along for plant in seedlings.column(1, 4)] == list(range(12))


def test_moving_a_seedling_counts_it_once() -> None:
    seedlings = Seedlings(trays=1, seed=1)
    seedling = seedlings.column(0, 0)[0]
    for place in (Location.CLAMPED, Location.IN_CLAW, Location.FALLING, Location.IN_CUP):
        seedlings.move(seedling, place)
        counts = seedlings.counts()
        assert counts.in_tray + counts.in_claw + counts.in_cups == 72 == counts.total
    assert seedlings.counts().in_cups == 1


@pytest.mark.parametrize(
    ("offset_m", "count"),
    [(0.0, 12), (0.008, 12), (0.0216, 11), (-0.0216, 11), (0.301, 5), (-0.301, 5), (0.516, 0), (-0.516, 0)],
)
def test_the_claws_reach_the_cells_under_them(offset_m: float, count: int) -> None:
    """Claws reach half a cell pitch in either direction, so a larger offset leaves fewer cells under them."""
    seedlings = Seedlings(trays=1, seed=1)
    bed = Bed(seedlings, pitch_m=0.043)
    bed.lay([(0, offset_m)], trays_m=0.0, is_placed=True, turned={})
    standing = bed.standing(2)
    assert len(standing) == count
    assert all(plant.column == 2 for plant in standing)
    assert bed.is_empty is (count == 0)


def test_seedlings_of_a_skewed_tray_are_offset_in_proportion_to_their_cell() -> None:
    """At a skew of 10 mrad, cells 0 and 11, 5.5 pitches of 43 mm from the centre, are offset by -/+2.365 mm."""
    seedlings = Seedlings(trays=2, seed=1)
    bed = Bed(seedlings, pitch_m=0.043)
    bed.lay([(0, 0.0)], trays_m=0.0, is_placed=True, turned={0: 0.010})
    column = seedlings.column(0, 0)
    assert [bed.off_m(column[along]) for along in (0, 11)] == pytest.approx([-0.002365, 0.002365])
    assert bed.off_m(column[5]) == pytest.approx(-0.000215)
    assert bed.off_m(seedlings.column(1, 0)[0]) == 0.0


@pytest.mark.parametrize(
    ("pose", "is_placed", "place"),
    [
        (Pose(0.1984, 0.004, gripping=True, free=False, travel_m=0.0049, freed_s=0.0), True, Location.CLAMPED),
        (Pose(0.1986, 0.004, gripping=True, free=False, travel_m=0.0049, freed_s=0.0), True, Location.LOST_PICK),
        (Pose(0.1984, 0.0051, gripping=True, free=False, travel_m=0.0049, freed_s=0.0), True, Location.LOST_PICK),
        (Pose(0.1984, 0.004, gripping=True, free=False, travel_m=0.0051, freed_s=0.0), True, Location.LOST_PICK),
        (Pose(0.1984, 0.004, gripping=True, free=False, travel_m=0.0049, freed_s=0.0), False, Location.LOST_PICK),
        (Pose(0.1984, 0.131, gripping=True, free=False, travel_m=0.0049, freed_s=0.0), True, Location.STANDING),
    ],
)
def test_claws_clamp_only_within_all_tolerances(pose: Pose, is_placed: bool, place: Location) -> None:
    row = Row()
    row.seedlings.make_typical()
    grip = grip_over(row, is_placed=is_placed)
    grip.step(dataclasses.replace(pose, gripping=False, free=True))
    grip.step(pose)
    assert {plant.location for plant in row.seedlings.column(0, 0)} == {place}


def grip_over(
    row: "Row", *, is_placed: bool = True, turned_rad: float = 0.0, mirrored: bool = False, strip_reach_m: float = 0.015
) -> Grip:
    """Return the grip of an arm whose claws can reach the first tray of a row."""
    machine = load_machine()
    bed = Bed(row.seedlings, pitch_m=0.043)
    bed.lay([(0, 0.0)], trays_m=0.0, is_placed=is_placed, turned={0: turned_rad})
    reach = Reach("left", machine.columns_m, tray_edge_m=0.16, mirrored=mirrored, spread_m=0.187, reach_m=0.015)
    spec = dataclasses.replace(machine.seedling, strip_reach_m=strip_reach_m)
    mechanics = Mechanics(spec, foam_mm=10.0, age_d=51.0)
    return Grip(machine.handling, mechanics, reach, row.seedlings, bed, row=row.row, report=lambda *_: None)


@pytest.mark.parametrize(("mirrored", "column", "missed"), [(False, 0, [8, 9, 10, 11]), (True, 5, [0, 1, 2, 3])])
def test_the_skew_of_a_tray_adds_to_the_offset_of_the_claws(mirrored: bool, column: int, missed: list[int]) -> None:
    """A skew of 10 mrad offsets each cell by 0.43 mm more than the previous one.

    With claws offset by 4 mm, strips that reach 5 mm miss the cells more than 2.3 pitches from the centre, on the side
    where the two offsets add up.
    """
    row = Row()
    row.seedlings.make_typical()
    grip = grip_over(row, turned_rad=0.010, mirrored=mirrored, strip_reach_m=0.005)
    x_m = load_machine().columns_m[0] + 0.004
    pose = Pose(x_m, 0.0, gripping=False, free=True, travel_m=0.0, freed_s=0.0)
    for change in ({}, {"gripping": True, "free": False}, {"gripping": True, "free": False, "rise_m": 0.10}):
        grip.step(dataclasses.replace(pose, **change))
        grip.record_force(7.8, change.get("rise_m", 0.0))
    plants = row.seedlings.column(0, column)
    assert [plant.along for plant in plants if plant.location is Location.LOST_PICK] == missed
    assert [plant.along for plant in grip.held] == [along for along in range(12) if along not in missed]


def test_stems_harmed_by_the_claws_are_lost_when_the_claws_open() -> None:
    """If the claws close and reopen without rising, stems too weak for the force or for the holding time are lost."""
    row = Row()
    row.seedlings.make_typical()
    plants = row.seedlings.column(0, 0)
    plants[2].traits, plants[7].traits = TYPICAL._replace(strength=-10.0), TYPICAL._replace(endurance=-10.0)
    grip = grip_over(row)
    is_open = Pose(load_machine().columns_m[0], 0.0, gripping=False, free=True, travel_m=0.0, freed_s=0.0)
    grip.step(is_open)
    grip.step(dataclasses.replace(is_open, gripping=True, free=False))
    grip.record_force(7.8, 0.0)
    grip.step(dataclasses.replace(is_open, now_s=10.0, freed_s=10.0))
    assert [plant.along for plant in plants if plant.location is Location.LOST_PICK] == [2, 7]
    assert sum(plant.location is Location.STANDING for plant in plants) == 10


class Row:
    """Row of cups whose chain position is set by the test; cup -n is under claw n."""

    def __init__(self) -> None:
        self.seedlings = Seedlings(trays=2, seed=1)
        self.incidents: list[Incident] = []
        self.row = PlantingRow(
            "left", self.seedlings, lambda kind, _: self.incidents.append(kind), pitch_m=0.060, catch_m=0.0085
        )
        self.waiting = iter(self.seedlings)

    def fall(self, position_m: float, chain_m: float) -> Seedling:
        seedling = next(self.waiting)
        self.row.start_fall(seedling, position_m=position_m, lands_s=0.005)
        assert seedling.location is Location.FALLING
        self.row.step(0.005, chain_m=chain_m, chain_m_s=0.0)
        return seedling


@pytest.mark.parametrize(
    ("off_m", "place"), [(0.0084, Location.IN_CUP), (0.0086, Location.LOST_THROW), (0.03, Location.LOST_THROW)]
)
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("claw", [0, 5, 11])
def test_a_plug_must_land_within_8_mm_and_a_half_of_a_cup(off_m: float, side: int, claw: int, place: Location) -> None:
    row = Row()
    assert row.fall(claw * 0.060 + side * off_m, 0.120).location is place
    assert row.incidents == []


def test_a_plug_falls_for_its_time() -> None:
    row = Row()
    seedling = next(row.waiting)
    row.row.start_fall(seedling, position_m=0.0, lands_s=0.1277)
    places = []
    for number in range(1, 28):
        assert row.row.falling is (seedling.location is Location.FALLING)
        row.row.step(0.005 * number, chain_m=0.0, chain_m_s=0.0)
        places.append(seedling.location)
    assert places == [Location.FALLING] * 25 + [Location.IN_CUP] * 2
    assert not row.row.falling


@pytest.mark.parametrize("late_s", [0.0, 0.010, 0.100])
def test_a_plug_meets_the_cups_at_their_position_at_landing(late_s: float) -> None:
    """A landing evaluated up to 100 ms late uses the chain position at the time of landing; the tolerance is 8.5 mm."""
    for off_m, place in ((0.0084, Location.IN_CUP), (0.0086, Location.LOST_THROW)):
        row = Row()
        seedling = next(row.waiting)
        row.row.start_fall(seedling, position_m=0.0, lands_s=0.200)
        row.row.step(0.200 + late_s, chain_m=off_m + 0.045 * late_s, chain_m_s=0.045)
        assert seedling.location is place


def test_a_fall_of_80_mm_takes_128_ms() -> None:
    handling = load_machine().handling
    assert handling.fall_s(0.0) == pytest.approx(0.1277, abs=0.0001)
    assert handling.fall_s(0.010) == pytest.approx(0.1355, abs=0.0001)


def test_a_second_plug_into_a_cup_is_lost_and_reported() -> None:
    row = Row()
    first = row.fall(0.0, 0.0)
    second = row.fall(0.060, 0.060)  # the same cup, one claw further
    assert (first.location, second.location) == (Location.IN_CUP, Location.LOST_THROW)
    assert row.incidents == [Incident.DOUBLE]


def test_missed_cups_are_the_empty_ones_between_the_first_and_the_last_filled_cup() -> None:
    """If cups 0, 3 and 4 are filled, cups 1 and 2 are missed; the cups before 0 and after 4 are not counted."""
    row = Row()
    for cup in (0, 3, 4):
        row.fall(0.0, cup * 0.060)
    missed = []
    for cup in range(12):
        row.row.step(0.010, chain_m=(cup + 11.5) * 0.060 + 1e-6, chain_m_s=0.0)  # cup has just left the last claw
        missed.append(row.row.missed_cups)
    assert missed == [0, 0, 0, 2, 2, 2, 2, 2, 2, 2, 2, 2]


def passed_cups(row: Row, cups: int) -> list[PassedCup]:
    """Return the observations after the given number of cups has passed the last claw."""
    row.row.step(0.010, chain_m=(cups + 10.5) * 0.060 + 1e-6, chain_m_s=0.0)
    return [each for each in row.row.passed or [] if each.cup >= 0]


def test_every_passed_cup_is_reported_with_its_content_and_cause() -> None:
    """Cup 1 receives nothing, cup 2 two plugs; the plug for cup 3 falls beside it, that for cup 4 was lost before."""
    row = Row()
    row.row.passed = []
    row.fall(0.0, 0.0)
    row.fall(0.0, 2 * 0.060)
    row.fall(0.060, 3 * 0.060)
    row.fall(0.0, 3 * 0.060 + 0.025)
    row.seedlings.move(lost := next(row.waiting), Location.LOST_CARRY)
    row.row.note_loss(lost, position_m=0.0, lands_s=0.005)
    row.row.step(0.005, chain_m=4 * 0.060 + 0.002, chain_m_s=0.0)
    assert row.row.filled == [0, 2]
    cups = [
        PassedCup(0, 1),
        PassedCup(1, 0),
        PassedCup(2, 2),
        PassedCup(3, 0, Location.LOST_THROW),
        PassedCup(4, 0, Location.LOST_CARRY),
    ]
    assert passed_cups(row, 5) == cups
    assert list(row.row.recent)[-5:] == cups
    assert row.row.filled == []
    assert row.seedlings.counts().in_cups == 2


def test_a_plug_that_drifts_into_the_next_cup_leaves_its_own_one_empty() -> None:
    """A drift of 60 mm lands in the neighbouring cup, which is filled; the intended cup is empty due to the throw."""
    row = Row()
    row.row.passed = []
    row.row.start_fall(next(row.waiting), position_m=0.0, lands_s=0.005, drift_m=0.060)
    row.row.step(0.005, chain_m=2 * 0.060, chain_m_s=0.0)
    assert passed_cups(row, 3) == [PassedCup(0, 0), PassedCup(1, 1), PassedCup(2, 0, Location.LOST_THROW)]


def test_a_plug_that_drifts_into_a_passed_cup_is_added_to_it() -> None:
    row = Row()
    row.row.passed = []
    passed_cups(row, 1)
    row.row.start_fall(next(row.waiting), position_m=11 * 0.060, lands_s=0.020, drift_m=0.030)
    row.row.step(0.020, chain_m=11.5 * 0.060 + 1e-6, chain_m_s=0.0)
    assert row.row.passed[-2:] == [PassedCup(0, 0), PassedCup(0, 1)]
    assert row.seedlings.counts().in_cups == 1


def test_cups_are_not_recorded_without_an_observer() -> None:
    row = Row()
    row.fall(0.0, 0.0)
    passed_cups(row, 100)
    assert row.row.passed is None
    assert len(row.row.recent) == RECENT_CUPS


def test_invalid_distances_are_rejected() -> None:
    values = {field: getattr(load_machine().handling, field) for field in HandlingSpec.__dataclass_fields__}
    for changed, said in (
        ({"reach_m": 0.022}, "reach_m must be between grip_tolerance_m and half of cell_pitch_m"),
        ({"extraction_rise_m": 0.131}, "extraction_rise_m must be between put_back_rise_m and stem_clearance"),
    ):
        with pytest.raises(SpecError, match=said):
            HandlingSpec(**(values | changed))
