"""Rows of the history as a table to read, as CSV, JSON or Parquet: the same rows and columns in each."""

from __future__ import annotations

import csv
import importlib
import json
import unicodedata
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Final

from controller.hmi.history_query import Record, unfolded
from controller.hmi.history_schema import COMMON, TABLES, HistoryError

Pages = Iterator[list[Record]]

_HIDDEN: Final = {"edges", "key"}
"""Not for the eye."""
_LAST: Final = ("text", "result", "detail")
"""Free texts: behind the other columns."""


def local_time(utc_ms: int) -> str:
    """Return an instant of the wall clock as local date and time."""
    return datetime.fromtimestamp(utc_ms / 1000, UTC).astimezone().strftime("%Y-%m-%d %H:%M:%S")


def write_text(table: str, pages: Pages, file: IO[str]) -> None:
    """Write a table with columns one below the other, times local."""
    own = [name for name in TABLES[table] if name not in {*COMMON, *_HIDDEN, *_LAST}]
    names = ["run", *own, *(name for name in _LAST if name in TABLES[table])]
    lines = [["time", *names]]
    lines += [
        [local_time(int(str(row["utc_ms"]))), *(printable(row[name]) for name in names)]
        for page in pages
        for row in page
    ]
    widths = [max(map(columns, cells)) for cells in zip(*lines, strict=True)]
    for cells in lines:
        padded = [cell + " " * (width - columns(cell)) for cell, width in zip(cells, widths, strict=True)]
        file.write("  ".join(padded).rstrip() + "\n")


def write_csv(table: str, pages: Pages, file: IO[str]) -> None:
    """Write a header and a line for each row; what is not there is empty, JSON is text."""
    writer = csv.DictWriter(file, list(TABLES[table]), lineterminator="\n")
    writer.writeheader()
    for page in pages:
        writer.writerows(page)


def write_json(table: str, pages: Pages, file: IO[str]) -> None:  # noqa: ARG001 - one form for all writers
    """Write one list with an object for each row, each on a line."""
    between = "[\n"
    for page in pages:
        for row in page:
            file.write(between + json.dumps(unfolded(row), ensure_ascii=False))
            between = ",\n"
    file.write("[]\n" if between == "[\n" else "\n]\n")


WRITERS: Final[dict[str, Callable[[str, Pages, IO[str]], None]]] = {
    "text": write_text,
    "csv": write_csv,
    "json": write_json,
}


def write_parquet(table: str, pages: Pages, path: Path) -> None:
    """Write a Parquet file, 64-bit integers and strings; JSON is text.

    Raises:
        HistoryError: pyarrow is not installed.
        OSError: The file cannot be written.
    """
    try:
        arrow, parquet = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ModuleNotFoundError as error:
        raise HistoryError(f"no {error.name} here; install it: pip install 'seedling-transplanter[history]'") from error
    types = {"INTEGER": arrow.int64(), "TEXT": arrow.string()}
    schema = arrow.schema([(name, types[kind]) for name, kind in TABLES[table].items()])
    with parquet.ParquetWriter(path, schema) as writer:
        for page in pages:
            writer.write_table(arrow.Table.from_pylist(page, schema=schema))


def printable(value: object) -> str:
    """Return a value for a terminal: nothing in it can move the cursor."""
    if value is None or value == "{}":
        return ""
    return "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in str(value))


def columns(text: str) -> int:
    """Return the columns a text takes in a terminal; Chinese characters take two."""
    return sum(2 if unicodedata.east_asian_width(character) in "WF" else 1 for character in text)
