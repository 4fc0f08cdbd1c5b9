"""Indices and rates of small rows with manually computed results."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.common.proportion import Proportion
from plant_sim.line.indices import missing_by_cause, planting_rates, spacing_indices
from plant_sim.line.row import NO_PLANT, Missing, PlantRow
from plant_sim.planter.verdict import Stand


def row_of(plants: Sequence[tuple[int, Missing, int, bool]]) -> PlantRow:
    """Return a row with 0.4 m between cups; for each cup, plants, cause, stand and injury are given."""
    number = len(plants)
    seedlings, missing, stand, injured = (np.array(each) for each in zip(*plants, strict=True))
    travel_m = np.array([0.4 * cup for cup in range(number)])
    nothing = np.full(number, np.nan)
    return PlantRow(
        cup=np.arange(number),
        time_s=np.array([cup / 0.75 for cup in range(number)]),
        travel_m=travel_m,
        speed_m_s=np.full(number, 0.3),
        ratio=nothing,
        seedlings=seedlings,
        missing=missing,
        position_m=np.where(seedlings > 0, travel_m, np.nan),
        depth_m=nothing,
        tilt_deg=nothing,
        stand=stand,
        scraped=np.zeros(number, dtype=np.bool_),
        injured=injured,
        within=np.ones(number, dtype=np.bool_),
        injury_within=np.ones(number, dtype=np.bool_),
        in_transit=0,
        seedlings_in_transit=0,
        seedlings_lost=0,
        phase=np.empty(0),
    )


UPRIGHT, TILTED, LODGED = (
    (1, Missing.NONE, Stand.UPRIGHT, False),
    (1, Missing.NONE, Stand.TILTED, False),
    (1, Missing.NONE, Stand.LODGED, False),
)
INJURED = (1, Missing.NONE, Stand.UPRIGHT, True)
DOUBLE = (2, Missing.NONE, Stand.UPRIGHT, False)


def empty(cause: Missing) -> tuple[int, Missing, int, bool]:
    return 0, cause, NO_PLANT, False


def test_the_limits_of_the_indices_belong_to_multiple_and_quality() -> None:
    """A spacing of exactly half the set spacing is a multiple; exactly 1.5 times is in the quality of feed."""
    indices = spacing_indices([np.array([0.0, 0.25, 1.0, 1.5, 2.2578125])], 0.5)
    assert (indices.multiple.hits, indices.quality.hits, indices.miss.hits) == (1, 2, 1)
    assert indices.number == 4


def test_mean_variation_and_precision_of_a_small_row() -> None:
    """Spacings 0.38, 0.42, 0.80 and 0.10 have the mean 0.425; the two in the quality of feed deviate by 0.02."""
    indices = spacing_indices([np.array([0.0, 0.38, 0.80, 1.60, 1.70])], 0.4)
    assert indices.mean_m == pytest.approx(0.425)
    assert indices.sd_m == pytest.approx(math.sqrt((0.045**2 + 0.005**2 + 0.375**2 + 0.325**2) / 3))
    assert indices.cv == pytest.approx(indices.sd_m / 0.425)
    assert indices.regular_mean_m == pytest.approx(0.40)
    assert indices.precision == pytest.approx(0.02 * math.sqrt(2) / 0.4)
    assert [rate.percent for rate in (indices.multiple, indices.quality, indices.miss)] == [25.0, 50.0, 25.0]


def test_no_spacing_is_counted_between_two_rows() -> None:
    indices = spacing_indices([np.array([0.0, 0.4]), np.array([0.0, 0.4, 0.8])], 0.4)
    assert (indices.number, indices.quality.hits) == (3, 3)


def test_a_row_without_spacings_has_no_indices() -> None:
    indices = spacing_indices([np.array([0.3])], 0.4)
    assert indices.number == 0
    assert math.isnan(indices.mean_m)
    assert math.isnan(indices.multiple.percent)
    assert indices.multiple.record()["percent"] is None


@settings(derandomize=True)
@given(st.lists(st.floats(0.0, 3.0), min_size=2, max_size=50))
def test_every_spacing_is_in_exactly_one_index(spacings_m: list[float]) -> None:
    indices = spacing_indices([np.cumsum(spacings_m)], 0.4)
    assert indices.multiple.hits + indices.quality.hits + indices.miss.hits == len(spacings_m) - 1


def test_a_double_is_one_multiple() -> None:
    row = row_of([UPRIGHT, DOUBLE, UPRIGHT])
    assert row.plants_m.tolist() == pytest.approx([0.0, 0.4, 0.4, 0.8])
    indices = spacing_indices([row.plants_m], 0.4)
    assert (indices.multiple.hits, indices.quality.hits, indices.miss.hits) == (1, 2, 0)


def test_one_missing_plant_is_one_miss() -> None:
    row = row_of([UPRIGHT, empty(Missing.P), UPRIGHT, UPRIGHT])
    indices = spacing_indices([row.plants_m], 0.4)
    assert (indices.multiple.hits, indices.quality.hits, indices.miss.hits) == (0, 1, 1)


def test_rates_and_causes_of_a_small_row() -> None:
    row = row_of(
        [UPRIGHT, TILTED, LODGED, INJURED, DOUBLE, *(empty(cause) for cause in Missing if cause), empty(Missing.P)]
    )
    rates = planting_rates([row, dataclasses.replace(row)])
    assert rates == {
        "qualified": Proportion(2, 24),
        "missed": Proportion(14, 24),
        "double": Proportion(2, 24),
        "lodged": Proportion(2, 10),
        "injured": Proportion(2, 10),
    }
    others = dict.fromkeys(("D", "T", "missed_cup", "handover", "release"), 1)
    assert missing_by_cause([row]) == {"P": 2, **others}
    assert (row.single, row.double, row.released) == (4, 1, 12)


def test_a_row_that_leans_or_was_scraped_is_not_qualified() -> None:
    """Of 100 single plants, 36 lean and 97 were scraped: 3 upright ones were not, and only these are qualified."""
    row = row_of([UPRIGHT] * 64 + [TILTED] * 30 + [LODGED] * 6)
    row.scraped[3:] = True
    assert planting_rates([row])["qualified"] == Proportion(3, 100)
