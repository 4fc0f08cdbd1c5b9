"""Proportions, and their intervals beside those of another library."""

from __future__ import annotations

import math

import pytest
from scipy.stats import binomtest

from plant_sim.common.proportion import Proportion, binomial_interval


@pytest.mark.parametrize(("hits", "draws"), [(0, 144), (144, 144), (0, 1), (1, 1), (1, 144), (136, 144), (5000, 7200)])
@pytest.mark.parametrize("confidence", [0.95, 0.99])
def test_the_interval_of_a_share_is_exact(hits: int, draws: int, confidence: float) -> None:
    exact = binomtest(hits, draws).proportion_ci(confidence, method="exact")
    assert binomial_interval(hits, draws, confidence) == pytest.approx((exact.low, exact.high), abs=1e-9)


def test_the_interval_of_no_hits_or_all_hits_ends_at_0_or_1() -> None:
    """Exact form of the rule of three: without a hit in n draws the upper end is 1 - 0.025^(1/n)."""
    upper = 1 - 0.025 ** (1 / 144)
    assert binomial_interval(0, 144) == pytest.approx((0.0, upper), abs=1e-12)
    assert binomial_interval(144, 144) == pytest.approx((1 - upper, 1.0), abs=1e-12)


def test_the_interval_without_draws_is_0_to_1() -> None:
    assert binomial_interval(0, 0) == (0.0, 1.0)


def test_a_proportion_in_percent_and_as_text() -> None:
    assert Proportion(136, 144).percent == pytest.approx(94.44, abs=0.01)
    assert Proportion(136, 144).interval_percent == pytest.approx((89.35, 97.57), abs=0.01)
    assert Proportion(136, 144).text() == "94.4 % (89.3 to 97.6)"
    assert Proportion(136, 144).text(decimals=0) == "94 % (89 to 98)"


def test_a_proportion_without_draws_has_no_value() -> None:
    none = Proportion(0, 0)
    assert math.isnan(none.share)
    assert none.text() == "none"
    assert none.record() == {"hits": 0, "of": 0, "percent": None, "low": 0.0, "high": 100.0}
