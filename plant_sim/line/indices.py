"""Indices of rows of plants: spacing indices after ISO 7256-1, and the rates reported by Chinese transplanter tests.

The spacing indices are defined by Kachman and Smith (1995) on the basis of ISO 7256-1: a spacing of at most half the
set spacing is a multiple, a spacing of more than 1.5 times the set spacing is a miss, and all others are in the quality
of feed. The indices are shares of the number of spacings.

The rates follow the terms of JB/T 10291; its text was not available, so the definitions are assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from plant_sim.common.proportion import Proportion
from plant_sim.line.ground import Floats
from plant_sim.line.row import CAUSES, PlantRow
from plant_sim.planter.verdict import Stand

MULTIPLE_BELOW: Final = 0.5
"""Upper limit of a multiple, in units of the set spacing. Source: Kachman and Smith (1995), after ISO 7256-1."""
MISS_ABOVE: Final = 1.5
"""Largest spacing that is not a miss, in units of the set spacing. Source: as for `MULTIPLE_BELOW`."""


@dataclass(frozen=True, slots=True)
class SpacingIndices:
    """Distribution of the spacings of all rows.

    Attributes:
        number: Number of spacings.
        mean_m: Mean, m; NaN without spacings.
        sd_m: Standard deviation, m; NaN for fewer than two spacings.
        regular_mean_m: Mean of the spacings in the quality of feed, m; NaN if there are none.
        multiple: Share of the spacings that are multiples.
        quality: Share of the spacings in the quality of feed.
        miss: Share of the spacings that are misses.
        precision: Standard deviation of the spacings in the quality of feed, divided by the set spacing; NaN for fewer
            than two of them.
    """

    number: int
    mean_m: float
    sd_m: float
    regular_mean_m: float
    multiple: Proportion
    quality: Proportion
    miss: Proportion
    precision: float

    @property
    def cv(self) -> float:
        """Coefficient of variation."""
        return self.sd_m / self.mean_m


def spacing_indices(rows_m: Sequence[Floats], set_m: float) -> SpacingIndices:
    """Return the indices of the spacings between successive plants.

    Args:
        rows_m: Positions of the plants of each row in ascending order, m.
        set_m: Set spacing, m.

    >>> indices = spacing_indices([np.array([0.0, 0.4, 0.8, 0.9, 1.7])], 0.4)
    >>> indices.multiple.hits, indices.quality.hits, indices.miss.hits
    (1, 2, 1)
    """
    spacings_m = np.concatenate([np.diff(row) for row in rows_m]) if rows_m else np.empty(0)
    is_multiple = spacings_m <= MULTIPLE_BELOW * set_m
    is_miss = spacings_m > MISS_ABOVE * set_m
    regular_m = spacings_m[~is_multiple & ~is_miss]
    number = len(spacings_m)
    return SpacingIndices(
        number=number,
        mean_m=float(spacings_m.mean()) if number else float("nan"),
        sd_m=_sd(spacings_m),
        regular_mean_m=float(regular_m.mean()) if len(regular_m) else float("nan"),
        multiple=Proportion(int(np.count_nonzero(is_multiple)), number),
        quality=Proportion(len(regular_m), number),
        miss=Proportion(int(np.count_nonzero(is_miss)), number),
        precision=_sd(regular_m) / set_m,
    )


def planting_rates(rows: Sequence[PlantRow]) -> dict[str, Proportion]:
    """Return the rates of all rows.

    A qualified position has a single plant that is upright, not scraped and not injured. Qualified, missed and double
    positions are shares of all positions, lodged and injured ones of the positions with a plant. If injury is not
    modelled, the injured rate is absent and injury is not considered in the qualified rate.
    """
    released = sum(row.released for row in rows)
    planted = sum(int(np.count_nonzero(row.planted)) for row in rows)
    lodged = sum(int(np.count_nonzero(row.stand == Stand.LODGED)) for row in rows)
    rates = {
        "qualified": Proportion(sum(map(_qualified, rows)), released),
        "missed": Proportion(released - planted, released),
        "double": Proportion(sum(row.double for row in rows), released),
        "lodged": Proportion(lodged, planted),
    }
    flags = [row.injured for row in rows if row.injured is not None]
    return rates | ({"injured": Proportion(sum(int(each.sum()) for each in flags), planted)} if flags else {})


def _qualified(row: PlantRow) -> int:
    qualified = (row.seedlings == 1) & (row.stand == Stand.UPRIGHT) & ~row.scraped
    return int(np.count_nonzero(qualified if row.injured is None else qualified & ~row.injured))


def missing_by_cause(rows: Sequence[PlantRow]) -> dict[str, int]:
    """Return the number of missing plants of all rows by cause, in the order of `Missing`."""
    return {cause.label: _total(rows, cause) for cause in CAUSES}


def _total(rows: Sequence[PlantRow], cause: int) -> int:
    return sum(int(np.count_nonzero(row.missing == cause)) for row in rows)


def _sd(values: Floats) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else float("nan")
