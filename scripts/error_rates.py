"""Error rates of the analysis of counted seedlings: false alarms, power and coverage, by simulation.

``python -m scripts.error_rates`` prints the tables of docs/statistics.md. The design is that of Table 4 of the pepper
paper, and the truth is its equation 5. The seedlings of a tray of 72 are correlated: each tray has a share of its own,
drawn from a beta distribution, and its count is binomial with that share. Every table is analysed by the functions of
the weighted fit (`plant_sim.study.doe.irls`).
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special, stats

from plant_sim.common.paper_sheet import equation
from plant_sim.common.polynomial import CONSTANT, Polynomial, model_matrix
from plant_sim.study.doe.irls import Array, irls, split_residual
from plant_sim.study.doe.optimum import best
from plant_sim.study.doe.regression import point_numbers, terms
from plant_sim.study.paper_tables import pepper_experiment

TRAY: Final = 72
"""Seedlings of a tray, which fail together."""
SEEDLINGS: Final = (144, 720, 7200)
CORRELATIONS: Final = (0.0, 0.01, 0.03)
NOMINAL: Final = 0.05
DEPARTURE_POINTS: Final = 3.0
"""Coefficient of the cubic departure from equation 5, percentage points."""
DEPARTURE_SEEDLINGS: Final = 1440
_DRAWS = 200
_LOCATED_DESIGNS = 2000

CODED: Final = pepper_experiment().coded
NAMES: Final = (CONSTANT, *terms(3, "quadratic"))
MATRIX: Final = model_matrix(CODED, NAMES)
POINTS: Final = point_numbers(CODED)
PURE_DF: Final = len(CODED) - int(POINTS.max()) - 1
LACK_DF: Final = len(CODED) - len(NAMES) - PURE_DF
EQUATION_5: Final = Polynomial(equation("pepper-equation-5", "S"))


def truth(cubic_points: float = 0.0) -> Array:
    """Return the true share of every run: equation 5, and a cubic term of the claw pressure.

    Args:
        cubic_points: Coefficient of X3³, percentage points.
    """
    return np.asarray((EQUATION_5.predict(CODED) + cubic_points * CODED[:, 2] ** 3) / 100)


def simulated(shares: Array, seedlings: int, correlation: float, designs: int, rng: np.random.Generator) -> Array:
    """Return the observed shares of runs whose trays have correlated seedlings, one design per row.

    Args:
        shares: True share of each run.
        seedlings: Seedlings of a run, whole trays.
        correlation: Correlation of two seedlings of a tray.
        designs: Number of designs.
        rng: Random generator.
    """
    trays = seedlings // TRAY
    shape = (designs, len(shares), trays)
    if correlation == 0:
        return rng.binomial(seedlings, shares, size=shape[:2]) / seedlings
    strength = (1 - correlation) / correlation
    own = rng.beta(shares[:, np.newaxis] * strength, (1 - shares[:, np.newaxis]) * strength, size=shape)
    return np.asarray(rng.binomial(TRAY, own).sum(axis=-1) / seedlings)


@dataclass(frozen=True)
class Rejections:
    """Fraction of the designs in which each test finds a lack of fit at the nominal 5 %.

    Attributes:
        weighted: F test of the weighted fit with the pure error as it is.
        floored: The same with a pure error of at least 1.
        least_squares: F test of least squares on the shares.
        binomial: Likelihood ratio of the quadratic and the saturated binomial model, χ².
    """

    weighted: float
    floored: float
    least_squares: float
    binomial: float


def lack_of_fit(observed: Array, seedlings: int) -> Rejections:
    """Return how often the tests of the lack of fit reject.

    Args:
        observed: Observed shares, one design per row.
        seedlings: Seedlings of a run.
    """
    totals = np.full(len(CODED), float(seedlings))
    coefficients, response, weights, _ = irls(MATRIX, observed, totals)
    residual, pure = split_residual(MATRIX, response, weights, POINTS)
    limit = stats.f.isf(NOMINAL, LACK_DF, PURE_DF)
    lack, error = (residual - pure) / LACK_DF, pure / PURE_DF
    plain_residual, plain_pure = split_residual(MATRIX, observed, np.ones_like(observed), POINTS)
    plain_f = (plain_residual - plain_pure) / LACK_DF / (plain_pure / PURE_DF)
    fitted = np.clip(coefficients @ MATRIX.T, 0.5 / seedlings, 1 - 0.5 / seedlings)
    member = np.eye(int(POINTS.max()) + 1)[POINTS]
    means = (observed @ member / member.sum(axis=0))[:, POINTS]
    ratio = 2 * seedlings * _likelihood(observed, means, fitted)
    return Rejections(
        float(np.mean(lack / error > limit)),
        float(np.mean(lack / np.maximum(error, 1) > limit)),
        float(np.mean(plain_f > limit)),
        float(np.mean(ratio > stats.chi2.isf(NOMINAL, LACK_DF))),
    )


def _likelihood(observed: Array, means: Array, fitted: Array) -> Array:
    """Return the log-likelihood of the means of the points minus that of the fitted shares, per seedling."""

    def log_likelihood(shares: Array) -> Array:
        return np.asarray((special.xlogy(observed, shares) + special.xlogy(1 - observed, 1 - shares)).sum(axis=-1))

    return log_likelihood(means) - log_likelihood(fitted)


@dataclass(frozen=True)
class IntervalCoverage:
    """Fraction of the 95 % intervals that contain the truth.

    Attributes:
        coefficients: Of the intervals of all coefficients, by term.
        floored: Mean of the coefficients, with a dispersion of at least 1.
        optimum: Of the success at the optimum of equation 5.
        place: Of the location of the optimum, by factor.
    """

    coefficients: Mapping[str, float]
    floored: float
    optimum: float
    place: tuple[float, ...]


def coverage(
    observed: Array, seedlings: int, rng: np.random.Generator, *, located: int = _LOCATED_DESIGNS
) -> IntervalCoverage:
    """Return how often the intervals of the weighted fit contain the truth.

    Args:
        observed: Observed shares, one design per row.
        seedlings: Seedlings of a run.
        rng: Random generator of the draws.
        located: Maximum number of designs whose optimum is located in every draw.
    """
    totals = np.full(len(CODED), float(seedlings))
    coefficients, response, weights, _ = irls(MATRIX, observed, totals)
    _, pure = split_residual(MATRIX, response, weights, POINTS)
    inverse = np.linalg.inv(np.einsum("ij,dj,jk->dik", MATRIX.T, weights, MATRIX))
    scale = (pure / PURE_DF)[:, np.newaxis]
    true = np.array([EQUATION_5.coefficients[name] for name in NAMES]) / 100
    off, quantile = np.abs(coefficients - true), stats.t.ppf(0.975, PURE_DF)
    spread = np.diagonal(inverse, axis1=1, axis2=2)
    inside = off <= quantile * np.sqrt(scale * spread)
    place, _ = best(EQUATION_5, (-1.0,) * 3, (1.0,) * 3)
    row = model_matrix(place[np.newaxis], NAMES)[0]
    error = np.sqrt(scale[:, 0] * np.einsum("i,dij,j->d", row, inverse, row))
    drawn = slice(0, located)
    spread_matrix = np.linalg.cholesky(scale[drawn, :, np.newaxis] * inverse[drawn])
    shape = (len(spread_matrix), _DRAWS)
    normal = rng.standard_normal((*shape, len(NAMES)))
    t = np.einsum("dij,dnj->dni", spread_matrix, normal) / np.sqrt(rng.chisquare(PURE_DF, shape) / PURE_DF)[..., None]
    optima = best_of_quadratics((coefficients[drawn, np.newaxis] + t).reshape(-1, len(NAMES))).reshape(*shape, 3)
    low, high = np.quantile(optima, (0.025, 0.975), axis=1)
    return IntervalCoverage(
        dict(zip(NAMES, map(float, inside.mean(axis=0)), strict=True)),
        float(np.mean(off <= quantile * np.sqrt(np.maximum(scale, 1) * spread))),
        float(np.mean(np.abs((coefficients - true) @ row) <= quantile * error)),
        tuple(map(float, ((low <= place) & (place <= high)).mean(axis=0))),
    )


def best_of_quadratics(coefficients: Array) -> Array:
    """Return the maximum in the box from -1 to 1 of quadratics in three factors, one per row.

    The maximum is a stationary point of one of the 27 faces of the box, so all of them are computed and compared.

    Args:
        coefficients: Coefficients in the order of `NAMES`.
    """
    linear, crossed, squared = coefficients[:, 1:4], coefficients[:, 4:7], coefficients[:, 7:10]
    hessian = np.zeros((len(coefficients), 3, 3))
    for column, (i, j) in enumerate(itertools.combinations(range(3), 2)):
        hessian[:, i, j] = hessian[:, j, i] = crossed[:, column]
    hessian[:, range(3), range(3)] = 2 * squared
    found, value = np.zeros_like(linear), np.full(len(coefficients), -np.inf)
    for face in itertools.product((None, -1.0, 1.0), repeat=3):
        free = [index for index, side in enumerate(face) if side is None]
        points = np.tile([0.0 if side is None else side for side in face], (len(coefficients), 1))
        if free:
            gradient = (linear + np.einsum("dij,dj->di", hessian, points))[:, free]
            block = hessian[np.ix_(range(len(points)), free, free)]
            points[:, free] = np.linalg.solve(block, -gradient[..., np.newaxis])[..., 0]
        here = np.einsum("di,di->d", linear, points) + np.einsum("di,dij,dj->d", points, hessian, points) / 2
        better = (np.abs(points) <= 1).all(axis=1) & (here > value)
        found[better], value[better] = points[better], here[better]
    return found


def false_alarm_rows(designs: int, seed: int = 1) -> list[tuple[str, ...]]:
    """Return the rows of the table of false alarms."""
    rows: list[tuple[str, ...]] = []
    for seedlings, correlation in itertools.product(SEEDLINGS, CORRELATIONS):
        rng = np.random.default_rng((seed, seedlings, round(1000 * correlation)))
        found = lack_of_fit(simulated(truth(), seedlings, correlation, designs, rng), seedlings)
        low, high = stats.binomtest(round(found.weighted * designs), designs).proportion_ci(method="exact")
        rows.append(
            (
                f"{seedlings:,}",
                f"{correlation:g}",
                f"{100 * found.weighted:.1f} ({100 * low:.1f} to {100 * high:.1f})",
                *(f"{100 * each:.1f}" for each in (found.floored, found.least_squares, found.binomial)),
            )
        )
    return rows


def power_rows(designs: int, seed: int = 2) -> list[tuple[str, ...]]:
    """Return the rows of the table of power."""
    shares = truth(DEPARTURE_POINTS)
    rows: list[tuple[str, ...]] = []
    for correlation in CORRELATIONS:
        rng = np.random.default_rng((seed, round(1000 * correlation)))
        observed = simulated(shares, DEPARTURE_SEEDLINGS, correlation, designs, rng)
        found = lack_of_fit(observed, DEPARTURE_SEEDLINGS)
        rows.append(
            (
                f"{correlation:g}",
                *(f"{100 * each:.0f}" for each in (found.weighted, found.floored, found.least_squares)),
            )
        )
    return rows


def coverage_rows(designs: int, seed: int = 3) -> list[tuple[str, ...]]:
    """Return the rows of the table of coverage."""
    rows: list[tuple[str, ...]] = []
    for seedlings, correlation in itertools.product(SEEDLINGS, CORRELATIONS):
        rng = np.random.default_rng((seed, seedlings, round(1000 * correlation)))
        found = coverage(simulated(truth(), seedlings, correlation, designs, rng), seedlings, rng)
        each = found.coefficients.values()
        rows.append(
            (
                f"{seedlings:,}",
                f"{correlation:g}",
                f"{100 * min(each):.1f} to {100 * max(each):.1f}",
                f"{100 * found.floored:.1f}",
                f"{100 * found.optimum:.1f}",
                ", ".join(f"{100 * part:.1f}" for part in found.place),
            )
        )
    return rows


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def tables(designs: int) -> str:
    """Return the three tables in Markdown."""
    departure = f"{DEPARTURE_POINTS:g} points · X3³, {DEPARTURE_SEEDLINGS:,} seedlings"
    return "\n\n".join(
        (
            f"False alarms of the test of lack of fit, %, at nominal 5 %; {designs:,} designs per row:",
            table(
                (
                    "seedlings per run",
                    "correlation",
                    "weighted, F (95 % interval)",
                    "weighted, dispersion at least 1",
                    "least squares, F",
                    "binomial, χ²",
                ),
                false_alarm_rows(designs),
            ),
            f"Power against a departure of {departure}, %:",
            table(
                ("correlation", "weighted, F", "weighted, dispersion at least 1", "least squares, F"),
                power_rows(designs),
            ),
            "Coverage of 95 % intervals of the weighted fit, %:",
            table(
                (
                    "seedlings per run",
                    "correlation",
                    "coefficients, least and most",
                    "mean, dispersion at least 1",
                    "success at the optimum",
                    "location of the optimum: X1, X2, X3",
                ),
                coverage_rows(designs),
            ),
        )
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m scripts.error_rates", description=__doc__, allow_abbrev=False)
    parser.add_argument("--designs", type=int, default=4000, help="simulated designs per row (default: 4000)")
    sys.stdout.write(tables(parser.parse_args().designs) + "\n")


if __name__ == "__main__":
    main()
