"""Tables of fault cases as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

Record = Mapping[str, object]
"""One case as a flat record; a value may be a list of texts."""


def markdown_table(heading: Sequence[str], rows: Iterable[Iterable[str]]) -> list[str]:
    """Return the lines of a Markdown table."""
    return [_line(cells) for cells in (heading, ["---"] * len(heading), *rows)]


def as_csv(records: Iterable[Record], columns: Sequence[str]) -> str:
    """Return every case as one line of CSV; lists are separated by semicolons."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {key: "; ".join(value) if isinstance(value, list) else value for key, value in record.items()}
        for record in records
    )
    return text.getvalue()


def write_table(
    folder: Path, name: str, markdown: str, records: Sequence[Record], columns: Sequence[str]
) -> list[Path]:
    """Write a table to a folder; return the files.

    Raises:
        OSError: The folder is not writable.
    """
    texts = {
        f"{name}.md": markdown,
        f"{name}.csv": as_csv(records, columns),
        f"{name}.json": json.dumps(records, indent=1) + "\n",
    }
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")
    return [folder / file for file in texts]


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"
