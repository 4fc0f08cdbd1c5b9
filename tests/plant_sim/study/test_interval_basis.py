"""Basis of the intervals of counted seedlings: binomial, or the scatter between the trials."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from plant_sim.study.estimates import BY_SCATTER, IntervalBasis, estimate
from plant_sim.twin.report import TrialReport
from plant_sim.twin.trial import run_trial


@cache
def one() -> TrialReport:
    """Return the report of a trial, whose counts the tests replace."""
    return run_trial(seed=1)


def trials(lost: NDArray[np.int64]) -> list[TrialReport]:
    """Return trials with the given numbers of seedlings lost at the throw, and no others."""
    return [
        replace(one(), P=0, D=0, T=int(each), in_cups=144 - int(each), S=100 * (144 - int(each)) / 144, F_p=0, F_d=0)
        for each in lost
    ]


def test_losses_of_independent_seedlings_have_binomial_intervals() -> None:
    rng = np.random.default_rng(1)
    reports = [trials(rng.binomial(144, share, 10)) for share in (0.03, 0.1)]
    basis = IntervalBasis.of(reports)
    assert basis.is_binomial
    assert list(basis.scatter) == ["S", "F_t"]
    assert basis.text(BY_SCATTER).startswith("Binomial intervals: allowed (scatter between equal trials")
    assert estimate("S", reports[0], is_binomial=basis.is_binomial) == estimate("S", reports[0])


def test_rows_lost_at_once_have_intervals_of_their_scatter() -> None:
    """12 seedlings at once in a third of the trials: the binomial interval is too narrow and is not used."""
    lost = np.array([2, 3, 14, 4, 16, 2, 3, 15, 1, 4])
    basis = IntervalBasis.of([trials(lost)])
    assert basis.refused == ("S", "F_t")
    assert BY_SCATTER in basis.text(BY_SCATTER)
    assert basis.record()["is_binomial"] is False
    refused = estimate("S", trials(lost), is_binomial=False)
    binomial = estimate("S", trials(lost))
    assert refused.mean == pytest.approx(binomial.mean)
    half = 2.2622 * (100 * lost / 144).std(ddof=1) / np.sqrt(10)  # t(0.975, 9)
    assert refused.mean is not None
    assert refused.low is not None
    assert refused.mean - refused.low == pytest.approx(half, rel=1e-4)
    assert binomial.low is not None
    assert refused.low < binomial.low


def test_single_trials_are_not_tested() -> None:
    basis = IntervalBasis.of([trials(np.array([5])), trials(np.array([20]))])
    assert basis.is_binomial
    assert "whether seedlings fail together is not tested here" in basis.text(BY_SCATTER)
