"""Verdicts of random falls, simulated with full contact."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from plant_sim.common.proportion import Proportion
from plant_sim.planter.falls import motion_at
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter
from plant_sim.planter.scatter import Ground, Ranges, draw
from plant_sim.planter.verdict import FallVerdict, verdict_of
from plant_sim.study.engines import Progress, spread
from plant_sim.study.planter.lodging_fit import Values
from plant_sim.study.runner import trial_seed

FREQUENCY_PER_MIN: Final = 56.0
"""Planting frequency of the paper's simulated cases. Source: cabbage paper, 2.2.2."""
_HALF = 0.5
_KM_H = 3.6


class SimulatedCase(NamedTuple):
    """Simulated case of the paper, 2.2.2.

    Attributes:
        speed_km_h: Machine speed, km/h.
        printed: Ratio printed in the paper.
        verdict: Verdict stated in the paper.
    """

    speed_km_h: float
    printed: float
    verdict: FallVerdict

    def motion(self, planter: Planter) -> Motion:
        """Return the motion of the case."""
        return Motion(planter.chain, speed_m_s=self.speed_km_h / _KM_H, frequency_per_min=FREQUENCY_PER_MIN)


CASES: Final = (
    SimulatedCase(1.9, 0.87, FallVerdict.FORWARD),
    SimulatedCase(1.65, 1.0, FallVerdict.PUSHED),
    SimulatedCase(1.4, 1.17, FallVerdict.CLEAN),
)


@dataclass(frozen=True)
class FallPoint:
    """Point of a sweep.

    Attributes:
        ratio: Ratio lambda.
        opener_deg: Position of the opener, degrees.
        draws: Number of random falls.
        values: Parameters that differ from those of the planter, by dotted name.
        kind: Ground.
        frequency_per_min: Planting frequency, 1/min.
    """

    ratio: float
    opener_deg: float
    draws: int
    values: tuple[tuple[str, float], ...] = ()
    kind: Ground = Ground.RIGID
    frequency_per_min: float = FREQUENCY_PER_MIN


@dataclass(frozen=True)
class VerdictCount:
    """Verdicts of the random falls at one point.

    Attributes:
        point: Point of the sweep.
        counts: Number of falls by verdict.
    """

    point: FallPoint
    counts: Counter[FallVerdict]

    def proportion(self, *verdicts: FallVerdict) -> Proportion:
        """Return the proportion of falls with one of the verdicts."""
        return Proportion(sum(self.counts[each] for each in verdicts), self.point.draws)


def count_verdicts(
    planter: Planter,
    ranges: Ranges,
    points: Sequence[FallPoint],
    *,
    seed: int,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[VerdictCount]:
    """Simulate random falls with full contact.

    The falls at a point depend only on the seed and on the index of the point. Sticking to a plate is not simulated.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        points: Points of the sweep.
        seed: Seed of the study.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed point.
    """
    jobs = [partial(_count, planter, ranges, point, trial_seed(seed, index, 0)) for index, point in enumerate(points)]
    return spread(jobs, workers, progress)


def _count(planter: Planter, ranges: Ranges, point: FallPoint, seed: int) -> VerdictCount:
    changed = planter.with_values(dict(point.values))
    motion = motion_at(changed, point.ratio, point.frequency_per_min)
    rng = np.random.default_rng(seed)
    falls = (draw(changed, ranges, point.kind, rng).fall(motion, point.opener_deg) for _ in range(point.draws))
    return VerdictCount(point, Counter(verdict_of(fall.tilt_deg, fall.pushed_m) for fall in falls))


def crossings(ratios: Iterable[float], shares: Values) -> list[float]:
    """Return the ratios at which a share crosses one half, by linear interpolation.

    >>> crossings([0.8, 0.9, 1.0], np.array([1.0, 0.75, 0.25])), crossings([0.8, 0.9], np.array([1.0, 0.9]))
    ([0.95], [])
    """
    above = np.asarray(shares) - _HALF
    found = []
    for (low, high), (before, after) in zip(pairwise(ratios), pairwise(above.tolist()), strict=True):
        if (before < 0.0) != (after < 0.0):
            found.append(round(low + (high - low) * before / (before - after), 12))
    return found
