"""Data files of the papers: notes, coding, and rejection of damaged files."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.common.errors import InputError
from plant_sim.common.paper_sheet import DATA, cabbage_coding, read_sheet, sheet

NOTE = "# [P] Table 9 (section 9.9): of nothing."


@pytest.mark.parametrize("path", sorted(DATA.glob("*.csv")), ids=lambda path: path.stem)
def test_every_file_names_its_paper_and_table(path: Path) -> None:
    notes = " ".join(read_sheet(path).notes)
    assert notes.startswith(("[P]", "[K]"))
    assert any(word in notes for word in ("Table", "section", "[X]"))


def test_the_coding_of_the_cabbage_trial() -> None:
    assert cabbage_coding() == ((1.75, 0.15), (58.0, 1.0), (104.62, 8.79))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a,b\n1,2\n", "requires a line '# paper, table'"),
        (f"{NOTE}\na,b\n", "a heading and rows"),
        (f"{NOTE}\na,b\n1,2\n\n3\n", "line 5: 1 cells, but the heading has 2"),
        (f"{NOTE}\na,b\n1,2\n3,4,5\n", "line 4: 3 cells, but the heading has 2"),
    ],
)
def test_a_damaged_file_is_rejected(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=says) as error:
        read_sheet(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("cell", ["", "1,5", "high", "nan", "inf"])
def test_a_non_numeric_cell_is_rejected_with_its_line(tmp_path: Path, cell: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f'{NOTE}\na,b\n1,2\n3,"{cell}"\n', encoding="utf-8")
    with pytest.raises(InputError, match="line 4: b is"):
        read_sheet(path).numbers("b")


def test_a_missing_column_or_file_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has no column 'Z'; it has run, X1, X2, X3, S"):
        sheet("pepper-table-4").texts("Z")
    with pytest.raises(InputError, match="cannot be read"):
        read_sheet(tmp_path / "none.csv")
