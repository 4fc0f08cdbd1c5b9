"""Folder of the files that are kept from run to run: memory, history, trends and passwords."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

IN_CHECKOUT: Final = Path("var")
"""Folder of a program that runs from a checkout, in the current folder."""
_ROOT: Final = Path(__file__).resolve().parents[3]


def state_folder() -> Path:
    """Return the folder; it need not exist.

    It is ``var`` in the current folder if the package runs from a checkout, or if the user has no home folder.
    Otherwise it is ``transplanter`` in the user's state folder, which is ``%LOCALAPPDATA%`` on Windows, and else
    ``$XDG_STATE_HOME`` or ``~/.local/state``. A relative path in these variables is ignored, as the XDG Base Directory
    Specification demands.
    """
    if (_ROOT / "pyproject.toml").is_file():
        return IN_CHECKOUT
    variable, default = ("LOCALAPPDATA", "~/AppData/Local") if os.name == "nt" else ("XDG_STATE_HOME", "~/.local/state")
    given = Path(os.environ.get(variable, ""))
    try:
        base = given if given.is_absolute() else Path(default).expanduser()
    except RuntimeError:  # a user without an entry, as in some containers
        return IN_CHECKOUT
    return base / "transplanter"
