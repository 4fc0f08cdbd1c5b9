"""A file taken for one process alone, so that two controllers never write the same one."""

from __future__ import annotations

import fcntl
from pathlib import Path
from typing import TextIO


class ClaimError(ValueError):
    """The file cannot be taken; one line with the remedy, without the name of the file."""


def claim(path: Path) -> TextIO:
    """Take a file; the operating system lets it go when the process ends, or the returned lock is closed.

    Args:
        path: The file; neither it nor its folder need be there, but what the folder lies in. The lock lies beside
            it, as `<name>.lock`.

    Raises:
        ClaimError: It is a folder, cannot be written, or another process has it.
    """
    if path.is_dir():
        raise ClaimError("is a folder; name a file")
    if not path.parent.parent.is_dir():  # rather mistyped than wanted: what was kept would not be found
        raise ClaimError(f"there is no folder {path.parent.parent}; make it, or name another file")
    try:
        path.parent.mkdir(exist_ok=True)
        lock = path.with_name(path.name + ".lock").open("w", encoding="utf-8")
    except OSError as error:
        raise ClaimError(f"{error.strerror}; name a file that can be written") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        lock.close()
        raise ClaimError("another controller is using it; stop that one or name another file") from None
    return lock
