"""Tables of trials: what is read, and what is told by line and column."""

from __future__ import annotations

from pathlib import Path

import pytest

from plant_sim.cli.main import main
from plant_sim.study.analyse.table import read_table
from plant_sim.study.errors import StudyError

GOOD = "foam (mm),age (d),S (%)\n8,45,90\n8,55,91\n16,45,92\n16,55,95\n8,45,89\n"


def written(folder: Path, text: str | bytes) -> Path:
    """Write a table and return its path."""
    path = folder / "t.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def refused(folder: Path, text: str | bytes, capsys: pytest.CaptureFixture[str]) -> str:
    """Return the single line with which the command refuses a table, after the name of the file."""
    path = written(folder, text)
    assert main(["study", "analyse", str(path)]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert printed.err.startswith(f"{path}:")
    return printed.err.removeprefix(f"{path}:").strip()


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("16,45,92", "16,,92", "4: column age: the value is missing; complete it, or delete the line"),
        ("16,45,92", "16,n/a,92", "4: column age: the value is missing; complete it, or delete the line"),
        ("16,45,92", '16,45,"92,5"', "4: column S: '92,5' has a decimal comma; write 92.5"),
        ("16,45,92", "l6,45,92", "4: column foam: 'l6' has a letter in place of a digit; write 16"),
        ("16,45,92", "16,45,１２", "4: column S: '１２' has full-width characters; write 12"),
        ("16,45,92", "16,45,92%", "4: column S: '92%' has a unit; write 92 and the unit in the heading, as in S (%)"),
        (
            "16,45,92",
            "16,45,good",
            "4: column S: 'good' is not a number; correct it, or name a factor of names with --categorical",
        ),
        ("16,45,92", "16,45,1e999", "4: column S: is too large; write a finite number"),
        ("16,45,92", "16,45,9,2", "4: has 4 cells for 3 columns; a decimal comma, as in 1,5, ends a cell; write 1.5"),
        ("16,45,92", "16,45", "4: has 2 cells for 3 columns; complete the line"),
        ("16,45,92", "16;45;92", "4: has 1 cell for 3 columns; separate its cells with commas instead of semicolons"),
        ("age (d)", "foam", "1: column foam: occurs twice in the heading; rename one"),
        ("age (d)", "", "1: column 2: has no heading; name it"),
        ("foam (mm),age (d),S (%)\n", "", "1: column 1: the heading is a number; write the names of the columns first"),
        ("16,45,92", '16,45,"92', "4: is not CSV (unexpected end of data); correct the quotation marks"),
        ("16,45,92", "16,45,9\x1b[31m", "4: contains a control character; save it as 'CSV UTF-8 (comma delimited)'"),
    ],
)
def test_a_fault_is_told_with_line_column_and_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, complaint: str
) -> None:
    assert refused(tmp_path, GOOD.replace(old, new), capsys) == complaint


@pytest.mark.parametrize("formula", ["=1+1", "@SUM(A1)", "+cmd|' /C calc'!A0", "-2+3"])
def test_a_formula_is_neither_evaluated_nor_repeated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], formula: str
) -> None:
    complaint = refused(tmp_path, GOOD.replace("16,45,92", f"16,45,{formula}"), capsys)
    assert complaint.startswith("4: column S: begins like a formula of a spreadsheet, which is not evaluated; ")
    assert formula not in complaint
    in_heading = refused(tmp_path, GOOD.replace("age (d)", formula), capsys)
    assert in_heading.startswith("1: column 2: the heading begins like a formula")
    assert formula not in in_heading


@pytest.mark.parametrize(("separator", "word"), [(";", "semicolons"), ("\t", "tabs"), ("，", "full-width commas")])
def test_another_separator_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], separator: str, word: str
) -> None:
    complaint = refused(tmp_path, GOOD.replace(",", separator), capsys)
    assert complaint.startswith(f"1: column 'foam (mm)': the columns are separated by {word}; save the table with comm")


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        ("épaisseur,âge,S\n8,45,90\n".encode("latin-1"), "1: column 1: is not UTF-8, UTF-16, GBK or Shift-JIS text"),
        ("8,45,90\n8,45,é\n".encode("latin-1"), "2: column 3: is not UTF-8, UTF-16, GBK or Shift-JIS text; save"),
        (b"PK\x03\x04" + bytes(99), "1: is a workbook, not a table of text; save it as 'CSV UTF-8"),
        (b"", "1: is empty; write a heading and one line per trial"),
    ],
    ids=["latin-1", "latin-1 in the third column", "workbook", "empty"],
)
def test_another_encoding_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], data: bytes, complaint: str
) -> None:
    assert refused(tmp_path, data, capsys).startswith(complaint)


@pytest.mark.parametrize("encoding", ["gbk", "utf-16", "utf-16-le"])
def test_a_table_in_the_encoding_of_a_chinese_spreadsheet_is_read_and_the_report_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], encoding: str
) -> None:
    text = "泡沫厚度(mm),苗龄(d),成功率(%)\n8,45,90\n8,55,91\n16,45,92\n16,55,95\n8,45,89\n8,55,91.5\n"
    path = written(tmp_path, text.encode(encoding))
    table = read_table(path)
    assert [(each.name, each.unit) for each in table.columns] == [("泡沫厚度", "mm"), ("苗龄", "d"), ("成功率", "%")]
    assert main(["study", "analyse", str(path)]) == 0
    told = {"gbk": "read as GBK", "utf-16": "", "utf-16-le": "read as UTF-16 without a byte order mark"}[encoding]
    report = capsys.readouterr().out
    assert ("The file is read as" in report) == bool(told)
    assert told in report


def test_a_byte_order_mark_blank_lines_and_chinese_headings_are_read(tmp_path: Path) -> None:
    """The spreadsheet program itself writes the mark; names and units come from every usual form of a heading."""
    text = '\ufeff泡沫厚度/mm,苗龄（d）,"claw pressure, MPa",no unit\r\n8,45,0.3,1\r\n\r\n16,55,0.5,2\r\n'
    table = read_table(written(tmp_path, text))
    assert [(each.name, each.unit) for each in table.columns] == [
        ("泡沫厚度", "mm"),
        ("苗龄", "d"),
        ("claw pressure", "MPa"),
        ("no unit", "-"),
    ]
    assert table.lines == (2, 4)
    assert table.numbers(table.column("泡沫厚度", "--factors")) == [8, 16]


def test_too_large_tables_are_refused(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match="at most 10000 trials in 50 columns"):
        read_table(written(tmp_path, "a,b\n" + "1,2\n" * 10_001))
    with pytest.raises(StudyError, match="larger than 5 MB"):
        read_table(written(tmp_path, b"x" * 5_000_001))
    with pytest.raises(StudyError, match="cannot be read"):
        read_table(tmp_path / "none.csv")
