"""Tables of fault cases as Markdown, CSV and JSON."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from controller.common.document.parts import Part
from controller.common.document.rendering import csv_text, markdown, write_texts

Record = Mapping[str, object]
"""One case as a flat record; a value may be a list of texts."""


def counted_names(names: Iterable[str]) -> str:
    """Return names with their frequencies, most frequent first."""
    return ", ".join(f"{name} {count}" for name, count in Counter(names).most_common())


def extent(numbers: Sequence[int]) -> str:
    """Return the smallest and the largest number as text, or the number if all are equal."""
    low, high = min(numbers), max(numbers)
    return f"{low}" if low == high else f"{low} to {high}"


def bullets(lines: Iterable[str]) -> str:
    """Return a Markdown list; ``None.`` if it is empty."""
    return "\n".join(f"- {line}" for line in lines) or "None."


def as_csv(records: Iterable[Record], columns: Sequence[str]) -> str:
    """Return every case as one line of CSV; lists are separated by semicolons."""
    return csv_text(columns, ([_cell(record[name]) for name in columns] for record in records))


def write_table(
    stem: Path, title: str, parts: Iterable[Part], records: Sequence[Record], columns: Sequence[str]
) -> list[Path]:
    """Write a page with a table, and its cases, to the files of a stem; return the files.

    Raises:
        OSError: The folder is not writable.
    """
    texts = {
        ".md": markdown(title, parts, is_literal=False),
        ".csv": as_csv(records, columns),
        ".json": json.dumps(records, indent=1) + "\n",
    }
    return write_texts(stem.parent, {f"{stem.name}{ending}": text for ending, text in texts.items()})


def _cell(value: object) -> object:
    return "; ".join(value) if isinstance(value, list) else value
