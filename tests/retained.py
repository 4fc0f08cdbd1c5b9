"""Options of a controller for its memory file."""

from __future__ import annotations

from pathlib import Path

from controller.core.retentive_store import MARK


def retained(path: Path) -> list[str]:
    """Return the options for a memory file; without one, the machine is declared as new."""
    is_new = not (path.exists() or path.with_name(path.name + MARK).exists())
    return ["--retain", str(path), *(["--new-machine"] if is_new else [])]
