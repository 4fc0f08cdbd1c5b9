"""Tests whether seedlings of the twin fail independently, so that their counts are binomial.

Both tests measure a dispersion, which is 1 on average for independent seedlings, and draw its distribution for
independent seedlings instead of approximating it: losses are few, and the groups of a claw are small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FALSE_ALARMS: Final = 0.01
"""Probability that independent seedlings are taken for dependent ones."""
GROUPS: Final[Mapping[str, tuple[int, ...]]] = {"tray": (2, 3), "row": (3,), "claw": (1, 2)}
"""Axes of an array of trials, trays, rows and claws that are summed to the counts of each group of a trial."""
_DRAWS = 1999
_SEED = 1
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class LossScatter:
    """Scatter of losses between groups of seedlings.

    Attributes:
        dispersion: Mean square of the counts of the groups, as a multiple of that of independent seedlings.
        p: Probability of this dispersion, or a greater one, for independent seedlings.
    """

    dispersion: float
    p: float

    def is_independent(self, tests: int = 1) -> bool:
        """Return whether the losses pass as independent.

        Args:
            tests: Number of tests made together, of which none may raise a false alarm (Bonferroni).
        """
        return self.p >= FALSE_ALARMS / tests


def group_scatter(failed: NDArray[np.bool_], draws: int = _DRAWS) -> dict[str, LossScatter]:
    """Return the scatter of losses between trays, rows and claws of equal trials.

    Groups are those of one trial: a tray, a row of claws in one column of a tray, a claw over all columns. The outcomes
    of each cell are permuted between the trials, which removes what the seedlings of a trial share and keeps what a
    cell has in every trial: a row that always loses more is no correlation.

    Args:
        failed: True for a lost seedling; axes: trial, tray, row (column of the tray), claw.
        draws: Number of permutations.
    """
    values = failed.astype(np.int16)
    mean = values.mean(axis=0)
    rng = np.random.default_rng(_SEED)
    found = {name: _square(values, mean, axes) for name, axes in GROUPS.items()}
    exceeded = dict.fromkeys(GROUPS, 0)
    total = dict.fromkeys(GROUPS, 0.0)
    for _ in range(draws):
        permuted = rng.permuted(values, axis=0)
        for name, axes in GROUPS.items():
            drawn = _square(permuted, mean, axes)
            total[name] += drawn
            exceeded[name] += drawn >= found[name] * (1 - _ROUNDING)
    return {
        name: LossScatter(found[name] * draws / total[name] if total[name] else 1.0, _p(exceeded[name], draws))
        for name in GROUPS
    }


def trial_scatter(lost: Sequence[NDArray[np.int64]], seedlings: int, draws: int = _DRAWS) -> LossScatter | None:
    """Return the scatter of losses between the trials of equal settings.

    Independent losses have a multivariate hypergeometric distribution over the trials of a setting, given their sum.

    Args:
        lost: Lost seedlings of each trial, by setting.
        seedlings: Seedlings of a trial.
        draws: Number of draws.

    Returns:
        The scatter; None if no setting has several trials with losses and successes.
    """
    rng = np.random.default_rng(_SEED)
    found, drawn = 0.0, np.zeros(draws)
    for counts in lost:
        total, places = int(counts.sum()), len(counts) * seedlings
        if len(counts) < 2 or total in (0, places):
            continue
        share = total / places
        variance = seedlings * share * (1 - share)
        others = rng.multivariate_hypergeometric([seedlings] * len(counts), total, size=draws, method="marginals")
        found += float(np.sum((counts - seedlings * share) ** 2)) / variance
        drawn += np.sum((others - seedlings * share) ** 2, axis=1) / variance
    if not drawn.any():
        return None
    return LossScatter(found / float(drawn.mean()), _p(int(np.sum(drawn >= found * (1 - _ROUNDING))), draws))


def _square(values: NDArray[np.int16], mean: NDArray[np.float64], axes: tuple[int, ...]) -> float:
    """Return the sum of the squared deviations of the groups from their mean over the trials."""
    expected = mean.sum(axis=tuple(axis - 1 for axis in axes))
    return float(np.sum((values.sum(axis=axes) - expected) ** 2))


def _p(exceeded: int, draws: int) -> float:
    """Return the P value of a statistic that is one of the draws."""
    return (1 + exceeded) / (1 + draws)
