"""Files of a page: its own, those that all pages share, and the files of others that the build makes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from starlette.routing import Mount
from starlette.staticfiles import StaticFiles

_SHARED: Final = Path(__file__).parent / "static"
_FOREIGN: Final = Path(__file__).parents[1] / "panel/static/foreign"
"""Fonts and charts, made by `scripts/foreign_files.py`."""


def static_routes(folder: Path, below: str = "/static") -> list[Mount]:
    """Return the routes of the files of a page.

    Args:
        folder: Folder of its own files, which have priority.
        below: Path below which they are served.
    """
    files = StaticFiles(directory=folder)
    files.all_directories.append(_SHARED)
    foreign = [Mount(f"{below}/foreign", StaticFiles(directory=_FOREIGN))] if _FOREIGN.is_dir() else []
    return [*foreign, Mount(below, files)]
