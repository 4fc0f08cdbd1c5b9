"""Exclusive file lock that prevents two controllers from writing the same file."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Final

from filelock import BaseFileLock, FileLock, Timeout

from controller.common.errors import InputError
from controller.common.files.state_folder import state_folder

LOCK: Final = ".lock"
"""Ending of the name of the lock."""


class FileLockError(InputError):
    """Raised if a file cannot be locked; the message is one line that includes the remedy but not the file name."""


class FileInUseError(FileLockError):
    """Raised if another process holds the lock."""


def place_problem(path: Path) -> str:
    """Return the reason for which a file cannot be locked, without creating anything; empty = none known."""
    folder = path.parent
    if path.is_dir():
        return "is a folder, not a file"
    if not folder.parent.is_dir() and folder != state_folder():  # probably a typo
        return f"folder {folder.parent} does not exist; create it or choose another file"
    nearest = next(each for each in (path, *path.parents) if each.exists())
    if nearest != path and not nearest.is_dir():
        return f"{os.strerror(errno.ENOTDIR)}; choose a writable file"
    return "" if os.access(nearest, os.W_OK) else f"{os.strerror(errno.EACCES)}; choose a writable file"


def lock_file(path: Path) -> BaseFileLock:
    """Lock a file for this process; the operating system releases the lock when the process ends.

    Args:
        path: File to lock. It need not exist. Its folder is created if missing; the parent of that folder must exist,
            unless it is that of `state_folder`. The lock is a separate file in the same folder, `<name>.lock`.

    Returns:
        The lock, to be released with `release`.

    Raises:
        FileInUseError: Another process holds the lock.
        FileLockError: The path is a folder or cannot be written.
    """
    if problem := place_problem(path):
        raise FileLockError(problem)
    # History and retentive memory are not always closed by the thread that opened them.
    lock = FileLock(path.with_name(path.name + LOCK), timeout=0, thread_local=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise FileInUseError("in use by another controller; stop that controller or choose another file") from None
    except OSError as error:
        raise FileLockError(f"{error.strerror}; choose a writable file") from error
    return lock
