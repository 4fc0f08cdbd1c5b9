"""Response surface of the pepper seedling trial, eq. 5 of the paper, and its factors."""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from plant_sim.common.limits import require_within

AXIAL_LEVEL = 1.525
"""Coded distance of the axial points from the centre of the paper's design. Source: docs/sources/machine.md 5."""

FACTORIAL_RADIUS = math.sqrt(3)
"""Coded distance of the corners from the centre."""

Number = float | NDArray[np.float64]
"""A number or an array of numbers."""

N = TypeVar("N", float, NDArray[np.float64])


def coded_factors(foam_mm: N, age_d: N, pressure_mpa: N) -> tuple[N, N, N]:
    """Return the coded, dimensionless factors of the regression.

    Args:
        foam_mm: Foam thickness on the claws, mm.
        age_d: Age of the seedlings, days.
        pressure_mpa: Claw pressure, MPa.

    Source: docs/sources/machine.md 5.
    """
    return (foam_mm - 12) / 3.6, (age_d - 50) / 5, (pressure_mpa - 0.45) / 0.13


def natural_factors(x1: N, x2: N, x3: N) -> tuple[N, N, N]:
    """Return foam thickness (mm), age (d) and claw pressure (MPa) for coded factors.

    Source: docs/sources/machine.md 5.
    """
    return 12 + 3.6 * x1, 50 + 5 * x2, 0.45 + 0.13 * x3


def success_percent(foam_mm: N, age_d: N, pressure_mpa: N) -> N:
    """Return the percentage of seedlings that end up in a cup, by eq. 5 of the pepper paper.

    The result is not limited to 0 to 100: outside the design region it is an extrapolation.

    Args:
        foam_mm: Foam thickness on the claws, mm.
        age_d: Age of the seedlings, days.
        pressure_mpa: Claw pressure, MPa.

    The rounded optimum of the paper, and the centre of the design:

    >>> round(success_percent(10, 51, 0.40), 2)
    94.93
    >>> round(success_percent(12, 50, 0.45), 2)
    93.76

    Source: docs/sources/machine.md 5.
    """
    x1, x2, x3 = coded_factors(foam_mm, age_d, pressure_mpa)
    linear = -2.37 * x1 - 0.58 * x2 - 2.91 * x3
    crossed = -1.50 * x1 * x2 + 2.20 * x1 * x3 - 2.67 * x2 * x3
    squared = -3.47 * x1**2 - 3.32 * x2**2 - 5.32 * x3**2
    return 93.76 + linear + crossed + squared


@dataclass(frozen=True, slots=True)
class CropSpec:
    """Settings of the crop and the claws.

    Attributes:
        foam_thickness_mm: Foam thickness on the claws, mm.
        seedling_age_d: Age of the seedlings, days.
        claw_pressure_mpa: Claw pressure, MPa.
    """

    foam_thickness_mm: float
    seedling_age_d: float
    claw_pressure_mpa: float

    def __post_init__(self) -> None:
        """Validate the parameters."""
        require_within(self, 0.0, 30.0, "foam_thickness_mm")
        require_within(self, 1.0, 200.0, "seedling_age_d")
        require_within(self, 0.0, 1.0, "claw_pressure_mpa")

    @property
    def extrapolates(self) -> bool:
        """True if the settings are outside the region of the points to which eq. 5 was fitted.

        A point is inside if no coded factor exceeds the axial level and its distance from the centre does not exceed
        that of the factorial corners. This definition is an assumption; the paper does not define a region.
        """
        coded = coded_factors(self.foam_thickness_mm, self.seedling_age_d, self.claw_pressure_mpa)
        rounding = 1e-9
        beyond_axis = max(map(abs, coded)) > AXIAL_LEVEL + rounding
        return beyond_axis or math.hypot(*coded) > FACTORIAL_RADIUS + rounding
