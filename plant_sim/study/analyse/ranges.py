"""Range analysis of an orthogonal array, as Chinese papers on agricultural machinery print it (极差分析).

The range R of a factor is the difference between the highest and the lowest mean of its levels. It is descriptive: it
has no error and no test.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats


@dataclass(frozen=True, slots=True)
class FactorRange:
    """Range of one factor.

    Attributes:
        levels: Levels, ascending.
        sums: Sum of the response at each level, K in the papers.
        means: Mean of the response at each level, k in the papers.
        best: Level with the best mean.
    """

    levels: tuple[float, ...]
    sums: tuple[float, ...]
    means: tuple[float, ...]
    best: float

    @property
    def value(self) -> float:
        """Range R: highest less lowest mean."""
        return max(self.means) - min(self.means)


def is_orthogonal_array(points: NDArray[np.float64]) -> bool:
    """Return whether the trials are an orthogonal array: each pair of levels of two factors occurs equally often.

    >>> is_orthogonal_array(np.array([[1, 1], [1, 2], [2, 1], [2, 2]])), is_orthogonal_array(np.array([[1, 1], [2, 2]]))
    (True, False)
    """
    columns = [np.unique(column, return_inverse=True)[1] for column in points.T]
    for column in columns:
        if len(set(np.bincount(column).tolist())) != 1:
            return False
    for first, second in itertools.combinations(columns, 2):
        pairs = np.bincount(first * (int(second.max()) + 1) + second, minlength=(first.max() + 1) * (second.max() + 1))
        if len(set(pairs.tolist())) != 1:
            return False
    return True


def ranges(points: NDArray[np.float64], response: NDArray[np.float64], *, is_high_best: bool) -> list[FactorRange]:
    """Return the range of every factor.

    Args:
        points: Levels of the trials, trials x factors.
        response: Response of every trial.
        is_high_best: True if a high response is good.
    """
    found = []
    for column in points.T:
        levels, groups = np.unique(column, return_inverse=True)
        sums = np.bincount(groups, weights=response)
        means = sums / np.bincount(groups)
        best = levels[int(means.argmax() if is_high_best else means.argmin())]
        found.append(FactorRange(tuple(levels.tolist()), tuple(sums.tolist()), tuple(means.tolist()), float(best)))
    return found


def order_of_influence(found: Sequence[FactorRange]) -> list[int]:
    """Return the numbers of the factors by falling range, from 1."""
    return sorted(range(1, len(found) + 1), key=lambda number: -found[number - 1].value)


def range_by_chance(levels: int, trials: int, *, sd: float, degrees: int, confidence: float = 0.95) -> float:
    """Return the range that a factor without any effect stays below with the given probability.

    The means of its levels differ by the error alone; their range has the studentized range distribution.

    Args:
        levels: Number of levels of the factor.
        trials: Trials at each level.
        sd: Standard deviation of one trial.
        degrees: Degrees of freedom of that standard deviation.
        confidence: Probability, above 0 and below 1.
    """
    return _studentized_range(confidence, levels, degrees) * sd / float(np.sqrt(trials))


@cache
def _studentized_range(confidence: float, levels: int, degrees: int) -> float:
    """Return a quantile of the studentized range distribution, which takes a tenth of a second."""
    return float(stats.studentized_range.ppf(confidence, levels, degrees))
