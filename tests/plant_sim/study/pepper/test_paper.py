"""Analysis of the pepper paper's data: equation, table, optimum, and reported discrepancies."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from controller.common.document.parts import Table
from plant_sim.common.paper_sheet import equation, sheet
from plant_sim.common.polynomial import Polynomial
from plant_sim.study.doe.design import central_composite, to_coded, to_natural
from plant_sim.study.doe.optimum import best
from plant_sim.study.doe.regression import Fit, fit, terms
from plant_sim.study.paper_tables import PEPPER_FACTORS, printed_anova
from plant_sim.study.pepper.paper import (
    HIGH,
    LOW,
    binomial_sd_percent,
    coefficients,
    equation_5,
    paper_study,
    pure_error_slack,
    refit,
    trial_shares,
)
from plant_sim.study.report import study as report
from plant_sim.study.report.fit_parts import anova_table, coefficient_table, optimum_table, p_text
from plant_sim.study.report.study import Study
from plant_sim.study.report.surface import _grid
from tests.plant_sim.study.figures import figures_of


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return refit()


@pytest.fixture(scope="module")
def study() -> Study:
    return paper_study()


def table(study: Study, name: str) -> Table:
    return next(part for part in study.parts if isinstance(part, Table) and part.name == name)


def test_the_refit_reproduces_equation_5(fitted: Fit) -> None:
    printed = equation("pepper-equation-5", "S")
    assert set(fitted.coefficients) == set(printed)
    assert fitted.values == pytest.approx(printed, abs=0.02)
    assert fitted.r2 == pytest.approx(0.965, abs=5e-4)


def test_the_refit_reproduces_table_5_within_its_rounding(fitted: Fit) -> None:
    for row in printed_anova("pepper-table-5"):
        found = fitted.row(row.source)
        assert found.degrees == row.degrees
        assert found.sum_of_squares == pytest.approx(row.sum_of_squares, abs=0.4 if row.source[0] == "X" else 1.1)
        assert (found.f is None) == (row.f is None)
        if row.f is not None:
            assert found.f == pytest.approx(row.f, rel=0.05)


def test_the_lack_of_fit_differs_within_the_rounding_of_the_data(fitted: Fit) -> None:
    printed = {row.source: row for row in printed_anova("pepper-table-5")}
    assert fitted.row("lack of fit").p == pytest.approx(0.18, abs=0.005)
    assert float(printed["lack of fit"].p) == 0.1905
    gap = abs(fitted.row("pure error").sum_of_squares - printed["pure error"].sum_of_squares)
    assert 0.3 < gap < pure_error_slack(fitted) < 0.7


def test_the_rounding_tolerance_is_that_of_the_worst_rounding(fitted: Fit) -> None:
    centre = fitted.response[-6:]
    stretched = centre + 0.05 * np.sign(centre - centre.mean())
    gain = 5 * (stretched.var(ddof=1) - centre.var(ddof=1))
    assert pure_error_slack(fitted) == pytest.approx(gain, abs=0.02)


def test_the_optimum(fitted: Fit) -> None:
    point, value = best(fitted, LOW, HIGH)
    foam_mm, age_d, pressure_mpa = to_natural(PEPPER_FACTORS, point)
    assert foam_mm == pytest.approx(10.1, abs=0.05)
    assert age_d == pytest.approx(51.0, abs=0.05)
    assert pressure_mpa == pytest.approx(0.394, abs=5e-4)
    assert value == pytest.approx(94.95, abs=0.005)
    rounded = to_coded(PEPPER_FACTORS, np.array([10.0, 51.0, 0.40]))
    assert float(equation_5().predict(rounded)[0]) == pytest.approx(94.93, abs=0.005)


def test_random_scatter_of_one_trial() -> None:
    assert binomial_sd_percent(94.6) == pytest.approx(1.88, abs=0.005)
    assert binomial_sd_percent(94.6, 4 * 144) == pytest.approx(1.88 / 2, abs=0.005)


def test_shares_of_integer_seedling_counts_are_recognised() -> None:
    whole = np.round(100 * np.arange(120, 145) / 144, 1)
    assert trial_shares(whole) == len(whole)
    assert trial_shares(np.array([94.6, 94.1])) == 0  # 136 of 144 are 94.4 %, 135 are 93.8 %
    assert trial_shares(sheet("pepper-table-4").numbers("S")) == 9
    assert trial_shares(sheet("pepper-verification").numbers("S")) == 0


def test_the_report_is_complete(study: Study) -> None:
    text = study.text()
    for said in ("R² = 0.9650", "P = 0.1792 here, 0.1905 printed", "95.0 % for it; equation 5 gives 94.93 %"):
        assert said in text
    assert "The mean is 94.58 %" in text
    assert "has a binomial standard deviation of 1.9 percentage points" in text
    assert "only 9 of the 20 printed success rates correspond to a whole number of seedlings: the others cannot" in text
    assert "and 5 of the 5 values do not correspond to a whole number of seedlings: they cannot be single" in text
    assert "in 22 of 100 cases (t-test), so the prediction is not contradicted." in text
    assert "must be means" not in text
    assert [row[0] for row in table(study, "anova").rows][-3:] == ["lack of fit", "pure error", "total"]
    assert len(table(study, "runs").rows) == 20
    assert table(study, "verification").shown()[-1] == ("mean", "94.58")
    assert study.command == "python -m plant_sim study pepper-rsm --data paper"


def test_the_record_contains_the_figures(study: Study) -> None:
    record = json.loads(study.json())
    assert record["refit"]["r2"] == pytest.approx(0.965, abs=5e-4)
    assert record["optimum"]["S"] == pytest.approx(94.95, abs=0.005)
    assert record["optimum"]["prediction_interval_95"][0] < 94.95 < record["optimum"]["prediction_interval_95"][1]
    assert record["paper_optimum"]["S_by_equation_5"] == pytest.approx(94.93, abs=0.005)
    assert record["verification"]["mean"] == pytest.approx(94.58)
    assert record["verification"]["mean_p"] == pytest.approx(0.224, abs=5e-4)
    assert record["paper"]["anova"]["lack of fit"]["p"] == "0.1905"


def test_the_plots_show_all_pairs_and_mark_the_optimum(study: Study) -> None:
    residuals, over, weighted, runs = figures_of(study).values()
    assert len(weighted.axes) == len(over.axes)
    assert [axes.get_ylabel() for axes in residuals.axes] == ["studentized residual"] * 2
    *panels, _ = over.axes
    pairs = [(axes.get_xlabel().split(",")[0], axes.get_ylabel().split(",")[0]) for axes in panels]
    names = [factor.name for factor in PEPPER_FACTORS]
    assert pairs == [(names[0], names[1]), (names[0], names[2]), (names[1], names[2])]
    marked = {line.get_label(): line for line in panels[0].lines}
    place = np.asarray(marked["best of the refit"].get_xydata())[0]
    assert place == pytest.approx([10.12, 51.03], abs=0.01)
    assert "0.3938 MPa" in panels[0].get_title()
    points = np.asarray(runs.axes[0].lines[1].get_xydata())
    assert points[:, 1].tolist() == sheet("pepper-table-4").numbers("S").tolist()


def test_a_panel_shows_the_response_over_its_pair_of_factors() -> None:
    """The response is S = X1 + 10 X2 + 100 X3; the panel shows X1 and X3, with X2 held at 0.5."""
    surface = Polynomial({"X1": 1.0, "X2": 10.0, "X3": 100.0})
    x, y, values = _grid(surface, (0, 2), (9.0, 0.5, 9.0), (1.0, 2.0, 3.0))
    assert (x.max(), y.max()) == (1.0, 3.0)
    assert values == pytest.approx(x + 5.0 + 100.0 * y)


@pytest.mark.nightly
def test_equal_studies_write_identical_files(study: Study, tmp_path: Path) -> None:
    first = report.write(study, tmp_path / "first")
    second = report.write(paper_study(), tmp_path / "second")
    assert [path.name for path in first] == [path.name for path in second]
    assert {path.suffix for path in first} == {".md", ".html", ".json", ".csv", ".png", ".svg"}
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_a_third_column_is_added_to_paper_and_refit(fitted: Fit) -> None:
    """The column contains a fit of other data, for example those of the twin."""
    columns = {"paper": equation_5().coefficients, "refit": fitted.values, "twin": {"1": 93.0, "X1": -2.0}}
    shown = coefficients(columns, fitted)
    assert shown.heading == ("term", "paper", "refit", "twin", "standard error", "P")
    assert shown.shown()[0][:4] == ("constant", "93.760", "93.764", "93.000")
    assert shown.shown()[2][3] == "-"


def test_missing_rows_of_a_fit_without_repeats_are_empty(fitted: Fit) -> None:
    design = central_composite(3, axial=1.5, centres=1)
    other = fit(design, fitted.predict(design) + np.sin(np.arange(15.0)), terms(3, "quadratic"))
    rows = {row[0]: row for row in anova_table("anova", "", {"paper": fitted.anova, "twin": other.anova}).rows}
    assert rows["lack of fit"][5:] == (None, None, None, None)
    assert rows["total"][5:7] == (other.row("total").sum_of_squares, 14)
    assert coefficient_table("c", "", {"refit": {"1": 1.0}}).rows == (("constant", 1.0),)


def test_a_setting_is_shown_in_natural_units() -> None:
    shown = optimum_table(
        "best",
        "",
        PEPPER_FACTORS,
        response="S, %",
        points={"one step": np.ones(3)},
        surfaces={"equation 5": equation_5(), "flat": Polynomial({"1": 90.0})},
    )
    assert shown.shown() == [("one step", "15.6", "55", "0.58", "73.82", "90.00")]


def test_p_is_formatted_as_in_the_papers() -> None:
    assert [p_text(p) for p in (None, 0.00009, 0.0001, 0.19054)] == [None, "<0.0001", "0.0001", "0.1905"]
