"""Simulated trials at one setting of the planter, with the mechanical model and with the paper's equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from plant_sim.common.proportion import Proportion
from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter
from plant_sim.planter.quality import injury_share, lodging_share
from plant_sim.planter.scatter import Ground, Ranges, draw
from plant_sim.planter.verdict import LODGED_DEG
from plant_sim.study.engines import Progress, spread
from plant_sim.study.runner import trial_seed

_KM_H = 3.6


class LodgingSetting(NamedTuple):
    """Setting of the planter.

    Attributes:
        speed_km_h: Machine speed, km/h.
        frequency_per_min: Planting frequency, 1/min.
        force_n: Clamp force, N.
    """

    speed_km_h: float
    frequency_per_min: float
    force_n: float


class SeedlingCount(NamedTuple):
    """Counted seedlings.

    Attributes:
        seedlings: Number of seedlings.
        lodged: Number of lodged seedlings.
        injured: Number of injured seedlings.
    """

    seedlings: int
    lodged: int
    injured: int

    def percent(self) -> tuple[float, float, float, float, float, float]:
        """Return lodging and the limits of its exact 95 % interval, then the same for injury, %."""
        lodging, injury = (Proportion(hits, self.seedlings) for hits in (self.lodged, self.injured))
        return lodging.percent, *lodging.interval_percent, injury.percent, *injury.interval_percent


@dataclass(frozen=True)
class OptimumCheck:
    """Trials at the setting that the paper claims to be optimal.

    Attributes:
        setting: The setting.
        expected: Lodging and injury from the mechanical model with the constants in use, %.
        mechanics: Trials with the mechanical model.
        equations: Trials with equations 10 and 11.
    """

    setting: LodgingSetting
    expected: tuple[float, float]
    mechanics: list[SeedlingCount]
    equations: list[SeedlingCount]


def pooled(trials: Sequence[SeedlingCount]) -> SeedlingCount:
    """Return the sum of several trials."""
    return SeedlingCount(*(sum(column) for column in zip(*trials, strict=True)))


def simulate_trials(
    planter: Planter,
    ranges: Ranges,
    setting: LodgingSetting,
    seedlings: Sequence[int],
    *,
    seed: int,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[SeedlingCount]:
    """Simulate trials with the mechanical model, every fall with full contact.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        setting: Setting of all trials.
        seedlings: Number of seedlings of each trial.
        seed: Seed of the study.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed trial.
    """
    jobs = [
        partial(_trial, planter, ranges, setting, number, trial_seed(seed, 0, trial))
        for trial, number in enumerate(seedlings)
    ]
    return spread(jobs, workers, progress)


def equation_trials(setting: LodgingSetting, seedlings: Sequence[int], *, seed: int) -> list[SeedlingCount]:
    """Return random trials of cabbage blocks with the shares from equations 10 and 11.

    Args:
        setting: Setting of all trials.
        seedlings: Number of seedlings of each trial.
        seed: Seed of the study.
    """
    shares = lodging_share(*setting).value, injury_share(*setting).value
    trials = []
    for trial, number in enumerate(seedlings):
        rng = np.random.default_rng(trial_seed(seed, 1, trial))
        lodged, injured = (int(rng.binomial(number, share)) for share in shares)
        trials.append(SeedlingCount(number, lodged, injured))
    return trials


def _trial(planter: Planter, ranges: Ranges, setting: LodgingSetting, seedlings: int, seed: int) -> SeedlingCount:
    gripping = planter.with_values({"grip.clamp_n": setting.force_n})
    motion = Motion(planter.chain, speed_m_s=setting.speed_km_h / _KM_H, frequency_per_min=setting.frequency_per_min)
    rng = np.random.default_rng(seed)
    lodged = injured = 0
    for _ in range(seedlings):
        drawn = draw(gripping, ranges, Ground.SOIL, rng)
        lodged += drawn.sticks or abs(drawn.fall(motion, planter.chain.release_deg).tilt_deg) >= LODGED_DEG
        injured += rng.uniform() < planter.scatter.injured_share_at(setting.force_n)
    return SeedlingCount(seedlings, int(lodged), int(injured))
