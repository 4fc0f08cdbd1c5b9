"""False alarms of ``study analyse``, from the CSV file to the P value."""

from __future__ import annotations

import pytest
from scipy import stats

from plant_sim.study.doe.irls import Link
from scripts.analyse_error_rates import DESIGNS, LINKS, rejections
from scripts.error_rates import CORRELATIONS

NIGHTLY_TABLES = 500
FEW_TABLES = 30
LEAST = 0.025
MOST: dict[Link, float] = {"logit": 0.07, "identity": 0.09}
"""Rates of false alarms between which the figures of docs/statistics.md are."""
CELLS = [
    *((design, "logit", 0.01, FEW_TABLES) for design in DESIGNS),
    *(
        pytest.param(design, link, correlation, NIGHTLY_TABLES, marks=pytest.mark.nightly)
        for design in DESIGNS
        for link in LINKS
        for correlation in CORRELATIONS
    ),
]


@pytest.mark.parametrize(("design", "link", "correlation", "tables"), CELLS)
def test_tables_without_an_effect_raise_the_stated_false_alarms(
    design: str, link: Link, correlation: float, tables: int
) -> None:
    """A sample leaves the limits once in 1,000 times if the true rate is at a bound."""
    found = rejections(design, link, correlation, tables, seed=2)
    assert len(found) == 2
    for test, count in found.items():
        assert count >= stats.binom.ppf(0.001, tables, LEAST), test
        assert count <= stats.binom.ppf(0.999, tables, MOST[link]), test
