"""Response surface of the pepper seedling trial, and the outcome it gives a single seedling."""

import enum
import math
from dataclasses import dataclass

from plant_sim.spec import require_within

_AXIAL_LEVEL = 1.525
_FACTORIAL_RADIUS = math.sqrt(3)


def coded_factors(foam_mm: float, age_d: float, pressure_mpa: float) -> tuple[float, float, float]:
    """Factors of the trial as the regression counts them, without unit.

    Args:
        foam_mm: Foam thickness on the claws, mm.
        age_d: Age of the seedlings, days.
        pressure_mpa: Claw pressure, MPa.

    Source: MACHINE.md 5.
    """
    return (foam_mm - 12) / 3.6, (age_d - 50) / 5, (pressure_mpa - 0.45) / 0.13


def success_percent(foam_mm: float, age_d: float, pressure_mpa: float) -> float:
    """Share of the seedlings of a trial that end in a cup, eq. 5 of the pepper paper, %.

    Not limited to 0 to 100: outside the design region it is an extrapolation and may be anything.

    Args:
        foam_mm: Foam thickness on the claws, mm.
        age_d: Age of the seedlings, days.
        pressure_mpa: Claw pressure, MPa.

    The paper's optimum as it rounds it, and the centre of the design:

    >>> round(success_percent(10, 51, 0.40), 2)
    94.93
    >>> round(success_percent(12, 50, 0.45), 2)
    93.76

    Source: MACHINE.md 5.
    """
    x1, x2, x3 = coded_factors(foam_mm, age_d, pressure_mpa)
    linear = -2.37 * x1 - 0.58 * x2 - 2.91 * x3
    crossed = -1.50 * x1 * x2 + 2.20 * x1 * x3 - 2.67 * x2 * x3
    squared = -3.47 * x1**2 - 3.32 * x2**2 - 5.32 * x3**2
    return 93.76 + linear + crossed + squared


@dataclass(frozen=True, slots=True)
class CropSpec:
    """The crop and how it is gripped.

    Attributes:
        foam_thickness_mm: Foam on the claws, mm.
        seedling_age_d: Age of the seedlings, days.
        claw_pressure_mpa: Claw pressure, MPa.
    """

    foam_thickness_mm: float
    seedling_age_d: float
    claw_pressure_mpa: float

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        require_within(self, 0.0, 30.0, "foam_thickness_mm")
        require_within(self, 1.0, 200.0, "seedling_age_d")
        require_within(self, 0.0, 1.0, "claw_pressure_mpa")

    @property
    def extrapolates(self) -> bool:
        """Whether eq. 5 is used outside the points it was fitted to.

        Inside means: no coded factor beyond the axial level, and no point further from the centre
        than the corners of the factorial. Our reading; the paper states no region.
        """
        coded = coded_factors(self.foam_thickness_mm, self.seedling_age_d, self.claw_pressure_mpa)
        rounding = 1e-9
        beyond_axis = max(map(abs, coded)) > _AXIAL_LEVEL + rounding
        return beyond_axis or math.hypot(*coded) > _FACTORIAL_RADIUS + rounding

    @property
    def failure_share(self) -> float:
        """Expected share of seedlings that never reach a cup, 0 to 1."""
        percent = success_percent(self.foam_thickness_mm, self.seedling_age_d, self.claw_pressure_mpa)
        return 1 - min(max(percent, 0.0), 100.0) / 100


class Fate(enum.Enum):
    """What a seedling does by itself when the machine makes no mistake."""

    THRIVES = "ends in a cup"
    FAILS_PICK = "is not pulled out of its cell"
    FAILS_CARRY = "breaks off on the way"
    FAILS_THROW = "falls beside its cup"


def fate_of(draw: float, failure_share: float) -> Fate:
    """Outcome of one seedling; failures are split evenly between pick, carry and throw.

    A single draw decides all three, so that a seedling that fails at one setting fails at every
    worse one.

    Args:
        draw: Uniform in 0 to 1, the seedling's own.
        failure_share: Expected share of failures, 0 to 1.

    >>> [fate_of(draw, 0.06).name for draw in (0.019, 0.021, 0.041, 0.061)]
    ['FAILS_PICK', 'FAILS_CARRY', 'FAILS_THROW', 'THRIVES']

    Source: MACHINE.md 5 for the sum; the even split is assumed until seedlings have mechanics.
    """
    third = failure_share / 3
    if draw < third:
        return Fate.FAILS_PICK
    if draw < 2 * third:
        return Fate.FAILS_CARRY
    return Fate.FAILS_THROW if draw < failure_share else Fate.THRIVES
