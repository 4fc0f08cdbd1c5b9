"""Reports of studies: what stands in them, no text taken for markup, none half-written."""

from __future__ import annotations

import csv
import json
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from plant_sim.bench.study import report as report_module
from plant_sim.bench.study.errors import StudyError
from plant_sim.bench.study.parts import Cell, Heading, Part, Picture, Table
from plant_sim.bench.study.report import Study, check_folder, drawing, write
from plant_sim.scope.store import RecordingError

TABLE = Table(
    "yield-by-foam",
    "Success by foam",
    ("foam, mm", "S, %", "P", "note"),
    ((7.5, 91.0625, "<0.0001", "a | b"), (10.0, 95.125, "0.0312", "<b>bold</b>"), (12.5, None, None, "5 * 3_")),
)


def line_figure() -> Figure:
    """A figure drawn as studies draw theirs."""
    with drawing():
        figure = Figure(figsize=(3, 2), layout="constrained")
        figure.add_subplot().plot([0, 1, 2], [0, 1, 4])
    return figure


def study(*parts: Part, record: dict[str, object] | None = None) -> Study:
    """A study made of some parts."""
    return Study("foam", "Foam & <claws>", "python -m plant_sim study own foam.yaml", parts, record or {})


def whole_study() -> Study:
    """A study with a part of every kind."""
    picture = Picture("success", "Success over foam", line_figure())
    return study("Said *first*.", Heading("Results"), TABLE, picture, record={"best": {"foam_mm": 10.0}})


class Page(HTMLParser):
    """The tags, texts and attributes of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def page_of(path: Path) -> Page:
    """A page that was written."""
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def test_the_folder_holds_report_tables_and_pictures_and_nothing_else(tmp_path: Path) -> None:
    """Every file is listed, exists, and is all there is, beside the folder too."""
    folder = tmp_path / "new" / "foam"
    files = write(whole_study(), folder)
    names = {"report.md", "report.html", "study.json", "yield-by-foam.csv", "success.png", "success.svg"}
    assert {path.name for path in files} == names
    assert {path.name for path in folder.iterdir()} == names
    assert all(path.parent == folder for path in files)
    assert [path.name for path in folder.parent.iterdir()] == ["foam"]


def test_equal_studies_give_equal_bytes(tmp_path: Path) -> None:
    """No date, no random id, whatever the user's matplotlib is set to."""
    first = write(whole_study(), tmp_path / "first")
    with mpl.rc_context({"svg.hashsalt": None, "font.size": 20.0, "lines.linewidth": 7.0}):
        second = write(whole_study(), tmp_path / "second")
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_text_has_headings_aligned_tables_and_names_of_pictures() -> None:
    lines = whole_study().text().splitlines()
    assert lines[:2] == ["Foam & <claws>", "=============="]
    assert lines[lines.index("Results") + 1] == "-------"
    at = lines.index("Success by foam")
    assert lines[at + 1 : at + 6] == [
        "foam, mm   S, %        P  note",
        "--------  -----  -------  -----------",
        "    7.50  91.06  <0.0001  a | b",
        "   10.00  95.12   0.0312  <b>bold</b>",
        "   12.50      -        -  5 * 3_",
    ]
    assert "[picture success: Success over foam]" in lines


def test_markdown_takes_no_text_for_markup(tmp_path: Path) -> None:
    """Bars, stars, tags and a leading number or hash stand as they are."""
    parts = (TABLE, "# no heading", "1. no list", "- none either", "foam_thickness_mm _stays_", whole_study().parts[3])
    write(study(*parts), tmp_path / "out")
    text = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert text.startswith("# Foam \\& \\<claws\\>\n\nMade by\n\n```sh\npython -m plant_sim study own foam.yaml\n```\n")
    assert "| ---: | ---: | ---: | --- |" in text
    assert "| 7.50 | 91.06 | \\<0.0001 | a \\| b |" in text
    assert "| 10.00 | 95.12 | 0.0312 | \\<b\\>bold\\</b\\> |" in text
    assert "| 12.50 | - | - | 5 \\* 3\\_ |" in text
    for escaped in ("\n\\# no heading\n", "\n1\\. no list\n", "\n\\- none either\n", "foam_thickness_mm \\_stays\\_"):
        assert escaped in text
    assert "![Success over foam](success.png)" in text
    assert "([CSV](yield-by-foam.csv))" in text


def test_html_takes_no_text_for_markup_and_points_at_files_beside_it(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    files = write(study(TABLE, whole_study().parts[3], Heading("<i>"), "<script>alert(1)</script>"), folder)
    page = page_of(folder / "report.html")
    tags = [tag for tag, _ in page.tags]
    assert not {"script", "b", "i", "claws", "link"} & set(tags)
    assert "<script>alert(1)</script>" in page.texts
    assert "<b>bold</b>" in page.texts
    assert page.texts.count("Foam & <claws>") == 2  # title and heading
    targets = [value for _, attributes in page.tags for key, value in attributes.items() if key in ("src", "href")]
    assert targets == ["yield-by-foam.csv", "success.svg"]
    assert set(targets) <= {path.name for path in files}
    cells = [attributes.get("class") for tag, attributes in page.tags if tag == "td"]
    assert cells == ["number", "number", "number", None] * 3


def test_csv_has_every_digit_and_nothing_where_there_is_nothing(tmp_path: Path) -> None:
    table = Table("numbers", "Numbers", ("a", "b, c"), ((1 / 3, 1), (None, float("nan")), ('say "x"', float("inf"))))
    write(study(table), tmp_path / "out")
    text = (tmp_path / "out" / "numbers.csv").read_text(encoding="utf-8")
    assert list(csv.reader(text.splitlines())) == [
        ["a", "b, c"], ["0.3333333333333333", "1"], ["", ""], ['say "x"', ""],
    ]  # fmt: skip


def test_json_has_numbers_as_they_are_and_null_for_what_is_none() -> None:
    numbers = {"third": np.float64(1 / 3), "row": np.array([1.0, np.inf]), "f": float("nan"), "n": 3, "is": np.True_,
               "list": (None, "text")}  # fmt: skip

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    found = json.loads(study(record=numbers).json(), parse_constant=refuse)
    assert found == {
        "study": "foam",
        "command": "python -m plant_sim study own foam.yaml",
        "third": 1 / 3,
        "row": [1.0, None],
        "f": None,
        "n": 3,
        "is": True,
        "list": [None, "text"],
    }


def test_a_record_holds_nothing_that_json_has_not() -> None:
    with pytest.raises(TypeError, match="cannot stand in the record"):
        study(record={"figure": object()}).json()


@pytest.mark.parametrize("cell", [None, 5, -0.25, "<0.0001", "1.5e-09"])
def test_a_column_of_numbers_is_numeric(cell: Cell) -> None:
    assert Table("t", "", ("a",), ((cell,), (1.0,))).is_numeric(0)


@pytest.mark.parametrize("cell", ["X1", "", "3 mm"])
def test_a_column_with_a_word_is_not(cell: Cell) -> None:
    assert not Table("t", "", ("a",), ((cell,), (1.0,))).is_numeric(0)


def test_a_folder_with_something_in_it_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(StudyError, match=r"exists and is not empty; name a new folder") as refusal:
        write(whole_study(), tmp_path)
    assert "\n" not in str(refusal.value)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_an_empty_folder_is_taken(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    write(study("Nothing else."), folder)
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "report.md", "study.json"]


def test_what_cannot_be_a_folder_is_refused_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_text("")
    link.symlink_to(tmp_path / "elsewhere")
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    too_long = tmp_path / (300 * "a")
    for folder in (file, file / "below", link, here, Path(), too_long, too_long / "below", Path("/proc/report")):
        with pytest.raises(StudyError, match=r"^--out .*; name "):
            check_folder(folder)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "here", "link"]


@pytest.mark.parametrize("empty_there", [False, True])
@pytest.mark.parametrize(
    "failure", [OSError(28, "No space left on device"), RecordingError("success.svg: cannot be written")]
)
def test_a_failure_in_the_middle_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: Exception, empty_there: bool
) -> None:
    """The disk is full at the last picture: no folder, no part of one, one line."""
    folder = tmp_path / "out"
    if empty_there:
        folder.mkdir()

    def full(*_: object) -> list[Path]:
        assert any(tmp_path.rglob("report.md"))  # the rest is already written, somewhere
        raise failure

    monkeypatch.setattr(report_module, "save", full)
    with pytest.raises(StudyError, match=r"^--out .*out: cannot be written .*; name another folder$"):
        write(whole_study(), folder)
    assert list(tmp_path.iterdir()) == ([folder] if empty_there else [])
    assert not folder.exists() or not list(folder.iterdir())


def test_two_files_of_one_name_are_refused() -> None:
    for parts in ((TABLE, TABLE), (Table("report", "", ("a",), ()),)):
        with pytest.raises(ValueError, match="file names taken"):
            study(*parts)
    study(TABLE, Picture(TABLE.name, "a picture may be called like a table", line_figure()))


@pytest.mark.parametrize("name", ["", "../up", "With Space", "UPPER", "a_b", "-a", "a.csv"])
def test_a_name_that_is_no_file_stem_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="lower-case words with hyphens"):
        Table(name, "", ("a",), ())
    with pytest.raises(ValueError, match="lower-case words with hyphens"):
        Picture(name, "", line_figure())


def test_a_row_that_does_not_fit_its_heading_is_refused() -> None:
    with pytest.raises(ValueError, match="table t: 1 cells under 2 headings"):
        Table("t", "", ("a", "b"), ((1,),))
