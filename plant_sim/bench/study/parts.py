"""What the report of a study is put together from: headings, tables, pictures; a paragraph is plain text."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from matplotlib.figure import Figure

Cell = str | int | float | None

_NAME = re.compile("[a-z0-9]+(-[a-z0-9]+)*")
_NUMBER = re.compile(r"[<>]?[+-]?\d+(\.\d+)?(e[+-]?\d+)?")


@dataclass(frozen=True, slots=True)
class Heading:
    """A heading within a report.

    Attributes:
        text: What it says.
    """

    text: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table; it also becomes a CSV file.

    Attributes:
        name: Stem of its file, lower-case words with hyphens.
        caption: What it shows, with the source where figures are somebody else's.
        heading: Name and unit of each column.
        rows: Its cells; None where there is nothing to tell.
        digits: Decimals with which a float is shown; the CSV has all of them.
    """

    name: str
    caption: str
    heading: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    digits: int = 2

    def __post_init__(self) -> None:
        """Refuse a name that is no file stem and a row that does not fit the heading."""
        _require_stem(self.name)
        for row in self.rows:
            if len(row) != len(self.heading):
                raise ValueError(f"table {self.name}: {len(row)} cells under {len(self.heading)} headings: {row}")

    def shown(self) -> list[tuple[str, ...]]:
        """Return the rows as they are shown."""
        return [tuple(_shown(cell, self.digits) for cell in row) for row in self.rows]

    def is_numeric(self, column: int) -> bool:
        """Tell whether a column holds numbers, which are set flush right; ``<0.0001`` is one too."""
        cells = [row[column] for row in self.rows if row[column] is not None]
        return bool(cells) and all(not isinstance(cell, str) or _NUMBER.fullmatch(cell) for cell in cells)


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture; it becomes a PNG and an SVG file.

    Attributes:
        name: Stem of its files, lower-case words with hyphens.
        caption: What it shows.
        figure: It.
    """

    name: str
    caption: str
    figure: Figure

    def __post_init__(self) -> None:
        """Refuse a name that is no file stem."""
        _require_stem(self.name)


Part = str | Heading | Table | Picture


def is_stem(name: str) -> bool:
    """Tell whether a name is made of lower-case words with hyphens, as every file of a report is named."""
    return _NAME.fullmatch(name) is not None


def counted(number: int, what: str) -> str:
    """Return a number of things as one says it.

    >>> counted(1, "trial"), counted(5, "trial")
    ('1 trial', '5 trials')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"


def _require_stem(name: str) -> None:
    if not is_stem(name):
        raise ValueError(f"{name!r}: a table or picture is named in lower-case words with hyphens")


def _shown(cell: Cell, digits: int) -> str:
    if cell is None:
        return "-"
    if isinstance(cell, float):
        return f"{cell:z.{digits}f}" if math.isfinite(cell) else "-"
    return str(cell)
