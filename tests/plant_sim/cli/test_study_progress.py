"""Progress of a study: lines for a pipe, with the remaining time."""

from __future__ import annotations

import pytest

from plant_sim.cli.study.progress import TenthsProgress, study_progress


def test_the_remaining_time_follows_from_the_trials_of_this_session(capsys: pytest.CaptureFixture[str]) -> None:
    """40 of 100 runs were stored before; each of the others takes 2 s."""
    times_s = iter(range(0, 1000, 2))
    progress = TenthsProgress("runs", lambda: float(next(times_s)))
    for done in range(40, 101):
        progress(done, 100)
    assert capsys.readouterr().err.splitlines() == [
        "40 of 100 runs",
        "50 of 100 runs, 0:01:40 left",
        "60 of 100 runs, 0:01:20 left",
        "70 of 100 runs, 0:01:00 left",
        "80 of 100 runs, 0:00:40 left",
        "90 of 100 runs, 0:00:20 left",
        "100 of 100 runs",
    ]


def test_nothing_is_printed_before_the_first_tenth(capsys: pytest.CaptureFixture[str]) -> None:
    with study_progress() as progress:
        for done in range(5):
            progress(done, 50)
        assert capsys.readouterr().err == ""
        progress(5, 50)
    assert capsys.readouterr().err.startswith("5 of 50 trials, ")
