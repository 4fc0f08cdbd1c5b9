"""Tables and equations printed in the two papers, stored as data files.

[P] is the pepper paper, [K] the cabbage paper; [X] marks computed values that are not printed. Every file in
``paper_data`` begins with lines that state its paper, table and section.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.common.errors import InputError

DATA: Final = Path(__file__).with_name("paper_data")

_DIGITS = 9
"""Decimal places to which a difference of printed numbers is rounded."""


@dataclass(frozen=True)
class Sheet:
    """Data file.

    Attributes:
        path: Path of the file.
        notes: Leading lines: paper, table, section, remarks.
        heading: Names of the columns.
        rows: Cells as text, row by row.
        lines: Line number of each row.
    """

    path: Path
    notes: tuple[str, ...]
    heading: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]

    def texts(self, column: str) -> tuple[str, ...]:
        """Return a column as text.

        Raises:
            InputError: The column is missing.
        """
        if column not in self.heading:
            raise InputError(f"{self.path}: has no column {column!r}; it has {', '.join(self.heading)}")
        index = self.heading.index(column)
        return tuple(row[index] for row in self.rows)

    def numbers(self, column: str) -> NDArray[np.float64]:
        """Return a column of numbers.

        Raises:
            InputError: The column is missing, or a cell is not a number.
        """
        return np.array([self._number(row, column, text) for row, text in enumerate(self.texts(column))])

    def optional_numbers(self, column: str) -> tuple[float | None, ...]:
        """Return a column of numbers with empty cells as None.

        Raises:
            InputError: The column is missing, or a cell is neither empty nor a number.
        """
        texts = enumerate(self.texts(column))
        return tuple(self._number(row, column, text) if text else None for row, text in texts)

    def points(self, *columns: str) -> NDArray[np.float64]:
        """Return numeric columns as an array with one row per point."""
        return np.column_stack([self.numbers(column) for column in columns])

    def _number(self, row: int, column: str, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        if not np.isfinite(value):
            where = f"{self.path}, line {self.lines[row]}"
            raise InputError(f"{where}: {column} is {text!r}, not a number; enter the number printed in the paper")
        return value


def read_sheet(path: Path) -> Sheet:
    """Read a data file: lines of notes starting with ``#``, a heading, and rows with the same number of cells.

    Raises:
        InputError: The file cannot be read, notes or heading are missing, or a row is too short or too long.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); reinstall the package") from None
    notes = tuple(line.removeprefix("#").strip() for line in lines if line.startswith("#"))
    cells = [
        (number, tuple(cell.strip() for cell in next(csv.reader([line]))))
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not notes or len(cells) < 2:
        raise InputError(f"{path}: requires a line '# paper, table', a heading and rows")
    (_, heading), *rows = cells
    for number, row in rows:
        if len(row) != len(heading):
            raise InputError(
                f"{path}, line {number}: {len(row)} cells, but the heading has {len(heading)}; correct the row"
            )
    return Sheet(path, notes, heading, tuple(row for _, row in rows), tuple(number for number, _ in rows))


def sheet(name: str) -> Sheet:
    """Return the data file with the given name, such as ``pepper-table-4``."""
    return read_sheet(DATA / f"{name}.csv")


def equation(name: str, response: str) -> dict[str, float]:
    """Return the coefficients of a printed equation, such as ``pepper-equation-5``, by term."""
    printed = sheet(name)
    return dict(zip(printed.texts("term"), map(float, printed.numbers(response)), strict=True))


def cabbage_coding() -> tuple[tuple[float, float], ...]:
    """Return the centre and step of each factor of the cabbage trial: speed, km/h; frequency, 1/min; plate force, N.

    Source: [K] Table 1, levels with codes 0 and 1.
    """
    coding = sheet("cabbage-table-1")
    levels = coding.points("speed_km_h", "frequency_per_min", "force_n")
    codes = coding.numbers("code").tolist()
    centres, ones = levels[codes.index(0.0)].tolist(), levels[codes.index(1.0)].tolist()
    return tuple((centre, round(one - centre, _DIGITS)) for centre, one in zip(centres, ones, strict=True))
