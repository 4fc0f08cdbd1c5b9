"""Memory of a campaign: it does not grow with the number of results."""

from __future__ import annotations

import gc
import tracemalloc
from pathlib import Path

import pytest

from plant_sim.study.campaign import run
from plant_sim.twin.trial import run_trial
from tests.plant_sim.study.campaign.folders import campaign, shards, written

MOST_BYTES_PER_RUN = 400
"""A key takes about 130 bytes, the record of a run more than 1 kB."""


@pytest.mark.nightly
def test_memory_does_not_grow_with_the_results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The trials are replaced by one report, so that thousands of results are stored in seconds.

    The first campaign loads modules and fills caches; it is not measured.
    """
    report = run_trial(seed=1, seedlings=12)
    monkeypatch.setattr(run, "run_trial", lambda **_: report)
    peaks = []
    for runs in (100, 400, 2000):
        file, out = written(tmp_path, f"replicates: {runs}\nseedlings: 12\n"), tmp_path / str(runs)
        gc.collect()
        tracemalloc.start()
        assert campaign(file, out, "--shard", "100") == 0
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(shards(out)) == runs / 100
    assert peaks[2] - peaks[1] < 1600 * MOST_BYTES_PER_RUN, peaks
