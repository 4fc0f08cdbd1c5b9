"""False alarms and power of ``study analyse``, by simulation.

``python -m scripts.analyse_error_rates`` prints the tables of docs/statistics.md. For the false alarms, no factor has
an effect. For the power, the losses are a quarter higher at the high level of a factor, and a quarter lower at its low
level. Seedlings of a tray of 72 are correlated as in `scripts.error_rates`. The tests are those of the command, for
many tables at once; a test compares their P values with those of CSV files that the command reads.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from scipy import stats

from plant_sim.common.polynomial import CONSTANT, model_matrix
from plant_sim.study.analyse.model import TrialModel, fit_model, model_terms
from plant_sim.study.analyse.roles import RoleOptions, assign
from plant_sim.study.analyse.table import read_table
from plant_sim.study.doe.block_columns import block_columns
from plant_sim.study.doe.irls import Array, Link
from plant_sim.study.doe.score_test import nested_f, pure_matrix
from plant_sim.study.doe.standard_designs import box_behnken
from scripts.error_rates import CORRELATIONS, NOMINAL, SEEDLINGS, simulated, table

LINKS: Final[tuple[Link, ...]] = ("logit", "identity")
DESIGNS: Final = ("blocks", "whole plots")
BLOCK_SHARES: Final = (0.07, 0.09)
"""Share of losses in each block."""
PLOT_SHARE: Final = 0.08
PLOT_CORRELATION: Final = 0.02
"""Mean share of losses of the whole plots, and correlation of two seedlings of different trials of one plot."""
EFFECT: Final = 0.25
"""Relative change of the losses from the middle to a level of a factor, for the power."""
TABLES: Final = 4000
_PLOTS, _FOAMS_MM, _AGES_D = 8, (8, 8, 16, 16), (45, 55)
_POINTS: Final = np.vstack([box_behnken(3, centres=3)] * 2)


@dataclass(frozen=True)
class FactorTest:
    """Test of one stratum of the error.

    Attributes:
        name: Name of the test.
        without: Model matrix of the hypothesis.
        matrix: Model matrix.
        pure: Matrix of the pure error.
        pooled: Number of successive trials whose counts are pooled to one mean.
    """

    name: str
    without: Array
    matrix: Array
    pure: Array
    pooled: int = 1

    def p_values(self, lost: Array, seedlings: int, link: Link) -> Array:
        """Return the P value of each table."""
        counts = lost.reshape(len(lost), -1, self.pooled).sum(axis=-1)
        totals = np.full(counts.shape[1], float(seedlings * self.pooled))
        f = nested_f(self.without, self.matrix, self.pure, counts / totals, totals, link=link)
        terms, degrees = self.matrix.shape[1] - self.without.shape[1], len(totals) - self.pure.shape[1]
        return np.asarray(stats.f.sf(f, terms, degrees))


def block_losses(
    seedlings: int, correlation: float, tables: int, rng: np.random.Generator, effect: float = 0.0
) -> Array:
    """Return the losses of a Box-Behnken design in two blocks of different losses, one table per row.

    Args:
        seedlings: Seedlings of a trial, whole trays.
        correlation: Correlation of two seedlings of a tray.
        tables: Number of tables.
        rng: Random generator.
        effect: Relative change of the losses from the middle to a level of the first factor.
    """
    shares = np.repeat(BLOCK_SHARES, len(_POINTS) // 2) * (1 + effect * _POINTS[:, 0])
    return seedlings * simulated(shares, seedlings, correlation, tables, rng)


def plot_losses(
    seedlings: int, correlation: float, tables: int, rng: np.random.Generator, effect: float = 0.0
) -> Array:
    """Return the losses of whole plots, each of one age and with a share of losses of its own, one table per row.

    The arguments are those of `block_losses`, with an effect of each factor.
    """
    strength = (1 - PLOT_CORRELATION) / PLOT_CORRELATION
    shares = rng.beta(PLOT_SHARE * strength, (1 - PLOT_SHARE) * strength, (tables, _PLOTS))
    of_trials = shares.repeat(len(_FOAMS_MM), axis=1) * np.prod(1 + effect * _plot_factors(), axis=1)
    return seedlings * np.vstack([simulated(each, seedlings, correlation, 1, rng) for each in of_trials])


def _plot_factors() -> Array:
    """Return the coded age and foam of each trial of the whole plots."""
    ages = np.array([-1.0, 1.0] * (_PLOTS // 2)).repeat(len(_FOAMS_MM))
    return np.column_stack([ages, np.tile([-1.0, -1.0, 1.0, 1.0], _PLOTS)])


LOSSES: Final[Mapping[str, Callable[..., Array]]] = {
    "blocks": block_losses,
    "whole plots": plot_losses,
}
"""Simulation of the losses of each design."""


@cache
def factor_tests(design: str) -> tuple[FactorTest, ...]:
    """Return the tests of the factors and of the lack of fit of a design."""
    if design == "blocks":
        coded = np.hstack([_POINTS, block_columns([0] * 15 + [1] * 15)])
        blocks = model_matrix(coded, [CONSTANT, "X4"])
        matrix = model_matrix(coded, [CONSTANT, *model_terms(_POINTS, "quadratic"), "X4"])
        pure = pure_matrix(coded, 1)
        return FactorTest("factors", blocks, matrix, pure), FactorTest("lack of fit", matrix, pure, pure)
    ages = np.array([[-1.0], [1.0]] * (_PLOTS // 2))
    between = model_matrix(ages, [CONSTANT, "X1"])
    plots = block_columns(np.repeat(np.arange(_PLOTS), len(_FOAMS_MM)).tolist())
    factors = _plot_factors()
    within = np.hstack([np.ones((len(factors), 1)), plots])
    return (
        FactorTest("factors between whole plots", between[:, :1], between, pure_matrix(ages), len(_FOAMS_MM)),
        FactorTest(
            "factors within whole plots",
            within,
            np.hstack([within, model_matrix(factors, ["X2", "X1 X2"])]),
            pure_matrix(np.hstack([factors, plots]), plots.shape[1]),
        ),
    )


def lines_of(design: str, lost: Array, seedlings: int) -> list[Sequence[object]]:
    """Return heading and lines of the CSV file of a table."""
    counts = [round(each) for each in lost.tolist()]
    if design == "blocks":
        blocks = [f"D{number // 15}" for number in range(len(counts))]
        rows = zip(_POINTS.tolist(), blocks, counts, strict=True)
        heading = ("foam", "age", "pressure", "date", "lost", "total")
        return [heading, *((*point, block, count, seedlings) for point, block, count in rows)]
    trials = itertools.product(range(_PLOTS), _FOAMS_MM)
    return [
        ("batch", "age", "foam", "lost", "total"),
        *(
            (plot, _AGES_D[plot % 2], foam, count, seedlings)
            for (plot, foam), count in zip(trials, counts, strict=True)
        ),
    ]


_ROLES = {
    "blocks": RoleOptions(),
    "whole plots": RoleOptions(factors=("age", "foam"), whole_plots="batch", counts="lost", total="total"),
}


def p_values_of_file(path: Path, design: str, link: Link) -> dict[str, float]:
    """Return the P values of the factors together and of the lack of fit of a file, by stratum of the error."""
    model = fit_model(assign(read_table(path), _ROLES[design]), None, link)
    assert isinstance(model, TrialModel)  # noqa: S101 - the designs identify a model
    found = {}
    for stratum in model.strata:
        name = "factors" if stratum.name == "trials" else f"factors {stratum.name}"
        lack = next((row.p for row in stratum.rows() if row.source == "lack of fit"), None)
        for test, p in ((name, stratum.model_p), ("lack of fit", lack)):
            if p is not None:
                found[test] = p
    return found


def rejections(
    design: str, seedlings: int, correlation: float, tables: int, *, effect: float = 0.0, seed: int = 1
) -> dict[str, dict[str, int]]:
    """Return by link in how many tables each test rejects at the nominal 5 %."""
    rng = np.random.default_rng((seed, DESIGNS.index(design), seedlings, round(1000 * correlation)))
    lost = LOSSES[design](seedlings, correlation, tables, rng, effect)
    return {
        link: {
            test.name: int(np.count_nonzero(test.p_values(lost, seedlings, link) < NOMINAL))
            for test in factor_tests(design)
        }
        for link in LINKS
    }


def rows(tables: int, effect: float = 0.0) -> list[tuple[str, ...]]:
    """Return the rows of the table of false alarms, or of power, with a column for each correlation."""
    cells: dict[tuple[str, ...], list[str]] = {}
    for design, seedlings, correlation in itertools.product(DESIGNS, SEEDLINGS, CORRELATIONS):
        for link, found in rejections(design, seedlings, correlation, tables, effect=effect).items():
            for test, count in found.items():
                if effect and test == "lack of fit":
                    continue  # the model of the test contains the effect
                low, high = stats.binomtest(count, tables).proportion_ci(method="exact")
                rate = f"{100 * count / tables:.1f} ({100 * low:.1f} to {100 * high:.1f})"
                cells.setdefault((design, test, link, f"{seedlings:,}"), []).append(rate)
    order = [(design, test.name) for design in DESIGNS for test in factor_tests(design)]
    keys = sorted(cells, key=lambda key: (order.index((key[0], key[1])), LINKS.index(_link(key[2]))))
    return [(*key, *cells[key]) for key in keys]


def _link(name: str) -> Link:
    return next(link for link in LINKS if link == name)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m scripts.analyse_error_rates", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--tables", type=int, default=TABLES, help=f"simulated tables of each kind (default: {TABLES})")
    heading = ("design", "test", "link", "seedlings", *(f"correlation {each:g}" for each in CORRELATIONS))
    tables = parser.parse_args().tables
    for title, effect in (("false alarms", 0.0), ("power", EFFECT)):
        sys.stdout.write(f"{title}, %\n\n{table(heading, rows(tables, effect))}\n\n")


if __name__ == "__main__":
    main()
