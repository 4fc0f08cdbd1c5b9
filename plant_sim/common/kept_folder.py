"""Folder of the files of one run, which remains within limits of age and size."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from filelock import FileLock

from controller.common.errors import InputError
from controller.common.files.new_files import NewFiles

FORM: Final = "%Y%m%dT%H%M%SZ"
"""Form of a name: the time of the start, UTC, in the basic format of ISO 8601."""
LOCK: Final = "run.lock"
"""File of a folder that is locked while its run uses it; the operating system unlocks it if the run is killed."""
_NAME: Final = re.compile(r"(\d{8}T\d{6}Z)(-\d+)?")


class KeptFolder:
    """New folder of one run, for use in a `with` block; it is removed at the end if nothing was recorded in it.

    Attributes:
        path: The folder.
    """

    def __init__(
        self,
        parent: Path,
        *,
        record: str,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        limit_days: int,
        limit_bytes: int,
    ) -> None:
        """Create the folder, and delete those of earlier runs beyond the limits.

        First the folders that are older than the limit are deleted, then the oldest ones while all of them take more
        bytes than the limit; of these the newest one remains in any case. The folder of a run that is still going on,
        and a folder with a name of another form, are neither counted nor deleted.

        Args:
            parent: Folder of the folders of all runs; it is created if missing.
            record: Name of the file for which the folder is kept.
            now: Clock with the time zone UTC.
            limit_days: Age from which a folder is deleted, days.
            limit_bytes: Total size of the folders of earlier runs, bytes.

        Raises:
            InputError: The folder cannot be created.
        """
        self._record = record
        start = now()
        name = start.strftime(FORM)
        self._new = NewFiles([parent / name / record])
        try:
            parent.mkdir(parents=True, exist_ok=True)
            self.path = _new_folder(parent, name)
        except OSError as error:
            self._new.remove()
            raise InputError(
                f"{parent}: the history cannot be kept here ({error.strerror}); start in a writable folder"
            ) from None
        self._lock = FileLock(self.path / LOCK, timeout=0)
        self._lock.acquire()
        _delete(parent, start - timedelta(days=limit_days), limit_bytes)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._lock.release()
        (self.path / LOCK).unlink(missing_ok=True)
        if not (self.path / self._record).exists():
            shutil.rmtree(self.path, ignore_errors=True)
            self._new.remove()


def _new_folder(parent: Path, name: str) -> Path:
    """Create a folder that no other run has."""
    number = 1
    while True:
        path = parent / (name if number == 1 else f"{name}-{number}")
        try:
            path.mkdir()
        except FileExistsError:
            number += 1
        else:
            return path


def _delete(parent: Path, oldest: datetime, limit_bytes: int) -> None:
    """Delete the folders of ended runs that are beyond the limits; one that cannot be deleted is left."""
    taken = 0
    for newer, (start, folder) in enumerate(sorted(_ended(parent), reverse=True)):
        with suppress(OSError):  # another start deletes it too
            taken += sum(file.stat().st_size for file in folder.iterdir())
        if start < oldest or (newer and taken > limit_bytes):
            shutil.rmtree(folder, ignore_errors=True)


def _ended(parent: Path) -> list[tuple[datetime, Path]]:
    """Return the start and the folder of each run that has ended."""
    ended = []
    for folder in parent.iterdir():
        if not (match := _NAME.fullmatch(folder.name)) or folder.is_symlink() or not folder.is_dir():
            continue
        with suppress(OSError, ValueError), FileLock(folder / LOCK, timeout=0):  # a Timeout is an OSError
            ended.append((datetime.strptime(match[1], FORM).replace(tzinfo=UTC), folder))
    return ended
