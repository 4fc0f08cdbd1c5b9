"""Documents: parts, escaping of markup, aligned columns, and the files that a document links."""

from __future__ import annotations

import csv
import io
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from controller.common.document.parts import (
    Cell,
    Heading,
    InlineDrawing,
    Part,
    Picture,
    ShellCommand,
    Table,
    counted,
    listing,
)
from controller.common.document.rendering import (
    aligned,
    csv_cell,
    csv_text,
    html,
    markdown,
    plain_text,
    reference_table,
    write_texts,
)

TITLE = "Foam & <claws>"
TABLE = Table(
    "yield-by-foam",
    "Success by foam",
    ("foam, mm", "S, %", "P", "note"),
    ((7.5, 91.0625, "<0.0001", "a | b"), (10.0, 95.125, "0.0312", "<b>bold</b>"), (12.5, None, None, "5 * 3_")),
)
PLAIN = listing(("key", "count"), [("`a|b`", "1"), ("c_", "20")])


class Blank:
    """Drawing without content."""

    def savefig(self, *_: object, **__: object) -> None:
        """Write nothing."""


PICTURE = Picture("success", "Success over *foam*", Blank())


class Page(HTMLParser):
    """Tags, texts and attributes of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        self.texts.append(data)


def test_text_has_headings_aligned_tables_and_names_of_pictures() -> None:
    parts = ("Said *first*.", ShellCommand("run it"), Heading("Results"), TABLE, PICTURE, PLAIN)
    assert plain_text(TITLE, parts).splitlines() == [
        "Foam & <claws>",
        "==============",
        "",
        "Said *first*.",
        "",
        "run it",
        "",
        "Results",
        "-------",
        "",
        "Success by foam",
        "foam, mm   S, %        P  note",
        "--------  -----  -------  -----------",
        "    7.50  91.06  <0.0001  a | b",
        "   10.00  95.12   0.0312  <b>bold</b>",
        "   12.50      -        -  5 * 3_",
        "",
        "[picture success: Success over *foam*]",
        "",
        "key    count",
        "-----  -----",
        "`a|b`  1",
        "c_     20",
    ]


def test_markdown_escapes_markup() -> None:
    """Bars, asterisks, tags and a leading number or hash are displayed literally."""
    parts = (
        ShellCommand("a * b"),
        TABLE,
        "# no heading",
        "1. no list",
        "- none  either",
        "foam_mm _stays_",
        Heading("`h`"),
    )
    assert markdown(TITLE, (*parts, PICTURE)) == (
        "# Foam \\& \\<claws\\>\n\n"
        "```sh\na * b\n```\n\n"
        "**Success by foam** ([CSV](yield-by-foam.csv))\n\n"
        "| foam, mm | S, % | P | note |\n"
        "| ---: | ---: | ---: | --- |\n"
        "| 7.50 | 91.06 | \\<0.0001 | a \\| b |\n"
        "| 10.00 | 95.12 | 0.0312 | \\<b\\>bold\\</b\\> |\n"
        "| 12.50 | - | - | 5 \\* 3\\_ |\n\n"
        "\\# no heading\n\n1\\. no list\n\n\\- none either\n\nfoam_mm \\_stays\\_\n\n"
        "## \\`h\\`\n\n"
        "![Success over \\*foam\\*](success.png)\n\n"
        "Success over \\*foam\\* ([SVG](success.svg), [data](success.data.csv))\n"
    )


def test_markdown_in_texts_is_kept_if_they_are_not_literal() -> None:
    """Only vertical bars in tables are escaped, since they would end a cell."""
    parts = ("- `a|b`\n- c", PLAIN, Heading("`h`", 3), PICTURE)
    assert markdown("T & U", parts, is_literal=False) == (
        "# T & U\n\n- `a|b`\n- c\n\n"
        "| key | count |\n| --- | --- |\n| `a\\|b` | 1 |\n| c_ | 20 |\n\n"
        "### `h`\n\n"
        "![Success over *foam*](success.png)\n\nSuccess over *foam* ([SVG](success.svg), [data](success.data.csv))\n"
    )


@pytest.mark.parametrize(
    ("formats", "shown", "linked"),
    [
        (("pdf", "svg"), ["success.svg"], ["success.pdf", "success.data.csv"]),
        (("png",), ["success.png"], ["success.data.csv"]),
        (("pdf",), [], ["success.pdf", "success.data.csv"]),
    ],
)
def test_a_page_shows_a_format_that_exists_and_links_the_others(
    formats: tuple[str, ...], shown: list[str], linked: list[str]
) -> None:
    """A browser shows no PDF as an image."""
    picture = Picture("success", "Success", Blank(), formats)
    page = Page(html(TITLE, [picture]))
    assert [attributes["src"] for tag, attributes in page.tags if tag == "img"] == shown
    assert [attributes["href"] for tag, attributes in page.tags if tag == "a"] == linked
    text = markdown(TITLE, [picture])
    assert re.findall(r"!\[Success]\((.*?)\)", text) == shown
    assert re.findall(r"(?<!!)\[\w+]\((.*?)\)", text) == linked


def test_the_rule_of_a_reference_table_has_no_spaces() -> None:
    text = reference_table(("*key*", ""), ("a|b", None), ("`c d`", 20))
    assert text == "| *key* |  |\n|---|---|\n| a\\|b | None |\n| `c d` | 20 |\n"


def test_html_escapes_markup_and_links_files_in_its_folder() -> None:
    parts = (TABLE, PICTURE, Heading("<i>", 3), "<script>alert(1)</script>", ShellCommand("run <file>"), PLAIN)
    page = Page(html(TITLE, parts))
    tags = [tag for tag, _ in page.tags]
    assert not {"script", "b", "i", "claws", "link"} & set(tags)
    assert {"<script>alert(1)</script>", "<b>bold</b>", "<i>", "run <file>"} <= set(page.texts)
    assert page.texts.count(TITLE) == 2  # title and heading
    assert [tag for tag in tags if tag[0] == "h" and tag[1:].isdigit()] == ["h1", "h3"]
    assert tags.count("caption") == 1  # not for the table without a name
    targets = [value for _, attributes in page.tags for key, value in attributes.items() if key in ("src", "href")]
    assert targets == ["yield-by-foam.csv", "success.svg", "success.png", "success.data.csv"]
    cells = [attributes.get("class") for tag, attributes in page.tags if tag == "td"]
    assert cells == ["number", "number", "number", None] * 3 + [None] * 4


LINKED = Table(
    "",
    "",
    ("case", "verdict"),
    (("stop: in <2> s", "failed"), ("guard", "passed")),
    headings=(Heading("stop: in <2> s"), None),
    strong=("failed",),
)


def test_a_row_links_to_its_heading_and_a_drawing_is_part_of_the_page() -> None:
    drawing = InlineDrawing("a & b", '<svg viewBox="0 0 1 1"></svg>')
    page = Page(html(TITLE, [LINKED, Heading("stop: in <2> s"), drawing]))
    assert [attributes["href"] for tag, attributes in page.tags if tag == "a"] == ["#stop-in-2-s"]
    assert ("h2", {"id": "stop-in-2-s"}) in page.tags
    assert [tag for tag, _ in page.tags].count("strong") == 1
    assert ("svg", {"viewbox": "0 0 1 1"}) in page.tags
    assert "a & b" in page.texts


def test_other_forms_contain_the_caption_of_a_drawing_and_no_links() -> None:
    parts: list[Part] = [LINKED, InlineDrawing("a & b", "<svg></svg>")]
    assert plain_text("T", parts).splitlines()[-1] == "[picture: a & b]"
    assert markdown("T", parts).splitlines()[-1] == "a \\& b"
    assert "| stop: in \\<2\\> s | failed |" in markdown("T", parts)


def test_each_row_of_a_table_with_links_has_a_heading_or_none() -> None:
    with pytest.raises(ValueError, match="1 headings for 2 rows"):
        Table("", "", ("a",), (("1",), ("2",)), headings=(None,))


def test_csv_has_every_digit_and_an_empty_cell_for_none() -> None:
    text = csv_text(("a", "b, c"), ((1 / 3, 1), (None, float("nan")), ('say "x"', float("inf"))))
    assert "\r" not in text
    assert list(csv.reader(text.splitlines())) == [
        ["a", "b, c"],
        ["0.3333333333333333", "1"],
        ["", ""],
        ['say "x"', ""],
    ]


@pytest.mark.parametrize("start", [*"=+-@\t\r\n", *"＝＋－＠"])
def test_a_name_in_csv_is_no_formula(start: str) -> None:
    """A cell with quotes, separators and line ends is protected as well, in the heading too."""
    name = f'{start}HYPERLINK("http://x/?"&A1,"阀岛")'
    heading, row = csv.reader(io.StringIO(csv_text((name, "b"), [(name, "valve")]), newline=""))
    assert heading == [f"'{name}", "b"]
    assert row == [f"'{name}", "valve"]


@pytest.mark.parametrize("number", [-1, -0.5, "-1", "+2.5", "-1.5e-3", "-", "+1.", 0])
def test_a_number_in_csv_stays_a_number(number: float | str) -> None:
    assert csv_text(("a",), [(number,)]) == f"a\n{number}\n"


@pytest.mark.parametrize("formula", ["-A1", "+1+1", "-1-cmd", "-e5", "--1", "-1\n", "-٣"])
def test_a_text_that_begins_like_a_number_is_no_number(formula: str) -> None:
    assert csv_cell(formula) == f"'{formula}"


def test_csv_lines_end_as_the_reader_demands() -> None:
    assert csv_text(("a",), [(1,), ("2\n3",)], end="\r\n") == 'a\r\n1\r\n"2\n3"\r\n'


def test_columns_are_aligned_without_trailing_spaces() -> None:
    assert aligned([("a", "1", ""), ("bcd", "20", "x y")], right=[1]) == ["a     1", "bcd  20  x y"]
    assert aligned([]) == []


def test_texts_are_written_to_a_new_folder_as_they_are(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "out"
    files = write_texts(folder, {"b.md": "°\n", "a.csv": "1\r\n"})
    assert files == [folder / "b.md", folder / "a.csv"]
    assert [file.read_bytes() for file in files] == [b"\xc2\xb0\n", b"1\r\n"]


@pytest.mark.parametrize("cell", [None, 5, -0.25, "<0.0001", "1.5e-09"])
def test_a_column_of_numbers_is_numeric(cell: Cell) -> None:
    assert Table("t", "", ("a",), ((cell,), (1.0,))).is_numeric(0)


@pytest.mark.parametrize("cell", ["X1", "", "3 mm"])
def test_a_column_with_text_is_not_numeric(cell: Cell) -> None:
    assert not Table("t", "", ("a",), ((cell,), (1.0,))).is_numeric(0)


def test_a_column_without_numbers_is_not_numeric() -> None:
    assert not Table("t", "", ("a",), ((None,),)).is_numeric(0)
    assert not listing(("a",), [(1.0,)]).is_numeric(0)


@pytest.mark.parametrize("name", ["../up", "With Space", "UPPER", "a_b", "-a", "a.csv"])
def test_an_invalid_file_stem_is_rejected(name: str) -> None:
    with pytest.raises(ValueError, match="lower-case words with hyphens"):
        Table(name, "", ("a",), ())
    with pytest.raises(ValueError, match="lower-case words with hyphens"):
        Picture(name, "", Blank())


def test_a_picture_must_have_a_name() -> None:
    with pytest.raises(ValueError, match="lower-case words with hyphens"):
        Picture("", "", Blank())


def test_a_row_with_a_wrong_number_of_cells_is_rejected() -> None:
    with pytest.raises(ValueError, match="table t: 1 cells for 2 headings"):
        Table("t", "", ("a", "b"), ((1,),))


def test_numbers_are_rounded_and_zero_has_no_minus_sign() -> None:
    table = Table("t", "T", ("a", "b", "c", "d"), ((-0.004, -0.006, 7, float("inf")),))
    assert table.shown() == [("0.00", "-0.01", "7", "-")]


def test_nouns_follow_their_number() -> None:
    assert [counted(number, "trial") for number in (0, 1, 2)] == ["0 trials", "1 trial", "2 trials"]
