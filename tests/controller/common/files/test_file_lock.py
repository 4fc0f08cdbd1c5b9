"""File locks: one process per file; only the folder that contains the file is created."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from controller.common.files.lock import FileLockError, lock_file


def test_the_folder_of_the_file_is_created(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for path in (Path("var/retentive.json"), tmp_path / "other" / "retentive.json", Path("retentive.json")):
        lock = lock_file(path)
        assert path.parent.is_dir()
        lock.release()


def test_a_missing_folder_above_is_rejected(tmp_path: Path) -> None:
    """A path with two missing folders is rejected; otherwise a typo would start the controller with empty memory."""
    with pytest.raises(FileLockError, match=f"folder {tmp_path}/typo does not exist; create it or choose another file"):
        lock_file(tmp_path / "typo" / "var" / "retentive.json")
    assert list(tmp_path.iterdir()) == []


def test_a_locked_file_cannot_be_locked_again(tmp_path: Path) -> None:
    path = tmp_path / "retentive.json"
    lock = lock_file(path)
    with pytest.raises(FileLockError, match="in use by another controller"):
        lock_file(path)
    lock.release()
    lock_file(path).release()


def test_a_lock_is_released_by_another_thread(tmp_path: Path) -> None:
    path = tmp_path / "retentive.json"
    lock = lock_file(path)
    thread = threading.Thread(target=lock.release)
    thread.start()
    thread.join()
    lock_file(path).release()


def test_a_path_that_cannot_be_locked_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(FileLockError, match="is a folder, not a file"):
        lock_file(tmp_path)
    (tmp_path / "file").touch()
    with pytest.raises(FileLockError, match="choose a writable file"):
        lock_file(tmp_path / "file" / "retentive.json")
