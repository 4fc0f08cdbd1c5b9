"""Analysis of tables of trials: roles, blocks, whole plots, counts and the range analysis."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from statsmodels.regression.linear_model import OLS

from plant_sim.cli.main import main
from plant_sim.study.analyse.model import TrialModel, fit_model
from plant_sim.study.analyse.ranges import range_by_chance, ranges
from plant_sim.study.analyse.roles import RoleOptions, Trials, assign
from plant_sim.study.analyse.study import analyse_study
from plant_sim.study.analyse.table import read_table
from plant_sim.study.doe.design import full_factorial
from plant_sim.study.doe.standard_designs import box_behnken, orthogonal_array
from plant_sim.study.doe.weighted import WeightedFit
from plant_sim.study.errors import StudyError
from tests.paths import DOCS

EXAMPLE = DOCS / "examples/made-up-trials.csv"


def table(folder: Path, heading: Sequence[str], rows: NDArray[Any] | Sequence[Sequence[object]]) -> Path:
    """Write a table and return its path."""
    path = folder / "t.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([heading, *(list(row) for row in rows)])
    return path


def trials_of(path: Path, **roles: Any) -> Trials:
    """Return the trials of a file."""
    return assign(read_table(path), RoleOptions(**roles))


def model_of(path: Path, **roles: Any) -> TrialModel:
    """Return the model of a file."""
    model = fit_model(trials_of(path, **roles), None, "identity")
    assert isinstance(model, TrialModel)
    return model


def split_plot(seed: int, *, whole_sd: float, effect: float = 0.0) -> NDArray[np.float64]:
    """Return lines of batch, age, foam and response: eight batches of one age, each with four trials."""
    rng = np.random.default_rng(seed)
    rows = []
    for batch in range(8):
        age, error = (45, 55)[batch % 2], rng.normal(0, whole_sd)
        for foam in (8, 8, 16, 16):
            rows.append((batch, age, foam, 90 + effect * (age == 55) + error + rng.normal()))
    return np.array(rows)


HEADING = ("batch", "age (d)", "foam (mm)", "S (%)")


def test_the_example_is_analysed_as_counts_with_blocks(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "analyse", str(EXAMPLE), "--json", "--counts", "lost", "--total", "144"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["dispersion"]["degrees"] == 30 - 13 - 1  # 13 points and one more block
    assert record["model"]["order"] == "quadratic"
    assert record["roles"] == (
        "Roles of the columns, guessed from their headings (change them with --counts, --total, --response, --factors, "
        "--categorical, --blocks, --whole-plots): response: lost of 144; factors: foam thickness, seedling age, claw "
        "pressure; blocks: date; not used: order, total."
    )
    assert main(["study", "analyse", str(EXAMPLE), "--link", "identity"]) == 0
    assert "without an effect: 4 to 6 %, for 144 to 7,200 seedlings" in capsys.readouterr().out
    assert record["command"].endswith(f"analyse {EXAMPLE} --counts lost --total 144")
    assert record["optimum"]["low"][2] <= record["optimum"]["natural"][2] <= record["optimum"]["high"][2]


def test_blocks_are_removed_from_effects_error_and_optimum(tmp_path: Path) -> None:
    """An independent least squares fit with a dummy of the block gives the same coefficients, errors and tests."""
    points = np.vstack([box_behnken(3, centres=3)] * 2)
    day = np.repeat([0, 1], 15)
    rng = np.random.default_rng(3)
    response = 80 + 3 * points[:, 0] - 4 * points[:, 1] ** 2 + 7 * day + rng.normal(size=30)
    path = table(
        tmp_path,
        ("a", "b", "c", "date", "y"),
        [(*x, f"D{d}", y) for x, d, y in zip(points, day, response, strict=True)],
    )
    model = model_of(path)
    x1, x2, x3 = points.T
    matrix = np.column_stack([np.ones(30), x1, x2, x3, x1 * x2, x1 * x3, x2 * x3, x1**2, x2**2, x3**2, day])
    independent = OLS(response, matrix).fit()
    found = [model.fit.coefficients[term] for term in model.terms]
    assert [each.value for each in found] == pytest.approx(independent.params[1:10])
    assert [each.p for each in found] == pytest.approx(independent.pvalues[1:10])
    both = independent.f_test(np.eye(11)[1:10])
    row = model.strata[0].rows()[0]
    assert (row.source, row.degrees) == ("factors", 9)
    assert (row.f, row.p) == pytest.approx((float(both.fvalue), float(both.pvalue)))
    pure = OLS(response, np.column_stack([np.eye(13)[np.unique(points, axis=0, return_inverse=True)[1]], day])).fit()
    rows = {each.source: each for each in model.strata[0].rows()}
    assert (rows["pure error"].sum_of_squares, rows["pure error"].degrees) == pytest.approx((pure.ssr, 16))
    assert rows["lack of fit"].degrees == 3
    assert float(model.predict(np.zeros(3))[0]) == pytest.approx(independent.params[0] + independent.params[10] / 2)


def test_counts_with_blocks_use_the_scatter_within_blocks(tmp_path: Path) -> None:
    """A shift of all losses of one day goes into the blocks, not into the dispersion."""
    rng = np.random.default_rng(5)
    points = np.vstack([box_behnken(3, centres=3)] * 2)
    share = 0.08 + 0.02 * points[:, 0]
    rows = {}
    for name, shift in (("calm", 0.0), ("shifted", 0.25)):
        lost = rng.binomial(400, share + np.repeat([0.0, shift], 15))
        path = table(tmp_path, ("a", "b", "c", "date", "lost", "total"), [
            (*x, f"D{n // 15}", count, 400) for n, (x, count) in enumerate(zip(points, lost, strict=True))
        ])  # fmt: skip
        fitted = model_of(path).fit
        assert isinstance(fitted, WeightedFit)
        assert fitted.dispersion.degrees == 16
        rows[name] = fitted.dispersion.estimate
    low, high = stats.chi2.ppf((0.001, 0.999), 16) / 16  # binomial counts: a dispersion of 1
    assert all(each is not None and low < each < high for each in rows.values()), rows


def test_whole_plots_have_their_own_error(tmp_path: Path) -> None:
    """Without any effect of age, the test by trials rejects far too often; that between whole plots does not."""
    rejected = np.zeros(2)
    for seed in range(60):
        path = table(tmp_path, HEADING, split_plot(seed, whole_sd=2.0))
        by_trial = model_of(path, response="S", factors=("age", "foam"), blocks=())
        p_trial = by_trial.fit.coefficients["X1"].p
        by_plot = model_of(path, response="S", factors=("age", "foam"), whole_plots="batch")
        p_plot = next(each.coefficient("X1") for each in by_plot.strata if "X1" in each.terms)
        assert p_trial is not None
        assert p_plot is not None
        assert p_plot.p is not None
        rejected += (p_trial < 0.05, p_plot.p < 0.05)
    assert rejected[0] > 9 >= rejected[1], rejected  # binomial(60, 0.05) exceeds 9 with a probability of 0.1 %


def test_the_strata_are_those_of_means_and_of_deviations(tmp_path: Path) -> None:
    """Between: t test of the batch means. Within: foam, after the mean of each batch is removed."""
    rows = split_plot(1, whole_sd=1.0, effect=3.0)
    model = model_of(table(tmp_path, HEADING, rows), response="S", factors=("age", "foam"), whole_plots="batch")
    means = rows[:, 3].reshape(8, 4).mean(axis=1)
    expected = stats.ttest_ind(means[1::2], means[::2])
    within, between = model.strata
    assert (within.name, between.name) == ("within whole plots", "between whole plots")
    assert between.terms == ("X1",)
    age = between.coefficient("X1")
    assert age is not None
    assert (age.t, age.p) == pytest.approx((expected.statistic, expected.pvalue))
    deviations = rows[:, 3] - means.repeat(4)
    foam = within.coefficient("X2")
    assert foam is not None
    assert foam.value == pytest.approx((deviations * np.where(rows[:, 2] == 16, 1, -1)).mean())


def test_factors_hard_to_change_are_warned_of_in_the_first_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path, HEADING, split_plot(1, whole_sd=1.0))
    assert "whole plots: batch" in analyse_study(read_table(path), RoleOptions(response="S"), "").text()
    with pytest.raises(StudyError, match=r"--blocks batch: age stays the same within every block.*--whole-plots batch"):
        trials_of(path, response="S", blocks=("batch",))
    named = ("--response", "S", "--factors", "age,foam")
    assert main(["study", "analyse", str(path), *named, "--hard", "age"]) == 0
    first = capsys.readouterr().out.splitlines()[3]
    assert first.startswith("P values of age are too small: ")
    assert main(["study", "analyse", str(path), *named, "--hard", "pressure"]) == 2
    assert capsys.readouterr().err.startswith("--hard pressure: is not a column")
    assert main(["study", "analyse", str(path), *named, "--whole-plots", "batch"]) == 0
    assert "too small" not in capsys.readouterr().out


def test_counts_without_repeated_trials_have_no_p_values(tmp_path: Path) -> None:
    points = box_behnken(3, centres=1)
    rows = [(*x, 10 + n, 144) for n, x in enumerate(points)]
    study = analyse_study(read_table(table(tmp_path, ("a", "b", "c", "lost", "total"), rows)), RoleOptions(), "")
    text = study.text()
    assert text.splitlines()[3].startswith("No trials are repeated at one point, or the repeated ones do not differ")
    assert "lower bound of the 95 % interval" in text
    assert "tested one by one" not in text
    coefficients = json.loads(study.json())["model"]["strata"]["trials"]
    assert all(row["p"] is None for row in coefficients)


def test_a_lack_of_fit_is_told_first(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    points = np.vstack([box_behnken(3, centres=3)] * 2)
    rows = [(*x, 50 + 5 * x[0] + 40 * x[0] ** 2 + rng.normal()) for x in points]
    path = table(tmp_path, ("a", "b", "c", "y"), rows)
    study = analyse_study(read_table(path), RoleOptions(), "", order="linear")
    assert "The model does not fit (lack of fit P <0.0001)" in "\n".join(study.text().splitlines()[3:8])
    assert "does not fit" not in analyse_study(read_table(path), RoleOptions(), "").text()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--counts", "lost", "--response", "total"), "--response, --counts: exclude each other; name a value or"),
        (("--counts", "kept"), "--counts kept: is not a column of"),
        (("--counts", "lost", "--total", "x"), "--total x: is not a column of"),
        (("--response", "lost", "--total", "144"), "--total: has no effect without --counts; omit it"),
        (("--response", "lost", "--link", "logit"), "--link: has no effect with --response; omit it"),
        (("--counts", "lost", "--total", "144", "--blocks", "total"), "--blocks total: has one block only; omit it"),
        (("--whole-plots", "date", "--blocks", "order"), "--whole-plots date: every factor changes within a whole"),
        (
            ("--counts", "lost", "--total", "144", "--factors", "total"),
            "column total: is 144 in every trial, so it is no factor",
        ),
        (("--counts", "total", "--total", "lost"), "column total: 144 of"),
        (("--counts", "lost", "--total", "5"), "column lost: 10 of 5 (--total 5) is impossible; correct one of them"),
        (("--trials", "5"), "--trials: has no effect with analyse; omit it"),
        (("--design", "L9"), "--design: has no effect with analyse; omit it"),
    ],
)
def test_an_invalid_role_is_told_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: Sequence[str], complaint: str
) -> None:
    assert main(["study", "analyse", str(EXAMPLE), *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert complaint in printed.err
    assert printed.err.count("\n") == 1


def test_the_range_analysis_of_an_array(tmp_path: Path) -> None:
    """K, k, R, order and best levels by hand: A adds 0, 3, 9, B adds 0, 1, 2, C and D nothing."""
    levels = (orthogonal_array("L9", 4) + 2).astype(int)
    response = [60 + (0, 3, 9)[a - 1] + b for a, b, _, _ in levels]
    path = table(tmp_path, ("A", "B", "C", "D", "得率 (%)"), [(*x, y) for x, y in zip(levels, response, strict=True)])
    study = analyse_study(read_table(path), RoleOptions(), "")
    record = json.loads(study.json())["ranges"]
    assert record["order"][:2] == [1, 2]
    assert record["factors"][0]["K"] == [3 * 62, 3 * 65, 3 * 71]
    assert record["factors"][0]["k"] == [62, 65, 71]
    assert [each["R"] for each in record["factors"]] == pytest.approx([9, 2, 0, 0])
    assert [each["best"] for each in record["factors"][:2]] == [3, 3]
    least = ranges(levels.astype(float), np.array(response, dtype=float), is_high_best=False)
    assert [each.best for each in least[:2]] == [1, 1]
    assert "descriptive" in study.text()
    assert "Order of influence X1 > X2" in study.text()


def test_a_design_that_is_no_array_has_no_range_analysis() -> None:
    study = analyse_study(read_table(EXAMPLE), RoleOptions(), "")
    assert "极差" not in study.text()
    assert json.loads(study.json())["ranges"] is None


def test_the_range_by_chance_is_exceeded_in_a_twentieth_of_experiments() -> None:
    """Three levels of six trials each, no effect, SD estimated with 15 degrees of freedom."""
    values = np.random.default_rng(1).normal(size=(20_000, 3, 6))
    found = np.ptp(values.mean(axis=2), axis=1)
    sd = np.sqrt(values.var(axis=2, ddof=1).mean(axis=1))
    limit = range_by_chance(3, 6, sd=1.0, degrees=15)
    assert np.mean(found > limit * sd) == pytest.approx(0.05, abs=0.006)  # four standard errors


def test_chinese_headings_give_a_report_whose_pictures_have_no_missing_glyph(tmp_path: Path) -> None:
    """A missing glyph is a warning of Matplotlib, and an error in the tests."""
    rng = np.random.default_rng(4)
    points = np.vstack([full_factorial([(-1, 0, 1)] * 2)] * 2)
    rows = [(*x, 8 + round(9 * x[0] ** 2 + rng.normal()), 144) for x in points]
    path = table(tmp_path, ("泡沫厚度/mm", "夹持压力/MPa", "损失数", "总数"), rows)
    out = tmp_path / "out"
    assert main(["study", "analyse", str(path), "--out", str(out)]) == 0
    report = (out / "report.md").read_text(encoding="utf-8")
    assert "response: 损失数 of 总数; factors: 泡沫厚度, 夹持压力" in report
    assert (out / "contours.svg").exists()
    assert (out / "given/file/t.csv").read_bytes() == path.read_bytes()


def test_a_corner_is_coded_1_in_a_composite(tmp_path: Path) -> None:
    rows = [(x, y) for x, y in ((-1.525, 1), (-1, 2), (0, 5), (1, 2), (1.525, 1), (0, 6), (1, 3))]
    trials = trials_of(table(tmp_path, ("a", "y"), [(12 + 3.6 * x, y) for x, y in rows]))
    assert trials.coded[:, 0] == pytest.approx([x for x, _ in rows])


def test_a_saturated_array_is_described_only(tmp_path: Path) -> None:
    levels = orthogonal_array("L4", 3)
    path = table(tmp_path, ("a", "b", "c", "y"), [(*x, n) for n, x in enumerate(levels)])
    text = analyse_study(read_table(path), RoleOptions(), "").text()
    assert text.splitlines()[3].startswith("No model is fitted and nothing is tested: ")
    assert "R by chance is unknown" in text
    with pytest.raises(StudyError, match="--model quadratic: "):
        analyse_study(read_table(path), RoleOptions(), "", order="quadratic")


def test_an_optimum_outside_the_trials_or_not_located_is_told(tmp_path: Path) -> None:
    """A Box-Behnken design has no corners; the response of a corner is a prediction from the others."""
    rng = np.random.default_rng(6)
    points = np.vstack([box_behnken(3, centres=3)] * 2)
    noise = rng.normal(size=len(points))
    texts = []
    for centre in (0.95, 0.1):
        response = 90 - 9 * ((points[:, :2] - centre) ** 2).sum(axis=1) - 9 * (points[:, 2] - centre) ** 2 + noise
        path = table(tmp_path, ("a", "b", "c", "y"), [(*x, y) for x, y in zip(points, response, strict=True)])
        texts.append(analyse_study(read_table(path), RoleOptions(), "").text())
    outside, inside = texts
    assert "outside the region of the trials" in outside
    assert "outside the region of the trials" not in inside
    assert "anywhere in the range" not in inside
    flat = [(*x, 90 - 9 * x[0] ** 2 + y) for x, y in zip(points, noise, strict=True)]
    text = analyse_study(read_table(table(tmp_path, ("a", "b", "c", "y"), flat)), RoleOptions(), "").text()
    assert "anywhere in the range" in text
    assert "is not located by these trials" in text
