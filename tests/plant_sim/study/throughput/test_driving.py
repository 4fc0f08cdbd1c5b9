"""Recommended driving speed from given trial results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.tags import ROWS, SIDES
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.machine.parameters import load_machine
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import RunOptions
from plant_sim.study.throughput import driving
from plant_sim.study.throughput.driving import Advice, FrequencyLimits, FrequencyResult, ThroughputResult, drive
from plant_sim.study.throughput.pace import CyclePaces
from plant_sim.study.throughput.study import _advice_parts
from plant_sim.twin.report import RowTimes, TrialReport, make_report

OPTIONS = RunOptions(trials=2, seed=3, workers=1, machine=load_machine(), io_map=load_io_map(DEFAULT_IO_MAP))
WAITS_S = {f"{side} row {row}": RowTimes(2, 16.0, 1.0 + row + 0.5 * (side == "left")) for side in SIDES for row in ROWS}
"""Waits for cups, s; the shortest is 2 s on the right with row 1."""


def trial(*, missed_cups: int = 0, reason: str = "") -> TrialReport:
    """Return the report of a trial without losses."""
    counts = SeedlingCounts(in_tray=0, in_claw=0, in_cups=36, P=0, D=0, T=0, total=36)
    made = make_report(seed=1, counts=counts, events=[], reason=reason, simulated_s=60.0, wall_s=0.0, air_l_min=40.0)
    return replace(made, missed_cups=missed_cups, cycle_times=WAITS_S)


def limits(without_gap: int | None) -> FrequencyLimits:
    return FrequencyLimits(without_gap=without_gap, settled=without_gap, by_row={}, searched_to=90)


def advised(
    monkeypatch: pytest.MonkeyPatch, limit: int | None, bad: dict[int, TrialReport], options: RunOptions = OPTIONS
) -> tuple[list[FrequencyResult], Advice | None]:
    """Return the tested frequencies and the recommendation for a limit; some frequencies have one bad trial."""

    def points(options: RunOptions, frequencies: Sequence[int]) -> list[FrequencyResult]:
        good = [trial()] * (options.trials - 1)
        return [FrequencyResult(each, FactorSetting({}), (*good, bad.get(each, trial()))) for each in frequencies]

    monkeypatch.setattr(driving, "_points", points)
    return driving._advice(options, limits(limit))


def test_the_air_per_seedling_is_that_of_each_trial_divided_by_its_seedlings() -> None:
    """40 L in a minute for 36 seedlings, planted or lost."""
    both = FrequencyResult(45, FactorSetting({}), (trial(), replace(trial(), simulated_s=30.0)))
    assert both.air_l_min == 40.0
    assert both.air_l_per_seedling == pytest.approx((40 / 36 + 20 / 36) / 2)


@pytest.mark.parametrize(
    ("limit", "bad", "highest"),
    [
        (55, {}, 55),
        (55, {55: trial(missed_cups=1)}, 54),
        (55, {55: trial(missed_cups=1), 54: trial(missed_cups=1)}, 53),
        (55, {55: trial(reason="jammed")}, 54),
        (55, {49: trial(missed_cups=1)}, 54),  # the frequency with the margin
        (55, {49: trial(reason="jammed")}, 54),
        (14, {}, 14),
        (13, {}, None),  # below the slowest frequency after the margin
        (None, {}, None),
    ],
)
def test_the_recommendation_has_no_bad_trial(
    monkeypatch: pytest.MonkeyPatch, limit: int | None, bad: dict[int, TrialReport], highest: int | None
) -> None:
    """After one gap or one incomplete trial the next lower frequency is tested."""
    _, advice = advised(monkeypatch, limit, bad)
    if highest is None:
        assert advice is None
    else:
        assert advice is not None
        assert (advice.highest.frequency_per_min, advice.with_margin.frequency_per_min) == (highest, int(0.9 * highest))


@pytest.mark.parametrize(("trials", "wanted"), [(1, driving.CONFIRMING_TRIALS), (2, 5), (7, 7)])
def test_the_recommendation_has_a_minimum_number_of_trials(
    monkeypatch: pytest.MonkeyPatch, trials: int, wanted: int
) -> None:
    """The recommendation is based on at least five trials, because each one can lower it."""
    tried, advice = advised(monkeypatch, 55, {55: trial(missed_cups=1)}, replace(OPTIONS, trials=trials))
    assert advice is not None
    assert [(each.frequency_per_min, len(each.trials), each.gaps) for each in tried] == [
        (55, wanted, 1),
        (54, wanted, 0),
    ]
    assert len(advice.with_margin.trials) == wanted


def result_with(advice: Advice | None, *, without_gap: int | None = 50, settled: int | None = 50) -> ThroughputResult:
    up_to = replace(limits(without_gap), settled=settled)
    return ThroughputResult(
        0.40, is_assumed=True, points=[], paces=CyclePaces(OPTIONS), limits=up_to, tried=[], advice=advice
    )


def advice_text(result: ThroughputResult) -> str:
    return str(_advice_parts(result)[1])


def test_the_recommendation_contains_speeds_margin_and_the_shortest_wait() -> None:
    """50 plants/min at a spacing of 0.4 m correspond to 1.2 km/h, or 1.08 km/h with a margin of 10 %."""
    fast, slow = (FrequencyResult(each, FactorSetting({}), (trial(), trial())) for each in (50, 45))
    text = advice_text(result_with(Advice(fast, slow)))
    assert text.startswith(
        "With 40 cm between plants (assumed), drive up to 1.20 km/h: 50 plants per minute per row, without a gap in "
        "2 trials of 36 seedlings. With a margin of 10 %: 1.08 km/h, 45 per minute; each arm then waits at least 2.0 s "
        "for its cups"
    )
    assert "beginning" not in text
    # 0 of 2: the Clopper-Pearson interval ends at 1 - 0.025 ** (1 / 2)
    assert "2 trials without a gap do not exclude gaps: they may still occur in up to 84 % of the starts" in text
    assert "highest frequency tested" not in text


def test_the_recommendation_reports_gaps_at_the_start_and_the_end_of_the_search() -> None:
    fast, slow = (FrequencyResult(each, FactorSetting({}), (trial(),)) for each in (90, 81))
    assert "90 plants per minute per row (the highest frequency tested), without a gap in 1 trial of 36" in advice_text(
        result_with(Advice(fast, slow), without_gap=90)
    )
    slower = FrequencyResult(50, FactorSetting({}), (trial(),))
    assert "Up to 1.44 km/h, 60 per minute, gaps occur only at the start" in advice_text(
        result_with(Advice(slower, slower), settled=60)
    )


def test_a_missing_recommendation_is_reported() -> None:
    assert advice_text(result_with(None)) == (
        "No speed can be recommended: no frequency down to 12/min, the lowest of this study, is free of gaps with a "
        "margin of 10 %."
    )


@pytest.mark.parametrize(("given", "spacing_m", "is_assumed"), [(None, 0.40, True), (0.40, 0.40, False)])
def test_a_missing_plant_spacing_is_marked_as_assumed(
    monkeypatch: pytest.MonkeyPatch, given: float | None, spacing_m: float, is_assumed: bool
) -> None:
    monkeypatch.setattr(driving, "_points", lambda *_: [])
    monkeypatch.setattr(driving, "CyclePaces", Unobserved)
    monkeypatch.setattr(driving, "_limits", lambda *_: limits(None))
    result = drive(OPTIONS, [20], given)
    assert (result.spacing_m, result.is_assumed) == (spacing_m, is_assumed)


class Unobserved(CyclePaces):
    """Paces without observed runs."""

    def observe(self, frequencies_per_min: object) -> None:
        """Do nothing."""


def test_progress_counts_trials_and_observed_runs_of_all_frequencies() -> None:
    """There are three frequencies with four trials and three observed runs each."""
    reported: list[tuple[int, int]] = []
    options = replace(OPTIONS, trials=4, progress=lambda done, total: reported.append((done, total)))
    progress = driving._with_overall_progress(options, 3).progress
    assert progress is not None
    for go in (12, 9, 1):
        for done in range(1, go + 1):
            progress(done, go)
    assert reported[0] == (1, 21)
    assert reported[20:] == [(21, 21), (22, 22)]
    assert driving._with_overall_progress(OPTIONS, 3) is OPTIONS
