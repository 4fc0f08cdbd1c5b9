"""Files of a figure: text that stays text, embedded fonts, resolution, equal bytes, and the data that is drawn."""

from __future__ import annotations

import argparse
import csv
import os
import re
import subprocess
import sys
import zlib
from pathlib import Path
from xml.etree import ElementTree as Xml

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from controller.common.errors import InputError
from plant_sim.common.figure_data import DrawnMark, drawn_marks
from plant_sim.common.figure_style import drawing, save, with_minus_signs
from plant_sim.common.picture_form import DPI, FORMATS, PictureForm, check_picture_options, formats_of, picture_form
from plant_sim.common.provenance.result_files import ResultFiles
from tests.paths import ROOT

ALL = PictureForm(FORMATS, dpi=300)
SVG = "{http://www.w3.org/2000/svg}"


def line_figure() -> Figure:
    """Return a figure with negative numbers on an axis, in the legend and in a text."""
    with drawing():
        figure = Figure(figsize=(3, 2), layout="constrained")
        axes = figure.add_subplot()
        axes.plot([-1.5, 0.0, 1.5], [-2.0, 0.25, 1 / 3], label="at -0.5")
        axes.set(xlabel="foam thickness, mm", ylabel="success rate S, %", title="20-30 d, -3 d")
        axes.legend()
    return figure


def saved(folder: Path) -> dict[str, bytes]:
    """Return the files of the figure in every format, by suffix."""
    folder.mkdir()
    with drawing():
        return {path.suffix: path.read_bytes() for path in save(line_figure(), folder / "line", form=ALL)}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the figure in every format."""
    saved(folder := tmp_path_factory.mktemp("figure") / "out")
    return folder


def test_the_text_of_an_svg_is_text_with_minus_signs(folder: Path) -> None:
    root = Xml.fromstring((folder / "line.svg").read_bytes())  # noqa: S314 - our own file
    texts = {"".join(each.itertext()).strip() for each in root.iter(f"{SVG}text")}
    assert {"foam thickness, mm", "success rate S, %", "at \N{MINUS SIGN}0.5", "20-30 d, \N{MINUS SIGN}3 d"} <= texts
    assert any(re.fullmatch("\N{MINUS SIGN}[0-9.]+", each) for each in texts), "tick labels"
    assert not any(re.fullmatch(r"-[0-9.]+", each) for each in texts)


def test_a_png_has_the_resolution_of_the_form(folder: Path) -> None:
    """The figure is 3 x 2 inches."""
    with Image.open(folder / "line.png") as picture:
        assert picture.size == (900, 600)
        assert picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)


def test_the_fonts_of_a_pdf_are_embedded_truetype(folder: Path) -> None:
    """Journals refuse Type 3 fonts and fonts that are not embedded."""
    content = (folder / "line.pdf").read_bytes()
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL)
    objects = content + b"".join(map(_inflated, streams))
    described = objects.count(b"/Type /FontDescriptor")
    assert described == objects.count(b"/FontFile2") > 0
    assert b"/Type3" not in objects
    assert b"/CreationDate" not in content


def _inflated(stream: bytes) -> bytes:
    try:
        return zlib.decompress(stream)
    except zlib.error:
        return b""


def test_equal_figures_give_equal_bytes(folder: Path, tmp_path: Path) -> None:
    """No file contains a date or a random id, or depends on the user's settings of Matplotlib."""
    first = {path.suffix: path.read_bytes() for path in folder.iterdir()}
    with mpl.rc_context({"svg.hashsalt": None, "svg.fonttype": "path", "pdf.fonttype": 3, "font.size": 20.0}):
        assert saved(tmp_path / "second") == first
    assert set(first) == {f".{each}" for each in FORMATS}


@pytest.mark.nightly
def test_another_process_gives_equal_bytes(tmp_path: Path) -> None:
    """With other hashes of strings, which determine the order of sets."""
    code = "import pathlib, sys, tests.plant_sim.common.test_figure_files as t; t.saved(pathlib.Path(sys.argv[1]))"
    for seed in ("1", "2"):
        command = [sys.executable, "-c", code, str(tmp_path / seed)]
        subprocess.run(command, check=True, cwd=ROOT, env={**os.environ, "PYTHONHASHSEED": seed})
    for path in (tmp_path / "1").iterdir():
        assert path.read_bytes() == (tmp_path / "2" / path.name).read_bytes(), path.name


def panel() -> tuple[Figure, mpl.axes.Axes]:
    """Return a figure with one panel."""
    figure = Figure()
    axes = figure.add_subplot()
    axes.set(xlabel="x,\nm", ylabel="y, s")
    return figure, axes


def test_lines_points_and_bars_are_in_the_data_with_every_digit(tmp_path: Path) -> None:
    """A point without a value has no error bar; a vertical line has no height."""
    figure, axes = panel()
    axes.errorbar([1, 1, 3], [1 / 3, np.nan, 0.5], [[0.1, 0.1, 0.2], [0.3, 0.1, 0.0]], fmt="o", label="runs")
    axes.plot([0, 1], [2, 3], label="model")
    axes.scatter([5], [6])
    axes.axvline(7)
    axes.axhline(8)
    axes.bar([2], [4], width=0.5)
    ResultFiles(tmp_path, None).picture("all", figure)
    with (tmp_path / "all.data.csv").open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    assert tuple(heading) == DrawnMark._fields
    assert {(row[0], row[1], row[2]) for row in rows} == {("1", "x, m", "y, s")}
    assert [row[3:8] + row[10:12] for row in rows[:3]] == [
        ["points", "1", "runs", "1.0", str(1 / 3), str(1 / 3 - 0.1), str(1 / 3 + 0.3)],
        ["points", "1", "runs", "1.0", "", "", ""],
        ["points", "1", "runs", "3.0", "0.5", "0.3", "0.5"],
    ]
    assert [row[3:8] for row in rows[3:8]] == [
        ["line", "2", "model", "0.0", "2.0"],
        ["line", "2", "model", "1.0", "3.0"],
        ["vertical line", "3", "", "7.0", ""],
        ["horizontal line", "4", "", "", "8.0"],
        ["points", "5", "", "5.0", "6.0"],
    ]
    assert rows[8][3:12] == ["bar", "6", "", "2.0", "2.0", "1.75", "2.25", "0.0", "4.0"]
    assert len(rows) == 9


def test_contours_cells_and_spans_are_in_the_data() -> None:
    """The contour lines of x + y lie on straight lines; the colour bar shows no data of its own."""
    figure, axes = panel()
    x, y = np.meshgrid(np.linspace(0, 1, 11), np.linspace(0, 2, 11))
    filled = axes.contourf(x, y, x + y)
    axes.contour(x, y, x + y, levels=[0.5, 1.5])
    figure.colorbar(filled, ax=axes)
    points = drawn_marks(figure)
    assert {(each.panel, each.kind) for each in points} == {(1, "contour")}
    assert {each.value for each in points} == {0.5, 1.5}
    assert all((each.x or 0) + (each.y or 0) == pytest.approx(each.value) for each in points)

    figure, axes = panel()
    axes.pcolormesh([0, 1, 3], [0, 2], [[10, 20]])
    axes.broken_barh([(1, 2)], (5, 1))
    axes.vlines([4], 0, 1)
    assert [each[3:4] + each[6:] for each in drawn_marks(figure)] == [
        ("cell", 0.5, 1.0, 0.0, 1.0, 0.0, 2.0, 10.0),
        ("cell", 2.0, 1.0, 1.0, 3.0, 0.0, 2.0, 20.0),
        ("bar", 2.0, 5.5, 1.0, 3.0, 5.0, 6.0, None),
        ("bar", 4.0, 0.5, 4.0, 4.0, 0.0, 1.0, None),
    ]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("-1.5 to -.5", "\N{MINUS SIGN}1.5 to \N{MINUS SIGN}.5"),
        ("(-3)", "(\N{MINUS SIGN}3)"),
        ("20-30", "20-30"),
        ("X1-2", "X1-2"),
        ("2026-11-29", "2026-11-29"),
        ("a - b", "a - b"),
        ("1e-05", "1e\N{MINUS SIGN}05"),
    ],
)
def test_only_the_hyphen_of_a_negative_number_becomes_a_minus_sign(text: str, shown: str) -> None:
    assert with_minus_signs(text) == shown


def options(**values: object) -> argparse.Namespace:
    """Return the options of a command with pictures."""
    return argparse.Namespace(**{"out": Path("out"), "format": None, "dpi": None, **values})


def test_the_form_follows_from_the_options() -> None:
    assert formats_of("SVG, pdf") == "pdf,svg"
    assert picture_form(options()) == PictureForm(("png", "svg"), DPI)
    assert picture_form(options(format="pdf,png", dpi=600)) == PictureForm(("pdf", "png"), 600)
    check_picture_options(options(format="pdf,png", dpi=600))
    with pytest.raises(InputError, match=r"^--format: has no effect without --out; add --out or omit it$"):
        check_picture_options(options(out=None, format="pdf"))
    with pytest.raises(argparse.ArgumentTypeError, match=r"^'eps' is not a format; write pdf, png, svg, or several$"):
        formats_of("pdf,eps")
