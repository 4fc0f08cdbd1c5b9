"""Tests of the posterior of the constants of lodging and injury: known truth, coverage, and what cannot be learned."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from plant_sim.common.proportion import binomial_interval
from plant_sim.planter.parameters import load_planter
from plant_sim.study.doe.design import to_natural
from plant_sim.study.paper_tables import CABBAGE_FACTORS, cabbage_experiment
from plant_sim.study.planter.lodging_fit import Values
from plant_sim.study.planter.lodging_posterior import (
    INJURY_PRIORS,
    INJURY_STEPS,
    LEVEL,
    LODGING_STEPS,
    _fit,
    injury_posterior,
    lodging_posterior,
)
from plant_sim.study.planter.tipping import DEEPEST_M, Tipping

SCATTER = load_planter().scatter
CODED = cabbage_experiment("reconciled").coded
FORCE_N = to_natural(CABBAGE_FACTORS, CODED)[:, 2]
RUNS = len(FORCE_N)
DRAWS = 60


def tipping(blocks: int = 200) -> Tipping:
    """Return falls that tip below a limit of the clearance, which depends on the speed."""
    clearance_m = (np.arange(blocks) + 0.5) / blocks * DEEPEST_M
    limit_m = 0.012 + 0.003 * CODED[:, 0]
    return Tipping(clearance_m, clearance_m[np.newaxis, :] < limit_m[:, np.newaxis])


def lodging(share: float, exponent: float, clearance_m: float) -> Values:
    sticks = np.minimum(1.0, share * (FORCE_N / SCATTER.stick_n) ** exponent)
    shares: Values = sticks + (1 - sticks) * tipping().share(clearance_m, SCATTER.clearance_sd_m)
    return shares


def scattered(shares: Values, seedlings: float, rng: np.random.Generator) -> Values:
    """Return shares in percent with the scatter of independent seedlings."""
    return 100 * (shares + rng.normal(size=RUNS) * np.sqrt(shares * (1 - shares) / seedlings))


def test_many_seedlings_locate_the_constants_and_the_number_is_found() -> None:
    rng = np.random.default_rng(1)
    found = lodging_posterior(tipping(), FORCE_N, scattered(lodging(0.05, 3.0, 0.020), 5_000, rng), SCATTER)
    for each, true in zip(found.constants, (5.0, 3.0, 20.0), strict=True):
        assert each.low < true < each.high
        assert each.width < 0.4
        assert each.learned == "yes"
    assert 2_000 < found.seedlings_per_dispersion < 12_000


def test_equal_forces_teach_nothing_of_the_exponent() -> None:
    observed = scattered(lodging(0.05, 3.0, 0.020), 100_000, np.random.default_rng(2))
    share, exponent, _ = lodging_posterior(
        tipping(), np.full(RUNS, SCATTER.stick_n), np.full(RUNS, observed.mean()), SCATTER
    ).constants
    assert share.learned == "yes"
    assert exponent.learned == "no"
    assert exponent.width == pytest.approx(1.0, abs=0.02)


def test_the_intervals_cover_constants_drawn_from_the_prior() -> None:
    """The number of seedlings is unknown to the posterior; a central interval covers LEVEL of the drawn constants."""
    rng = np.random.default_rng(3)
    hits = np.zeros(2, dtype=int)
    for _ in range(DRAWS):
        mean_n, sd_n = (rng.uniform(prior.low, prior.high) for prior in INJURY_PRIORS)
        shares = norm.cdf((FORCE_N - mean_n) / sd_n)
        seedlings = float(np.exp(rng.uniform(np.log(60), np.log(6_000))))
        found = injury_posterior(FORCE_N, scattered(shares, seedlings, rng), steps=100)
        hits += [each.low <= true <= each.high for each, true in zip(found.constants, (mean_n, sd_n), strict=True)]
    for count in hits.tolist():
        low, high = binomial_interval(count, DRAWS, 0.999)
        assert low < LEVEL < high, hits


@pytest.mark.parametrize("response", ["Y1", "Y2"])
def test_a_grid_of_half_the_step_has_the_same_intervals(response: str) -> None:
    observed = cabbage_experiment("reconciled").responses[response]
    if response == "Y1":
        coarse, fine = (
            lodging_posterior(tipping(), FORCE_N, observed, SCATTER, steps=steps).constants
            for steps in (LODGING_STEPS // 2, LODGING_STEPS)
        )
    else:
        coarse, fine = (
            injury_posterior(FORCE_N, observed, steps=steps).constants for steps in (INJURY_STEPS // 2, INJURY_STEPS)
        )
    for a, b in zip(coarse, fine, strict=True):
        most = 0.02 * b.prior.scale * (b.prior.high - b.prior.low)
        assert abs(a.low - b.low) < most, (a, b)
        assert abs(a.high - b.high) < most, (a, b)


def test_a_clearance_that_prevents_every_fall_is_bounded_from_one_side() -> None:
    observed = scattered(lodging(0.05, 3.0, 0.035), 5_000, np.random.default_rng(4))
    clearance = lodging_posterior(tipping(), FORCE_N, observed, SCATTER).constants[2]
    assert clearance.learned == "lower bound only"
    assert clearance.low > 15.0


def test_the_likelihood_is_that_of_normal_shares_integrated_over_the_unknown_number() -> None:
    """By quadrature with the prior 1 / v of the number v of seedlings over dispersion."""
    observed, shares = np.array([0.02, 0.05, 0.04]), np.array([[0.03, 0.03, 0.05], [0.01, 0.06, 0.02]])

    def integrand(v: float, expected: Values) -> float:
        return float(np.prod(norm.pdf(observed, expected, np.sqrt(expected * (1 - expected) / v))) / v)

    first, second = (quad(integrand, 1e-9, 1e6, args=(each,), points=[10, 100, 1_000])[0] for each in shares)
    log_density = _fit(shares, observed).log_density
    assert log_density[0] - log_density[1] == pytest.approx(np.log(first / second), rel=1e-5)
