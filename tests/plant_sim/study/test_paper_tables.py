"""Tables of the papers: printed values and corrections."""

from __future__ import annotations

import numpy as np
import pytest

from plant_sim.common.paper_sheet import equation, sheet
from plant_sim.crop.response import success_percent
from plant_sim.study.doe.design import central_composite, to_natural
from plant_sim.study.errors import StudyError
from plant_sim.study.paper_tables import (
    CABBAGE_FACTORS,
    PEPPER_FACTORS,
    Correction,
    cabbage_experiment,
    cabbage_settings,
    correct,
    corrections,
    pepper_experiment,
    pepper_optimum,
    printed_anova,
)


def test_the_plans_are_central_composite_designs_in_standard_order() -> None:
    assert np.array_equal(pepper_experiment().coded, central_composite(3, axial=1.525, centres=6))
    assert np.array_equal(cabbage_experiment("printed").coded, central_composite(3, axial=1.682, centres=9))


def numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]


def test_the_printed_responses() -> None:
    assert pepper_experiment().responses["S"].tolist() == numbers(
        "86.1 79.2 94.6 81.6 80.7 82.5 78.5 74.3 87.3 82.3 87.7 82.6 84.2 76.8 94.4 92.4 95.6 92.4 95.1 93.9"
    )
    printed = cabbage_experiment("printed").responses
    assert printed["Y1"].tolist() == numbers(
        "1.99 4.22 3.79 2.25 2.11 7.03 5.20 8.06 4.12 7.33 3.01 6.37 3.87 7.45 "
        "4.88 6.31 6.45 5.45 6.23 5.51 6.02 5.79 5.77"
    )
    assert printed["Y2"].tolist() == numbers(
        "3.17 3.05 3.23 3.12 4.22 4.07 5.77 5.63 4.25 4.02 2.14 6.33 2.26 5.74 "
        "3.86 4.13 4.22 3.91 3.75 4.22 4.55 4.01 3.59"
    )


def test_the_coding_gives_the_printed_levels() -> None:
    pepper = sheet("pepper-table-3")
    codes = pepper.numbers("code")[:, np.newaxis] * np.ones(3)
    printed = pepper.points("foam_mm", "age_d", "pressure_mpa")
    assert np.all(np.abs(to_natural(PEPPER_FACTORS, codes) - printed) <= [0.05, 0.5, 0.005])
    cabbage = sheet("cabbage-table-1")
    inner = slice(1, 4)
    codes = cabbage.numbers("code")[inner, np.newaxis] * np.ones(3)
    printed = cabbage.points("speed_km_h", "frequency_per_min", "force_n")[inner]
    assert to_natural(CABBAGE_FACTORS, codes) == pytest.approx(printed)
    assert max(cabbage.numbers("code")) == 1.628  # printed value, a known erratum


def test_equation_5_is_the_equation_of_the_seedling_model() -> None:
    coefficients = equation("pepper-equation-5", "S")
    assert len(coefficients) == 10
    assert coefficients["1"] == success_percent(12, 50, 0.45)
    at_one_step = coefficients["1"] + coefficients["X1"] + coefficients["X1^2"]
    assert at_one_step == pytest.approx(success_percent(15.6, 50, 0.45))


@pytest.mark.parametrize("name", ["pepper-table-5", "cabbage-table-3-y1", "cabbage-table-3-y2"])
def test_a_printed_analysis_of_variance_adds_up_to_its_rounding(name: str) -> None:
    rows = {row.source: row for row in printed_anova(name)}
    for whole, parts in (("total", ("model", "residual")), ("residual", ("lack of fit", "pure error"))):
        assert sum(rows[part].sum_of_squares for part in parts) == pytest.approx(rows[whole].sum_of_squares, abs=0.016)
        assert sum(rows[part].degrees for part in parts) == rows[whole].degrees
    assert rows["model"].p == "<0.0001"
    assert rows["total"].f is None


def test_the_optimum_settings_of_the_papers() -> None:
    assert pepper_optimum().natural == (10.0, 51.0, 0.40)
    assert pepper_optimum().responses == {"S": 95.0}
    predicted, bench, field = cabbage_settings()
    assert predicted.natural == bench.natural == field.natural == (1.6, 57.0, 91.83)
    assert [each.responses["Y1"] for each in (predicted, bench, field)] == [2.9, 3.13, 3.35]
    assert [each.responses["Y2"] for each in (predicted, bench, field)] == [2.83, 3.07, 3.14]
    assert sheet("pepper-verification").numbers("S").mean() == pytest.approx(94.58)


def test_the_single_factor_trials_change_one_factor_each() -> None:
    trials = sheet("pepper-single-factor")
    points = trials.points("foam_mm", "age_d", "pressure_mpa")
    for place, factor in enumerate(("foam", "age", "pressure")):
        own = points[np.array(trials.texts("factor")) == factor]
        assert len(np.unique(own[:, place])) == 7
        assert len(np.unique(np.delete(own, place, axis=1), axis=0)) == 1


def test_the_reconciled_data_differs_in_the_named_cells_only() -> None:
    printed, reconciled = cabbage_experiment("printed"), cabbage_experiment("reconciled")
    expected = {(4, "Y1"), (8, "Y1"), (12, "Y1"), (11, "Y2"), (22, "Y2"), (11, "X2"), (12, "X2")}
    assert {(each.run, each.column) for each in corrections()} == expected
    changed = {
        (int(run) + 1, name)
        for name in ("Y1", "Y2")
        for run in np.flatnonzero(printed.responses[name] != reconciled.responses[name])
    }
    changed |= {(int(run) + 1, f"X{factor + 1}") for run, factor in np.argwhere(printed.coded != reconciled.coded)}
    assert changed == expected
    assert reconciled.responses["Y1"][[3, 7, 11]].tolist() == [3.18, 8.53, 5.61]
    assert reconciled.responses["Y2"][[10, 21]].tolist() == [2.54, 4.20]
    assert to_natural(CABBAGE_FACTORS, reconciled.coded)[[10, 11], 1].tolist() == [56.0, 60.0]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (Correction(1, "Y1", 2.0, 3.0), "the table contains 1, not 2"),
        (Correction(3, "Y1", 2.0, 3.0), "the cell does not exist"),
        (Correction(1, "Y9", 1.0, 3.0), "the cell does not exist"),
    ],
)
def test_a_correction_that_does_not_match_the_printed_cell_is_rejected(change: Correction, says: str) -> None:
    columns = {"Y1": np.array([1.0, 2.0])}
    with pytest.raises(StudyError, match=says):
        correct(columns, np.array([1.0, 2.0]), [change])
    assert columns["Y1"].tolist() == [1.0, 2.0]


def test_an_unknown_data_set_is_rejected() -> None:
    with pytest.raises(StudyError, match="use printed or reconciled"):
        cabbage_experiment("improved")  # type: ignore[arg-type]
