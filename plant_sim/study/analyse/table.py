"""Reader of a CSV table of trials: every fault is told with its line and column, and no cell is ever evaluated."""

from __future__ import annotations

import csv
import io
import itertools
import math
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.common.document.parts import counted
from controller.common.files.text_encoding import EncodingError, FileText, file_text
from plant_sim.study.errors import StudyError

MOST_TRIALS: Final = 10_000
MOST_COLUMNS: Final = 50
_MOST_BYTES = 5_000_000
_MOST_CHARACTERS = 200
"""Longest cell."""

_ENDING = re.compile(r"(.+?)\s*(?:[(\[（【]\s*([^()\[\]（）【】]+?)\s*[)\]）】]|[,，]\s*(\S+))")
_SLASH = re.compile(r"(.+?)\s*/\s*(%|mm|cm|m|kPa|MPa|Pa|bar|N|s|ms|min|h|d|°C|℃|°|g|kg|r/min|km/h|m/s|1/min|次/min|株)")
_FORMULA: Final = ("=", "+", "@", "\t", "\r")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+")
_LETTERS_FOR_DIGITS: Final = str.maketrans("lIoO", "1100")
_MISSING: Final = frozenset({"", "-", "--", "/", "na", "n/a", "nan", "null", "none", "?", "缺", "无", "—", "——"})


@dataclass(frozen=True, slots=True)
class TrialColumn:
    """Column of a table.

    Attributes:
        name: Name, without the unit.
        unit: Unit, ``-`` if there is none.
        cells: Text of each trial.
    """

    name: str
    unit: str
    cells: tuple[str, ...]


@dataclass(frozen=True)
class TrialTable:
    """Table of trials as text.

    Attributes:
        path: Path of the file.
        columns: Columns.
        lines: Line of the file of each trial.
        notes: Assumptions about the encoding of the file.
    """

    path: Path
    columns: tuple[TrialColumn, ...]
    lines: tuple[int, ...]
    notes: tuple[str, ...] = ()

    def column(self, name: str, option: str) -> TrialColumn:
        """Return a column by its name, with or without its unit.

        Args:
            name: Name.
            option: Option that names the column, for the message.

        Raises:
            StudyError: There is no such column.
        """
        for column in self.columns:
            if name in (column.name, f"{column.name} ({column.unit})", f"{column.name} [{column.unit}]"):
                return column
        known = ", ".join(column.name for column in self.columns)
        raise StudyError(f"{option} {name}: is not a column of {self.path}; use some of {known}")

    def numbers(self, column: TrialColumn) -> list[float]:
        """Return the numbers of a column.

        Raises:
            StudyError: A cell is not a number.
        """
        return [self._number(line, column, cell) for line, cell in zip(self.lines, column.cells, strict=True)]

    def counts(self, column: TrialColumn) -> list[int]:
        """Return the whole numbers of a column, 0 or more.

        Raises:
            StudyError: A cell is not such a number.
        """
        values = self.numbers(column)
        for line, value in zip(self.lines, values, strict=True):
            if value < 0 or not value.is_integer():
                raise self.error(line, column, f"{value:g} is not a count; write a whole number, 0 or more")
        return [int(value) for value in values]

    def texts(self, column: TrialColumn) -> list[str]:
        """Return the labels of a column.

        Raises:
            StudyError: A cell is missing or could be a formula of a spreadsheet.
        """
        return [self._label(line, column, cell) for line, cell in zip(self.lines, column.cells, strict=True)]

    def error(self, line: int, column: TrialColumn | str, problem: str) -> StudyError:
        """Return the error of one cell."""
        name = column if isinstance(column, str) else column.name
        return StudyError(f"{self.path}:{line}: column {name}: {problem}")

    def is_numeric(self, column: TrialColumn) -> bool:
        """Return whether most cells of a column are numbers, mistyped or missing; the others are then typing errors."""
        numeric = sum(_is_meant_as_number(cell) or cell.lower() in _MISSING for cell in column.cells)
        return 2 * numeric > len(column.cells)

    @staticmethod
    def is_number(cell: str) -> bool:
        """Return whether a cell is a number."""
        return _NUMBER.fullmatch(cell) is not None

    def _number(self, line: int, column: TrialColumn, cell: str) -> float:
        if _NUMBER.fullmatch(cell):
            value = float(cell)
            if math.isfinite(value):
                return value
            raise self.error(line, column, "is too large; write a finite number")
        raise self.error(line, column, _complaint(cell))

    def _label(self, line: int, column: TrialColumn, cell: str) -> str:
        if cell.lower() in _MISSING:
            raise self.error(line, column, "the value is missing; complete it, or delete the line")
        if cell.startswith(_FORMULA):
            raise self.error(line, column, _FORMULA_COMPLAINT)
        return cell


_FORMULA_COMPLAINT: Final = (
    "begins like a formula of a spreadsheet, which is not evaluated; paste its value instead of the formula"
)


def _complaint(cell: str) -> str:
    """Return why a cell is not a number, and the remedy; a formula is not repeated."""
    if cell.lower() in _MISSING:
        return "the value is missing; complete it, or delete the line"
    if cell.startswith((*_FORMULA, "-")):
        return _FORMULA_COMPLAINT
    if _DECIMAL_COMMA.fullmatch(cell):
        return f"{cell!r} has a decimal comma; write {cell.replace(',', '.')}"
    narrow = unicodedata.normalize("NFKC", cell)
    if narrow != cell and _NUMBER.fullmatch(narrow):
        return f"{cell!r} has full-width characters; write {narrow}"
    digits = cell.translate(_LETTERS_FOR_DIGITS)
    if digits != cell and _NUMBER.fullmatch(digits):
        return f"{cell!r} has a letter in place of a digit; write {digits}"
    if cell.endswith("%") and _NUMBER.fullmatch(cell[:-1].strip()):
        return f"{cell!r} has a unit; write {cell[:-1].strip()} and the unit in the heading, as in S (%)"
    return f"{cell!r} is not a number; correct it, or name a factor of names with --categorical"


def _is_meant_as_number(cell: str) -> bool:
    """Return whether a cell is a number, also one that `_complaint` would correct.

    >>> [_is_meant_as_number(cell) for cell in ("1.5", "1,5", "１２", "l6", "92%", "=A1+1", "K326", "II")]
    [True, True, True, True, True, True, False, False]
    """
    if cell.startswith((*_FORMULA, "-")):
        return True
    narrow = unicodedata.normalize("NFKC", cell).removesuffix("%").strip().replace(",", ".")
    has_digit = any(character.isdigit() for character in narrow)
    return has_digit and _NUMBER.fullmatch(narrow.translate(_LETTERS_FOR_DIGITS)) is not None


def read_table(path: Path) -> TrialTable:
    """Read a table of trials: a heading, then one line per trial, with commas, in an encoding of `file_text`.

    Args:
        path: Path of the CSV file.

    Raises:
        StudyError: The file cannot be read, or is not such a table; the message states line, column and remedy.
    """
    decoded = _text(path)
    text = decoded.text
    _check_separator(path, text)
    records = _records(path, text)
    heading_line, heading = records[0]
    names = [_name(path, heading_line, number, cell) for number, cell in enumerate(heading, 1)]
    for number, (name, _) in enumerate(names):
        if name in [other for other, _ in names[:number]]:
            raise StudyError(f"{path}:{heading_line}: column {name}: occurs twice in the heading; rename one")
    rows = records[1:]
    if len(rows) < 2:
        raise StudyError(f"{path}: has {counted(len(rows), 'trial')}; write a heading and at least two lines")
    if len(rows) > MOST_TRIALS or len(names) > MOST_COLUMNS:
        raise StudyError(
            f"{path}: has {len(rows)} trials in {len(names)} columns; "
            f"at most {MOST_TRIALS} trials in {MOST_COLUMNS} columns are read; divide the table"
        )
    for line, row in rows:
        if len(row) != len(names):
            hint = _comma_hint(row) if len(row) > len(names) else _short_hint(row)
            raise StudyError(f"{path}:{line}: has {counted(len(row), 'cell')} for {len(names)} columns; {hint}")
    columns = zip(names, zip(*(row for _, row in rows), strict=True), strict=True)
    return TrialTable(
        path,
        tuple(TrialColumn(name, unit, cells) for (name, unit), cells in columns),
        tuple(line for line, _ in rows),
        decoded.notes,
    )


def _text(path: Path) -> FileText:
    """Return the text of the file."""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}); specify a CSV file") from None
    save = "save it as 'CSV UTF-8 (comma delimited)'"
    if len(data) > _MOST_BYTES:
        raise StudyError(f"{path}: is larger than {_MOST_BYTES // 1_000_000} MB; divide the table")
    if data.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise StudyError(f"{path}:1: is a workbook, not a table of text; {save} in the spreadsheet program")
    try:
        decoded = file_text(data)
    except EncodingError as error:
        column = data.split(b"\n")[error.line - 1][: error.column - 1].count(b",") + 1
        reason = str(error).partition(";")[0]
        raise StudyError(f"{path}:{error.line}: column {column}: is {reason}; {save}") from None
    control = re.search(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]", decoded.text)
    if control is not None:
        line = decoded.text.count("\n", 0, control.start()) + 1
        raise StudyError(f"{path}:{line}: contains a control character; {save}")
    return decoded


def _check_separator(path: Path, text: str) -> None:
    """Check that the cells of the heading are separated by commas."""
    number, heading = next(((n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()), (1, ""))
    if not heading:
        raise StudyError(f"{path}:{number}: is empty; write a heading and one line per trial")
    for separator, word in ((";", "semicolons"), ("\t", "tabs"), ("，", "full-width commas"), ("；", "semicolons")):
        if separator in heading and heading.count(separator) > heading.count(","):
            first = heading.split(separator)[0].strip().strip('"')
            decimal = " and decimal points" if separator == ";" else ""
            raise StudyError(
                f"{path}:{number}: column {first[:_MOST_CHARACTERS]!r}: the columns are separated by {word}; "
                f"save the table with commas{decimal}"
            )


def _records(path: Path, text: str) -> list[tuple[int, list[str]]]:
    """Return the lines that are not blank, each with its number and its cells."""
    reader = csv.reader(io.StringIO(text), strict=True)
    records: list[tuple[int, list[str]]] = []
    line = 1
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells):
                _check_cells(path, line, cells)
                records.append((line, cells))
            line = reader.line_num + 1
    except csv.Error as error:
        raise StudyError(f"{path}:{line}: is not CSV ({error}); correct the quotation marks") from None
    return records


def _check_cells(path: Path, line: int, cells: Sequence[str]) -> None:
    for number, cell in enumerate(cells, 1):
        if len(cell) > _MOST_CHARACTERS or "\n" in cell:
            raise StudyError(f"{path}:{line}: column {number}: the cell is too long or has a line break; shorten it")


def _name(path: Path, line: int, number: int, cell: str) -> tuple[str, str]:
    """Return name and unit of a heading: ``name (unit)``, ``name [unit]``, ``name, unit`` or ``name/unit``.

    >>> _name(Path("t.csv"), 1, 1, "foam thickness (mm)"), _name(Path("t.csv"), 1, 2, "压力/MPa")
    (('foam thickness', 'mm'), ('压力', 'MPa'))
    """
    if not cell:
        raise StudyError(f"{path}:{line}: column {number}: has no heading; name it")
    if cell.startswith((*_FORMULA, "-")):
        raise StudyError(f"{path}:{line}: column {number}: the heading {_FORMULA_COMPLAINT}")
    if not cell.isprintable():
        raise StudyError(f"{path}:{line}: column {number}: the heading has invisible characters; type it again")
    if _NUMBER.fullmatch(cell):
        raise StudyError(
            f"{path}:{line}: column {number}: the heading is a number; write the names of the columns first"
        )
    match = _ENDING.fullmatch(cell)
    if match is not None:
        return match[1], match[2] or match[3]
    match = _SLASH.fullmatch(cell)
    return (match[1], match[2]) if match is not None else (cell, "-")


def _short_hint(row: Sequence[str]) -> str:
    """Return the remedy for a line with too few cells."""
    return "separate its cells with commas instead of semicolons" if ";" in row[0] else "complete the line"


def _comma_hint(row: Iterable[str]) -> str:
    """Return the remedy for a line with too many cells."""
    if any(_is_split_number(pair) for pair in itertools.pairwise(row)):
        return "a decimal comma, as in 1,5, ends a cell; write 1.5"
    return "put a text with a comma in quotation marks"


def _is_split_number(pair: tuple[str, str]) -> bool:
    return all(cell.isdecimal() for cell in pair)
