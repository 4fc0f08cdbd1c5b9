"""Factors and experimental designs in coded units.

Coded 0 is the centre of a factor, and coded 1 is one step above it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from plant_sim.study.errors import StudyError

_MOST_FACTORS = 12
"""Maximum number of factors of a two-level design, which then has 4096 corners."""


def label(name: str, unit: str) -> str:
    """Return a name with its unit for a heading or an axis; the unit ``-`` is omitted.

    >>> label("foam thickness", "mm"), label("cups", "-")
    ('foam thickness, mm', 'cups')
    """
    return name if unit == "-" else f"{name}, {unit}"


@dataclass(frozen=True, slots=True)
class Factor:
    """Factor of an experiment.

    Attributes:
        name: Name.
        unit: Unit, ``-`` if dimensionless.
        centre: Value at coded 0, in the unit.
        step: Size of one coded unit, in the unit.

    Raises:
        StudyError: The centre or step is not finite, or the step is 0.

    >>> foam = Factor("foam thickness", "mm", 12.0, 3.6)
    >>> foam.natural(-1), round(foam.coded(15.6), 9)
    (8.4, 1.0)
    """

    name: str
    unit: str
    centre: float
    step: float

    def __post_init__(self) -> None:
        """Check the centre and the step."""
        if not math.isfinite(self.centre):
            raise StudyError(f"factor {self.name}: centre must be a finite number, not {self.centre:g}")
        if not math.isfinite(self.step) or self.step == 0:
            raise StudyError(f"factor {self.name}: step must be a finite number other than 0, not {self.step:g}")

    @property
    def label(self) -> str:
        """Name and unit."""
        return label(self.name, self.unit)

    def natural(self, coded: float) -> float:
        """Return the value of a coded level, in the factor's unit."""
        return self.centre + self.step * coded

    def coded(self, natural: float) -> float:
        """Return the coded level of a value in the factor's unit."""
        return (natural - self.centre) / self.step


def to_natural(factors: Sequence[Factor], coded: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return coded points (one, or one per row) in natural units."""
    centre, step = _coding(factors)
    return centre + coded * step


def to_coded(factors: Sequence[Factor], natural: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points in natural units (one, or one per row) as coded points."""
    centre, step = _coding(factors)
    return (natural - centre) / step


def _coding(factors: Sequence[Factor]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.array([factor.centre for factor in factors]), np.array([factor.step for factor in factors])


def full_factorial(levels: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """Return every combination of levels, the first factor changing fastest.

    Args:
        levels: Levels of every factor.

    Raises:
        StudyError: There is no factor, or a factor has no level.

    >>> full_factorial([(1, 2, 3), (7, 8)])[:4].tolist()
    [[1.0, 7.0], [2.0, 7.0], [3.0, 7.0], [1.0, 8.0]]
    """
    if not levels or not all(len(each) for each in levels):
        raise StudyError("full factorial: a factor or its levels are missing; specify at least one level per factor")
    slowest_first = itertools.product(*reversed(levels))
    return np.array([combination[::-1] for combination in slowest_first], dtype=np.float64)


def two_level(k: int) -> NDArray[np.float64]:
    """Return the 2^k factorial design with levels -1 and 1 in standard (Yates) order.

    Args:
        k: Number of factors.

    Raises:
        StudyError: k is below 1 or above 12.
    """
    _check_factors("two-level factorial", k)
    return full_factorial([(-1.0, 1.0)] * k)


def central_composite(k: int, *, axial: float, centres: int) -> NDArray[np.float64]:
    """Return a central composite design: the 2^k factorial, one axial pair per factor, and repeated centre runs.

    Args:
        k: Number of factors.
        axial: Coded level of the axial points.
        centres: Number of centre runs.

    Raises:
        StudyError: k is out of range, the axial level is not above 0, or centres is below 0.
    """
    _check_factors("central composite design", k)
    _check_centres(centres)
    if not (math.isfinite(axial) and axial > 0):
        raise StudyError(f"central composite design: axial must be above 0, not {axial:g}")
    pairs = np.repeat(np.eye(k), 2, axis=0) * np.tile([-axial, axial], k)[:, np.newaxis]
    return np.vstack([two_level(k), pairs, np.zeros((centres, k))])


def rotatable_axial(k: int) -> float:
    """Return the axial level that makes a central composite design rotatable: the fourth root of the number of corners.

    >>> round(rotatable_axial(3), 3)
    1.682
    """
    _check_factors("central composite design", k)
    return float(2.0 ** (k / 4))


def orthogonal_axial(k: int, centres: int) -> float:
    """Return the axial level that makes the squared terms of a central composite design uncorrelated.

    >>> round(orthogonal_axial(3, 6), 3)
    1.525
    """
    _check_factors("central composite design", k)
    _check_centres(centres)
    corners = 2**k
    runs = corners + 2 * k + centres
    return math.sqrt((math.sqrt(runs * corners) - corners) / 2)


def latin_hypercube(k: int, n: int, *, seed: int) -> NDArray[np.float64]:
    """Return a Latin hypercube over -1 to 1: for each factor, one point in each of n equal strata.

    Args:
        k: Number of factors.
        n: Number of points.
        seed: Seed of the generator; the same seed gives the same points.

    Raises:
        StudyError: There are no factors or no points, or the seed is negative.
    """
    if k < 1 or n < 1 or seed < 0:
        text = f"{k} factors, {n} points, seed {seed}"
        raise StudyError(f"latin hypercube: {text}; must be at least one factor, one point and a seed of 0 or more")
    from scipy.stats import qmc  # noqa: PLC0415 - importing it would delay every start of a worker

    sample: NDArray[np.float64] = qmc.LatinHypercube(d=k, rng=np.random.default_rng(seed)).random(n)
    return 2.0 * sample - 1.0


def _check_factors(what: str, k: int) -> None:
    if not 1 <= k <= _MOST_FACTORS:
        raise StudyError(f"{what}: {k} factors; must be 1 to {_MOST_FACTORS}")


def _check_centres(centres: int) -> None:
    if centres < 0:
        raise StudyError(f"central composite design: {centres} centres; must be 0 or more")
