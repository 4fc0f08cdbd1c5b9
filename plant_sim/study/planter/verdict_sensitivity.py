"""Parameters on which the verdicts of the paper's cases depend: Morris screening, then Sobol indices.

Both use the signed distance from the limits of the verdict, which is continuous, and the whole ranges of all
parameters, with the largest plausible deviations.

Sources: Morris, Technometrics 33 (1991) 161, with the mean of the absolute effects of Campolongo et al., Environmental
Modelling & Software 22 (2007) 1509; Saltelli et al., Computer Physics Communications 181 (2010) 259, for the Sobol
indices, by scipy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc, sobol_indices

from plant_sim.study.engines import Progress, spread
from plant_sim.study.planter.lodging_fit import Values
from plant_sim.study.planter.verdict_space import DEVIATIONS, VerdictSpace
from plant_sim.study.planter.verdicts import CASES, SimulatedCase
from plant_sim.study.runner import trial_seed

MOST: Final = 8
"""Largest number of parameters with Sobol indices."""
MATTERS: Final = 0.05
"""Smallest lower end of the interval of the total index of a parameter on which a verdict depends."""

_LEVELS = 4
_CONFIDENCE = 0.95
_RESAMPLES = 999
_CHUNK = 64


class SampleSize(NamedTuple):
    """Size of the samples.

    Attributes:
        trajectories: Number of trajectories of the screening.
        base: Number of points of each of the two samples of the Sobol indices, a power of 2.
    """

    trajectories: int
    base: int

    @classmethod
    def of(cls, draws: int) -> SampleSize:
        """Return the sizes that belong to a number of draws at each point: 20 and 256 for 240 draws."""
        return cls(max(2, draws // 12), 2 ** max(2, math.ceil(math.log2(draws))))


@dataclass(frozen=True)
class Influence:
    """Influence of one parameter on the distance from the limits of a verdict.

    Attributes:
        name: Name of the coordinate.
        effect: Mean absolute effect over the whole range, in the screening.
        first: First-order index with its interval: value, low, high.
        total: Total index with its interval.
    """

    name: str
    effect: float
    first: tuple[float, float, float]
    total: tuple[float, float, float]

    @property
    def matters(self) -> bool:
        """True if the verdict depends on the parameter."""
        return self.total[1] >= MATTERS


@dataclass(frozen=True)
class Sensitivity:
    """Sensitivity of the verdict of one case.

    Attributes:
        case: Simulated case of the paper.
        effects: Mean absolute effect of every screened coordinate, by name, the largest first.
        influences: Coordinates with Sobol indices, the largest total index first; empty if the distance is constant.
    """

    case: SimulatedCase
    effects: dict[str, float]
    influences: tuple[Influence, ...]

    @property
    def depends_on(self) -> tuple[str, ...]:
        """Names of the parameters on which the verdict depends, the most influential first."""
        return tuple(each.name for each in self.influences if each.matters)


def sensitivities(
    space: VerdictSpace,
    size: SampleSize,
    *,
    seed: int,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Sensitivity]:
    """Return the sensitivity of every case of the paper.

    Args:
        space: Space of the falls.
        size: Size of the samples.
        seed: Seed of the samples.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed part.
    """
    return [
        _Analysis(space, case, size, trial_seed(seed, index, 1), workers, progress).sensitivity()
        for index, case in enumerate(CASES)
    ]


def planned_jobs(space: VerdictSpace, size: SampleSize) -> int:
    """Return the number of jobs of `sensitivities`."""
    screening = size.trajectories * (len(space.parameters) + len(DEVIATIONS) + 1)
    return len(CASES) * (_chunks(screening) + _chunks(size.base * (MOST + 2)))


def elementary_effects(steps: Values, values: Values) -> Values:
    """Return the mean absolute effect of each coordinate, per whole range.

    Args:
        steps: Trajectories, of shape (trajectories, coordinates + 1, coordinates); each step changes one coordinate.
        values: Values at the points, of shape (trajectories, coordinates + 1).

    >>> steps = np.array([[[0.0, 0.0], [0.5, 0.0], [0.5, 1.0]]])
    >>> elementary_effects(steps, np.array([[1.0, 2.0, -1.0]])).tolist()
    [2.0, 3.0]
    """
    changes = np.diff(steps, axis=1)
    which = np.abs(changes).argmax(axis=2)
    size = np.take_along_axis(changes, which[..., np.newaxis], axis=2)[..., 0]
    effects = np.abs(np.diff(values, axis=1) / size)
    means: Values = np.array([effects[which == each].mean() for each in range(steps.shape[2])])
    return means


@dataclass(frozen=True)
class _Analysis:
    """Sensitivity analysis of one case; the attributes are the arguments of `sensitivities`."""

    space: VerdictSpace
    case: SimulatedCase
    size: SampleSize
    seed: int
    workers: int | None
    progress: Progress | None

    def sensitivity(self) -> Sensitivity:
        from pyDOE3 import morris_sampling  # noqa: PLC0415 - importing it would delay every start of a worker

        free = (*self.space.parameters, *DEVIATIONS)
        trajectories = self.size.trajectories
        points = morris_sampling(len(free), trajectories, num_levels=_LEVELS, seed=self.seed % 2**32)
        steps = points.reshape(trajectories, len(free) + 1, len(free))
        margins = self._margins(free, points).reshape(steps.shape[:2])
        effects = dict(zip(free, elementary_effects(steps, margins).tolist(), strict=True))
        ranked = dict(sorted(effects.items(), key=lambda each: -each[1]))
        most = {name: effect for name, effect in list(ranked.items())[:MOST] if effect > 0.0}
        return Sensitivity(self.case, ranked, self._influences(most) if most else ())

    def _influences(self, effects: dict[str, float]) -> tuple[Influence, ...]:
        """Return the Sobol indices of a few coordinates; the others have their default values."""
        names, base, rng = tuple(effects), self.size.base, np.random.default_rng(self.seed)
        first, second = np.split(qmc.Sobol(2 * len(names), rng=rng).random(base), 2, axis=1)
        is_mixed = np.eye(len(names), dtype=bool)[:, np.newaxis, :]
        mixed = np.where(is_mixed, second, first).reshape(-1, len(names))
        margins = self._margins(names, np.vstack([first, second, mixed])).reshape(-1, 1, base)
        if np.ptp(margins[:2]) == 0.0:
            return ()
        every = np.arange(base)
        first_order, total = _indices(margins, every)
        resampled = np.array([_indices(margins, rng.integers(base, size=base)) for _ in range(_RESAMPLES)])
        low, high = np.quantile(resampled, [(1 - _CONFIDENCE) / 2, (1 + _CONFIDENCE) / 2], axis=0)
        found = [
            Influence(
                name,
                effects[name],
                (float(first_order[index]), float(low[0, index]), float(high[0, index])),
                (float(total[index]), float(low[1, index]), float(high[1, index])),
            )
            for index, name in enumerate(names)
        ]
        return tuple(sorted(found, key=lambda each: -each.total[0]))

    def _margins(self, names: Sequence[str], coordinates: Values) -> Values:
        """Return the distances from the limits at points with other values of some coordinates."""
        points = np.tile(self.space.nominal(), (len(coordinates), 1))
        points[:, [self.space.names.index(name) for name in names]] = coordinates
        chunks = np.array_split(points, _chunks(len(points)))
        jobs = [partial(self.space.margins, self.case, chunk) for chunk in chunks]
        return np.concatenate(spread(jobs, self.workers, self.progress))


def _chunks(points: int) -> int:
    return math.ceil(points / _CHUNK)


def _indices(margins: Values, chosen: NDArray[np.intp]) -> tuple[Values, Values]:
    """Return the first-order and the total indices from some points of both samples; 0 if the distance is constant.

    The bootstrap of the result of scipy has no seed.
    """
    part = margins[..., chosen]
    if np.ptp(part[:2]) == 0.0:
        none = np.zeros(len(part) - 2)
        return none, none
    result = sobol_indices(func={"f_A": part[0], "f_B": part[1], "f_AB": part[2:]}, n=len(chosen))
    return np.ravel(result.first_order), np.ravel(result.total_order)
