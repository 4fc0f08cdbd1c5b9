"""Means of a response over trials, with their confidence intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from statsmodels.stats.weightstats import DescrStatsW

from controller.program.set_points import CUPS
from plant_sim.twin.repeats import SHARES, pool
from plant_sim.twin.report import TrialReport

SHARE_OF = {name: name for name in SHARES} | {count: name for name, count in SHARES.items()}
"""Share that corresponds to each response based on seedling counts; a share corresponds to itself."""

ROWS_FAIL_TOGETHER = (
    "The binomial intervals assume that seedlings fail independently. A late release or a stop loses up to "
    f"{CUPS} at once; the intervals are then too narrow, and the standard deviation between trials is a better measure."
)
"""Limitation of the intervals of counted seedlings."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Estimate of a response at one setting.

    Attributes:
        mean: Mean over the trials; None if no trial has a value.
        low: Lower end of the 95 % confidence interval of the mean; None if undefined.
        high: Upper end of the interval.
        sd: Standard deviation between trials; None for fewer than two trials.
    """

    mean: float | None
    low: float | None = None
    high: float | None = None
    sd: float | None = None


def estimate(response: str, trials: Sequence[TrialReport]) -> Estimate:
    """Return the mean of a response at one setting with its 95 % interval.

    Seedling counts are pooled over the trials. Their interval is the exact binomial interval (Clopper and Pearson), as
    a percentage or, multiplied by the seedlings per trial, as a number. For any other response, the interval is based
    on Student's t distribution, which requires at least two trials with different values.

    Args:
        response: Name of a numeric field of the trial report.
        trials: Reports of all trials at the setting.
    """
    values = numbers(response, trials)
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    share = SHARE_OF.get(response)
    if share is not None:
        pooled = pool(trials)
        scale = 1.0 if share == response else pooled.seedlings / pooled.trials / 100
        low, high = pooled.intervals[share]
        return Estimate(scale * pooled.shares[share], scale * low, scale * high, sd)
    if len(values) == 0:
        return Estimate(None)
    if np.ptp(values) == 0:
        return Estimate(float(values[0]), sd=sd)
    described = DescrStatsW(values)
    low, high = described.tconfint_mean(alpha=0.05)
    return Estimate(float(described.mean), float(low), float(high), sd)


def numbers(response: str, trials: Sequence[TrialReport]) -> NDArray[np.float64]:
    """Return the values of a response; trials without a value are omitted."""
    values = [getattr(trial, response) for trial in trials]
    return np.array([value for value in values if value is not None], dtype=np.float64)
