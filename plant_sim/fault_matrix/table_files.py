"""Tables of fault cases as Markdown, CSV and JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from controller.common.document.parts import Part
from plant_sim.common.provenance.provenance import Provenance
from plant_sim.common.provenance.result_files import ResultFiles

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


def cells(records: Iterable[Record], columns: Sequence[str]) -> list[list[object]]:
    """Return the cells of every case in CSV; lists are separated by semicolons."""
    return [[_cell(record[name]) for name in columns] for record in records]


def write_table(
    stem: Path,
    title: str,
    parts: Iterable[Part],
    records: Sequence[Record],
    columns: Sequence[str],
    *,
    provenance: Provenance | None,
) -> list[Path]:
    """Write a page with a table, and its cases, to the files of a stem; return the files.

    Raises:
        InputError: The folder is not writable.
    """
    files = ResultFiles(stem.parent, provenance)
    files.markdown(f"{stem.name}.md", title, parts, is_literal=False)
    files.csv(f"{stem.name}.csv", columns, cells(records, columns))
    files.json(f"{stem.name}.json", {"cases": records}, indent=1)
    return files.finish()


def _cell(value: object) -> object:
    return "; ".join(value) if isinstance(value, list) else value
