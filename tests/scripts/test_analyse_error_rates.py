"""False alarms of ``study analyse``: the simulated tests are those of the command, and err as often as stated."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from scripts.analyse_error_rates import (
    DESIGNS,
    LINKS,
    LOSSES,
    TABLES,
    factor_tests,
    lines_of,
    p_values_of_file,
    rejections,
)
from scripts.error_rates import CORRELATIONS, SEEDLINGS

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
