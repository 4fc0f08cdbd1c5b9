"""Robustness of the verdicts of the paper's cases: draws over all ranges, as a function of the assumed pitch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from plant_sim.common.proportion import Proportion
from plant_sim.study.engines import Progress, spread
from plant_sim.study.planter.lodging_fit import Values
from plant_sim.study.planter.verdict_space import VerdictSpace
from plant_sim.study.planter.verdicts import CASES, SimulatedCase

PITCHES_DEG: Final = (0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Assumed largest pitch of a block; its pitch is uniform up to it, degrees."""
LEAST_SHARE: Final = 0.9
"""Smallest share of draws with the verdict at which it is robust."""
LEAST_BOUND: Final = 0.8
"""Smallest lower end of the exact 95 % interval of this share."""

_PITCH: Final = "scatter.pitch_deg"


@dataclass(frozen=True)
class Robustness:
    """Draws over all ranges at one assumed pitch.

    Attributes:
        case: Simulated case of the paper.
        pitch_deg: Largest pitch, degrees.
        agreeing: Draws with the verdict of the paper.
    """

    case: SimulatedCase
    pitch_deg: float
    agreeing: Proportion

    @property
    def is_robust(self) -> bool:
        """True if the verdict holds in nearly all draws."""
        return self.agreeing.share >= LEAST_SHARE and self.agreeing.interval[0] >= LEAST_BOUND


def robustness(
    space: VerdictSpace, *, draws: int, seed: int, workers: int | None = None, progress: Progress | None = None
) -> list[Robustness]:
    """Draw over all ranges for every case of the paper and every assumed pitch.

    All cases and pitches have the same draws, so that their differences are not due to chance.

    Args:
        space: Space of the falls.
        draws: Number of draws at each point.
        seed: Seed of the draws.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed point.
    """
    points = np.random.default_rng(seed).uniform(size=(draws, len(space.names)))
    settings = [(case, pitch_deg) for case in CASES for pitch_deg in PITCHES_DEG]
    jobs = [partial(space.margins, case, _with_pitch(space, points, pitch_deg)) for case, pitch_deg in settings]
    margins = spread(jobs, workers, progress)
    return [
        Robustness(case, pitch_deg, Proportion(sum(margin > 0.0 for margin in each), draws))
        for (case, pitch_deg), each in zip(settings, margins, strict=True)
    ]


def robust_up_to_deg(points: Sequence[Robustness]) -> float | None:
    """Return the largest pitch up to which a case is robust, degrees; None if it is not even without pitch.

    Args:
        points: Points of one case in ascending order of the pitch.
    """
    found = None
    for point in points:
        if not point.is_robust:
            break
        found = point.pitch_deg
    return found


def _with_pitch(space: VerdictSpace, points: Values, pitch_deg: float) -> Values:
    """Return points with another largest pitch."""
    changed = points.copy()
    changed[:, space.names.index(_PITCH)] = space.coordinate(_PITCH, pitch_deg)
    return changed
