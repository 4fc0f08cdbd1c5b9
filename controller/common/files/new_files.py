"""Files of a start, which leaves none of them behind if it fails."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path


class NewFiles:
    """Files and their folders that do not exist before a start."""

    def __init__(self, paths: Iterable[Path]) -> None:
        """Note which of the files and of their folders are absent."""
        paths = list(paths)
        self._files = [path for path in paths if not path.exists()]
        self._folders = {folder for path in paths for folder in path.parents if not folder.exists()}

    def remove(self) -> None:
        """Remove the noted files, and the noted folders that are empty; what cannot be removed is left."""
        for path in self._files:
            with suppress(OSError):
                path.unlink()
        for folder in sorted(self._folders, reverse=True):  # a folder comes after those that it contains
            with suppress(OSError):  # not empty
                folder.rmdir()
