"""Knowledge of the constants of lodging and injury after the 23 runs of Table 2 of the cabbage paper.

The paper states neither the number n of seedlings of a run nor their dispersion φ, so that only the ratio n / φ
matters and is unknown: the variance of a run with the share p is p (1 - p) φ / n. With the prior 1 / (n / φ), the ratio
is integrated out exactly (the t distribution of a normal sample with unknown variance), and the posterior of the
constants is a sum over a grid with uniform priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.stats import norm

from plant_sim.planter.ground import ScatterSpec
from plant_sim.study.planter.lodging_fit import Values
from plant_sim.study.planter.tipping import DEEPEST_M, Tipping

LEVEL: Final = 0.9
NOT_LEARNED: Final = 0.8
"""Width of the posterior interval, relative to that of the prior, above which a constant is not learned."""
INJURY_STEPS: Final = 400
LODGING_STEPS: Final = 100
"""Grid points of each constant; with half of them, no end of an interval moves by 2 % of its prior."""
NEAR_LIMIT: Final = 0.05
"""Distance of an end from the limit of the prior, relative to the width of the prior, up to which the limit, not the
runs, determines the end."""
_TAIL: Final = (1 - LEVEL) / 2
_LEAST_SHARE: Final = 1e-6


class Prior(NamedTuple):
    """Uniform prior of a constant.

    Attributes:
        name: Constant with its unit.
        low: Smallest value.
        high: Largest value.
        scale: Factor from SI to the unit of the name.
    """

    name: str
    low: float
    high: float
    scale: float = 1.0

    def grid(self, steps: int) -> Values:
        """Return the centres of equal cells."""
        return self.low + (np.arange(steps) + 0.5) / steps * (self.high - self.low)


LODGING_PRIORS: Final = (
    Prior("share that sticks at the centre force, %", 0.0, 0.15, 100.0),
    Prior("exponent of the force", 0.0, 8.0),
    Prior("mean clearance, mm", 0.0, DEEPEST_M, 1000.0),
)
"""Priors before the bench, assumed: up to three times the lodging at the centre may be sticking, which does not fall
with the force, and the clearance is any that is simulated."""
INJURY_PRIORS: Final = (
    Prior("mean strength, N", 120.0, 600.0),
    Prior("standard deviation of the strength, N", 10.0, 300.0),
)
"""Priors before the bench, assumed: most blocks stand the largest tested force, 119 N, and up to five times as much."""


class Knowledge(NamedTuple):
    """Marginal posterior of one constant.

    Attributes:
        prior: Its prior.
        low: Lower end of the central interval with the probability `LEVEL`, in the unit of the prior.
        high: Upper end.
        width: Width of this interval, relative to that of the prior.
    """

    prior: Prior
    low: float
    high: float
    width: float

    @property
    def is_learned(self) -> bool:
        """True if the runs narrow the interval of the prior to `NOT_LEARNED` of its width or less."""
        return self.width <= NOT_LEARNED

    @property
    def learned(self) -> str:
        """Result in words: whether the constant is learned, or only a bound of it, the other end being the prior's."""
        low, high = self.prior.scale * self.prior.low, self.prior.scale * self.prior.high
        near = NEAR_LIMIT * (high - low)
        if not self.is_learned:
            return "no"
        if self.high > high - near:
            return "lower bound only"
        return "upper bound only" if self.low < low + near else "yes"


class Posterior(NamedTuple):
    """Posterior of the constants of one response.

    Attributes:
        constants: Marginal posterior of each constant.
        seedlings_per_dispersion: n / φ at the best grid point: the number of independent seedlings of a run that the
            scatter of the runs about the model corresponds to.
    """

    constants: tuple[Knowledge, ...]
    seedlings_per_dispersion: float


def lodging_posterior(
    tipping: Tipping, force_n: Values, observed_percent: Values, scatter: ScatterSpec, *, steps: int = LODGING_STEPS
) -> Posterior:
    """Return the posterior of the share that sticks, its exponent and the mean clearance.

    Args:
        tipping: Simulated falls, one setting per run.
        force_n: Clamp force of every run, N.
        observed_percent: Observed lodging of every run, %.
        scatter: Standard deviation of the clearance, and the force to which the share of sticking blocks applies.
        steps: Grid points of each constant.
    """
    share, exponent, clearance_m = (prior.grid(steps) for prior in LODGING_PRIORS)
    sticks = np.minimum(1.0, share[:, None, None] * (force_n / scatter.stick_n) ** exponent[:, None])
    tips = [tipping.share(each, scatter.clearance_sd_m) for each in clearance_m.tolist()]
    fits = [_fit(sticks + (1 - sticks) * each, observed_percent / 100) for each in tips]
    return _posterior(GridFit(*(np.stack(each, axis=-1) for each in zip(*fits, strict=True))), LODGING_PRIORS)


def injury_posterior(force_n: Values, observed_percent: Values, *, steps: int = INJURY_STEPS) -> Posterior:
    """Return the posterior of the mean and the standard deviation of the strength.

    Args:
        force_n: Clamp force of every run, N.
        observed_percent: Observed injury of every run, %.
        steps: Grid points of each constant.
    """
    mean_n, sd_n = (prior.grid(steps) for prior in INJURY_PRIORS)
    shares = norm.cdf((force_n - mean_n[:, None, None]) / sd_n[:, None])
    return _posterior(_fit(shares, observed_percent / 100), INJURY_PRIORS)


class GridFit(NamedTuple):
    """Fit of the model at grid points.

    Attributes:
        log_density: Logarithm of the likelihood with n / φ integrated out, without a constant term.
        seedlings: Best n / φ.
    """

    log_density: Values
    seedlings: Values


def _fit(shares: Values, observed: Values) -> GridFit:
    """Return the fit at grid points.

    Args:
        shares: Expected share of every run, of shape (grid points..., runs).
        observed: Observed share of every run.
    """
    expected = np.clip(shares, _LEAST_SHARE, 1 - _LEAST_SHARE)
    variance = expected * (1 - expected)
    squares = np.sum((observed - expected) ** 2 / variance, axis=-1)
    runs = len(observed)
    return GridFit(-np.log(variance).sum(axis=-1) / 2 - runs / 2 * np.log(squares), runs / squares)


def _posterior(fit: GridFit, priors: Sequence[Prior]) -> Posterior:
    """Return the posterior over a grid with one axis for each constant."""
    density = np.exp(fit.log_density - fit.log_density.max())
    constants = []
    for axis, prior in enumerate(priors):
        low, high = _interval(density.sum(axis=tuple({*range(density.ndim)} - {axis})), prior)
        width = (high - low) / (LEVEL * (prior.high - prior.low))
        constants.append(Knowledge(prior, prior.scale * low, prior.scale * high, width))
    return Posterior(tuple(constants), float(fit.seedlings.flat[density.argmax()]))


def _interval(marginal: Values, prior: Prior) -> tuple[float, float]:
    """Return the central interval of a density in equal cells."""
    cumulative = np.append(0.0, np.cumsum(marginal) / marginal.sum())
    ends = np.linspace(prior.low, prior.high, len(cumulative))
    low, high = np.interp([_TAIL, 1 - _TAIL], cumulative, ends)
    return float(low), float(high)
