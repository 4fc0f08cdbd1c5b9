"""Command ``planter``: printed figures, drawings, and invalid options reported in one line."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from plant_sim.cli.main import main
from plant_sim.common.defaults import DEFAULT_PLANTER
from plant_sim.planter import falls
from tests.paths import DOCS
from tests.sampling import first_of, one_in


def record_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["planter", "--json", *arguments]) == 0
    record: dict[str, Any] = json.loads(capsys.readouterr().out)
    return record


@pytest.mark.parametrize(
    ("speed", "ratio", "regime", "points"),
    [("1.9", 0.8653, "shortened cycloid", 0), ("1.65", 0.9964, "shortened cycloid", 0), ("1.4", 1.1743, "trochoid", 2)],
)
def test_the_simulated_cases_of_the_paper(
    speed: str, ratio: float, regime: str, points: int, capsys: pytest.CaptureFixture[str]
) -> None:
    record = record_of(capsys, "--speed", speed)
    assert record["ratio"] == pytest.approx(ratio, abs=5e-5)
    assert record["regime"] == regime
    assert {len(each) for each in record["zero_speed"].values()} == {points}


def test_the_text_has_the_figures_and_the_assumptions(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["planter", "--model", "corrected", "--release", "170"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "chain planter, model corrected: 1.4 km/h, 56 plants/min, chain 456.7 mm/s"
    assert lines[1] == "ratio               1.1743, trochoid"
    assert lines[2] == "plant spacing       416.7 mm"
    assert "  tip               38.27° -0.493 m/s; 141.73° +0.493 m/s" in lines
    assert "  D                 0.0, 0.0 mm; 0.0, -171.3 mm/s" in lines
    assert "separation time     108.1 ms after the release at 170° (numerical and closed form)" in lines
    assert lines[-1].startswith("assumed, not published: chain.teeth, chain.span_part, chain.offset_m, ")


def test_the_printed_equations_have_no_separation(capsys: pytest.CaptureFixture[str]) -> None:
    record = record_of(capsys, "--model", "printed")
    assert record["separation_s"] is record["separation_closed_form_s"] is None
    assert main(["planter", "--model", "printed"]) == 0
    assert "separation time     none: the path of the printed equations is not continuous" in capsys.readouterr().out


def test_frequency_release_and_parameters_are_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = DEFAULT_PLANTER.read_text(encoding="utf-8")
    changed = tmp_path / "planter.yaml"
    changed.write_text(text.replace("sprocket_radius_m: {value: 0.080", "sprocket_radius_m: {value: 0.090"))
    before = record_of(capsys)
    double = record_of(capsys, "--frequency", "112")
    assert double["ratio"] == pytest.approx(2 * before["ratio"])
    assert double["spacing_m"] == pytest.approx(before["spacing_m"] / 2)
    assert before["release_deg"] == 75.0
    assert record_of(capsys, "--release", "150")["separation_s"] > before["separation_s"]
    other = record_of(capsys, "--planter", str(changed))
    assert other["depth_m"] == pytest.approx(before["depth_m"] + 0.010)
    assert "chain.offset_m" in other["assumed"]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("arguments", "start"),
    one_in(
        4,
        [
            (["--plot", "motion.png"], b"\x89PNG"),
            (["--plot", "motion.svg"], b"<?xml"),
            (["--plot", "motion.pdf"], b"%PDF"),
            (["--figure", "3", "--plot", "scheme.png"], b"\x89PNG"),
            (["--figure", "4", "--plot", "paths.svg", "--model", "corrected"], b"<?xml"),
            (["--figure", "9", "--plot", "motion.gif"], b"GIF89a"),
        ],
    ),
)
def test_a_figure_is_drawn(
    arguments: list[str],
    start: bytes,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("plant_sim.planter.drawing.gif.FRAMES_PER_S", 2)
    record_of(capsys, *arguments)
    (path,) = tmp_path.iterdir()
    assert path.read_bytes().startswith(start)


@pytest.mark.nightly
@pytest.mark.parametrize(("figure", "speed_km_h"), first_of([("7", 1.9), ("8", 1.65), ("9", 1.4)]))
def test_a_figure_of_a_case_has_its_speed(
    figure: str, speed_km_h: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "case.svg"
    record = record_of(capsys, "--figure", figure, "--plot", str(path))
    assert record["speed_m_s"] == pytest.approx(speed_km_h / 3.6)
    assert f"after Fig. {figure}: {speed_km_h:g} km/h, 56 plants/min" in path.read_text(encoding="utf-8")


def rows_of(page: Path, first_cell: str) -> list[list[str]]:
    """Return the cells of the table of a page whose heading begins with a cell, without the heading."""
    _, _, table = page.read_text(encoding="utf-8").partition(f"| {first_cell} |")
    lines = table.partition("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in [f"{first_cell} |{lines[0]}", *lines[2:]]]


def test_the_tables_of_the_guide_are_those_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    _, *cases = rows_of(DOCS / "planter.md", "km/h")
    assert len(cases) == 3
    for speed, ratio, printed, regime, points, spacing in cases:
        record = record_of(capsys, "--speed", speed)
        assert (f"{record['ratio']:.4f}", f"{1000 * record['spacing_m']:.1f} mm") == (ratio, spacing)
        assert float(printed) == round(record["ratio"], 2)
        assert regime.startswith(record["regime"])
        found = record["zero_speed"]["tip"]
        assert all(f"{point['phase_deg']:.1f}°" in points for point in found)
        assert all(f"{1000 * abs(point['vertical_m_s']):.0f} mm/s" in points for point in found)
        assert points.startswith("none") is not bool(found)
    phases, times = rows_of(DOCS / "planter.md", "release at")
    for phase, time in zip(phases[1:], times[1:], strict=True):
        record = record_of(capsys, "--release", phase.removesuffix("°"))
        assert f"{1000 * record['separation_s']:.1f}" == time


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--speed", "0"], "--speed 0: must be 0.001 to 36"),
        (["--speed", "nan"], "--speed nan: must be 0.001 to 36"),
        (["--frequency", "-1"], "--frequency -1: must be 0.001 to 1000"),
        (["--frequency", "1e4"], "--frequency 1e4: must be 0.001 to 1000"),
        (["--release", "181"], "--release 181: must be 0 to 180"),
        (["--figure", "7"], "--figure 7: has no effect without a file; add --plot FILE"),
        (
            ["--figure", "7", "--plot", "a.png", "--speed", "2"],
            "--figure 7: its speed and frequency are fixed; omit --speed",
        ),
        (["--plot", "a.jpg"], "--plot a.jpg: unknown format; use a name that ends in .png, .svg, .pdf or .gif"),
        (
            ["--plot", "a.svg", "--dpi", "300"],
            "--dpi 300: has no effect without a PNG file; add --plot FILE.png or omit it",
        ),
        (["--dpi", "300"], "--dpi 300: has no effect without a PNG file; add --plot FILE.png or omit it"),
        (["--plot", "/no/such/folder/a.png"], "/no/such/folder/a.png: cannot be written (No such file"),
        (["--plot", "/no/such/folder/a.gif"], "/no/such/folder/a.gif: cannot be written (No such file"),
        (["--planter", "/no/such/planter.yaml"], "/no/such/planter.yaml: cannot be read"),
    ],
)
def test_invalid_input_is_one_line_and_exit_code_2(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["planter", *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(expected)
    assert printed.err.count("\n") == 1


def test_the_falls_on_both_grounds_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    found = record_of(capsys, "--speed", "1.9")["falls"]
    assert found["rigid_ground"]["verdict"] == "scraped and tipped forward"
    assert found["rigid_ground"]["shares"]["scraped and tipped forward"] > 0.9
    assert found["bench_soil"]["shares"]["scraped and tipped forward"] < 0.1
    assert record_of(capsys)["falls"]["rigid_ground"]["verdict"] == "clean and upright"
    assert record_of(capsys, "--model", "corrected")["falls"] is None


def test_equations_10_and_11_are_for_cabbage_blocks(capsys: pytest.CaptureFixture[str]) -> None:
    record = record_of(capsys, "--speed", "1.75", "--frequency", "58")["cabbage_blocks"]
    assert record["lodging_equation_10"] == {"value": pytest.approx(0.0552), "extrapolated": False}
    assert record["injury_equation_11"]["value"] == pytest.approx(0.0408)
    assert record_of(capsys)["cabbage_blocks"]["lodging_equation_10"]["extrapolated"]


def test_tables_of_falls_are_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        falls.write_table, "__kwdefaults__", {"grid": falls.Grid((1.17,), (75.0,), 1, (58.0,)), "progress": None}
    )
    assert main(["planter", "--falls", str(tmp_path / "falls")]) == 0
    printed = capsys.readouterr()
    assert sorted(printed.out.splitlines()) == sorted(map(str, (tmp_path / "falls").iterdir()))
    assert printed.err.splitlines() == ["rigid_ground: 1 of 1 motions", "bench_soil: 1 of 1 motions"]
    (tmp_path / "file").write_text("")
    assert main(["planter", "--falls", str(tmp_path / "file")]) == 2
    assert "cannot be written" in capsys.readouterr().err
