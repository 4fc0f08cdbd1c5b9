"""Folders of runs that remain: a name of their own, limits of age and size, and nothing after a failed start."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import pytest

from controller.common.errors import InputError
from plant_sim.common.kept_folder import KeptFolder

RECORD: Final = "history.sqlite"
BYTES: Final = 400
"""Size of the record of a run."""
START: Final = datetime(2026, 3, 31, 23, 59, 58, tzinfo=UTC)


def kept(parent: Path, *, days: float = 0, limit_days: int = 90, limit_bytes: int = 10_000) -> KeptFolder:
    """Return the folder of a run that starts some days after the first one."""
    return KeptFolder(
        parent,
        record=RECORD,
        now=lambda: START + timedelta(days=days),
        limit_days=limit_days,
        limit_bytes=limit_bytes,
    )


def recorded(parent: Path, days: float, size: int = BYTES) -> Path:
    """Return the folder of a run that has ended."""
    with kept(parent, days=days) as folder:
        (folder.path / RECORD).write_bytes(bytes(size))
    return folder.path


def test_two_runs_never_share_a_folder(tmp_path: Path) -> None:
    parent = tmp_path / "var/trials"
    with kept(parent) as one, kept(parent) as two:
        for folder in (one, two):
            (folder.path / RECORD).touch()
    assert (one.path.name, two.path.name) == ("20260331T235958Z", "20260331T235958Z-2")
    assert sorted(parent.iterdir()) == [one.path, two.path]
    assert [path.name for path in one.path.iterdir()] == [RECORD]


def test_a_run_without_a_record_leaves_nothing(tmp_path: Path) -> None:
    with kept(tmp_path / "var/trials") as folder:
        (folder.path / "constants.yaml").touch()
    assert list(tmp_path.iterdir()) == []


def test_folders_beyond_the_age_are_deleted(tmp_path: Path) -> None:
    old, young = recorded(tmp_path, 0), recorded(tmp_path, 1)
    with kept(tmp_path, days=90) as last:
        assert sorted(tmp_path.iterdir()) == [old, young, last.path]
    with kept(tmp_path, days=90.5) as last:
        assert sorted(tmp_path.iterdir()) == [young, last.path]


def test_the_oldest_folders_are_deleted_while_all_take_too_much(tmp_path: Path) -> None:
    first, second, third = (recorded(tmp_path, days) for days in range(3))
    with kept(tmp_path, days=3, limit_bytes=3 * BYTES):
        assert first.exists()
    with kept(tmp_path, days=3, limit_bytes=3 * BYTES - 1):
        assert [path.exists() for path in (first, second, third)] == [False, True, True]


def test_the_newest_folder_remains_at_any_size(tmp_path: Path) -> None:
    older, newest = recorded(tmp_path, 0, 1), recorded(tmp_path, 1)
    with kept(tmp_path, days=2, limit_bytes=BYTES - 1):
        assert [path.exists() for path in (older, newest)] == [False, True]


def test_the_folder_of_a_run_that_goes_on_is_neither_deleted_nor_counted(tmp_path: Path) -> None:
    with kept(tmp_path) as running:
        (running.path / RECORD).write_bytes(bytes(BYTES))
        ended = recorded(tmp_path, 1)
        newest = recorded(tmp_path, 2)
        with kept(tmp_path, days=2, limit_days=1, limit_bytes=2 * BYTES):
            assert all(path.exists() for path in (running.path, ended, newest))
    with kept(tmp_path, days=3, limit_days=1, limit_bytes=2 * BYTES):
        assert [path.exists() for path in (running.path, ended, newest)] == [False, False, True]


@pytest.mark.parametrize("name", ["mine", "20260331", "20260331T235958Z-b", "x20260331T235958Z", "20269931T235958Z"])
def test_only_folders_of_runs_are_deleted(tmp_path: Path, name: str) -> None:
    """Also the target of a link with the name of a run remains."""
    parent, target = tmp_path / "trials", tmp_path / "target"
    for folder in (parent / name, target):
        folder.mkdir(parents=True)
        (folder / RECORD).write_bytes(bytes(BYTES))
    (parent / "20260101T000000Z").symlink_to(target)
    with kept(parent, days=500, limit_bytes=0):
        assert (parent / name / RECORD).exists()
        assert [path.name for path in target.iterdir()] == [RECORD]


def test_a_place_that_cannot_be_written_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "var").touch()
    with pytest.raises(InputError, match=r"/var/trials: the history cannot be kept here \(Not a directory\); start in"):
        kept(tmp_path / "var/trials")
    with pytest.raises(InputError, match="File name too long"):
        kept(tmp_path / "new" / ("n" * 300))
    assert [path.name for path in tmp_path.iterdir()] == ["var"]
