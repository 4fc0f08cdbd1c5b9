"""Recommended driving speed from given trial results."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.common.document.parts import Table
from controller.iomap.loader import DEFAULT_IO_MAP, load_io_map
from controller.program.tags import ROWS, SIDES
from plant_sim.common.figure_data import drawn_marks
from plant_sim.crop.seedling import SeedlingCounts
from plant_sim.machine.parameters import load_machine
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import RunOptions
from plant_sim.study.throughput import driving
from plant_sim.study.throughput.driving import (
    LEAST_TRIALS,
    FrequencyLimits,
    FrequencyResult,
    ThroughputResult,
    drive,
    limits_of,
)
from plant_sim.study.throughput.figures import curves, scan_figure
from plant_sim.study.throughput.pace import CyclePace, CyclePaces, Observed
from plant_sim.study.throughput.scan import SERVED_PER_MIN, ConditionScan
from plant_sim.study.throughput.study import _advice_parts, _limit_parts
from plant_sim.study.throughput.timeline import Timeline
from plant_sim.twin.report import RowTimes, TrialReport, make_report

OPTIONS = RunOptions(trials=2, seed=3, workers=1, machine=load_machine(), io_map=load_io_map(DEFAULT_IO_MAP))
WAITS_S = {f"{side} row {row}": RowTimes(2, 16.0, 1.0 + row + 0.5 * (side == "left")) for side in SIDES for row in ROWS}
"""Waits for cups, s; the shortest is 2 s on the right with row 1."""


def trial(*, missed_cups: int = 0, reason: str = "") -> TrialReport:
    """Return the report of a trial without losses."""
    counts = SeedlingCounts(in_tray=0, in_claw=0, in_cups=36, P=0, D=0, T=0, total=36)
    made = make_report(seed=1, counts=counts, events=[], reason=reason, simulated_s=60.0, wall_s=0.0, air_l_min=40.0)
    return replace(made, missed_cups=missed_cups, cycle_times=WAITS_S)


EMPTY: Final = Timeline({}, {}, {}, {}, {}, dict.fromkeys(SIDES, ()))
"""Timeline of a run without throws."""
FREE: Final = (*range(20, 51), 53, 54, 60)
"""Frequencies at which the simulated trials have no gap; the condition fails at 51 and is met again above."""


class FakeRuns:
    """Trials that have a gap at every frequency outside a set, in place of the twin.

    Attributes:
        asked: Number of trials, and indices for the seeds, of every call.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, free: Collection[int]) -> None:
        """Replace the trials and the observed runs; there are no gains."""
        self.asked: list[tuple[int, tuple[int, ...]]] = []

        def run(options: RunOptions, settings: Sequence[tuple[int, FactorSetting]]) -> list[list[TrialReport]]:
            return self.reports(options.trials, settings)

        monkeypatch.setattr(RunOptions, "run_indexed", run)
        monkeypatch.setattr(CyclePaces, "observe", observed)
        monkeypatch.setattr(driving, "motion_gains", lambda *_: [])
        self._free = free

    def reports(self, trials: int, settings: Sequence[tuple[int, FactorSetting]]) -> list[list[TrialReport]]:
        """Return the reports of the trials; one of them has a gap outside the set."""
        self.asked.append((trials, tuple(index for index, _ in settings)))
        frequencies = [each.values["cups.planting_frequency_per_min"] for _, each in settings]
        return [[*[trial()] * (trials - 1), trial(missed_cups=int(each not in self._free))] for each in frequencies]


def observed(paces: CyclePaces, frequencies_per_min: Sequence[int]) -> None:
    """Observe runs without rounds."""
    paces._paces.update({each: CyclePace(each, ()) for each in frequencies_per_min})


@pytest.fixture
def settled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Observed runs miss no cup and every row has a margin."""
    monkeypatch.setattr(CyclePace, "settled_missed_cups", property(lambda _: 0.0))
    monkeypatch.setattr(CyclePace, "least_margin_s", lambda *_: 1.0)


def test_the_air_per_seedling_is_that_of_each_trial_divided_by_its_seedlings() -> None:
    """40 L in a minute for 36 seedlings, planted or lost."""
    both = FrequencyResult(45, FactorSetting({}), (trial(), replace(trial(), simulated_s=30.0)))
    assert both.air_l_min == 40.0
    assert both.air_l_per_seedling == pytest.approx((40 / 36 + 20 / 36) / 2)


STARTS: Final = ((20,), (45, 50), (51,), (52, 53), (60, 90), tuple(range(20, 91, 10)))
"""Frequencies given by the user: at the lowest, below the limit, at a gap, above the limit, and the default."""


@pytest.mark.usefixtures("settled")
@pytest.mark.parametrize("frequencies", STARTS)
def test_the_answer_does_not_depend_on_the_given_frequencies(
    monkeypatch: pytest.MonkeyPatch, frequencies: tuple[int, ...]
) -> None:
    """The condition fails at 51, so 50 is the limit, although no gap occurs at 53, 54 and 60."""
    runs = FakeRuns(monkeypatch, FREE)
    result = drive(OPTIONS, frequencies, 0.4)
    assert runs.asked == [(LEAST_TRIALS, tuple(SERVED_PER_MIN))]
    assert result.limits.without_gap.limit == 50
    assert result.limits.without_gap.first_failure == 51
    assert result.limits.without_gap.met_again == (53, 54, 60)
    assert result.advice is not None
    assert (result.advice.highest.frequency_per_min, result.advice.with_margin.frequency_per_min) == (50, 45)
    assert tuple(each.frequency_per_min for each in result.points) == frequencies
    assert advice_text(result).startswith("With 40 cm between plants, drive up to 1.20 km/h: 50 plants per minute")
    limits = next(part for part in _limit_parts(result, 3) if isinstance(part, Table))
    assert limits.rows[0][1:] == (50, 14.4, 51, "53 to 54, 60")


@pytest.mark.usefixtures("settled")
@pytest.mark.parametrize(
    ("free", "highest"),
    [
        (range(20, 91), 90),
        (range(20, 24), 23),  # 20 with the margin
        (range(20, 23), None),  # below the frequencies of the program with the margin
        (range(21, 91), None),
        ((), None),
    ],
)
def test_the_recommendation_is_within_the_frequencies_of_the_program(
    monkeypatch: pytest.MonkeyPatch, free: Collection[int], highest: int | None
) -> None:
    FakeRuns(monkeypatch, free)
    advice = drive(OPTIONS, [45], None).advice
    assert (advice and advice.highest.frequency_per_min) == highest


def test_a_trial_that_does_not_complete_is_a_failure() -> None:
    results = {
        each: FrequencyResult(each, FactorSetting({}), (trial(), trial(reason="jammed" if each == 46 else "")))
        for each in (45, 46, 47)
    }
    scan = limits_of(results, {}).without_gap
    assert (scan.limit, scan.met_again) == (45, (47,))


@given(st.lists(st.booleans(), min_size=1, max_size=30))
def test_the_limit_of_any_scan_is_below_its_first_failure(met: list[bool]) -> None:
    """Below the first failure the condition is met throughout; every other frequency at which it is met is listed."""
    scan = ConditionScan("any", dict(enumerate(met, 20)))
    below = met.index(False) if False in met else len(met)
    assert scan.limit == (19 + below if below else None)
    assert scan.first_failure == (20 + below if below < len(met) else None)
    assert set(scan.met_again) == {20 + index for index, each in enumerate(met) if each and index > below}


def result_with(without_gap: int, settled: int) -> ThroughputResult:
    """Return a result with limits of two conditions, and two trials at each frequency."""

    def scan(limit: int) -> ConditionScan:
        return ConditionScan("", {each: each <= limit for each in SERVED_PER_MIN})

    results = {each: FrequencyResult(each, FactorSetting({}), (trial(), trial())) for each in SERVED_PER_MIN}
    limits = FrequencyLimits(scan(without_gap), scan(settled), {})
    return ThroughputResult(0.40, True, (45,), results, {}, limits, [])


def advice_text(result: ThroughputResult) -> str:
    return str(_advice_parts(result)[1])


def test_the_recommendation_contains_speeds_margin_and_the_shortest_wait() -> None:
    """50 plants/min at a spacing of 0.4 m correspond to 1.2 km/h, or 1.08 km/h with a margin of 10 %."""
    text = advice_text(result_with(50, 50))
    assert text.startswith(
        "With 40 cm between plants (assumed), drive up to 1.20 km/h: 50 plants per minute per row. At every frequency "
        "from 20/min to this one, 2 trials of 36 seedlings had no gap; the first gap occurs at 51/min. With a margin "
        "of 10 %: 1.08 km/h, 45 per minute; each arm then waits at least 2.0 s for its cups"
    )
    assert "start of the observed runs" not in text
    # 0 of 2: the Clopper-Pearson interval ends at 1 - 0.025 ** (1 / 2)
    assert "2 trials without a gap do not exclude gaps: they may still occur in up to 84 % of the starts" in text


def test_the_recommendation_reports_gaps_at_the_start_and_the_end_of_the_scan() -> None:
    assert "had no gap; 90/min is the highest frequency that the program serves." in advice_text(result_with(90, 90))
    assert "Up to 1.44 km/h, 60 per minute, gaps occur only at the start" in advice_text(result_with(50, 60))


def test_a_missing_recommendation_is_reported() -> None:
    assert advice_text(result_with(21, 21)) == (
        "No speed can be recommended: the first gap occurs at 22/min, and the program serves no frequency below "
        "20/min, with a margin of 10 %."
    )


@pytest.mark.usefixtures("settled")
@pytest.mark.parametrize(("stated_m", "spacing_m", "is_assumed"), [(None, 0.40, True), (0.40, 0.40, False)])
def test_a_missing_plant_spacing_is_marked_as_assumed(
    monkeypatch: pytest.MonkeyPatch, stated_m: float | None, spacing_m: float, is_assumed: bool
) -> None:
    FakeRuns(monkeypatch, FREE)
    result = drive(OPTIONS, [20], stated_m)
    assert (result.spacing_m, result.is_assumed) == (spacing_m, is_assumed)


def test_progress_counts_the_trials_and_the_observed_runs() -> None:
    """71 frequencies with five trials and an observed run each; the gains change nine motions twice."""
    reported: list[tuple[int, int]] = []
    options = replace(OPTIONS, trials=5, progress=lambda done, total: reported.append((done, total)))
    progress = driving._with_overall_progress(options).progress
    assert progress is not None
    planned = 71 * 6 + 18 * (2 + 5 * 6)
    for done, total in ((20, 355), (40, 355), (355, 355), (1, 71), (71, 71), (20, 2000)):
        progress(done, total)
    assert reported == [
        (20, planned),
        (40, planned),
        (355, planned),
        (356, planned),
        (426, planned),
        (446, 2426),  # more than planned
    ]
    assert driving._with_overall_progress(OPTIONS) is OPTIONS


def test_the_figures_show_the_intervals_of_the_trials() -> None:
    """Gaps in 1 and 0 of 2 trials: Clopper-Pearson. Air of 40 and 42 L/min: Student's t, one degree of freedom."""
    results = {
        45: FrequencyResult(45, FactorSetting({}), (trial(), replace(trial(missed_cups=2), air_l_min=42.0))),
        46: FrequencyResult(46, FactorSetting({}), (trial(), trial())),
    }
    shown = replace(result_with(45, 45), results=results, limits=limits_of(results, {}))
    figure = scan_figure(shown)
    limit = shown.limits.without_gap.limit
    assert [text.get_text() for text in figure.axes[0].texts] == ([] if limit is None else [f"limit {limit}/min"])
    scan = [each for each in drawn_marks(figure) if each.kind == "points"]
    assert [(each.x, each.y) for each in scan] == [(45, 50), (46, 0)]
    assert [(each.y_low, each.y_high) for each in scan] == [
        pytest.approx((1.258, 98.742), abs=1e-3),
        pytest.approx((0.0, 84.189), abs=1e-3),
    ]
    paces = {each: CyclePace(each, (Observed(FactorSetting({}), 1, EMPTY, (), ""),)) for each in results}
    marks = drawn_marks(curves(list(results.values()), paces, is_binomial=True))
    air = [each for each in marks if each.y_axis.startswith("air consumption")]
    assert [(each.y, each.y_low, each.y_high) for each in air] == [
        pytest.approx((41.0, 41.0 - 12.7062, 41.0 + 12.7062), abs=1e-3),
        (40.0, None, None),
    ]
