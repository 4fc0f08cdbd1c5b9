"""Program that is ended at each of its writes in turn: by SIGKILL, by a loss of power with all that was not synced, or
by a disk that is full from then on.

The methods of SQLite that write, truncate, sync and delete files are replaced (https://sqlite.org/c3ref/vfs.html and
https://sqlite.org/c3ref/io_methods.html). Each case runs in a fork of this process.
"""

from __future__ import annotations

import _sqlite3
import ctypes
import os
import shutil
import signal
import sqlite3
import sys
from collections.abc import Callable
from ctypes import CFUNCTYPE, POINTER, Structure, c_char_p, c_int, c_int64, c_void_p
from itertools import count
from pathlib import Path
from typing import Any, Final

from controller.history.file import HistoryFile, HistoryRow, WalBusyError
from controller.history.schema import HistoryError
from tests.controller.history.history_rig import WALL_MS

SYNCED: Final = "synced"
"""Folder of the files as they were last synced."""
ACKNOWLEDGED: Final = "acknowledged"
"""File with the number of batches whose commit has returned."""
BATCHES: Final = 4
ENDS: Final = ("killed", "killed in a write", "power lost", "disk full")
REPORTED: Final = 3
"""Exit code of a case whose error was reported."""
DAY_MS: Final = 86_400_000
LATER_MS: Final = WALL_MS + 91 * DAY_MS
"""Time of a run by which the rows of the one before are too old."""

_Open = CFUNCTYPE(c_int, c_void_p, c_void_p, POINTER(c_void_p), c_int, c_void_p)
_Delete = CFUNCTYPE(c_int, c_void_p, c_char_p, c_int)
_Write = CFUNCTYPE(c_int, c_void_p, c_void_p, c_int, c_int64)
_Truncate = CFUNCTYPE(c_int, c_void_p, c_int64)
_Sync = CFUNCTYPE(c_int, c_void_p, c_int)
_Methods = c_void_p * 19
"""Table of the methods of a file, of which the first entry is its version."""
_WRITE, _TRUNCATE, _SYNC = 3, 4, 5


class _Vfs(Structure):
    """Beginning of the structure sqlite3_vfs of SQLite."""

    _fields_ = (
        ("version", c_int),
        ("file_size", c_int),
        ("longest_path", c_int),
        ("next", c_void_p),
        ("name", c_char_p),
        ("data", c_void_p),
        ("open", c_void_p),
        ("delete", c_void_p),
    )


class CutShort:
    """Replacement of the methods that write, in the process that creates it."""

    def __init__(self, folder: Path, number: int, end: str) -> None:
        """Replace the methods.

        Args:
            folder: Folder of the database.
            number: Number of the call, from 1, in which this process ends.
            end: One of `ENDS`.
        """
        self._folder, self._number, self._end = folder, number, end
        self._calls = 0
        self._kept: list[Any] = []
        find = ctypes.CDLL(_sqlite3.__file__).sqlite3_vfs_find
        find.restype = POINTER(_Vfs)
        self._vfs: _Vfs = find(None).contents
        self._open: Any = ctypes.cast(self._vfs.open, _Open)
        self._delete: Any = ctypes.cast(self._vfs.delete, _Delete)
        self._vfs.open = self._method(_Open, self._opened)
        self._vfs.delete = self._method(_Delete, self._deleted)

    def _method(self, kind: Any, function: Callable[..., int]) -> Any:
        """Return the address of a function, which is kept."""
        self._kept.append(kind(function))
        return ctypes.cast(self._kept[-1], c_void_p).value

    def _opened(self, vfs: int, name: int | None, file: Any, flags: int, given: int) -> int:
        """Open a file, and give it a table of methods of its own; the file keeps the pointer to its name."""
        result = int(self._open(vfs, name, file, flags, given))
        if result == 0 and name is not None:
            methods = _Methods.from_buffer_copy(_Methods.from_address(file[0]))
            write: Any = _Write(methods[_WRITE] or 0)
            truncate: Any = _Truncate(methods[_TRUNCATE] or 0)
            path = Path(os.fsdecode(ctypes.string_at(name)))

            def written(handle: int, data: int, size: int, place: int) -> int:
                self._count(lambda: write(handle, data, size // 2, place))
                return sqlite3.SQLITE_FULL if self._is_full else int(write(handle, data, size, place))

            def truncated(handle: int, size: int) -> int:
                self._count()
                return int(truncate(handle, size))

            def synced(_: int, __: int) -> int:
                self._count()
                self._keep(path)
                return 0

            methods[_WRITE] = self._method(_Write, written)
            methods[_TRUNCATE] = self._method(_Truncate, truncated)
            methods[_SYNC] = self._method(_Sync, synced)
            self._kept.append(methods)
            file[0] = ctypes.addressof(methods)
        return result

    def _deleted(self, vfs: int, name: bytes, sync: int) -> int:
        self._count()
        result = int(self._delete(vfs, name, sync))
        if sync:
            (self._folder / SYNCED / Path(os.fsdecode(name)).name).unlink(missing_ok=True)
        return result

    def _keep(self, path: Path) -> None:
        """Keep a copy of a file instead of waiting for the disk."""
        (self._folder / SYNCED).mkdir(exist_ok=True)
        shutil.copyfile(path, self._folder / SYNCED / path.name)

    @property
    def _is_full(self) -> bool:
        return self._end == "disk full" and self._calls >= self._number

    def _count(self, half: Callable[[], object] = lambda: None) -> None:
        """Count a call, and end this process in it, perhaps after half of it."""
        self._calls += 1
        if self._calls < self._number or self._is_full:
            return
        if self._end == "killed in a write":
            half()
        if self._end == "power lost":
            for path in self._folder.glob("history.sqlite*"):
                path.unlink()
            for path in (self._folder / SYNCED).glob("*"):
                shutil.copyfile(path, self._folder / path.name)
        os.kill(os.getpid(), signal.SIGKILL)


def record(folder: Path) -> None:
    """Record a run by which earlier rows are too old, and note each commit."""
    file = HistoryFile(folder / "history.sqlite", 4_000_000, limit_days=90)
    for batch in range(BATCHES):
        rows = [HistoryRow("audit", LATER_MS, batch, ("p", "w", "a", str(n), "x" * 500)) for n in range(20)]
        file.append([HistoryRow("runs", LATER_MS, 0, ("p", "v")), *rows] if batch == 0 else rows)
        (folder / ACKNOWLEDGED).write_text(str(batch + 1), encoding="ascii")
    file.close()


def main(base: Path, begun: Path, end: str, every: int) -> None:
    """Repeat a run on copies of the folder `begun`, ended `every` calls later each time, until it is not ended."""
    for number in count(1, every):
        folder = base / str(number)
        shutil.copytree(begun, folder)
        if (folder / "history.sqlite").exists():  # it was synced when it was made
            shutil.copytree(begun, folder / SYNCED)
        child = os.fork()
        if child == 0:
            hook = CutShort(folder, number, end)
            try:
                record(folder)
            except (HistoryError, WalBusyError, sqlite3.Error):
                os._exit(REPORTED)
            os._exit(0 if hook else 1)
        _, status = os.waitpid(child, 0)
        if os.WIFEXITED(status) and os.WEXITSTATUS(status) != REPORTED:
            sys.exit(os.WEXITSTATUS(status))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]))
