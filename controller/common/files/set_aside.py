"""Renaming of files that cannot be used, so that a start goes on and nothing is lost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path


def set_aside(path: Path, endings: Sequence[str] = ("",)) -> tuple[Path, ...]:
    """Rename a file and its companions to ``<name>.damaged-N``, and return the new paths of those that exist.

    No earlier file is replaced: N is the lowest number that none of them has.

    Args:
        path: Path of the file.
        endings: Endings of the names of the companions after that of the file, which itself has the ending "".

    Raises:
        OSError: A file cannot be renamed.
    """
    count = 1
    while any(_aside(path, count, ending).exists() for ending in endings):
        count += 1
    asides = []
    for ending in endings:
        part = path.with_name(path.name + ending)
        if part.exists():
            asides.append(part.replace(_aside(path, count, ending)))
    return tuple(asides)


def _aside(path: Path, count: int, ending: str) -> Path:
    return path.with_name(f"{path.name}.damaged-{count}{ending}")
