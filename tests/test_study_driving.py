"""How fast to drive: what the advice is made of, without a machine around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from controller.io_map import DEFAULT_IO_MAP, load_io_map
from controller.program.tags import ROWS, SIDES
from plant_sim.bench.report import RowTimes, TrialReport, make_report
from plant_sim.bench.study import driving
from plant_sim.bench.study.driving import Advice, Found, Limits, Point, drive
from plant_sim.bench.study.factors import Setting
from plant_sim.bench.study.pace import Paces
from plant_sim.bench.study.runner import RunOptions
from plant_sim.bench.study.throughput import _advice_parts
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.parameters import load_machine

OPTIONS = RunOptions(trials=2, seed=3, workers=1, machine=load_machine(), io_map=load_io_map(DEFAULT_IO_MAP))
WAITS_S = {f"{side} row {row}": RowTimes(2, 16.0, 1.0 + row + 0.5 * (side == "left")) for side in SIDES for row in ROWS}
"""Shortest on the right with row 1, 2 s."""


def trial(*, missed_cups: int = 0, reason: str = "") -> TrialReport:
    """Return the report of a trial without losses."""
    counts = SeedlingCounts(in_tray=0, in_claw=0, in_cups=36, P=0, D=0, T=0, total=36)
    made = make_report(seed=1, counts=counts, events=[], reason=reason, simulated_s=60.0, wall_s=0.0, air_l_min=40.0)
    return replace(made, missed_cups=missed_cups, cycle_times=WAITS_S)


def limits(without_gap: int | None) -> Limits:
    return Limits(without_gap=without_gap, settled=without_gap, by_row={}, searched_to=90)


def advised(
    monkeypatch: pytest.MonkeyPatch, limit: int | None, bad: dict[int, TrialReport], options: RunOptions = OPTIONS
) -> tuple[list[Point], Advice | None]:
    """Return the advice below a limit where the last of the trials is bad at some frequencies."""

    def points(options: RunOptions, frequencies: Sequence[int]) -> list[Point]:
        good = [trial()] * (options.trials - 1)
        return [Point(each, Setting({}), (*good, bad.get(each, trial()))) for each in frequencies]

    monkeypatch.setattr(driving, "_points", points)
    return driving._advice(options, limits(limit))


@pytest.mark.parametrize(
    ("limit", "bad", "highest"),
    [
        (55, {}, 55),
        (55, {55: trial(missed_cups=1)}, 54),
        (55, {55: trial(missed_cups=1), 54: trial(missed_cups=1)}, 53),
        (55, {55: trial(reason="jammed")}, 54),
        (55, {49: trial(missed_cups=1)}, 54),  # the one with the margin
        (55, {49: trial(reason="jammed")}, 54),
        (14, {}, 14),
        (13, {}, None),  # a tenth less is too slow for the program
        (None, {}, None),
    ],
)
def test_what_is_advised_is_borne_out_by_every_trial(
    monkeypatch: pytest.MonkeyPatch, limit: int | None, bad: dict[int, TrialReport], highest: int | None
) -> None:
    """One gap or one trial that does not complete, and the next lower frequency is tried."""
    _, found = advised(monkeypatch, limit, bad)
    if highest is None:
        assert found is None
    else:
        assert found is not None
        assert (found.highest.frequency_per_min, found.with_margin.frequency_per_min) == (highest, int(0.9 * highest))


@pytest.mark.parametrize(("trials", "wanted"), [(1, driving.CONFIRMING_TRIALS), (2, 5), (7, 7)])
def test_the_advice_rests_on_several_trials_however_few_the_study_runs(
    monkeypatch: pytest.MonkeyPatch, trials: int, wanted: int
) -> None:
    """And each of them can bring it down."""
    tried, found = advised(monkeypatch, 55, {55: trial(missed_cups=1)}, replace(OPTIONS, trials=trials))
    assert found is not None
    assert [(each.frequency_per_min, len(each.trials), each.gaps) for each in tried] == [
        (55, wanted, 1),
        (54, wanted, 0),
    ]
    assert len(found.with_margin.trials) == wanted


def found_with(advice: Advice | None, *, without_gap: int | None = 50, settled: int | None = 50) -> Found:
    up_to = replace(limits(without_gap), settled=settled)
    return Found(0.40, is_assumed=True, points=[], paces=Paces(OPTIONS), limits=up_to, tried=[], advice=advice)


def told(found: Found) -> str:
    return str(_advice_parts(found)[1])


def test_the_advice_tells_speeds_margin_and_the_shortest_wait() -> None:
    """50 plants a minute 0.4 m apart are 1.2 km/h; a tenth less 1.08."""
    fast, slow = (Point(each, Setting({}), (trial(), trial())) for each in (50, 45))
    text = told(found_with(Advice(fast, slow)))
    assert text.startswith(
        "With 40 cm between plants (assumed), drive up to 1.20 km/h: 50 plants a minute and row, without a gap in "
        "2 trials of 36. With 10 % margin: 1.08 km/h, 45 a minute; each arm then waits 2.0 s or more for its cups"
    )
    assert "beginning" not in text
    # none of two: Clopper and Pearson's interval ends at 1 - 0.025 ** (1 / 2)
    assert "A gap in none of 2 trials does not rule out one: it may still come in up to 84 % of the starts" in text
    assert "nothing faster was tried" not in text


def test_it_tells_that_gaps_may_come_at_the_beginning_only_or_that_nothing_faster_was_tried() -> None:
    fast, slow = (Point(each, Setting({}), (trial(),)) for each in (90, 81))
    assert "90 plants a minute and row (nothing faster was tried), without a gap in 1 trial of 36" in told(
        found_with(Advice(fast, slow), without_gap=90)
    )
    slower = Point(50, Setting({}), (trial(),))
    assert "Up to 1.44 km/h, 60 a minute, gaps come only at the beginning" in told(
        found_with(Advice(slower, slower), settled=60)
    )


def test_without_advice_it_says_so() -> None:
    assert told(found_with(None)) == (
        "No speed can be advised: down to 12/min, the slowest of this study, none is without a gap and leaves a margin "
        "of 10 %."
    )


@pytest.mark.parametrize(("given", "spacing_m", "is_assumed"), [(None, 0.40, True), (0.40, 0.40, False)])
def test_only_a_distance_that_nobody_gave_is_assumed(
    monkeypatch: pytest.MonkeyPatch, given: float | None, spacing_m: float, is_assumed: bool
) -> None:
    monkeypatch.setattr(driving, "_points", lambda *_: [])
    monkeypatch.setattr(driving, "Paces", Unobserved)
    monkeypatch.setattr(driving, "_limits", lambda *_: limits(None))
    found = drive(OPTIONS, [20], given)
    assert (found.spacing_m, found.is_assumed) == (spacing_m, is_assumed)


class Unobserved(Paces):
    """Paces of which none is observed."""

    def observe(self, frequencies_per_min: object) -> None:
        """Do nothing."""


def test_the_bar_counts_trials_and_observed_runs_of_all_frequencies_from_the_first_on() -> None:
    """Three frequencies, four trials and three observed runs each."""
    told: list[tuple[int, int]] = []
    options = replace(OPTIONS, trials=4, progress=lambda done, total: told.append((done, total)))
    progress = driving._told_as_one(options, 3).progress
    assert progress is not None
    for go in (12, 9, 1):
        for done in range(1, go + 1):
            progress(done, go)
    assert told[0] == (1, 21)
    assert told[20:] == [(21, 21), (22, 22)]
    assert driving._told_as_one(OPTIONS, 3) is OPTIONS
