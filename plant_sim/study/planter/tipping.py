"""Simulated tipping of blocks on soil, as a function of the clearance between planter and furrow."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from plant_sim.planter.motion import Motion
from plant_sim.planter.parameters import Planter
from plant_sim.planter.scatter import Draw, Ground, Ranges, draw
from plant_sim.planter.verdict import LODGED_DEG
from plant_sim.study.engines import Progress, spread
from plant_sim.study.errors import StudyError

DEEPEST_M = 0.040
"""Largest simulated clearance between the tip of the planter and the bottom of the furrow, m."""
LEAST_BLOCKS = 10
"""Smallest number of blocks; fewer clearances would be too sparse for a standard deviation of a few mm."""

_KM_H = 3.6


@dataclass(frozen=True)
class Tipping:
    """Tipped blocks at several settings, with the same random blocks at every setting.

    Attributes:
        clearance_m: Clearance of each block, evenly distributed from 0 to `DEEPEST_M`, m.
        lodged: True if a block lodged, of shape (settings, blocks).
    """

    clearance_m: NDArray[np.float64]
    lodged: NDArray[np.bool_]

    def share(self, mean_m: float, sd_m: float) -> NDArray[np.float64]:
        """Return the share of tipped blocks at every setting for normally distributed clearances.

        Args:
            mean_m: Mean clearance, m.
            sd_m: Standard deviation of the clearance, m.
        """
        share: NDArray[np.float64] = self.lodged @ self._weights(mean_m, sd_m)
        return share

    def standard_error(self, mean_m: float, sd_m: float) -> NDArray[np.float64]:
        """Return the standard error of `share` that is due to the number of blocks.

        This is an upper limit, because the even distribution of the clearances is not taken into account.
        """
        weights, share = self._weights(mean_m, sd_m), self.share(mean_m, sd_m)
        error: NDArray[np.float64] = np.sqrt((self.lodged - share[:, np.newaxis]) ** 2 @ weights**2)
        return error

    def _weights(self, mean_m: float, sd_m: float) -> NDArray[np.float64]:
        density = np.exp(-(((self.clearance_m - mean_m) / sd_m) ** 2) / 2)
        weights: NDArray[np.float64] = density / density.sum()
        return weights


def simulate_tipping(
    planter: Planter,
    ranges: Ranges,
    settings: NDArray[np.float64],
    *,
    blocks: int,
    seed: int,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Tipping:
    """Simulate the falls of random blocks at several settings with full contact.

    Args:
        planter: Parameters of the planter.
        ranges: Plausible ranges of its parameters.
        settings: Machine speed, km/h, planting frequency, 1/min, and clamp force, N, one setting per row; equal
            settings are simulated once.
        blocks: Number of random blocks.
        seed: Seed of the blocks.
        workers: Number of processes; by default one per core.
        progress: Callback after each completed setting.

    Raises:
        StudyError: There are too few blocks.
    """
    if blocks < LEAST_BLOCKS:
        raise StudyError(f"--trials {blocks}: must be {LEAST_BLOCKS} or more random blocks")
    distinct, places = np.unique(settings, axis=0, return_inverse=True)
    clearances_m = np.random.default_rng(seed).permutation((np.arange(blocks) + 0.5) / blocks * DEEPEST_M)
    jobs = [partial(_tilts_deg, planter, ranges, tuple(setting), clearances_m, seed) for setting in distinct.tolist()]
    tilts_deg = np.array(spread(jobs, workers, progress))
    return Tipping(clearances_m, (np.abs(tilts_deg) >= LODGED_DEG)[places.ravel()])


def _tilts_deg(
    planter: Planter, ranges: Ranges, setting: Sequence[float], clearances_m: NDArray[np.float64], seed: int
) -> list[float]:
    """Return the tilt of every block at one setting, degrees."""
    speed_km_h, frequency_per_min, force_n = setting
    gripping = planter.with_values({"grip.clamp_n": force_n})
    motion = Motion(planter.chain, speed_m_s=speed_km_h / _KM_H, frequency_per_min=frequency_per_min)
    rng = np.random.default_rng(seed)
    opener_deg = planter.chain.release_deg
    return [
        _with_clearance(draw(gripping, ranges, Ground.SOIL, rng), clearance_m).fall(motion, opener_deg).tilt_deg
        for clearance_m in clearances_m.tolist()
    ]


def _with_clearance(drawn: Draw, clearance_m: float) -> Draw:
    return drawn._replace(ground=dataclasses.replace(drawn.ground, clearance_m=clearance_m))
