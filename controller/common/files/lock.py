"""Exclusive file lock that prevents two controllers from writing the same file."""

from __future__ import annotations

from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from controller.common.errors import InputError


class FileLockError(InputError):
    """Raised if a file cannot be locked; the message is one line that includes the remedy but not the file name."""


def lock_file(path: Path) -> BaseFileLock:
    """Lock a file for this process; the operating system releases the lock when the process ends.

    Args:
        path: File to lock. It need not exist. Its folder is created if missing; the parent of that folder must exist.
            The lock is a separate file in the same folder, `<name>.lock`.

    Returns:
        The lock, to be released with `release`.

    Raises:
        FileLockError: The path is a folder or cannot be written, or another process holds the lock.
    """
    if path.is_dir():
        raise FileLockError("is a folder, not a file")
    if not path.parent.parent.is_dir():  # probably a typo
        raise FileLockError(f"folder {path.parent.parent} does not exist; create it or choose another file")
    # History and retentive memory are not always closed by the thread that opened them.
    lock = FileLock(path.with_name(path.name + ".lock"), timeout=0, thread_local=False)
    try:
        path.parent.mkdir(exist_ok=True)
        lock.acquire()
    except Timeout:
        raise FileLockError("in use by another controller; stop that controller or choose another file") from None
    except OSError as error:
        raise FileLockError(f"{error.strerror}; choose a writable file") from error
    return lock
