"""Folders and files that other users of the computer could have written or read.

On Windows, only the place of a folder is checked: it must be in the profile of the user, which other users cannot write
by default. Access control lists are not read, and secrets are not checked.
"""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import stat
import tempfile
from functools import cache
from pathlib import Path
from typing import Final

_PRIVATE: Final = "SEEDLING_TRANSPLANTER_PRIVATE_CACHE"
"""Environment variable that tells child processes the private folder of their parent."""
_BELONGS: Final = "belongs to another user; choose another folder"
_WRITABLE: Final = "other users can write it; run chmod go-w on it"

_log = logging.getLogger(__name__)


def exposure(path: Path) -> str | None:
    """Return how another user could replace a file or the content of a folder, with the remedy; None if nobody can.

    The path and all folders above it must belong to this user or to the administrator, and only the owner, or a group
    of that user alone, may write them. In a folder above that has the sticky bit, such as ``/tmp``, others cannot
    replace what belongs to the user.

    Args:
        path: File or folder; what does not exist yet is not checked.
    """
    if not hasattr(os, "geteuid"):
        in_profile = path.resolve().is_relative_to(Path.home().resolve())
        return None if in_profile else f"{path}: outside the profile of the user; choose another folder"
    given, real = path.absolute(), Path(os.path.realpath(path))
    for each in dict.fromkeys((given, *given.parents, real, *real.parents)):
        try:
            status = each.lstat()
        except FileNotFoundError:
            continue
        if not _is_own(status):
            return f"{each}: {_BELONGS}"
        sticky = each not in {given, real} and status.st_mode & stat.S_ISVTX
        if _others_write(status) and not sticky and not stat.S_ISLNK(status.st_mode):
            return f"{each}: {_WRITABLE}"
    return None


def secret_exposure(path: Path) -> str | None:
    """Return how another user could read or replace a secret, with the remedy; None if nobody can.

    A secret of the administrator may be readable by a group, which is how a service is given one.

    Raises:
        OSError: The file or a folder above it cannot be examined.
    """
    if not hasattr(os, "geteuid"):
        return None
    problem = exposure(path)
    if problem is not None or not path.exists():
        return problem
    status = path.stat()
    others = stat.S_IRWXG | stat.S_IRWXO
    if status.st_uid == 0 != os.geteuid():
        others &= ~stat.S_IRGRP
    return f"{path}: accessible to other users; run chmod 600 on it" if status.st_mode & others else None


def trusted_folder(base: Path, name: str) -> Path:
    """Return a folder for machine code that no other user can have written; it is created if it does not exist.

    If another user could write the folder, one line reports it, and a private folder takes its place: it exists until
    this process ends, and child processes use it too.

    Args:
        base: Folder of the cache.
        name: Name of the folder in it.

    Raises:
        OSError: The folder cannot be created.
    """
    folder = base / name
    problem = exposure(folder)
    if problem is None:
        _make(folder)
        problem = exposure(folder) or _foreign_content(folder)
    if problem is None:
        return folder
    private = _private_folder()
    _report(problem, private)
    (private / name).mkdir(mode=0o700, exist_ok=True)
    return private / name


def _is_own(status: os.stat_result) -> bool:
    return status.st_uid in {0, os.geteuid()}


def _others_write(status: os.stat_result) -> bool:
    """Return whether the mode lets other users write; the members of the private group of this user are no others."""
    if status.st_mode & stat.S_IWGRP and status.st_gid != _private_group():
        return True
    return bool(status.st_mode & stat.S_IWOTH)


@cache
def _private_group() -> int | None:
    """Return the group of this user alone, by which many systems make new files writable; None if there is none."""
    import grp  # noqa: PLC0415 - absent on Windows
    import pwd  # noqa: PLC0415

    try:
        user = pwd.getpwuid(os.geteuid())
        group = grp.getgrgid(user.pw_gid)
    except KeyError:  # a user without an entry, as in some containers
        return None
    is_private = group.gr_name == user.pw_name and {*group.gr_mem} <= {user.pw_name}
    return group.gr_gid if is_private else None


def _foreign_content(folder: Path) -> str | None:
    """Return how the content of a folder was exposed earlier."""
    if not hasattr(os, "geteuid"):
        return None
    reachable = folder.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO)
    for path in folder.rglob("*"):
        status = path.lstat()
        if not _is_own(status) or stat.S_ISLNK(status.st_mode) or (reachable and _others_write(status)):
            return f"{path}: another user can have written it; delete it"
    return None


def _make(folder: Path) -> None:
    """Create a folder and the missing ones above it, whatever the file mode mask is, for this user alone."""
    for each in (*reversed(folder.parents), folder):
        if not each.is_dir():
            each.mkdir(mode=0o700, exist_ok=True)


@cache
def _private_folder() -> Path:
    inherited = Path(os.environ.get(_PRIVATE, ""))
    if inherited.is_absolute() and inherited.is_dir() and exposure(inherited) is None:
        return inherited
    folder = Path(tempfile.mkdtemp(prefix="seedling-transplanter-"))
    os.environ[_PRIVATE] = str(folder)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@cache
def _report(problem: str, private: Path) -> None:
    """Report a folder once; a child process has the private folder from its parent, which has reported it."""
    _log.warning("%s: machine code in it is not used, but compiled in %s", problem, private)
