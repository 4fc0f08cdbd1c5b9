"""Factors and designs: which settings an experiment runs, in coded units.

Coded means: 0 is the centre of a factor, 1 is one step above it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from plant_sim.bench.study.errors import StudyError

_MOST_FACTORS = 12  # 4096 corners


def label(name: str, unit: str) -> str:
    """Return a name with its unit, for a heading or an axis; a unit ``-`` is none.

    >>> label("foam thickness", "mm"), label("cups", "-")
    ('foam thickness, mm', 'cups')
    """
    return name if unit == "-" else f"{name}, {unit}"


@dataclass(frozen=True, slots=True)
class Factor:
    """What an experiment changes.

    Attributes:
        name: Its name.
        unit: Its unit, ``-`` for none.
        centre: Its value at the coded 0, in its unit.
        step: How much one coded unit is, in its unit.

    Raises:
        StudyError: centre or step is not finite, or the step is 0.

    >>> foam = Factor("foam thickness", "mm", 12.0, 3.6)
    >>> foam.natural(-1), round(foam.coded(15.6), 9)
    (8.4, 1.0)
    """

    name: str
    unit: str
    centre: float
    step: float

    def __post_init__(self) -> None:
        """Refuse a factor that codes nothing."""
        if not math.isfinite(self.centre):
            raise StudyError(f"factor {self.name}: centre {self.centre:g} is no number; give a finite one")
        if not math.isfinite(self.step) or self.step == 0:
            raise StudyError(f"factor {self.name}: a step of {self.step:g} changes nothing; give a finite one, not 0")

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
    """Return points in natural units: of coded points, one row each, or of one."""
    centre, step = _coding(factors)
    return centre + coded * step


def to_coded(factors: Sequence[Factor], natural: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return coded points: of points in natural units, one row each, or of one."""
    centre, step = _coding(factors)
    return (natural - centre) / step


def _coding(factors: Sequence[Factor]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.array([factor.centre for factor in factors]), np.array([factor.step for factor in factors])


def full_factorial(levels: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """Return every combination of levels, the first factor changing fastest.

    Args:
        levels: The levels of every factor.

    Raises:
        StudyError: there is no factor, or one without a level.

    >>> full_factorial([(1, 2, 3), (7, 8)])[:4].tolist()
    [[1.0, 7.0], [2.0, 7.0], [3.0, 7.0], [1.0, 8.0]]
    """
    if not levels or not all(len(each) for each in levels):
        raise StudyError("full factorial: every factor needs a level; give at least one factor with one level")
    slowest_first = itertools.product(*reversed(levels))
    return np.array([combination[::-1] for combination in slowest_first], dtype=np.float64)


def two_level(k: int) -> NDArray[np.float64]:
    """Return the 2^k factorial at -1 and 1 in standard (Yates) order.

    Args:
        k: Number of factors.

    Raises:
        StudyError: there are fewer than 1 or more than 12.
    """
    _check_factors("two-level factorial", k)
    return full_factorial([(-1.0, 1.0)] * k)


def central_composite(k: int, *, axial: float, centres: int) -> NDArray[np.float64]:
    """Return a central composite design: the 2^k factorial, an axial pair a factor, repeated centres.

    Args:
        k: Number of factors.
        axial: Coded level of the axial points.
        centres: How often the centre is run.

    Raises:
        StudyError: k is out of range, the axial level is not above 0, or centres is below 0.
    """
    _check_factors("central composite design", k)
    _check_centres(centres)
    if not (math.isfinite(axial) and axial > 0):
        raise StudyError(f"central composite design: axial {axial:g} is no distance; give a level above 0")
    pairs = np.repeat(np.eye(k), 2, axis=0) * np.tile([-axial, axial], k)[:, np.newaxis]
    return np.vstack([two_level(k), pairs, np.zeros((centres, k))])


def rotatable_axial(k: int) -> float:
    """Return the axial level that makes a central composite design rotatable: the fourth root of its corners.

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
    """Return points of a Latin hypercube over -1 to 1: of every factor one in each of n equal strata.

    Args:
        k: Number of factors.
        n: Number of points.
        seed: Seed of the generator; the same seed gives the same points.

    Raises:
        StudyError: there is no factor or no point, or the seed is negative.
    """
    if k < 1 or n < 1 or seed < 0:
        text = f"{k} factors, {n} points, seed {seed}"
        raise StudyError(f"latin hypercube: {text}; give at least one factor, one point and a seed from 0")
    sample: NDArray[np.float64] = qmc.LatinHypercube(d=k, rng=np.random.default_rng(seed)).random(n)
    return 2.0 * sample - 1.0


def _check_factors(what: str, k: int) -> None:
    if not 1 <= k <= _MOST_FACTORS:
        raise StudyError(f"{what}: {k} factors; give 1 to {_MOST_FACTORS}")


def _check_centres(centres: int) -> None:
    if centres < 0:
        raise StudyError(f"central composite design: {centres} centres; give 0 or more")
