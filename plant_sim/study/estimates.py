"""Means of a response over trials, with their confidence intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from statsmodels.stats.weightstats import DescrStatsW

from controller.program.set_points import CUPS
from plant_sim.study.doe.independence import FALSE_ALARMS, LossScatter, trial_scatter
from plant_sim.twin.repeats import SHARES, pool
from plant_sim.twin.report import TrialReport

SHARE_OF = {name: name for name in SHARES} | {count: name for name, count in SHARES.items()}
"""Share that corresponds to each response based on seedling counts; a share corresponds to itself."""


BY_SCATTER = "Their intervals are those of Student's t between the trials."
"""Intervals of a report whose counts are not binomial."""


@dataclass(frozen=True)
class IntervalBasis:
    """Basis of the intervals of counted seedlings: binomial if the trials scatter as those of independent seedlings.

    Attributes:
        scatter: Scatter between equal trials, by name of the share; empty if no equal trials lose seedlings.
    """

    scatter: Mapping[str, LossScatter]

    @classmethod
    def of(cls, reports: Sequence[Sequence[TrialReport]]) -> IntervalBasis:
        """Test the trials of a study.

        Args:
            reports: Trial reports of each setting, all with the same number of seedlings.
        """
        seedlings = reports[0][0].seedlings
        found = {
            share: trial_scatter(
                [np.array([getattr(trial, count) for trial in trials], dtype=np.int64) for trials in reports], seedlings
            )
            for share, count in SHARES.items()
        }
        return cls({share: each for share, each in found.items() if each is not None})

    @property
    def refused(self) -> tuple[str, ...]:
        """Shares whose counts are not binomial."""
        return tuple(name for name, each in self.scatter.items() if not each.is_independent(len(SHARES)))

    @property
    def is_binomial(self) -> bool:
        """True unless the trials show that seedlings fail together."""
        return not self.refused

    def text(self, remedy: str) -> str:
        """Return whether binomial intervals are used, and why.

        Args:
            remedy: Sentence about the intervals where they are refused.
        """
        if not self.scatter:
            return (
                "Binomial intervals: no setting has several trials with losses, so whether seedlings fail together is "
                f"not tested here; a late release or a stop loses up to {CUPS} at once, and the intervals are then "
                "lower bounds. Seedlings of the delivered machine pass the test (docs/statistics.md)."
            )
        found = ", ".join(f"{name} {each.dispersion:.2f}" for name, each in self.scatter.items())
        test = (
            f"scatter between equal trials, as a multiple of that of independent seedlings: {found}; a test that "
            f"rejects independent seedlings in {100 * FALSE_ALARMS:g} % of studies"
        )
        if self.is_binomial:
            return f"Binomial intervals: allowed ({test}, does not)."
        return f"Binomial intervals: refused for {', '.join(self.refused)} ({test}, does so). {remedy}"

    def record(self) -> dict[str, object]:
        """Return the record of the tests."""
        return {"is_binomial": self.is_binomial, "scatter": {name: asdict(each) for name, each in self.scatter.items()}}


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


def estimate(response: str, trials: Sequence[TrialReport], *, is_binomial: bool = True) -> Estimate:
    """Return the mean of a response at one setting with its 95 % interval.

    Seedling counts are pooled over the trials. Their interval is the exact binomial interval (Clopper and Pearson), as
    a percentage or, multiplied by the seedlings per trial, as a number. For any other response, and for counts that are
    not binomial, the interval is based on Student's t distribution, which requires at least two trials with different
    values.

    Args:
        response: Name of a numeric field of the trial report.
        trials: Reports of all trials at the setting.
        is_binomial: Whether the seedlings fail independently; see `IntervalBasis`.
    """
    values = numbers(response, trials)
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    share = SHARE_OF.get(response)
    if share is not None and is_binomial:
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
