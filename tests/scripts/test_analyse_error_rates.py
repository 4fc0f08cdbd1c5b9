"""Error rates of ``study analyse``: the simulated tests are those of the command, and err as often as stated."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from scripts.analyse_error_rates import (
    BLOCK_SHARES,
    DESIGNS,
    EFFECT,
    LINKS,
    LOSSES,
    TABLES,
    factor_tests,
    lines_of,
    p_values_of_file,
    rejections,
)
from scripts.error_rates import CORRELATIONS, NOMINAL, SEEDLINGS, TRAY

FEW_TABLES = 200
LEAST, MOST = 0.035, 0.07
"""Rates of false alarms between which a test at the nominal 5 % must be."""
CELLS = [
    *((design, 144, 0.01, FEW_TABLES) for design in DESIGNS),
    *(
        pytest.param(design, seedlings, correlation, TABLES, marks=pytest.mark.nightly)
        for design in DESIGNS
        for seedlings in SEEDLINGS
        for correlation in CORRELATIONS
    ),
]


@pytest.mark.parametrize("design", DESIGNS)
def test_the_simulated_tests_are_those_of_the_command(design: str, tmp_path: Path) -> None:
    """P values of a CSV file that the command reads, for every test and link."""
    lost = LOSSES[design](144, 0.03, 2, np.random.default_rng(5))
    path = tmp_path / "trials.csv"
    for number, own in enumerate(lost):
        with path.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(lines_of(design, own, 144))
        for link in LINKS:
            expected = {test.name: float(test.p_values(lost, 144, link)[number]) for test in factor_tests(design)}
            assert p_values_of_file(path, design, link) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("design", "seedlings", "correlation", "tables"), CELLS)
def test_tables_without_an_effect_raise_the_nominal_false_alarms(
    design: str, seedlings: int, correlation: float, tables: int
) -> None:
    """A sample leaves the limits once in 1,000 times if the true rate is at a bound."""
    for link, found in rejections(design, seedlings, correlation, tables, seed=2).items():
        assert len(found) == 2
        for test, count in found.items():
            assert count >= stats.binom.ppf(0.001, tables, LEAST), (link, test)
            assert count <= stats.binom.ppf(0.999, tables, MOST), (link, test)


@pytest.mark.parametrize(
    ("correlation", "tables"),
    [(0.01, FEW_TABLES), *(pytest.param(each, TABLES, marks=pytest.mark.nightly) for each in CORRELATIONS)],
)
def test_the_power_is_that_of_the_noncentral_f_distribution(correlation: float, tables: int) -> None:
    """By hand for 144 seedlings: 16 of the 30 trials have the factor at a level, which changes their losses.

    The distribution takes the variance of all trials as that of the mean share of losses.
    """
    share, seedlings = sum(BLOCK_SHARES) / 2, 144
    dispersion = 1 + (TRAY - 1) * correlation
    noncentrality = 16 * seedlings * (share * EFFECT) ** 2 / (share * (1 - share) * dispersion)
    (factors,) = (test for test in factor_tests("blocks") if test.name == "factors")
    terms = factors.matrix.shape[1] - factors.without.shape[1]
    degrees = len(factors.matrix) - factors.pure.shape[1]
    expected = stats.ncf.sf(stats.f.isf(NOMINAL, terms, degrees), terms, degrees, noncentrality)
    assert 0.1 < expected < 0.7
    for link, found in rejections("blocks", seedlings, correlation, tables, effect=EFFECT).items():
        spread = 3.3 * np.sqrt(expected * (1 - expected) / tables)
        assert found["factors"] / tables == pytest.approx(expected, abs=0.03 + spread), link
