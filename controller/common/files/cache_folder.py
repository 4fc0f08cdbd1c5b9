"""Folder of cached machine code."""

from __future__ import annotations

import os
from pathlib import Path


def user_cache_folder() -> Path:
    """Return the path of ``seedling-transplanter`` in the user's cache folder; the folders need not exist.

    The user's cache folder is ``%LOCALAPPDATA%`` on Windows, otherwise ``$XDG_CACHE_HOME`` or ``~/.cache``.

    Raises:
        RuntimeError: The user has no home folder.
    """
    variable, default = ("LOCALAPPDATA", "~/AppData/Local") if os.name == "nt" else ("XDG_CACHE_HOME", "~/.cache")
    return Path(os.environ.get(variable) or default).expanduser() / "seedling-transplanter"
