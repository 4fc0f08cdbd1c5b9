"""Gains of changed motions from given trials: frequencies that are scanned, interval of the gain, and the report."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import pytest
from scipy import stats

from controller.common.document.parts import Table
from plant_sim.study.factors import FactorSetting
from plant_sim.study.runner import RunOptions
from plant_sim.study.throughput.gains import MOTIONS, ROUNDING_PER_MIN, MotionGain, _scanned
from plant_sim.study.throughput.pace import FREQUENCY
from plant_sim.study.throughput.scan import SERVED_PER_MIN, ConditionScan
from plant_sim.study.throughput.study import _gain_parts
from plant_sim.twin.report import TrialReport
from tests.plant_sim.study.throughput.test_driving import OPTIONS, result_with, trial

SLIDE = MOTIONS[0]
LAST_FREE = (50, 52)
"""Highest frequency without a gap in each of two trials of the unchanged machine, 1/min."""
FREE = {each: tuple(each <= last for last in LAST_FREE) for each in SERVED_PER_MIN}


def gain_of(differences_per_min: tuple[int, ...], *, changed_s: float = 0.9) -> MotionGain:
    """Return the gain of the slide with given differences of the trials."""
    return MotionGain(SLIDE, 1.0, changed_s, 2.0, 0.1, ConditionScan("", {50: True, 51: False}), differences_per_min)


@pytest.mark.parametrize(
    ("shift_per_min", "scanned"),
    [
        (0, range(50, 54)),  # some trials have a gap at 51 and 52
        (3, range(50, 57)),  # up to the first frequency at which no trial is free
        (-4, range(46, 54)),  # down to the first one at which all are
        (100, range(50, 91)),
        (-100, range(20, 54)),
    ],
)
def test_the_scan_goes_on_until_it_is_decided_on_both_sides(
    monkeypatch: pytest.MonkeyPatch, shift_per_min: int, scanned: range
) -> None:
    asked: list[int] = []

    def run(_: RunOptions, settings: Sequence[tuple[int, FactorSetting]]) -> list[list[TrialReport]]:
        asked.extend(index for index, _ in settings)
        assert all(setting.values[FREQUENCY] == index for index, setting in settings)
        assert all(setting.values[SLIDE.parameter] == 2.0 for _, setting in settings)
        return [[trial(missed_cups=int(index > last + shift_per_min)) for last in LAST_FREE] for index, _ in settings]

    monkeypatch.setattr(RunOptions, "run_indexed", run)
    (own,) = _scanned(replace(OPTIONS, trials=2), [(SLIDE, 2.0)], LAST_FREE[0], FREE)
    assert list(own) == list(scanned) == sorted(asked)
    assert own[50] == tuple(last + shift_per_min >= 50 for last in LAST_FREE)


def test_the_interval_of_a_gain_is_students_t_between_the_trials() -> None:
    gain = gain_of((3, 1, 2, 2, 4))
    described = stats.t.interval(0.95, 4, 2.4, stats.sem((3, 1, 2, 2, 4)))
    assert gain.gain_per_min == 2.4
    assert gain.interval_per_min == pytest.approx(described)
    assert gain.is_shown


@pytest.mark.parametrize(("difference", "is_shown"), [(0, False), (1, True), (-1, True)])
def test_equal_differences_are_known_to_a_step_of_the_frequencies_only(difference: int, is_shown: bool) -> None:
    gain = gain_of((difference,) * 5)
    low, high = gain.interval_per_min
    assert high - difference == difference - low == pytest.approx(2.7764 * ROUNDING_PER_MIN / math.sqrt(5), rel=1e-4)
    assert gain.is_shown is is_shown


def test_the_report_names_the_gains_that_are_shown_and_those_that_are_not() -> None:
    """A second at 50/min is worth 50 / 14.4 plants per minute."""
    settle = replace(gain_of((1, 0, 0, 0, 0)), motion=MOTIONS[5])
    gains = [gain_of((2,) * 5), gain_of((-2,) * 5, changed_s=1.1), settle, replace(settle, changed_s=1.1)]
    _, text, table = _gain_parts(replace(result_with(50, 50), gains=gains))
    assert "worth 3.5 plants per minute" in str(text)
    assert str(text).endswith(
        "Shorter by 10 %, these give plants per minute: slide in and out +2.0. Not shown for: settle at row."
    )
    assert isinstance(table, Table)
    assert [row[-4:] for row in table.rows[:3]] == [
        ("+2.0", "+1.6", "+2.4", "yes"),
        ("-2.0", "-2.4", "-1.6", "yes"),
        ("+0.2", "-0.4", "+0.8", "no: the interval includes 0"),
    ]
    _, text, _ = _gain_parts(replace(result_with(50, 50), gains=[settle]))
    assert str(text).endswith("is shown to give a plant per minute; a larger --trials may.")
