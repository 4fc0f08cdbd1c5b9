"""Export of history rows as a text table, CSV, JSON or Parquet.

All formats contain the same rows; CSV, JSON and Parquet also contain the same columns.
"""

from __future__ import annotations

import csv
import importlib
import json
import unicodedata
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Final

from controller.common.document.rendering import csv_cell
from controller.history.query import Record, decoded
from controller.history.schema import COMMON, TABLES

Pages = Iterator[list[Record]]

_HIDDEN: Final = {"edges", "key"}
"""Columns omitted from the text table."""
_LAST: Final = ("text", "result", "detail")
"""Free-text columns, placed after the others in the text table."""


def local_time(utc_ms: int) -> str:
    """Return a wall-clock timestamp as local date and time with its UTC offset, as in 2026-05-01 06:00:01+08:00.

    The hour that is repeated when daylight saving time ends has two offsets.
    """
    return datetime.fromtimestamp(utc_ms // 1000, UTC).astimezone().isoformat(" ")


def write_text(table: str, pages: Pages, file: IO[str]) -> None:
    """Write a table with aligned columns and local times with their UTC offsets."""
    specific = [name for name in TABLES[table] if name not in {*COMMON, *_HIDDEN, *_LAST}]
    names = ["run", *specific, *(name for name in _LAST if name in TABLES[table])]
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
    """Write a header and one line per row; missing values are empty, JSON is text, no text is a formula."""
    writer = csv.DictWriter(file, list(TABLES[table]), lineterminator="\n")
    writer.writeheader()
    for page in pages:
        writer.writerows({name: csv_cell(value) for name, value in row.items()} for row in page)


def write_json(table: str, pages: Pages, file: IO[str]) -> None:  # noqa: ARG001 - common signature of all writers
    """Write one list with one object per row, each on its own line."""
    separator = "[\n"
    for page in pages:
        for row in page:
            file.write(separator + json.dumps(decoded(row), ensure_ascii=False))
            separator = ",\n"
    file.write("[]\n" if separator == "[\n" else "\n]\n")


WRITERS: Final[dict[str, Callable[[str, Pages, IO[str]], None]]] = {
    "text": write_text,
    "csv": write_csv,
    "json": write_json,
}


def write_parquet(table: str, pages: Pages, path: Path) -> None:
    """Write a Parquet file with 64-bit integers and strings; JSON is text.

    Raises:
        ModuleNotFoundError: pyarrow is not installed.
        OSError: The file cannot be written.
    """
    arrow, parquet = importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    types = {"INTEGER": arrow.int64(), "TEXT": arrow.string()}
    schema = arrow.schema([(name, types[kind]) for name, kind in TABLES[table].items()])
    with path.open("wb") as file, parquet.ParquetWriter(file, schema) as writer:
        for page in pages:
            writer.write_table(arrow.Table.from_pylist(page, schema=schema))


def printable(value: object) -> str:
    """Return a value as printable text for a terminal, without control characters."""
    if value is None or value == "{}":
        return ""
    return "".join(character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in str(value))


def columns(text: str) -> int:
    """Return the width of a text in terminal columns; Chinese characters are two columns wide."""
    return sum(2 if unicodedata.east_asian_width(character) in "WF" else 1 for character in text)
