"""Study ``plan``: the comparison, the design and its sheet, and what is refused."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from plant_sim.cli.main import main
from plant_sim.study.errors import StudyError
from plant_sim.study.plan.request import factors_of, shares

FACTORS = "foam (mm)=8.4..15.6, age (d)=45..55, pressure (MPa)=0.32..0.58"


def test_a_comparison_is_tabulated_over_the_correlation(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "plan", "--difference", "93,95", "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    listed = [(each["trials_by_count"], each["trials_by_trial"]) for each in record["comparison"]]
    assert listed == [(16, 17), (38, 39), (82, 83)]
    assert main(["study", "plan", "--difference", "93,95", "--correlation", "0.02", "--seedlings", "72"]) == 0
    assert "2.42" in capsys.readouterr().out


def test_the_sheet_of_a_plan_is_read_by_analyse(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    design = ("--design", "composite", "--axial", "1.525", "--centres", "9", "--blocks", "3", "--factors", FACTORS)
    assert main(["study", "plan", *design, "--difference", "93,95", "--out", str(out)]) == 0
    sheet = out / "trials.csv"
    assert main(["study", "analyse", str(sheet)]) == 2
    assert f"{sheet}:2: column response: the value is missing; complete it" in capsys.readouterr().err
    with sheet.open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    assert heading[:6] == ["order", "block", "foam (mm)", "age (d)", "pressure (MPa)", "response"]
    assert len(rows) == 23
    for number, row in enumerate(rows):
        row[5] = str(80 + float(row[2]) + 0.1 * (number % 3))
    with sheet.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([heading, *rows])
    assert main(["study", "analyse", str(sheet), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert "factors: foam, age, pressure; blocks: block; not used: order, provenance" in record["roles"]
    assert record["model"]["coefficients"]["X1"] == pytest.approx(3.6, abs=0.1)  # half the range, mm


def test_the_power_of_an_effect_and_of_lack_of_fit_is_stated(capsys: pytest.CaptureFixture[str]) -> None:
    command = ("study", "plan", "--design", "box-behnken", "--factors", FACTORS, "--sd", "1.35", "--effect", "6")
    assert main([*command, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    powers = record["design_power"]["terms"]["SD 1.35"]
    assert powers["X1"] > powers["X1 X2"] > 0.5
    assert main([*command]) == 0
    assert "lack of fit, X1^3 missing  not visible" in capsys.readouterr().out
    assert main(["study", "plan", "--design", "L9", "--factors", FACTORS, "--model", "linear"]) == 0
    assert "No power is stated; specify --effect with --sd" in capsys.readouterr().out
    without = ("study", "plan", "--design", "L9", "--factors", FACTORS, "--model", "linear", "--difference", "93,95")
    assert main([*without]) == 0
    assert "counts are tested against repeated trials, of which the design has none" in capsys.readouterr().out


@pytest.mark.parametrize("design", ["factorial", "fraction-4", "latin-12", "L9", "L12", "L18"])
def test_every_design_is_planned(capsys: pytest.CaptureFixture[str], design: str) -> None:
    assert main(["study", "plan", "--design", design, "--factors", FACTORS, "--trials", "4", "--blocks", "2"]) == 0
    assert "in 2 blocks, in random order within each block (seed 1)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ((), "plan: nothing to plan; specify --difference 93,95 or --design NAME with --factors, or both"),
        (("--difference", "93"), "--difference 93: must be two percentages, such as 93,95"),
        (("--difference", "93,93"), "--difference 93,93: must be two different percentages above 0 and below 100"),
        (("--difference", "93,100"), "--difference 93,100: must be two different percentages"),
        (("--difference", "93,95", "--factors", FACTORS), "--factors: has no effect without --design; omit it, or add"),
        (("--difference", "93,95", "--power", "1"), "--power 1: must be 0.1 to 0.999"),
        (("--difference", "93,95", "--correlation", "2"), "--correlation 2: must be 0 to 1"),
        (("--design", "L9"), "--factors: is missing; name each factor with its range"),
        (("--design", "L7", "--factors", FACTORS), "--design L7: is unknown; use one of factorial, fraction-RUNS"),
        (("--design", "L9", "--factors", "a"), "--factors a: is malformed; write NAME (UNIT)=LOW..HIGH"),
        (("--design", "L9", "--factors", "a=2..1"), "--factors a=2..1: the range is empty; write the lower end first"),
        (("--design", "L9", "--factors", "a=1..2,a=1..2"), "--factors a=1..2: the name occurs twice; delete one"),
        (("--design", "L9", "--factors", FACTORS, "--blocks", "2"), "--blocks 2: blocks of L9 are complete replicates"),
        (("--design", "L9", "--factors", FACTORS, "--blocks", "date"), "--blocks date: must be a whole number"),
        (("--design", "fraction-5", "--factors", FACTORS), "fractional factorial: 5 runs for 3 factors; use 4"),
        (("--response", "S"), "--response: has no effect with plan; omit it"),
        (("x.csv", "--difference", "93,95"), "FILE: has no effect with plan; omit it"),
    ],
)
def test_an_invalid_request_is_told_in_one_line(
    capsys: pytest.CaptureFixture[str], arguments: Sequence[str], complaint: str
) -> None:
    assert main(["study", "plan", *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(complaint)
    assert printed.err.count("\n") == 1


def test_texts_of_the_request_are_parsed() -> None:
    assert shares("93 %, 95%") == (0.93, 0.95)
    foam, cups = factors_of("foam thickness [mm]=-1..1,cups=6..12")
    assert (foam.label, foam.natural(-1), cups.label, cups.natural(1)) == ("foam thickness, mm", -1, "cups", 12)
    with pytest.raises(StudyError, match="must be numbers"):
        factors_of("a=1e..2")
