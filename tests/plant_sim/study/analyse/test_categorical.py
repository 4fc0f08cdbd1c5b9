"""Categorical factors of a table of trials: coding, tests, optimum, range analysis and typing errors."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from statsmodels.formula.api import ols
from statsmodels.stats.anova import anova_lm

from plant_sim.cli.main import main
from plant_sim.study.analyse.model import TrialModel, fit_model
from plant_sim.study.analyse.roles import RoleOptions, assign
from plant_sim.study.analyse.study import analyse_study
from plant_sim.study.analyse.table import read_table
from plant_sim.study.doe.standard_designs import orthogonal_array

EFFECTS = {"flat": 0.0, "cone": 4.0, "fan": -3.0}
VARIETIES = ("K326", "云烟87")


def written(folder: Path, lines: list[tuple[object, ...]], heading: str) -> Path:
    """Write a table and return its path."""
    path = folder / "t.csv"
    rows = [heading, *(",".join(map(str, each)) for each in lines)]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


def sprayed(folder: Path, seed: int = 1) -> Path:
    """Write trials of pressure, nozzle and variety: two of each combination."""
    rng = np.random.default_rng(seed)
    lines: list[tuple[object, ...]] = []
    for pressure in (1, 2, 3):
        for nozzle, effect in EFFECTS.items():
            for variety in VARIETIES:
                for _ in range(2):
                    mean = 60 + effect + 2 * (pressure - 2) * (nozzle == "cone") - 3 * (pressure - 2) ** 2
                    lines.append((pressure, nozzle, variety, f"{mean + rng.normal():.3f}"))
    return written(folder, lines, "pressure (bar),nozzle,variety,cover (%)")


def test_categorical_factors_have_the_tests_of_statsmodels(tmp_path: Path) -> None:
    """Sum coding and type III: the formula of statsmodels gives the same coefficients, F and P."""
    path = sprayed(tmp_path)
    trials = assign(read_table(path), RoleOptions())
    assert [each.name for each in trials.factors] == ["pressure"]
    assert [each.name for each in trials.kinds] == ["nozzle", "variety"]
    model = fit_model(trials, "quadratic", "logit")
    assert isinstance(model, TrialModel)
    data = {"p": trials.coded[:, 0], "y": trials.response}
    data |= {each.name: np.array(each.cells) for each in trials.kinds}
    frame = pd.DataFrame(data)
    order = {each.name: list(each.labels) for each in trials.kinds}
    nozzle = f"C(nozzle, Sum, levels={order['nozzle']})"
    variety = f"C(variety, Sum, levels={order['variety']})"
    independent = ols(f"y ~ p + {nozzle} + {variety} + p:{nozzle} + p:{variety} + {nozzle}:{variety} + I(p**2)", frame)
    fitted = independent.fit()
    expected = anova_lm(fitted, typ=3)
    rows = {row.source: row for row in model.strata[0].rows()}
    names = {"X1": "p", "X2": nozzle, "X1 X2": f"p:{nozzle}", "X2 X3": f"{nozzle}:{variety}", "X1^2": "I(p ** 2)"}
    for ours, theirs in names.items():
        row = expected.loc[theirs]
        assert rows[ours].degrees == row["df"], ours
        assert (rows[ours].f, rows[ours].p) == pytest.approx((row["F"], row["PR(>F)"])), ours
    assert model.fit.values["X2"] == pytest.approx(fitted.params[f"{nozzle}[S.flat]"])
    assert "X2^2" not in rows


def test_the_report_states_coding_and_best_levels(tmp_path: Path) -> None:
    study = analyse_study(read_table(sprayed(tmp_path)), RoleOptions(), "")
    text = study.text()
    assert "factors: pressure, nozzle, variety" in text
    assert "categorical: flat, cone, fan" in text
    assert "X2[flat] is the effect of nozzle flat relative to that mean" in text
    record = json.loads(study.json())
    assert record["categorical"] == {"nozzle": ["flat", "cone", "fan"], "variety": list(VARIETIES)}
    assert record["optimum"]["labels"]["nozzle"] == "cone"
    nozzle_share, variety_share = record["optimum"]["label_shares"]
    assert nozzle_share > 0.99
    assert variety_share < 0.95
    assert "The best level of variety is not certain" in text
    assert record["optimum"]["natural"] == pytest.approx([2 + 1 / 3], abs=0.2)


def test_numbers_are_names_if_the_user_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines: list[tuple[object, ...]] = [(kind, load, 3 * (kind == 2) + load) for kind in (1, 2, 3) for load in (1, 2, 4)]
    path = written(tmp_path, [*lines, *lines], "type,load,y")
    command = ["study", "analyse", str(path), "--json", "--model", "linear", "--categorical", "type"]
    assert main(command) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["categorical"] == {"type": ["1", "2", "3"]}
    assert record["model"]["coefficients"]["X2[1]"] == pytest.approx(-1)
    assert record["command"].endswith("--categorical type --model linear")
    assert main([*command[:-1], "y"]) == 2
    assert "--categorical y: is not a factor" in capsys.readouterr().err


def test_only_categorical_factors_have_an_optimum(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    lines: list[tuple[object, ...]] = [
        (name, rng.binomial(144, share), 144) for name, share in (("A", 0.05), ("B", 0.2), ("C", 0.3)) for _ in range(6)
    ]
    roles = RoleOptions(counts="lost", total="total", factors=("operator",), blocks=())
    table = read_table(written(tmp_path, lines, "operator,lost,total"))
    record = json.loads(analyse_study(table, roles, "").json())
    assert record["optimum"]["labels"] == {"operator": "A"}
    assert record["model"]["coefficients"]["X1[A]"] < 0 < record["model"]["strata"]["trials"][0]["f"]


def test_the_range_analysis_names_the_levels(tmp_path: Path) -> None:
    """L9 with a nozzle: R is 9, the best level is the third of the table."""
    array = (orthogonal_array("L9", 3) + 1).astype(int)
    lines: list[tuple[object, ...]] = [(("fan", "flat", "cone")[a], b, c, (0, 3, 9)[a] + b + 60) for a, b, c in array]
    path = written(tmp_path, lines, "nozzle,b,c,y")
    record = json.loads(analyse_study(read_table(path), RoleOptions(), "").json())["ranges"]
    assert record["factors"][2]["best"] == "cone"
    assert record["factors"][2]["R"] == pytest.approx(9)
    assert record["order"][0] == 3


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("2,B,7", "2,,7", "5: column kind: the value is missing; complete it, or delete the line"),
        ("2,B,7", "2,b,7", "5: column kind: 'b' is probably 'B', as in line 3; write one of them"),
        ("2,B,7", "2,3,7", "5: column kind: 3 is a number among names; correct it, or name the column with"),
        ("2,B,7", "2,=B1,7", "5: column kind: begins like a formula of a spreadsheet, which is not evaluated"),
    ],
)
def test_a_mistyped_level_is_told_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, complaint: str
) -> None:
    path = tmp_path / "t.csv"
    path.write_text("load,kind,y\n1,A,5\n1,B,6\n2,A,7\n2,B,7\n3,A,6\n3,B,9\n".replace(old, new), encoding="utf-8")
    assert main(["study", "analyse", str(path), "--factors", "load,kind"]) == 2
    assert capsys.readouterr().err.removeprefix(f"{path}:").startswith(complaint)


def test_too_many_levels_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, [(f"N{n}", n, n) for n in range(14)], "kind,load,y")
    assert main(["study", "analyse", str(path), "--factors", "load,kind"]) == 2
    assert "column kind: has more than 10 levels here; combine levels" in capsys.readouterr().err


def test_whole_plots_of_a_variety_have_their_own_error(tmp_path: Path) -> None:
    """A variety is sown by bed: its effect is tested between beds."""
    rng = np.random.default_rng(2)
    lines: list[tuple[object, ...]] = []
    for bed in range(6):
        error = rng.normal(0, 2)
        lines += [(f"B{bed}", "ABC"[bed % 3], load, 50 + load + error + rng.normal()) for load in (1, 2, 3, 4)]
    trials = assign(read_table(written(tmp_path, lines, "bed,variety,load,y")), RoleOptions(whole_plots="bed"))
    assert trials.hard == (2,)
    model = fit_model(trials, "linear", "logit")
    assert isinstance(model, TrialModel)
    within, between = model.strata
    assert (within.terms, between.terms) == (("X1",), ("X2", "X3"))
    assert next(row for row in between.rows() if row.source == "X2").degrees == 2
