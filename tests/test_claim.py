"""A file is one process's, and lies in a folder that somebody wanted."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.core.claim import ClaimError, claim


def test_the_folder_of_the_file_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for path in (Path("var/retentive.json"), tmp_path / "other" / "retentive.json", Path("retentive.json")):
        with claim(path):
            assert path.parent.is_dir()


def test_a_folder_that_is_not_there_holds_no_file(tmp_path: Path) -> None:
    """A mistyped place would begin with an empty memory, and nobody would know why."""
    with pytest.raises(ClaimError, match=f"there is no folder {tmp_path}/typo; make it, or name another file"):
        claim(tmp_path / "typo" / "var" / "retentive.json")
    assert list(tmp_path.iterdir()) == []


def test_only_one_has_the_file(tmp_path: Path) -> None:
    path = tmp_path / "retentive.json"
    with claim(path), pytest.raises(ClaimError, match="another controller is using it"):
        claim(path)
    claim(path).close()
