"""Parts of a document: headings, commands, tables and pictures; a paragraph is a text."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, Protocol

Cell = str | int | float | None

PICTURE_FORMATS: Final = ("png", "svg")
"""File formats of a picture by default."""

_NAME = re.compile("[a-z0-9]+(-[a-z0-9]+)*")
_NUMBER = re.compile(r"[<>]?[+-]?\d+(\.\d+)?(e[+-]?\d+)?")


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading in a document; in HTML, a cell of a table can link to it.

    Attributes:
        text: Text of the heading.
        level: Level, 1 for the title.
    """

    text: str
    level: int = 2

    @property
    def anchor(self) -> str:
        """Identifier of the heading in HTML: its letters and digits with hyphens."""
        return re.sub(r"\W+", "-", self.text.lower()).strip("-")


@dataclass(frozen=True, slots=True)
class ShellCommand:
    """Command for a shell.

    Attributes:
        text: The command, as typed.
    """

    text: str


@dataclass(frozen=True, slots=True)
class Table:
    """Table, with a CSV file if it has a name.

    Attributes:
        name: File stem, lower-case words with hyphens; empty for a table without a file and a caption, whose columns
            are all left-aligned.
        caption: Caption, with the source of third-party data.
        heading: Name and unit of each column.
        rows: Cells, row by row; None for an empty cell.
        digits: Number of decimals displayed for a float; the CSV contains all digits.
        headings: Heading of the document to which the first cell of each row links in HTML, row by row, None for no
            link; empty for a table without links.
        strong: Texts of the cells that are emphasised in HTML.
    """

    name: str
    caption: str
    heading: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    digits: int = 2
    headings: tuple[Heading | None, ...] = ()
    strong: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the name, the length of every row, and the number of links."""
        if self.name:
            _require_stem(self.name)
        if self.headings and len(self.headings) != len(self.rows):
            raise ValueError(f"table {self.name}: {len(self.headings)} headings for {len(self.rows)} rows")
        for row in self.rows:
            if len(row) != len(self.heading):
                raise ValueError(f"table {self.name}: {len(row)} cells for {len(self.heading)} headings: {row}")

    def shown(self) -> list[tuple[str, ...]]:
        """Return the rows as formatted text."""
        return [tuple(_shown(cell, self.digits) for cell in row) for row in self.rows]

    def is_numeric(self, column: int) -> bool:
        """Return whether a column contains only numbers and is right-aligned; ``<0.0001`` counts as a number."""
        cells = [row[column] for row in self.rows if row[column] is not None]
        return bool(self.name and cells) and all(not isinstance(cell, str) or _NUMBER.fullmatch(cell) for cell in cells)


class Drawing(Protocol):
    """Drawing that writes itself to a file, such as a figure of Matplotlib."""

    def savefig(self, *args: Any, **options: Any) -> object:
        """Write the drawing to a file, in the format of its suffix."""


@dataclass(frozen=True, slots=True)
class Picture:
    """Picture, with a file in each of its formats and its data as CSV.

    Attributes:
        name: File stem, lower-case words with hyphens.
        caption: Caption.
        figure: Its drawing.
        formats: File formats.
    """

    name: str
    caption: str
    figure: Drawing
    formats: tuple[str, ...] = PICTURE_FORMATS

    @property
    def data_file(self) -> str:
        """File with the data of the drawing."""
        return f"{self.name}.data.csv"

    def shown_file(self, *preferred: str) -> str:
        """Return the file to show on a page: in the first of the preferred formats that exists, else in any format."""
        return f"{self.name}.{next((each for each in preferred if each in self.formats), self.formats[0])}"

    def __post_init__(self) -> None:
        """Check the name."""
        _require_stem(self.name)


@dataclass(frozen=True, slots=True)
class InlineDrawing:
    """Drawing inside an HTML page, without a file; other forms of the document contain only its caption.

    Attributes:
        caption: Caption.
        svg: Text of the SVG.
    """

    caption: str
    svg: str


Part = str | Heading | ShellCommand | Table | Picture | InlineDrawing


def listing(heading: Iterable[str], rows: Iterable[Iterable[object]]) -> Table:
    """Return a table of texts, without a file and a caption."""
    return Table("", "", tuple(heading), tuple(tuple(map(str, row)) for row in rows))


def is_stem(name: str) -> bool:
    """Return whether a name consists of lower-case words with hyphens, as required for the files of a document."""
    return _NAME.fullmatch(name) is not None


def counted(number: int, what: str) -> str:
    """Return a number followed by its noun in the singular or plural.

    >>> counted(1, "trial"), counted(5, "trial")
    ('1 trial', '5 trials')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"


def _require_stem(name: str) -> None:
    if not is_stem(name):
        raise ValueError(f"{name!r}: the name of a table or picture must consist of lower-case words with hyphens")


def _shown(cell: Cell, digits: int) -> str:
    if cell is None:
        return "-"
    if isinstance(cell, float):
        return f"{cell:z.{digits}f}" if math.isfinite(cell) else "-"
    return str(cell)
